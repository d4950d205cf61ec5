//! GDAL's tags in sets of pictures, sparse files, and pages of several samples, in files that the tests write.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use super::*;
use ::tiff::encoder::{Compression, TiffEncoder, colortype};
use ::tiff::tags::Tag;

/// A grey TIFF of 4 x 4 px and u16 with the samples 1 to 16, two rows a strip, and texts as tags.
fn grey(compression: Compression, texts: &[(Tag, &str)]) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes).unwrap().with_compression(compression);
    let mut image = encoder.new_image::<colortype::Gray16>(4, 4).unwrap();
    image.rows_per_strip(2).unwrap();
    for (tag, text) in texts {
        image.encoder().write_tag(*tag, *text).unwrap();
    }
    image.write_data(&(1..=16).collect::<Vec<u16>>()).unwrap();
    bytes.into_inner()
}

/// Sets offset and size of the second strip to 0.
fn without_second_strip(mut bytes: Vec<u8>) -> Vec<u8> {
    let at = |bytes: &[u8], at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    let first = at(&bytes, 4);
    for tag in [273u16, 279] {
        let entry = (first + 2..).step_by(12).find(|&e| bytes[e..e + 2] == tag.to_le_bytes()).unwrap();
        assert_eq!((bytes[entry + 2], at(&bytes, entry + 4)), (4, 2), "two numbers of 32 bits");
        let list = at(&bytes, entry + 8);
        bytes[list + 4..list + 8].fill(0);
    }
    bytes
}

/// Values of a chart of 4 x 4 px, and pixels without data.
fn read(chart: &DecodedChart, band: usize) -> Result<(Vec<f32>, u64), ChartError> {
    let dir = tempfile::tempdir().unwrap();
    chart.copy_bands(&[band], dir.path(), 1, &|_, _| ())?;
    let mut out = vec![0.0; 16];
    chart.read_rect(band, Size::new(4, 4).rect(), &mut out)?;
    Ok((out, chart.stats().1))
}

#[test]
fn strips_that_a_sparse_file_does_not_store_hold_zero_or_the_no_data_sample() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("sparse.tif");
    let stored: Vec<f32> = (1..=16).map(|v| if v > 8 { 0.0 } else { v as f32 }).collect();
    let compressions =
        [Compression::Uncompressed, Compression::Lzw, Compression::Deflate(Default::default())];
    for (k, compression) in compressions.into_iter().enumerate() {
        fs::write(&path, without_second_strip(grey(compression, &[]))).unwrap();
        let found = read(&open_tiff(&path, NanPolicy::Error).unwrap(), 0).unwrap();
        assert_eq!(found, (stored.clone(), 0), "compression {k}");
        fs::write(&path, without_second_strip(grey(compression, &[(Tag::GdalNodata, "77")]))).unwrap();
        let error = read(&open_tiff(&path, NanPolicy::Error).unwrap(), 0).unwrap_err();
        assert!(matches!(error, ChartError::NoData { row: 2, column: 0, value: 77.0, .. }), "{error}");
        let found = read(&open_tiff(&path, NanPolicy::Zero).unwrap(), 0).unwrap();
        assert_eq!(found, (stored.clone(), 8), "compression {k}");
    }
}

fn write_set(dir: &Path, tags: [&[(Tag, &str)]; 2]) {
    for (name, texts) in ["b_450nm.tif", "b_550nm.tif"].iter().zip(tags) {
        fs::write(dir.join(name), grey(Compression::Uncompressed, texts)).unwrap();
    }
}

#[test]
fn scale_offset_and_no_data_of_every_picture_of_a_set_apply() {
    let dir = tempfile::tempdir().unwrap();
    let item = |scale: &str, offset: &str| {
        format!(
            r#"<GDALMetadata><Item name="SCALE" sample="0" role="scale">{scale}</Item><Item name="OFFSET" sample="0" role="offset">{offset}</Item></GDALMetadata>"#
        )
    };
    let (first, second) = (item("0.5", "-1"), item("2", "10"));
    let metadata = Tag::Unknown(42112);
    write_set(
        dir.path(),
        [&[(metadata, &first), (Tag::GdalNodata, "16")], &[(metadata, &second), (Tag::GdalNodata, "16")]],
    );
    let chart = |nan| open_set(dir.path().to_str().unwrap(), nan).unwrap();
    assert!(chart(NanPolicy::Error).notes().iter().any(|n| n.contains("scale and offset are applied")));
    assert!(matches!(read(&chart(NanPolicy::Error), 1), Err(ChartError::NoData { row: 3, column: 3, .. })));
    for (band, (scale, offset)) in [(0.5, -1.0), (2.0, 10.0)].into_iter().enumerate() {
        let expected: Vec<f32> =
            (1..=16).map(|v| if v == 16 { 0.0 } else { v as f32 * scale + offset }).collect();
        assert_eq!(read(&chart(NanPolicy::Zero), band).unwrap(), (expected, 1), "band {band}");
    }
    write_set(dir.path(), [&[(Tag::GdalNodata, "16")], &[]]);
    let error = open_set(dir.path().to_str().unwrap(), NanPolicy::Error).unwrap_err().to_string();
    assert!(error.contains("b_550nm.tif") && error.contains("expected 16, as in b_450nm.tif"), "{error}");
}

#[test]
fn pages_of_several_samples_are_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("pages.tif");
    let mut encoder = TiffEncoder::new(fs::File::create(&path).unwrap()).unwrap();
    for _ in 0..2 {
        let mut image = encoder.new_image::<colortype::RGB16>(2, 2).unwrap();
        image.encoder().write_tag(Tag::PhotometricInterpretation, 1u16).unwrap();
        image.write_data(&[1; 12]).unwrap();
    }
    let error = open_tiff(&path, NanPolicy::Error).unwrap_err().to_string();
    assert!(error.contains("page 2 after one of 3 samples per pixel"), "{error}");
}
