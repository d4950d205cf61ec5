//! Images of FITS files (FITS Standard 4.0, 2018): primary data and IMAGE extensions.
//!
//! A header is cards of 80 characters in blocks of 2880 bytes up to END; data follow in blocks of 2880 bytes, big-endian,
//! NAXIS1 fastest:
//!
//! ```text
//! bytes = |BITPIX|/8 · GCOUNT · (PCOUNT + NAXIS1·NAXIS2·…)          value = BZERO + BSCALE · sample
//! ```
//! Read: BITPIX 8 (unsigned), 16, 32, −32, −64, up to four axes. Tables are skipped, compressed images among them; random
//! groups are an error.

use crate::import::npy::Npy;
use crate::import::{MAX_ARRAY_BYTES, MAX_COUNT};

const BLOCK: usize = 2880;
const CARD: usize = 80;
/// Maximum blocks of a header.
const MAX_HEADER_BLOCKS: usize = 1000;
const MAX_AXES: usize = 4;

/// Header and data of one unit.
struct Unit<'a> {
    header: Header,
    data: &'a [u8],
}

#[derive(Default)]
struct Header {
    cards: Vec<(String, String)>,
}

/// Image `index` of a file, counted from 0 without units that have no data; without an index the only one.
///
/// # Errors
/// What was found and expected.
pub(super) fn image(bytes: &[u8], index: Option<usize>) -> Result<Npy, String> {
    let (mut rest, mut images) = (bytes, Vec::new());
    for number in 0.. {
        if number > 0 && rest.iter().all(|b| *b == 0) {
            break;
        }
        if number > MAX_COUNT {
            return Err(format!("has more than {MAX_COUNT} units"));
        }
        let (unit, behind) = unit(rest, number)?;
        if unit.header.is_image(number) && !unit.data.is_empty() {
            images.push(unit);
        }
        rest = behind;
    }
    let index = match index {
        None if images.len() > 1 => {
            return Err(format!("has {} images, expected 1; name one by FILE:0", images.len()));
        }
        index => index.unwrap_or(0),
    };
    match images.get(index) {
        Some(unit) => decode(unit),
        None => Err(format!(
            "has {} images, expected image {index}; compressed images and tables are not read",
            images.len()
        )),
    }
}

/// The unit at the start of `bytes`, and the bytes behind it.
fn unit(bytes: &[u8], number: usize) -> Result<(Unit<'_>, &[u8]), String> {
    let header = Header::parse(bytes, number)?;
    let blocks = header.1;
    let header = header.0;
    let size = header.bytes()?;
    let behind = &bytes[blocks * BLOCK..];
    let Some(data) = usize::try_from(size).ok().and_then(|size| behind.get(..size)) else {
        return Err(format!(
            "holds {} bytes of data in unit {number}, expected {size}; is the file cut short?",
            behind.len()
        ));
    };
    let padded = data.len().next_multiple_of(BLOCK).min(behind.len());
    Ok((Unit { header, data }, &behind[padded..]))
}

impl Header {
    /// The header at the start of `bytes`, and its blocks.
    fn parse(bytes: &[u8], number: usize) -> Result<(Self, usize), String> {
        let mut header = Self::default();
        for (b, block) in bytes.chunks_exact(BLOCK).take(MAX_HEADER_BLOCKS).enumerate() {
            for card in block.chunks_exact(CARD) {
                let Ok(card) = std::str::from_utf8(card) else {
                    return Err(format!("has a header that is not text in unit {number}"));
                };
                let Some((key, value)) = card.split_at_checked(8) else { continue };
                if key == "END     " {
                    return header.with_start(number).map(|header| (header, b + 1));
                }
                if let Some(value) = value.strip_prefix("= ") {
                    header.cards.push((key.trim_end().to_owned(), plain(value).to_owned()));
                }
            }
            header = header.with_start(number)?;
        }
        Err(format!("has no END of the header of unit {number}"))
    }

    /// Itself, if it starts as a header does.
    fn with_start(self, number: usize) -> Result<Self, String> {
        let (key, expected) = if number == 0 { ("SIMPLE", "T") } else { ("XTENSION", "'") };
        match self.cards.first() {
            Some((name, value)) if name == key && value.starts_with(expected) => Ok(self),
            _ => Err(format!(
                "has no card {key} at the start of unit {number}: it is no FITS file, or a damaged one"
            )),
        }
    }

    fn get(&self, key: &str) -> Option<&str> {
        self.cards.iter().find(|(name, _)| name == key).map(|(_, value)| value.as_str())
    }

    /// An integer; absent: `default`, or an error.
    fn integer(&self, key: &str, default: Option<i64>) -> Result<i64, String> {
        match self.get(key) {
            None => default.ok_or_else(|| format!("has no card {key}")),
            Some(text) => text.parse().map_err(|_| format!("has {key} = {text}, expected an integer")),
        }
    }

    /// A number; absent: `default`.
    fn number(&self, key: &str, default: f64) -> Result<f64, String> {
        let Some(text) = self.get(key) else { return Ok(default) };
        let number = text.replace(['D', 'd'], "E").parse().ok().filter(|v: &f64| v.is_finite());
        number.ok_or_else(|| format!("has {key} = {text}, expected a number"))
    }

    /// Sizes of the axes, NAXIS1 first.
    fn axes(&self) -> Result<Vec<usize>, String> {
        let count = self.integer("NAXIS", None)?;
        if !(0..=999).contains(&count) {
            return Err(format!("has NAXIS = {count}, expected 0 to 999"));
        }
        let size = |i| {
            let key = format!("NAXIS{i}");
            let size = self.integer(&key, None)?;
            usize::try_from(size).map_err(|_| format!("has {key} = {size}, expected a size"))
        };
        (1..=count).map(size).collect()
    }

    fn is_image(&self, number: usize) -> bool {
        number == 0 || self.get("XTENSION").is_some_and(|t| t.trim_matches(['\'', ' ']) == "IMAGE")
    }

    /// Bytes of the data.
    fn bytes(&self) -> Result<u64, String> {
        let axes = self.axes()?;
        if self.get("GROUPS") == Some("T") {
            return Err("has random groups (GROUPS = T), which are not read; expected images".into());
        }
        let bits = self.integer("BITPIX", None)?;
        if ![8, 16, 32, 64, -32, -64].contains(&bits) {
            return Err(format!("has BITPIX = {bits}, expected 8, 16, 32, -32 or -64"));
        }
        let (heap, groups) = (self.integer("PCOUNT", Some(0))?, self.integer("GCOUNT", Some(1))?);
        let samples = axes.iter().try_fold(u64::from(!axes.is_empty()), |n, a| n.checked_mul(*a as u64));
        let bytes = samples
            .zip(u64::try_from(heap).ok())
            .and_then(|(n, heap)| n.checked_add(heap))
            .zip(u64::try_from(groups).ok())
            .and_then(|(n, groups)| n.checked_mul(groups))
            .and_then(|n| n.checked_mul(bits.unsigned_abs() / 8));
        bytes.ok_or_else(|| format!("declares axes {axes:?}, more than a file holds"))
    }
}

/// The value of a card without its comment.
fn plain(value: &str) -> &str {
    let value = value.trim_start();
    match value.strip_prefix('\'') {
        Some(text) => text.find('\'').map_or(value, |end| &value[..end + 2]),
        None => value.split('/').next().unwrap_or("").trim_end(),
    }
}

fn decode(unit: &Unit<'_>) -> Result<Npy, String> {
    let (header, data) = (&unit.header, unit.data);
    let mut shape = header.axes()?;
    shape.reverse();
    if shape.len() > MAX_AXES {
        return Err(format!("has {} axes, expected at most {MAX_AXES}", shape.len()));
    }
    if header.integer("PCOUNT", Some(0))? != 0 || header.integer("GCOUNT", Some(1))? != 1 {
        return Err("has PCOUNT or GCOUNT, expected an image without them".into());
    }
    if data.len() as u64 > MAX_ARRAY_BYTES {
        return Err(format!("has {} bytes of samples, more than {MAX_ARRAY_BYTES}", data.len()));
    }
    let bits = header.integer("BITPIX", None)?;
    let mut values: Vec<f64> = match bits {
        8 => data.iter().map(|b| f64::from(*b)).collect(),
        16 => samples(data, |b| f64::from(i16::from_be_bytes(b))),
        32 => samples(data, |b| f64::from(i32::from_be_bytes(b))),
        -32 => samples(data, |b| f64::from(f32::from_be_bytes(b))),
        -64 => samples(data, f64::from_be_bytes),
        _ => return Err(format!("has BITPIX = {bits}, expected 8, 16, 32, -32 or -64")),
    };
    let (zero, scale) = (header.number("BZERO", 0.0)?, header.number("BSCALE", 1.0)?);
    if header.get("BLANK").is_some() && bits > 0 {
        let blank = header.integer("BLANK", None)? as f64;
        values.iter_mut().filter(|v| **v == blank).for_each(|v| *v = f64::NAN);
    }
    if (zero, scale) != (0.0, 1.0) {
        values.iter_mut().for_each(|v| *v = zero + scale * *v);
    }
    Ok(Npy { shape, single: bits == -32, values })
}

fn samples<const N: usize>(data: &[u8], of: impl Fn([u8; N]) -> f64) -> Vec<f64> {
    data.as_chunks::<N>().0.iter().map(|b| of(*b)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A unit: its cards, padded, and its data, padded.
    fn unit_bytes(cards: &[&str], data: &[u8]) -> Vec<u8> {
        let mut bytes: Vec<u8> =
            cards.iter().chain(&["END"]).flat_map(|c| format!("{c:80}").into_bytes()).collect();
        bytes.resize(bytes.len().next_multiple_of(BLOCK), b' ');
        bytes.extend(data);
        bytes.resize(bytes.len().next_multiple_of(BLOCK), 0);
        bytes
    }

    fn primary(bits: &str, more: &[&str], data: &[u8]) -> Vec<u8> {
        let bits = format!("BITPIX  = {bits:>20} / bits");
        let cards = [
            "SIMPLE  =                    T",
            &bits,
            "NAXIS   =                    2",
            "NAXIS1  =                    3",
            "NAXIS2  =                    2",
        ];
        unit_bytes(&[&cards[..], more].concat(), data)
    }

    #[test]
    fn samples_of_each_type_are_big_endian_with_the_first_axis_fastest() {
        let expected = vec![1.0, -2.0, 3.0, 4.0, 5.0, -6.0];
        let bytes = |of: &dyn Fn(f64) -> Vec<u8>| expected.iter().flat_map(|v| of(*v)).collect::<Vec<u8>>();
        for (bits, data) in [
            ("16", bytes(&|v| (v as i16).to_be_bytes().to_vec())),
            ("32", bytes(&|v| (v as i32).to_be_bytes().to_vec())),
            ("-32", bytes(&|v| (v as f32).to_be_bytes().to_vec())),
            ("-64", bytes(&|v| v.to_be_bytes().to_vec())),
        ] {
            let read = image(&primary(bits, &[], &data), None).unwrap();
            assert_eq!((read.shape, read.values), (vec![2, 3], expected.clone()), "{bits}");
        }
        // Unsigned 16 bits, by the convention of BZERO.
        let data: Vec<u8> = [-32768i16, 32767, 0, 1, 2, 3].iter().flat_map(|v| v.to_be_bytes()).collect();
        let read = image(
            &primary("16", &["BZERO   =              32768.0", "BSCALE  =                1.0D0"], &data),
            None,
        );
        assert_eq!(read.unwrap().values, [0.0, 65535.0, 32768.0, 32769.0, 32770.0, 32771.0]);
    }

    #[test]
    fn images_are_counted_without_tables_and_units_of_no_data() {
        let empty = unit_bytes(
            &[
                "SIMPLE  =                    T",
                "BITPIX  =                    8",
                "NAXIS   =                    0",
            ],
            &[],
        );
        let table = unit_bytes(
            &[
                "XTENSION= 'BINTABLE'",
                "BITPIX  =                    8",
                "NAXIS   =                    2",
                "NAXIS1  =                    4",
                "NAXIS2  =                    1",
                "PCOUNT  =                    3",
                "GCOUNT  =                    1",
            ],
            &[9; 7],
        );
        let extension = |v: u8| {
            unit_bytes(
                &[
                    "XTENSION= 'IMAGE   '           / image",
                    "BITPIX  =                    8",
                    "NAXIS   =                    1",
                    "NAXIS1  =                    2",
                ],
                &[v, v],
            )
        };
        let file = [empty.clone(), extension(1), table.clone(), extension(2)].concat();
        assert_eq!(image(&file, Some(1)).unwrap().values, [2.0, 2.0]);
        assert!(image(&file, None).unwrap_err().contains("has 2 images, expected 1"));
        assert!(image(&file, Some(2)).unwrap_err().contains("expected image 2"));
        assert!(image(&[empty, table].concat(), None).unwrap_err().contains("has 0 images"));
    }

    #[test]
    fn other_units_and_damage_are_named() {
        let error = |bytes: &[u8]| image(bytes, None).unwrap_err();
        assert!(error(b"BM").contains("no END") && error(&[b' '; 2880]).contains("no card SIMPLE"));
        assert!(error(&primary("64", &[], &[0; 48])).contains("BITPIX = 64, expected 8, 16, 32, -32 or -64"));
        assert!(error(&primary("12", &[], &[0; 48])).contains("BITPIX = 12"));
        assert!(
            error(&primary("-64", &["GROUPS  =                    T"], &[0; 48])).contains("random groups")
        );
        assert!(
            error(&primary("-64", &[], &[0; 48])[..2880 + 40])
                .contains("holds 40 bytes of data in unit 0, expected 48")
        );
        let huge = primary("-64", &[], &[]);
        let huge = String::from_utf8(huge)
            .unwrap()
            .replace("NAXIS1  =                    3", "NAXIS1  =  9223372036854775807");
        assert!(error(huge.as_bytes()).contains("declares axes"));
        // Blank samples of integers are not numbers.
        let blank = primary("16", &["BLANK   =                    7"], &[0, 7, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1]);
        assert!(image(&blank, None).unwrap().values[0].is_nan());
    }
}
