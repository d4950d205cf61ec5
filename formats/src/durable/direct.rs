//! Reading and writing with `O_DIRECT`: bytes that are used once are not copied into the page cache.
//!
//! The aligned part of a large file is written directly, from a page-aligned buffer; the rest, less than a page, and files on file systems
//! without direct writes go through the cache. The file has the same bytes either way, and is durable only after `fsync`. Reads include the
//! pages at both ends of the range, into a page-aligned buffer; file systems without direct reads read through the cache.

use std::fs::File;
use std::io::{ErrorKind, Result, Write};
use std::ops::{Deref, Range};
use std::os::unix::fs::FileExt;

/// Alignment in bytes of addresses, offsets and lengths of direct writes: a page, a multiple of every disk's sector.
const ALIGNMENT: usize = 4096;
/// Bytes of one direct write.
const WRITE_BYTES: usize = 4 << 20;
/// Minimum file size for direct writes; below it the page cache is as fast.
const MIN_BYTES: usize = 1 << 20;

/// Writes all of `bytes` into `file`, which is new.
pub(super) fn write_all(file: &mut File, bytes: &[u8]) -> Result<()> {
    let mut done = 0;
    if bytes.len() >= MIN_BYTES && set_direct(file, true).is_ok() {
        let written = write_pages(file, bytes);
        set_direct(file, false)?;
        done = written?;
    }
    file.write_all(&bytes[done..])
}

/// Writes the complete pages of `bytes` and returns the number of bytes written, less if the file system writes less or rejects direct
/// writes.
fn write_pages(file: &mut File, bytes: &[u8]) -> Result<usize> {
    let mut buffer = vec![0u8; WRITE_BYTES + ALIGNMENT];
    let start = buffer.as_ptr().align_offset(ALIGNMENT);
    let buffer = &mut buffer[start..start + WRITE_BYTES];
    let mut done = 0;
    for part in bytes[..bytes.len() / ALIGNMENT * ALIGNMENT].chunks(WRITE_BYTES) {
        buffer[..part.len()].copy_from_slice(part);
        let written = match file.write(&buffer[..part.len()]) {
            Err(e) if done == 0 && e.kind() == ErrorKind::InvalidInput => 0,
            other => other?,
        };
        done += written;
        if written < part.len() {
            break;
        }
    }
    Ok(done)
}

/// Bytes of a file: a part of a buffer, which may begin and end with other bytes of the same pages.
#[derive(Clone, Debug)]
pub struct FileBytes {
    buffer: Vec<u8>,
    range: Range<usize>,
}

impl From<Vec<u8>> for FileBytes {
    fn from(buffer: Vec<u8>) -> Self {
        let range = 0..buffer.len();
        Self { buffer, range }
    }
}

impl Deref for FileBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.buffer[self.range.clone()]
    }
}

/// Reads `length` bytes from `offset` of `file`, which holds them.
pub(super) fn read_exact(file: &File, offset: u64, length: usize) -> Result<FileBytes> {
    let first = offset / ALIGNMENT as u64 * ALIGNMENT as u64;
    let skipped = (offset - first) as usize;
    let pages = (skipped + length).next_multiple_of(ALIGNMENT);
    let mut buffer = vec![0; pages + ALIGNMENT];
    let start = buffer.as_ptr().align_offset(ALIGNMENT);
    let mut is_direct = set_direct(file, true).is_ok();
    let mut done = 0;
    while done < skipped + length {
        match file.read_at(&mut buffer[start + done..start + pages], first + done as u64) {
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Ok(n) => done += n,
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            // The file system has no direct reads, or none from the middle of a page.
            Err(e) if is_direct && e.kind() == ErrorKind::InvalidInput => {
                set_direct(file, false)?;
                is_direct = false;
            }
            Err(e) => return Err(e),
        }
    }
    Ok(FileBytes { buffer, range: start + skipped..start + skipped + length })
}

#[cfg(target_os = "linux")]
fn set_direct(file: &File, on: bool) -> Result<()> {
    use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
    let mut flags = fcntl_getfl(file)?;
    flags.set(OFlags::DIRECT, on);
    Ok(fcntl_setfl(file, flags)?)
}

#[cfg(not(target_os = "linux"))]
fn set_direct(_: &File, on: bool) -> Result<()> {
    if on { Err(std::io::ErrorKind::Unsupported.into()) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_range_is_read() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("data");
        let bytes: Vec<u8> = (0..5 * ALIGNMENT + 123).map(|i| (i * 7 % 251) as u8).collect();
        std::fs::write(&path, &bytes).unwrap();
        let file = File::open(&path).unwrap();
        let edges = [0, 1, 4095, 4096, 4097, 8192, 10_000, 20_480, 20_481, bytes.len()];
        for (from, to) in
            edges.iter().flat_map(|a| edges.iter().map(move |b| (*a, *b))).filter(|(a, b)| a <= b)
        {
            let read = read_exact(&file, from as u64, to - from).unwrap();
            assert!(read[..] == bytes[from..to], "{from}..{to}");
        }
        let beyond = read_exact(&file, 0, bytes.len() + 1);
        assert_eq!(beyond.unwrap_err().kind(), ErrorKind::UnexpectedEof);
    }

    #[test]
    fn every_length_is_written_completely() {
        let directory = tempfile::tempdir().unwrap();
        let bytes: Vec<u8> = (0..WRITE_BYTES + MIN_BYTES + 4321).map(|i| (i * 7 % 251) as u8).collect();
        let lengths = [
            0,
            1,
            MIN_BYTES - 1,
            MIN_BYTES,
            MIN_BYTES + 1,
            WRITE_BYTES,
            WRITE_BYTES + ALIGNMENT + 1,
            bytes.len(),
        ];
        for n in lengths {
            let path = directory.path().join(n.to_string());
            let mut file = File::create_new(&path).unwrap();
            write_all(&mut file, &bytes[..n]).unwrap();
            drop(file);
            assert!(std::fs::read(&path).unwrap() == bytes[..n], "{n} bytes");
        }
    }
}
