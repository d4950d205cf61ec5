//! Charts decoded from pictures: one grey PNG or TIFF per band (a folder, a pattern), or the bands of one TIFF
//! (`crate::image::tiff_bands`).
//!
//! | source | order of the bands | wavelengths |
//! |---|---|---|
//! | `FOLDER`, `'FOLDER/*.png'` | file names, numbers by value | one number of 200 to 2500 nm at the same position in every name (`names`) |
//! | TIFF | as stored | GDAL's metadata (`crate::image::gdal`) |
//!
//! Samples are values, not colours: no transfer function applies, and integers are counts (unit `counts`) unless they are scaled. GDAL's
//! scale, offset and no-data sample apply.

mod find;
mod names;

use std::path::{Path, PathBuf};

use pipeline::geometry::Size;
use serde_json::{Value, json};

use super::decoded_chart::{BandDecoder, Declared, DecodedChart, Sink};
use super::error::ChartError;
use super::file_change::{WatchedFile, modified_json};
use super::header::header_error;
use super::options::NanPolicy;
use super::values::Values;
use crate::durable::DurableError;
use crate::image::tiff_bands::{TiffBands, TiffPart};
use crate::image::{gdal, png};
use crate::parallel::{self, Progress};
use crate::sample::{RasterSample, Sample};

/// Memory of a PNG decoder besides its rows: compressed input, inflate window.
const PNG_DECODER_BYTES: usize = 2 << 20;

/// Tag of GDAL's no-data sample, for messages.
const NO_DATA: &str = "GDAL no-data value (tag 42113)";

/// Files; if there are several, each is one band.
#[derive(Debug)]
struct Pictures(Vec<PictureFile>);

#[derive(Debug)]
struct PictureFile {
    path: PathBuf,
    format: Format,
    size: Size,
}

#[derive(Debug)]
enum Format {
    Png,
    Tiff(TiffBands),
}

/// What a thread decodes at a time.
enum Part {
    Png { file: usize },
    Tiff { file: usize, part: TiffPart },
}

/// A header that was read.
struct Opened {
    file: PictureFile,
    bands: usize,
    sample: RasterSample,
    watched: WatchedFile,
    bytes: u64,
    modified: Value,
}

fn open_picture(path: &Path) -> Result<Opened, ChartError> {
    let meta = std::fs::metadata(path).map_err(|e| DurableError::io("look up", path, 0, e))?;
    let opened = |format, size, bands, sample| Opened {
        file: PictureFile { path: path.into(), format, size },
        bands,
        sample,
        watched: WatchedFile::data(path, &meta),
        bytes: meta.len(),
        modified: modified_json(&meta),
    };
    match find::kind(path)? {
        find::Kind::Png => {
            let (header, _) = png::open(path)?;
            if header.channels != 1 {
                let expected = "one grey channel, the samples of a band; a colour picture is converted by `lenscube chart image`";
                return Err(header_error(path, "channels", expected, "red, green and blue, or a palette"));
            }
            let sample = if header.white == 255 { Sample::U8 } else { Sample::U16 };
            Ok(opened(Format::Png, header.size, 1, RasterSample::Plain(sample)))
        }
        find::Kind::Tiff => {
            let tiff = TiffBands::open(path)?;
            let (size, bands, sample) = (tiff.size, tiff.bands, tiff.sample);
            Ok(opened(Format::Tiff(tiff), size, bands, sample))
        }
    }
}

/// Whether `spec` is a pattern of file names, or a folder of PNG or TIFF files that is not a Zarr store.
pub fn is_set_of_pictures(spec: &str) -> bool {
    find::is_pattern(spec) || find::is_folder(Path::new(spec))
}

/// The files of a pattern of file names; `None` if `spec` is none, nothing if no file matches.
pub fn files_of_pattern(spec: &str) -> Option<Vec<PathBuf>> {
    find::is_pattern(spec).then(|| find::pictures(spec).map_or(Vec::new(), |found| found.paths))
}

/// Whether `path` is a TIFF file, by its first bytes.
pub fn is_tiff(path: &Path) -> bool {
    path.is_file() && matches!(find::kind(path), Ok(find::Kind::Tiff))
}

/// Opens a folder or pattern of pictures, one per band.
///
/// # Errors
/// [`ChartError`] if there are none, or one is not supported or differs from the first in format, size or sample type.
pub fn open_set(spec: &str, nan: NanPolicy) -> Result<DecodedChart, ChartError> {
    let found = find::pictures(spec)?;
    let mut files = found.paths.iter().map(|path| {
        let opened = open_picture(path)?;
        match opened.bands {
            1 => Ok(opened),
            n => Err(header_error(path, "bands", "one in each picture", n.to_string())),
        }
    });
    let first = files.next().expect("`find` returns at least one")?;
    let mut all = vec![first];
    for next in files {
        let (next, first) = (next?, &all[0]);
        let describe = |o: &Opened| {
            let format = if matches!(o.file.format, Format::Png) { "PNG" } else { "TIFF" };
            format!("{format} of {} px, {}", o.file.size, o.sample.name())
        };
        if (describe(&next), next.sample) != (describe(first), first.sample) {
            let expected = format!("{}, as {}", describe(first), name_of(&first.file.path));
            return Err(header_error(&next.file.path, "picture", expected, describe(&next)));
        }
        all.push(next);
    }
    let names: Vec<String> = found.paths.iter().map(|p| name_of(p)).collect();
    let wavelengths_nm = names::wavelengths(&names);
    let mut notes = vec![order_note(&names, wavelengths_nm.as_deref())];
    if found.ignored > 0 {
        notes.push(format!("{} other files in {spec} are not used", found.ignored));
    }
    let values = values_of_set(&all)?;
    notes.extend(scaling_note(&values));
    chart(Path::new(spec), all, wavelengths_nm, values, notes, nan)
}

/// Opens a TIFF with one or more bands.
///
/// # Errors
/// [`ChartError`] if its header or GDAL's metadata in it are invalid or not supported.
pub fn open_tiff(path: &Path, nan: NanPolicy) -> Result<DecodedChart, ChartError> {
    let opened = open_picture(path)?;
    let Format::Tiff(tiff) = &opened.file.format else {
        return Err(header_error(path, "first bytes", "those of a TIFF", "something else"));
    };
    let (values, wavelengths_nm) = gdal_values(path, tiff)?;
    let notes = scaling_note(&values).into_iter().collect();
    chart(path, vec![opened], wavelengths_nm, values, notes, nan)
}

/// The conversion of samples and the wavelengths that GDAL's tags in a TIFF declare.
fn gdal_values(path: &Path, tiff: &TiffBands) -> Result<(Values, Option<Vec<f64>>), ChartError> {
    let metadata = match &tiff.metadata {
        None => gdal::GdalMetadata::default(),
        Some(xml) => gdal::parse(xml, tiff.bands)
            .map_err(|found| header_error(path, "GDAL metadata (tag 42112)", "valid XML", found))?,
    };
    let no_data =
        tiff.no_data_value().map_err(|text| header_error(path, NO_DATA, "a number", format!("`{text}`")))?;
    // NaN is no data in any case.
    let no_data = no_data.map(|v| tiff.sample.nearest(v)).filter(|v| v.is_finite());
    let values =
        Values { scaling: metadata.scaling, no_data: no_data.into_iter().collect(), ..Values::default() };
    Ok((values, metadata.wavelengths_nm))
}

/// The conversion of samples of a set of pictures: scale and offset of each, one no-data value for all.
fn values_of_set(all: &[Opened]) -> Result<Values, ChartError> {
    let mut set = Values::default();
    let mut scaling = Vec::new();
    for (k, opened) in all.iter().enumerate() {
        let path = &opened.file.path;
        let values = match &opened.file.format {
            Format::Png => Values::default(),
            Format::Tiff(tiff) => gdal_values(path, tiff)?.0,
        };
        if k == 0 {
            set.no_data.clone_from(&values.no_data);
        } else if values.no_data != set.no_data {
            let first_of = |v: &Values| v.no_data.first().map_or("none".to_owned(), f64::to_string);
            let expected = format!("{}, as in {}", first_of(&set), name_of(&all[0].file.path));
            return Err(header_error(path, NO_DATA, expected, first_of(&values)));
        }
        scaling.push(values.scaling.first().copied().unwrap_or((1.0, 0.0)));
    }
    if scaling.iter().any(|s| *s != (1.0, 0.0)) {
        set.scaling = scaling;
    }
    Ok(set)
}

fn scaling_note(values: &Values) -> Option<String> {
    let note = "the TIFF's GDAL scale and offset are applied: value = sample · scale + offset";
    (!values.scaling.is_empty()).then(|| note.into())
}

fn chart(
    path: &Path,
    opened: Vec<Opened>,
    wavelengths_nm: Option<Vec<f64>>,
    values: Values,
    notes: Vec<String>,
    nan: NanPolicy,
) -> Result<DecodedChart, ChartError> {
    let (size, sample) = (opened[0].file.size, opened[0].sample);
    let bands: usize = opened.iter().map(|o| o.bands).sum();
    let names: Vec<_> =
        opened.iter().map(|o| json!({ "name": name_of(&o.file.path), "bytes": o.bytes })).collect();
    let content = json!({ "pictures": names, "layout": format!("{size}, {bands} bands, {}", sample.code()) });
    let mtimes = Value::Array(opened.iter().map(|o| o.modified.clone()).collect());
    let (pictures, files) = opened.into_iter().map(|o| (o.file, o.watched)).unzip();
    let declared = Declared {
        path: path.into(),
        size,
        bands,
        sample,
        wavelengths_nm,
        values,
        units: None,
        array: None,
        notes,
        content,
        mtimes,
        files,
        nan,
    };
    DecodedChart::new(declared, Box::new(Pictures(pictures)))
}

impl Pictures {
    /// The parts that hold `bands`.
    fn parts(&self, bands: &[usize]) -> Result<Vec<Part>, ChartError> {
        if let [PictureFile { path, format: Format::Tiff(tiff), .. }] = &self.0[..] {
            let parts = tiff.parts(path, bands)?;
            return Ok(parts.into_iter().map(|part| Part::Tiff { file: 0, part }).collect());
        }
        let mut all = Vec::new();
        for &file in bands {
            let PictureFile { path, format, .. } = &self.0[file];
            match format {
                Format::Png => all.push(Part::Png { file }),
                Format::Tiff(tiff) => {
                    all.extend(tiff.parts(path, &[0])?.into_iter().map(|part| Part::Tiff { file, part }));
                }
            }
        }
        Ok(all)
    }

    fn decode_part(&self, part: &Part, bands: &[usize], sink: Sink<'_>) -> Result<(), ChartError> {
        let (Part::Png { file } | Part::Tiff { file, .. }) = part;
        let PictureFile { path, format, size } = &self.0[*file];
        match (part, format) {
            (Part::Tiff { part, .. }, Format::Tiff(tiff)) => {
                // The only band of a picture of a set has the number of its file.
                let wanted = if self.0.len() > 1 { &[0] } else { bands };
                tiff.decode(path, part, wanted, &mut |band, row, column, samples| {
                    sink(path, file + band, row, column, samples)
                })
            }
            _ => {
                let (header, rows) = png::open(path)?;
                if (header.size, header.channels) != (*size, 1) {
                    let reason = "it changed after it was opened".into();
                    return Err(ChartError::Damaged { path: path.clone(), reason });
                }
                let (mut bytes, mut decoded) = (Vec::with_capacity(2 * size.width), 0);
                let is_u8 = header.white == 255;
                rows.for_each_row(path, &header, &mut |row, samples| {
                    bytes.clear();
                    match is_u8 {
                        true => bytes.extend(samples.iter().map(|&v| v as u8)),
                        false => bytes.extend(samples.iter().flat_map(|v| v.to_ne_bytes())),
                    }
                    decoded += 1;
                    sink(path, *file, row, 0, &bytes)
                })?;
                match decoded == size.height {
                    true => Ok(()),
                    false => {
                        let reason = format!("it holds {decoded} rows of {}", size.height);
                        Err(ChartError::Damaged { path: path.clone(), reason })
                    }
                }
            }
        }
    }
}

impl BandDecoder for Pictures {
    fn decode(
        &self,
        bands: &[usize],
        threads: usize,
        progress: Progress<'_>,
        sink: Sink<'_>,
    ) -> Result<(), ChartError> {
        let parts = self.parts(bands)?;
        parallel::for_each(threads, parts.len(), progress, |n| self.decode_part(&parts[n], bands, sink))
    }

    fn thread_bytes(&self) -> usize {
        let bytes = |f: &PictureFile| match &f.format {
            Format::Png => PNG_DECODER_BYTES,
            Format::Tiff(tiff) => tiff.decoder_bytes,
        };
        self.0.iter().map(bytes).max().unwrap_or(0)
    }
}

fn name_of(path: &Path) -> String {
    path.file_name().map_or(String::new(), |n| n.to_string_lossy().into_owned())
}

/// The order of the pictures: all of a few, else the first two and the last.
fn order_note(names: &[String], nm: Option<&[f64]>) -> String {
    const ALL: usize = 6;
    let one = |k: usize| match nm {
        Some(nm) => format!("{} ({} nm)", names[k], nm[k]),
        None => names[k].clone(),
    };
    let list = match names.len() {
        0..=ALL => (0..names.len()).map(one).collect::<Vec<_>>().join(", "),
        n => format!("{}, {}, …, {}", one(0), one(1), one(n - 1)),
    };
    let source = if nm.is_some() { " (wavelengths from the names)" } else { "" };
    format!("{} pictures are the bands, in this order{source}: {list}", names.len())
}

#[cfg(test)]
mod tests;
