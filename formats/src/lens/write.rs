//! Writer of lens packs: PSFs band by band, then tables, then the group's own metadata.
//!
//! Tables are f64, azimuth counts i32, PSFs f32; a chunk is one PSF height, or one row of a table; blosc (lz4, shuffle) + crc32c. Lenses without
//! rotational symmetry have ten times the PSFs: their chunks have about 1 MiB.
//! Bands with fewer field points or heights are padded with NaN (azimuths: 0), see [`lens`](super).

mod cones;
mod depth;
mod ghosts;
mod planar;
mod pupils;
mod tail;

use super::array::MAX_SAMPLES;
use super::attributes::{
    CONES, DEPTH_SCHEMA, EXTRAS, GHOST, MIDDLE, PLANAR_SCHEMA, PSF_FIELD, PUPIL_SCHEMA, PackAttributes,
    REFERENCE_POINT, SCHEMA, SEALED, TAIL,
};
use super::error::LensPackError;
use super::read::SUM_TOLERANCE;
use super::sink::Sink;
use pipeline::design::ghost::rings::RingSizes;
use pipeline::lens::cone_field::ConeField;
use pipeline::lens::{Lens, LensBand, PsfSample, PsfStack};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::num::NonZeroU64;
use std::path::Path;
use std::sync::Arc;
use zarrs::array::{Array, ArrayBytes, ArrayToBytesCodecTraits, CodecOptions};
use zarrs::metadata::ArrayMetadata;

/// Band and depth node of a stack.
type StackKey = (usize, Option<usize>);
/// Side, pitch, number of PSFs and kind of samples of a stack.
type StackShape = (usize, f64, usize, PsfSample);

/// Rings of the ghosts of a band, and reflectance of the film.
type GhostHead = (RingSizes, f64);

/// Writer of a pack: [`psf`](Self::psf) or [`pupils`](Self::pupils) for every band in any order, then [`finish`](Self::finish). Dropped before
/// that, it leaves no file.
pub struct LensPackWriter {
    sink: Sink,
    /// Side, pitch, number of PSFs and kind of samples of the stacks written so far, by band and depth node.
    written: BTreeMap<StackKey, StackShape>,
    /// Ghosts written so far, by band.
    ghosts: BTreeMap<usize, GhostHead>,
    /// Whether paths of ghosts were written.
    has_ghost_paths: bool,
    /// Most samples of the PSFs of a band: those that are read again.
    max_samples: u64,
    /// Whether it was begun for a lens without rotational symmetry.
    is_planar: bool,
    /// Whether pupil functions are written in place of PSFs.
    has_pupils: bool,
    /// Whether they are of whole pupils.
    has_whole_pupils: bool,
}

/// Writes a complete pack, one band of PSFs at a time.
///
/// # Errors
/// As [`LensPackWriter`], and the errors of `psf`.
pub fn write<E: From<LensPackError>>(
    path: impl AsRef<Path>,
    lens: &Lens,
    attributes: &PackAttributes,
    psf: impl IntoIterator<Item = Result<PsfStack, E>>,
) -> Result<(), E> {
    let mut writer = match lens.bands.iter().all(LensBand::is_symmetric) {
        true => LensPackWriter::create(path)?,
        false => LensPackWriter::create_planar(path)?,
    };
    for (band, stack) in psf.into_iter().enumerate() {
        writer.psf(band, &stack?)?;
    }
    Ok(writer.finish(lens, attributes)?)
}

impl LensPackWriter {
    /// Begins a pack: a .zip if `path` ends in `.zip`, else a directory.
    ///
    /// # Errors
    /// The path exists, or no file can be created there.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, LensPackError> {
        let sink = Sink::create(path.as_ref())?;
        let written = BTreeMap::new();
        Ok(Self {
            sink,
            written,
            ghosts: BTreeMap::new(),
            has_ghost_paths: false,
            max_samples: MAX_SAMPLES,
            is_planar: false,
            has_pupils: false,
            has_whole_pupils: false,
        })
    }

    /// As [`create`](Self::create), for a lens without rotational symmetry: its PSFs are stored in chunks of several.
    ///
    /// # Errors
    /// As [`create`](Self::create).
    pub fn create_planar(path: impl AsRef<Path>) -> Result<Self, LensPackError> {
        Ok(Self { is_planar: true, ..Self::create(path)? })
    }

    /// Writes one band's PSFs.
    ///
    /// # Errors
    /// A window is not finite or does not sum to 1 within 1e-3; the band was written before, or has more samples than are read again; an error
    /// of the disk.
    pub fn psf(&mut self, band: usize, stack: &PsfStack) -> Result<(), LensPackError> {
        self.stack(band, None, stack)
    }

    /// Writes the PSFs of a depth node of a band.
    ///
    /// # Errors
    /// As [`LensPackWriter::psf`].
    pub fn psf_of_node(&mut self, band: usize, node: usize, stack: &PsfStack) -> Result<(), LensPackError> {
        self.stack(band, Some(node), stack)
    }

    fn stack(&mut self, band: usize, node: Option<usize>, stack: &PsfStack) -> Result<(), LensPackError> {
        let name = node.map_or_else(|| format!("psf/{band}"), |d| format!("psf/{band}/{d}"));
        if self.has_pupils {
            return Err(self.invalid(format!("{name} after pupil functions of other bands")));
        }
        let n = stack.size;
        if n.is_multiple_of(2) || stack.samples.is_empty() || !stack.samples.len().is_multiple_of(n * n) {
            let samples = stack.samples.len();
            return Err(self.invalid(format!("{name} has {samples} samples in windows of {n} × {n}, n odd")));
        }
        if stack.samples.len() as u64 > self.max_samples {
            let (samples, most) = (stack.samples.len(), self.max_samples);
            return Err(self.invalid(format!(
                "{name} has {samples} samples, expected at most {most}: write pupil functions in place of PSFs (`--store pupils`)"
            )));
        }
        let heights = stack.heights();
        for k in 0..heights {
            let sum: f64 = stack.window(k).iter().map(|&v| f64::from(v)).sum();
            if !sum.is_finite() || (sum - 1.0).abs() > SUM_TOLERANCE {
                return Err(
                    self.invalid(format!("{name}: the window at height index {k} sums to {sum}, expected 1"))
                );
            }
        }
        self.record(&name, (band, node), (n, stack.pitch_um, heights, stack.sample))?;
        let (bytes, shape) = (bytemuck::cast_slice(&stack.samples), [heights, n, n]);
        match self.is_planar {
            false => self.array(&name, "float32", &shape, "1", &["psf_height", "row", "column"], bytes),
            true => {
                let chunk = [planar::windows_in_chunk(heights, n), n, n];
                let about = ("1", &["psf", "row", "column"][..]);
                self.chunked_array((&name, "float32"), (&shape, &chunk), about, bytes)
            }
        }
    }

    fn record(&mut self, name: &str, key: StackKey, shape: StackShape) -> Result<(), LensPackError> {
        match self.written.insert(key, shape) {
            Some(_) => Err(self.invalid(format!("{name} was written twice"))),
            None => Ok(()),
        }
    }

    /// Writes tables and attributes and renames the pack to its final path.
    ///
    /// # Errors
    /// A table is invalid or does not match the PSFs; an error of the disk.
    pub fn finish(mut self, lens: &Lens, attributes: &PackAttributes) -> Result<(), LensPackError> {
        self.check(lens)?;
        let bands = &lens.bands;
        self.column("wavelength", "nm", bands, |b| b.wavelength_nm)?;
        let is_symmetric = bands[0].is_symmetric();
        if is_symmetric {
            self.table("ideal_height", "mm", "field_point", bands, |b| &b.ideal_height_mm)?;
            self.table("image_height", "mm", "field_point", bands, |b| &b.image_height_mm)?;
            self.table("relative_illumination", "1", "field_point", bands, |b| &b.relative_illumination)?;
        }
        self.column("solid_angle", "sr", bands, |b| b.solid_angle_sr)?;
        self.column("transmission", "1", bands, |b| b.transmission)?;
        let psf_field = match &lens.depth {
            None if is_symmetric => self.psf_tables(bands).map(|()| None)?,
            None => Some(self.planar_tables(bands)?),
            Some(depth) => self.depth_tables(depth).map(|()| None)?,
        };
        let group = json!({"zarr_format": 3, "node_type": "group", "attributes": {}});
        let groups: &[&str] = if self.has_pupils { &["pupil", "pupil_segment"] } else { &["psf"] };
        for name in groups {
            self.json(&format!("{name}/zarr.json"), &group)?;
        }
        for band in 0..lens.depth.as_ref().map_or(0, |depth| depth.bands.len()) {
            self.json(&format!("psf/{band}/zarr.json"), &group)?;
        }
        let mut root =
            json!({"zarr_format": 3, "node_type": "group", "attributes": root_attributes(lens, attributes)});
        if self.has_pupils {
            self.column("psf_size", "1", bands, |b| b.psf_size as f64)?;
            root["attributes"]["schema"] = json!(PUPIL_SCHEMA);
        }
        if let Some(field) = psf_field {
            root["attributes"]["schema"] = json!(PLANAR_SCHEMA);
            root["attributes"][PSF_FIELD] = json!(field.name());
            if let Some(point) = attributes.reference_point {
                root["attributes"][REFERENCE_POINT] = json!(point.name());
            }
        }
        let mut extras = Vec::new();
        if bands.iter().any(|b| b.tail.is_some()) {
            self.tails(bands)?;
            self.json("tail/zarr.json", &group)?;
            extras.push(TAIL);
            if self.middles(bands)? {
                self.json("tail/middle/zarr.json", &group)?;
                extras.push(MIDDLE);
            }
        }
        let cones: Option<Vec<&ConeField>> = bands.iter().map(|b| b.cones.as_ref()).collect();
        if let Some(cones) = cones.filter(|cones| !cones.is_empty()) {
            self.cones(bands, &cones)?;
            self.json("cones/zarr.json", &group)?;
            extras.push(CONES);
        }
        if self.ghost_tables(lens)? {
            self.json("ghost/zarr.json", &group)?;
            self.json("ghost/operator/zarr.json", &group)?;
            if self.has_ghost_paths {
                self.json("ghost/paths/zarr.json", &group)?;
            }
            extras.push(GHOST);
        }
        if !extras.is_empty() {
            root["attributes"][EXTRAS] = json!(extras);
        }
        self.json("zarr.json", &root)?;
        self.sink.finish()
    }

    /// PSF tables of a lens without depth nodes.
    fn psf_tables(&mut self, bands: &[LensBand]) -> Result<(), LensPackError> {
        self.table("psf_height", "mm", "psf_height", bands, |b| &b.psf_height_mm)?;
        self.table("psf_energy", "1", "psf_height", bands, |b| &b.psf_energy)?;
        self.column("psf_pitch", "um", bands, |b| b.psf_pitch_um)?;
        if bands.iter().any(|b| b.kernel_pitch_um.is_some()) {
            self.column("kernel_pitch", "um", bands, |b| b.kernel_pitch_um.unwrap_or(0.0))?;
        }
        self.counts("azimuth_count", bands, |b| &b.azimuth_count)
    }

    /// Numbers of azimuths at the heights of each band, 0 after the last one.
    fn counts(
        &mut self,
        name: &str,
        bands: &[LensBand],
        values: impl Fn(&LensBand) -> &[usize],
    ) -> Result<(), LensPackError> {
        let width = bands.iter().map(|b| values(b).len()).max().unwrap_or(0);
        let padded = bands.iter().flat_map(|b| (0..width).map(|k| values(b).get(k).map_or(0, |&j| j as i32)));
        let bytes: Vec<u8> = padded.flat_map(i32::to_ne_bytes).collect();
        self.array(name, "int32", &[bands.len(), width], "1", &["wavelength", "psf_height"], &bytes)
    }

    fn check(&self, lens: &Lens) -> Result<(), LensPackError> {
        let expected = stacks(lens);
        if lens.bands.is_empty() || self.written.keys().ne(expected.keys()) {
            let have: Vec<_> = self.written.keys().map(|key| key.0).collect();
            let bands = lens.bands.len();
            return Err(self.invalid(format!("the lens has {bands} bands, PSFs were written for {have:?}")));
        }
        if let Err((name, e)) = lens.check_head() {
            return Err(self.invalid(format!("`{name}` is out of bounds: {e}")));
        }
        self.check_kind(lens)?;
        for (b, band) in lens.bands.iter().enumerate() {
            let nodes = lens.depth.as_ref().and_then(|depth| depth.bands.get(b));
            let checked = band.check().and_then(|()| nodes.map_or(Ok(()), |nodes| nodes.check(band)));
            checked.map_err(|source| LensPackError::Table { path: self.sink.path.clone(), source })?;
        }
        for (key, expected) in expected {
            if self.written[&key] != expected {
                let list = |(side, pitch_um, heights, sample): StackShape| {
                    let sample = if sample == PsfSample::Point { "point" } else { "integrated" };
                    format!("{heights} windows of {side} {sample} samples of {pitch_um} µm")
                };
                let (found, expected, b) = (list(self.written[&key]), list(expected), key.0);
                return Err(self.invalid(format!("psf/{b} has {found}, the lens's table {expected}")));
            }
        }
        match lens.bands.windows(2).find(|w| w[1].wavelength_nm <= w[0].wavelength_nm) {
            Some(w) => Err(self.invalid(format!("wavelengths do not ascend at {} nm", w[1].wavelength_nm))),
            None => Ok(()),
        }
    }

    fn column(
        &mut self,
        name: &str,
        unit: &str,
        bands: &[LensBand],
        value: impl Fn(&LensBand) -> f64,
    ) -> Result<(), LensPackError> {
        let bytes: Vec<u8> = bands.iter().flat_map(|b| value(b).to_ne_bytes()).collect();
        self.array(name, "float64", &[bands.len()], unit, &["wavelength"], &bytes)
    }

    fn table(
        &mut self,
        name: &str,
        unit: &str,
        along: &str,
        bands: &[LensBand],
        values: impl Fn(&LensBand) -> &Vec<f64>,
    ) -> Result<(), LensPackError> {
        let width = bands.iter().map(|b| values(b).len()).max().unwrap_or(0);
        let padded =
            bands.iter().flat_map(|b| (0..width).map(|i| values(b).get(i).copied().unwrap_or(f64::NAN)));
        let bytes: Vec<u8> = padded.flat_map(f64::to_ne_bytes).collect();
        self.array(name, "float64", &[bands.len(), width], unit, &["wavelength", along], &bytes)
    }

    /// Writes one array from its native bytes, in chunks of length 1 along the first axis (a 1-D array: a single chunk).
    fn array(
        &mut self,
        name: &str,
        data_type: &str,
        shape: &[usize],
        unit: &str,
        dims: &[&str],
        bytes: &[u8],
    ) -> Result<(), LensPackError> {
        let mut chunk = shape.to_vec();
        if let [first, _, ..] = chunk.as_mut_slice() {
            *first = 1;
        }
        self.chunked_array((name, data_type), (shape, &chunk), (unit, dims), bytes)
    }

    /// Writes an array of name and type, in chunks of a shape that divides the array along its first axis, of a unit and names of its axes; zeros fill the
    /// last chunk.
    fn chunked_array(
        &mut self,
        (name, data_type): (&str, &str),
        (shape, chunk): (&[usize], &[usize]),
        (unit, dims): (&str, &[&str]),
        bytes: &[u8],
    ) -> Result<(), LensPackError> {
        let item = if data_type == "float64" { 8 } else { 4 };
        let fill = if data_type == "int32" { json!(0) } else { json!("NaN") };
        let metadata = json!({
            "zarr_format": 3,
            "node_type": "array",
            "shape": shape,
            "data_type": data_type,
            "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": chunk}},
            "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
            "fill_value": fill,
            "codecs": [
                {"name": "bytes", "configuration": {"endian": "little"}},
                {"name": "blosc", "configuration": {"typesize": item, "cname": "lz4", "clevel": 5, "shuffle": "shuffle", "blocksize": 0}},
                {"name": "crc32c"},
            ],
            "attributes": {"units": unit},
            "dimension_names": dims,
        });
        let failed = |e: String| self.invalid(format!("array {name}: {e}"));
        let typed: ArrayMetadata =
            serde_json::from_value(metadata.clone()).map_err(|e| failed(e.to_string()))?;
        let array = Array::new_with_metadata(Arc::new(()), &format!("/{name}"), typed)
            .map_err(|e| failed(e.to_string()))?;
        let chunk: Vec<NonZeroU64> = chunk.iter().filter_map(|&n| NonZeroU64::new(n as u64)).collect();
        let length = chunk.iter().map(|n| n.get() as usize).product::<usize>() * item;
        let options = CodecOptions::default().with_concurrent_target(1);
        let mut padded = Vec::new();
        for (i, mut chunk_bytes) in bytes.chunks(length).enumerate() {
            if chunk_bytes.len() < length {
                padded.extend_from_slice(chunk_bytes);
                padded.resize(length, 0);
                chunk_bytes = &padded;
            }
            let mut index = vec![0; shape.len()];
            index[0] = i as u64;
            let encoded = array
                .codecs()
                .encode(
                    ArrayBytes::new_flen(chunk_bytes),
                    &chunk,
                    array.data_type(),
                    array.fill_value(),
                    &options,
                )
                .map_err(|e| self.invalid(format!("array {name}: {e}")))?;
            self.sink.write(array.chunk_key(&index).as_str(), &encoded)?;
        }
        self.json(&format!("{name}/zarr.json"), &metadata)
    }

    fn json(&mut self, key: &str, value: &Value) -> Result<(), LensPackError> {
        self.sink.write(key, format!("{value:#}").as_bytes())
    }

    fn invalid(&self, problem: String) -> LensPackError {
        LensPackError::Write { path: self.sink.path.clone(), problem }
    }
}

/// Side, pitch, number of PSFs and kind of samples of every stack of `lens`, by band and depth node.
fn stacks(lens: &Lens) -> BTreeMap<StackKey, StackShape> {
    let sample = lens.psf_sample;
    let flat = lens
        .bands
        .iter()
        .enumerate()
        .map(|(b, band)| ((b, None), (band.psf_size, band.psf_pitch_um, band.psf_count(), sample)));
    let Some(depth) = &lens.depth else { return flat.collect() };
    let nodes = depth.bands.iter().enumerate().flat_map(|(b, band)| {
        band.nodes.iter().enumerate().map(move |(d, node)| {
            ((b, Some(d)), (node.psf_size, node.psf_pitch_um, node.psf_height_mm.len(), sample))
        })
    });
    nodes.collect()
}

fn root_attributes(lens: &Lens, other: &PackAttributes) -> Value {
    let mut attributes = json!({
        "schema": if lens.depth.is_some() { DEPTH_SCHEMA } else { SCHEMA },
        "name": lens.name,
        "distortion_focal_length_mm": lens.distortion_focal_length_mm,
        "effective_focal_length_mm": lens.effective_focal_length_mm,
        "f_number": lens.f_number,
        "primary_wavelength_nm": lens.primary_wavelength_nm,
        "psf_sample": match lens.psf_sample {
            PsfSample::Point => "point",
            PsfSample::Integrated => "integrated",
        },
        "object_distance_mm": lens.object_distance_mm,
        "magnification": lens.magnification,
        "image_plane": other.image_plane,
        "defocus_mm": other.defocus_mm,
        "frame": other.frame,
        "psf_tolerance": other.psf_tolerance,
        "source": other.source,
    });
    if let Some(depth) = &lens.depth {
        attributes["focus_distance_m"] = match depth.focus_distance_m.is_finite() {
            true => json!(depth.focus_distance_m),
            false => json!("Infinity"),
        };
        attributes["blur_per_dioptre_um"] = json!(depth.blur_per_dioptre_um);
        attributes["entrance_pupil_mm"] = json!(depth.entrance_pupil_mm);
        attributes["entrance_pupil_diameter_mm"] = json!(depth.entrance_pupil_diameter_mm);
        attributes["depth_tolerance"] = json!(depth.tolerance);
    }
    for (name, value) in [("errors", &other.errors), ("compensators", &other.compensators)] {
        if let Some(value) = value {
            attributes[name] = value.clone();
        }
    }
    // Absent otherwise: packs are those of programs without it.
    if other.sealed {
        attributes[SEALED] = true.into();
    }
    attributes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_band_of_more_samples_than_are_read_again_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let mut pack = LensPackWriter::create_planar(directory.path().join("a.lens.zarr")).unwrap();
        pack.max_samples = 18;
        let windows = |count: usize| PsfStack {
            size: 3,
            pitch_um: 1.0,
            sample: PsfSample::Point,
            samples: vec![1.0 / 9.0; 9 * count],
        };
        pack.psf(0, &windows(2)).unwrap();
        let error = pack.psf(1, &windows(3)).unwrap_err().to_string();
        assert!(error.contains("psf/1 has 27 samples, expected at most 18"), "{error}");
        assert!(error.contains("--store pupils"), "{error}");
    }
}
