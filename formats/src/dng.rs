//! DNG: raws of cameras are read ([`CameraRaw`]); a frame of a raw is written as DNG 1.4, a classic TIFF of 16-bit uncompressed strips.
//!
//! Mosaic as CFA (Bayer and quad patterns of R, G, B), a monochrome raw as LinearRaw. Colour matrices (XYZ to the camera, illuminants A and
//! D65), neutral and noise profile are those of the sensor's own description, not estimates:
//!
//!   variance = S·x + O of x = (raw − black)/W,   S = g·K/W,   O = (σ_dark² + 1/12)/W²,   W = white − black
//!
//! Stored numbers of companding converters become linear by the LinearizationTable; black, white and noise are those of linear numbers.
//! Shading by the angle of incidence is undone by gain maps ([`GainMaps`]).
//! A reader that applies ColorMatrix2 to a frame of D65 has the matrix of [`pipeline::develop`]. Source: Adobe, Digital Negative
//! Specification 1.4.0.0 (2012); TIFF/EP (ISO 12234-2) for CFARepeatPatternDim, CFAPattern and ExposureTime.

mod error;
mod gain_map;
mod ifd;
mod lossless_jpeg;
mod read;
mod samples;

use std::ops::Range;
use std::path::Path;

pub use error::DngError;
pub use gain_map::GainMaps;
use pipeline::geometry::Size;
pub use read::{CameraRaw, is_dng};

use crate::developed::strips::{Page, Value};
use crate::export::ExportError;
use crate::parallel::Progress;

/// What a DNG says of its pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Dng<'a> {
    /// Size in pixels.
    pub size: Size,
    /// Name of the sensor.
    pub sensor: &'a str,
    /// Colour of each pixel of a period: rows of 0 (red), 1 (green), 2 (blue); `None`: monochrome.
    pub pattern: Option<Vec<Vec<u8>>>,
    /// Linear digital numbers of no light and of saturation.
    pub black_white_dn: (f64, f64),
    /// Colour and noise; of a monochrome raw only the noise is written.
    pub colour: DngColour,
    /// S and O of the noise profile.
    pub noise: (f64, f64),
    /// Exposure time, s.
    pub exposure_s: f64,
    /// ISO speed, if known.
    pub iso: Option<f64>,
    /// Linear number of each stored one, from 0 on; none: they are the same.
    pub linear_dn: Option<Vec<u16>>,
    /// Gains that undo the shading of the sensor's filters.
    pub gain_maps: Option<GainMaps>,
    /// Text for people.
    pub description: &'a str,
}

/// Colour of a DNG.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DngColour {
    /// XYZ to the camera under the illuminants A and D65.
    pub matrices: [[[f64; 3]; 3]; 2],
    /// Values of a white in the frame's light, at most 1.
    pub neutral: [f64; 3],
}

/// Writes a DNG; `make` gives the digital numbers of a strip of rows.
///
/// # Errors
/// [`ExportError`], among them of a frame of 4 GiB or more; or the caller's. No file is created then.
pub fn write_dng<E: From<ExportError> + Send>(
    path: &Path,
    dng: &Dng<'_>,
    (rows, threads): (usize, usize),
    progress: Progress<'_>,
    make: impl Fn(Range<usize>) -> Result<Vec<u16>, E> + Sync,
) -> Result<(), E> {
    let page = Page { path, size: dng.size, samples: (1, 2), rows, threads, tags: tags(dng) };
    if !page.is_classic() {
        return Err(ExportError::Format {
            path: path.into(),
            what: "size of a DNG",
            expected: "less than 4 GiB; write .zarr, or expose windows of the sensor with --roi".into(),
            found: format!("{} pixels", dng.size),
        }
        .into());
    }
    page.write(progress, |rows| Ok(make(rows)?.iter().flat_map(|v| v.to_ne_bytes()).collect()))
}

fn tags(d: &Dng<'_>) -> Vec<(u16, Value)> {
    let planes = if d.pattern.is_some() { 3 } else { 1 };
    let (black, white) = d.black_white_dn;
    let mut tags = vec![
        (254, Value::Long(vec![0])),
        (270, Value::Text(d.description.into())),
        (271, Value::Text("lenscube".into())),
        (272, Value::Text(d.sensor.into())),
        (305, Value::Text(concat!("lenscube ", env!("CARGO_PKG_VERSION")).into())),
        (33434, Value::Rational(vec![d.exposure_s])),
        (50706, Value::Byte(vec![1, 4, 0, 0])),
        (50707, Value::Byte(vec![1, 1, 0, 0])),
        (50708, Value::Text(format!("lenscube {}", d.sensor))),
        (50713, Value::Short(vec![1, 1])),
        (50714, Value::Rational(vec![black])),
        (50717, Value::Long(vec![white as u32])),
        (50730, Value::SignedRational(vec![0.0])),
        (51041, Value::Double([d.noise.0, d.noise.1].repeat(planes))),
    ];
    if let Some(iso) = d.iso.filter(|iso| *iso < 65536.0) {
        tags.push((34855, Value::Short(vec![iso.round() as u16])));
    }
    if let Some(table) = &d.linear_dn {
        tags.push((50712, Value::Short(table.clone())));
    }
    if let Some(maps) = &d.gain_maps {
        tags.push((51009, Value::Opaque(maps.opcodes(d.size))));
    }
    let Some(pattern) = &d.pattern else {
        tags.push((262, Value::Short(vec![34892])));
        return tags;
    };
    let matrix = |m: &[[f64; 3]; 3]| Value::SignedRational(m.as_flattened().to_vec());
    tags.extend([
        (262, Value::Short(vec![32803])),
        (33421, Value::Short(vec![pattern.len() as u16, pattern[0].len() as u16])),
        (33422, Value::Byte(pattern.concat())),
        (50710, Value::Byte(vec![0, 1, 2])),
        (50711, Value::Short(vec![1])),
        (50721, matrix(&d.colour.matrices[0])),
        (50722, matrix(&d.colour.matrices[1])),
        (50728, Value::Rational(d.colour.neutral.to_vec())),
        (50778, Value::Short(vec![17])),
        (50779, Value::Short(vec![21])),
    ]);
    tags
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// Bytes of each tag of the first directory of a classic little-endian TIFF.
    fn tags_of(file: &[u8]) -> BTreeMap<u16, Vec<u8>> {
        let short = |at: usize| u16::from_le_bytes([file[at], file[at + 1]]);
        let long = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&file[..2], short(2)), (&b"II"[..], 42));
        let directory = long(4);
        let entry = |k: usize| {
            let at = directory + 2 + 12 * k;
            let bytes = [0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8][usize::from(short(at + 2))] * long(at + 4);
            let first = if bytes <= 4 { at + 8 } else { long(at + 8) };
            (short(at), file[first..first + bytes].to_vec())
        };
        (0..usize::from(short(directory))).map(entry).collect()
    }

    fn longs(bytes: &[u8]) -> Vec<u32> {
        bytes.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b)).collect()
    }

    fn shorts(bytes: &[u8]) -> Vec<u16> {
        bytes.as_chunks().0.iter().map(|b| u16::from_le_bytes(*b)).collect()
    }

    fn ratios(bytes: &[u8]) -> Vec<f64> {
        longs(bytes).as_chunks::<2>().0.iter().map(|[n, d]| f64::from(*n as i32) / f64::from(*d)).collect()
    }

    fn dng<'a>(size: Size, pattern: Option<Vec<Vec<u8>>>) -> Dng<'a> {
        Dng {
            size,
            sensor: "s",
            pattern,
            black_white_dn: (256.5, 4064.0),
            colour: DngColour {
                matrices: [[[0.5, -0.25, 0.125]; 3], [[1.0, -0.5, 0.0]; 3]],
                neutral: [0.5, 1.0, 0.75],
            },
            noise: (1e-4, 1e-6),
            exposure_s: 1.0 / 64.0,
            iso: Some(200.0),
            linear_dn: None,
            gain_maps: None,
            description: "a film of µm",
        }
    }

    #[test]
    fn gain_maps_are_the_second_list_of_opcodes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.dng");
        let size = Size::new(6, 8);
        let gains: Vec<Vec<f32>> =
            (0..4).map(|k| (0..6).map(|i| 1.0 + (6 * k + i) as f32).collect()).collect();
        let maps = GainMaps { period: (2, 2), points: (2, 3), gains: gains.clone() };
        let dng = Dng { gain_maps: Some(maps), ..dng(size, Some(vec![vec![0, 1], vec![1, 2]])) };
        let make = |rows: Range<usize>| Ok::<_, ExportError>(vec![0; rows.len() * size.width]);
        write_dng(&path, &dng, (16, 1), &|_, _| (), make).unwrap();
        let list = tags_of(&std::fs::read(&path).unwrap()).remove(&51009).unwrap();
        let whole = |at: usize| u32::from_be_bytes(list[at..at + 4].try_into().unwrap());
        let double = |at: usize| f64::from_be_bytes(list[at..at + 8].try_into().unwrap());
        let bytes = 40 + 32 + 4 + 24;
        assert_eq!((whole(0), list.len()), (4, 4 + 4 * (16 + bytes)));
        for (k, gains) in gains.iter().enumerate() {
            let at = 4 + k * (16 + bytes);
            let head: Vec<u32> = (0..14).map(|i| whole(at + 4 * i)).collect();
            let place = [(k / 2) as u32, (k % 2) as u32];
            let expected =
                [&[9, 0x0103_0000, 1, bytes as u32], &place[..], &[6, 8, 0, 1, 2, 2, 2, 3]].concat();
            assert_eq!(head, expected);
            assert_eq!((double(at + 56), double(at + 64), double(at + 72)), (1.0, 0.5, 0.0));
            assert_eq!(whole(at + 88), 1);
            let found: Vec<f32> = (0..6).map(|i| f32::from_bits(whole(at + 92 + 4 * i))).collect();
            assert_eq!(&found, gains);
        }
    }

    #[test]
    fn mosaic_and_tags_are_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.dng");
        let size = Size::new(70, 33);
        let pixels: Vec<u16> = (0..size.pixels()).map(|k| (k * 31 % 4096) as u16).collect();
        for pattern in [Some(vec![vec![0, 1], vec![1, 2]]), None] {
            let make = |rows: Range<usize>| {
                Ok::<_, ExportError>(pixels[rows.start * size.width..rows.end * size.width].to_vec())
            };
            write_dng(&path, &dng(size, pattern.clone()), (16, 2), &|_, _| (), make).unwrap();
            let file = std::fs::read(&path).unwrap();
            let tags = tags_of(&file);
            assert!(!tags.contains_key(&50712));
            let stored: Vec<u16> = std::iter::zip(longs(&tags[&273]), longs(&tags[&279]))
                .flat_map(|(first, n)| shorts(&file[first as usize..(first + n) as usize]))
                .collect();
            assert!(stored == pixels);
            assert_eq!(
                (longs(&tags[&256]), longs(&tags[&257]), shorts(&tags[&258])),
                (vec![33], vec![70], vec![16])
            );
            assert_eq!((ratios(&tags[&50714]), longs(&tags[&50717])), (vec![256.5], vec![4064]));
            assert_eq!((ratios(&tags[&33434]), shorts(&tags[&34855])), (vec![1.0 / 64.0], vec![200]));
            assert_eq!((&tags[&50706][..], &tags[&50708][..]), (&[1, 4, 0, 0][..], &b"lenscube s\0"[..]));
            assert_eq!(tags[&270], b"a film of um\0");
            let planes = if pattern.is_some() { 3 } else { 1 };
            let noise: Vec<f64> = tags[&51041].as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
            assert_eq!(noise, [1e-4, 1e-6].repeat(planes));
            assert_eq!(shorts(&tags[&262]), [if planes == 3 { 32803 } else { 34892 }]);
            assert_eq!(tags.contains_key(&50721), planes == 3);
            if planes == 3 {
                assert_eq!((shorts(&tags[&33421]), &tags[&33422][..]), (vec![2, 2], &[0, 1, 1, 2][..]));
                assert_eq!(ratios(&tags[&50728]), [0.5, 1.0, 0.75]);
                assert_eq!(ratios(&tags[&50721]), [0.5, -0.25, 0.125].repeat(3));
                assert_eq!(ratios(&tags[&50722]), [1.0, -0.5, 0.0].repeat(3));
                assert_eq!((shorts(&tags[&50778]), shorts(&tags[&50779])), (vec![17], vec![21]));
            }
        }
    }

    #[test]
    fn numbers_of_a_companded_frame_have_a_table() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.dng");
        let table: Vec<u16> = (0..16).map(|v| v * v).collect();
        let dng = Dng { linear_dn: Some(table.clone()), ..dng(Size::new(4, 4), None) };
        write_dng(&path, &dng, (4, 1), &|_, _| (), |_| Ok::<_, ExportError>(vec![3; 16])).unwrap();
        assert_eq!(shorts(&tags_of(&std::fs::read(&path).unwrap())[&50712]), table);
    }

    #[test]
    fn frame_of_4_gib_is_an_error() {
        let never = |_| -> Result<Vec<u16>, ExportError> { unreachable!("no strip is made") };
        let dng = dng(Size::new(70_000, 40_000), None);
        let error = write_dng(Path::new("/nowhere/a.dng"), &dng, (64, 1), &|_, _| (), never);
        assert!(error.unwrap_err().to_string().contains("less than 4 GiB"));
    }
}
