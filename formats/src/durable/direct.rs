//! Writing past the page cache: what is written once and not read back need not be copied there first.
//!
//! The aligned part of a large file goes to the disk with `O_DIRECT`, from a buffer aligned to pages; what is left, less
//! than a page, and files of file systems that know no direct writes go through the cache. The file holds the same bytes
//! either way, and neither way counts before `fsync`.

use std::fs::File;
use std::io::{Result, Write};

/// Addresses, offsets and lengths of direct writes: pages, a multiple of every disk's sector.
const ALIGNED: usize = 4096;
/// Bytes of one direct write.
const AT_ONCE: usize = 4 << 20;
/// Below this the page cache is as fast.
const LEAST: usize = 1 << 20;

/// Writes all of `bytes` into `file`, which is new.
pub(super) fn write_all(file: &mut File, bytes: &[u8]) -> Result<()> {
    let mut done = 0;
    if bytes.len() >= LEAST && direct(file, true).is_ok() {
        let written = whole_pages(file, bytes);
        direct(file, false)?;
        done = written?;
    }
    file.write_all(&bytes[done..])
}

/// Writes as much as whole pages hold; less where the file system takes less, or refuses.
fn whole_pages(file: &mut File, bytes: &[u8]) -> Result<usize> {
    let mut room = vec![0u8; AT_ONCE + ALIGNED];
    let start = room.as_ptr().align_offset(ALIGNED);
    let room = &mut room[start..start + AT_ONCE];
    let mut done = 0;
    for part in bytes[..bytes.len() / ALIGNED * ALIGNED].chunks(AT_ONCE) {
        room[..part.len()].copy_from_slice(part);
        let written = match file.write(&room[..part.len()]) {
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
fn direct(file: &File, on: bool) -> Result<()> {
    use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
    let mut flags = fcntl_getfl(file)?;
    flags.set(OFlags::DIRECT, on);
    Ok(fcntl_setfl(file, flags)?)
}

#[cfg(not(target_os = "linux"))]
fn direct(_: &File, on: bool) -> Result<()> {
    if on { Err(std::io::ErrorKind::Unsupported.into()) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_length_arrives_whole() {
        let directory = tempfile::tempdir().unwrap();
        let bytes: Vec<u8> = (0..AT_ONCE + LEAST + 4321).map(|i| (i * 7 % 251) as u8).collect();
        let lengths = [0, 1, LEAST - 1, LEAST, LEAST + 1, AT_ONCE, AT_ONCE + ALIGNED + 1, bytes.len()];
        for n in lengths {
            let path = directory.path().join(n.to_string());
            let mut file = File::create_new(&path).unwrap();
            write_all(&mut file, &bytes[..n]).unwrap();
            drop(file);
            assert!(std::fs::read(&path).unwrap() == bytes[..n], "{n} bytes");
        }
    }
}
