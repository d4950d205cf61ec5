//! Writing with `O_DIRECT`: bytes that are written once and not read back are not copied into the page cache.
//!
//! The aligned part of a large file is written directly, from a page-aligned buffer; the rest, less than a page, and files on file systems
//! without direct writes go through the cache. The file has the same bytes either way, and is durable only after `fsync`.

use std::fs::File;
use std::io::{Result, Write};

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
            Err(e) if done == 0 && e.kind() == std::io::ErrorKind::InvalidInput => 0,
            other => other?,
        };
        done += written;
        if written < part.len() {
            break;
        }
    }
    Ok(done)
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
