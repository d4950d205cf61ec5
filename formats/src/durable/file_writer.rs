//! Writing into a file in order, for encoders: the error of the operating system is kept, since some encoders report it as a text.

use std::fs::File;
use std::io::{Error, Result, Seek, SeekFrom, Write};
use std::path::Path;

use super::error::DurableError;
use super::fault;

/// A writer into an open file.
#[derive(Debug)]
pub struct FileWriter<'a> {
    file: &'a File,
    /// Number of the first error of the operating system.
    failed: Option<i32>,
}

impl<'a> FileWriter<'a> {
    pub(super) fn new(file: &'a File) -> Self {
        Self { file, failed: None }
    }

    /// The first error of a write into the file `path`, whatever the encoder made of it.
    pub fn error(&self, path: &Path) -> Option<DurableError> {
        self.failed.map(|errno| DurableError::io("write", path, 0, Error::from_raw_os_error(errno)))
    }
}

impl Write for FileWriter<'_> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        let mut file = self.file;
        let written = fault::write(bytes, &mut |bytes| file.write_all(bytes));
        written.map(|()| bytes.len()).inspect_err(|e| self.failed = self.failed.or(e.raw_os_error()))
    }

    fn flush(&mut self) -> Result<()> {
        Ok(())
    }
}

impl Seek for FileWriter<'_> {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        let mut file = self.file;
        file.seek(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg_attr(not(target_os = "linux"), ignore = "unavailable: no /dev/full")]
    fn error_of_the_system_outlives_an_encoder_that_makes_a_text_of_it() {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let mut writer = FileWriter::new(&full);
        assert!(writer.error(Path::new("a.png")).is_none());
        let mut encoder = ::png::Encoder::new(&mut writer, 4, 4);
        encoder.set_color(::png::ColorType::Grayscale);
        assert!(encoder.write_header().is_err());
        let error = writer.error(Path::new("a.png")).unwrap();
        assert!(error.is_storage_full() && error.to_string().contains("a.png"), "{error}");
    }
}
