//! Tar files in memory: POSIX ustar headers of regular files, as WebDataset reads them. Their bytes depend on names and content alone.

const BLOCK: usize = 512;
/// Longest name.
const MAX_NAME: usize = 100;

/// A tar file that is being made.
#[derive(Default)]
pub(super) struct Tar(Vec<u8>);

impl Tar {
    /// Appends a file.
    pub fn add(&mut self, name: &str, content: &[u8]) {
        assert!(name.len() <= MAX_NAME, "{name}: names are keys and endings");
        let mut header = [0; BLOCK];
        let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
        put(0, name.as_bytes());
        put(100, b"0000644\0");
        put(108, b"0000000\0");
        put(116, b"0000000\0");
        put(124, format!("{:011o}\0", content.len()).as_bytes());
        put(136, b"00000000000\0");
        // The checksum is that of a header with blanks in its place.
        put(148, b"        ");
        put(156, b"0");
        put(257, b"ustar\x0000");
        let sum: u32 = header.iter().map(|b| u32::from(*b)).sum();
        header[148..156].copy_from_slice(format!("{sum:06o}\0 ").as_bytes());
        self.0.extend(header);
        self.0.extend(content);
        self.0.resize(self.0.len().next_multiple_of(BLOCK), 0);
    }

    /// The file, with the two empty blocks of its end.
    pub fn finish(mut self) -> Vec<u8> {
        self.0.resize(self.0.len() + 2 * BLOCK, 0);
        self.0
    }
}

/// Names and contents of the files of a tar file that [`Tar`] made; none if it is another one or damaged.
pub(super) fn entries(mut bytes: &[u8]) -> Option<Vec<(&str, &[u8])>> {
    let mut found = Vec::new();
    loop {
        let (header, rest) = bytes.split_at_checked(BLOCK)?;
        if header.iter().all(|b| *b == 0) {
            return (rest.len() == BLOCK && rest.iter().all(|b| *b == 0)).then_some(found);
        }
        let text = |range: std::ops::Range<usize>| {
            let field = &header[range];
            let end = field.iter().position(|b| *b == 0).unwrap_or(field.len());
            std::str::from_utf8(&field[..end]).ok()
        };
        let length = usize::from_str_radix(text(124..136)?, 8).ok()?;
        let sum = u32::from_str_radix(text(148..154)?, 8).ok()?;
        let actual = header.iter().enumerate().map(|(i, b)| match i {
            148..156 => u32::from(b' '),
            _ => u32::from(*b),
        });
        if actual.sum::<u32>() != sum {
            return None;
        }
        let content = rest.get(..length)?;
        found.push((text(0..MAX_NAME)?, content));
        bytes = rest.get(length.next_multiple_of(BLOCK)..)?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_found_again_and_damage_is_seen() {
        let mut tar = Tar::default();
        tar.add("000000001.film.png", b"picture");
        tar.add("000000001.json", &[b'x'; 512]);
        let bytes = tar.finish();
        assert_eq!(bytes.len(), 512 * (2 + 2 + 2));
        let found = entries(&bytes).unwrap();
        assert_eq!(found, [("000000001.film.png", &b"picture"[..]), ("000000001.json", &[b'x'; 512][..])]);
        assert_eq!(entries(&bytes[..1500]), None);
        let mut damaged = bytes.clone();
        damaged[3] ^= 1;
        assert_eq!(entries(&damaged), None);
    }
}
