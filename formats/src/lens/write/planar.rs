//! Tables of a lens without rotational symmetry: maps, and places of the PSFs, padded with NaN (azimuths: 0) past a band's last node.

use super::LensPackWriter;
use crate::lens::attributes::PsfField;
use crate::lens::error::LensPackError;
use crate::lens::read::MAP_NUMBERS;
use pipeline::bounds::{self, Bound};
use pipeline::lens::planar::{PlanarMap, PsfPlaces};
use pipeline::lens::{Lens, LensBand};

/// Bytes of a chunk of PSFs, about.
const CHUNK_BYTES: usize = 1 << 20;

/// Windows of `n` × `n` samples in a chunk of an array of `windows` of them.
pub(super) fn windows_in_chunk(windows: usize, n: usize) -> usize {
    (CHUNK_BYTES / (n * n * size_of::<f32>())).clamp(1, windows)
}

impl LensPackWriter {
    /// Checks that all bands of `lens` are of the kind that the pack was begun for and its pupils are of, with PSFs at places of one kind, and that its
    /// tables can be read again.
    pub(super) fn check_kind(&self, lens: &Lens) -> Result<(), LensPackError> {
        let with = |is: bool| if is { "with" } else { "without" };
        let (first, rest) = (lens.bands[0].is_symmetric(), &lens.bands[1..]);
        if let Some(band) = rest.iter().find(|band| band.is_symmetric() != first) {
            let (nm, is) = (band.wavelength_nm, with(band.is_symmetric()));
            return Err(self.invalid(format!(
                "the band {nm} nm is {is} rotational symmetry, the band {} nm {} it",
                lens.bands[0].wavelength_nm,
                with(first)
            )));
        }
        if self.has_pupils && self.has_whole_pupils == first {
            let pupils = if first { "whole" } else { "half" };
            let problem = format!("the lens is {} rotational symmetry, but has {pupils} pupils", with(first));
            return Err(self.invalid(problem));
        }
        if first && self.is_planar {
            let problem = "the lens is with rotational symmetry, the pack was begun for one without it";
            return Err(self.invalid(problem.into()));
        }
        if first {
            return Ok(());
        }
        if lens.depth.is_some() {
            return Err(self.invalid("a lens without rotational symmetry has depth nodes".into()));
        }
        let bands = &lens.bands;
        if bands.iter().any(|band| grid(band)[0].is_empty() != grid(&bands[0])[0].is_empty()) {
            return Err(self.invalid("some bands have PSFs at heights and azimuths, others on a grid".into()));
        }
        let (height, width) = map_size(bands);
        let psfs = bands.iter().map(LensBand::psf_count).max().unwrap_or(0);
        self.check_size(&MAP_NUMBERS, &[bands.len(), height, width])?;
        self.check_size(&bounds::TABLE_NUMBERS, &[bands.len(), psfs])
    }

    fn check_size(&self, bound: &Bound, sides: &[usize]) -> Result<(), LensPackError> {
        bound.check_product(sides).map(drop).map_err(|e| self.invalid(e.to_string()))
    }

    /// Writes maps and places of the PSFs of `bands`, all without rotational symmetry.
    pub(super) fn planar_tables(&mut self, bands: &[LensBand]) -> Result<PsfField, LensPackError> {
        self.table("map_x", "mm", "map_column", bands, |b| map(b, |map| &map.x_mm))?;
        self.table("map_y", "mm", "map_row", bands, |b| map(b, |map| &map.y_mm))?;
        self.map_table("map_ideal_x", "mm", bands, |map| &map.ideal_x_mm)?;
        self.map_table("map_ideal_y", "mm", bands, |map| &map.ideal_y_mm)?;
        self.map_table("map_relative_illumination", "1", bands, |map| &map.relative_illumination)?;
        self.table("psf_energy", "1", "psf", bands, |b| &b.psf_energy)?;
        self.column("psf_pitch", "um", bands, |b| b.psf_pitch_um)?;
        match bands[0].planar.as_ref().map(|planar| &planar.psfs) {
            Some(PsfPlaces::Cartesian { .. }) => {
                self.table("psf_x", "mm", "psf_column", bands, |b| grid(b)[0])?;
                self.table("psf_y", "mm", "psf_row", bands, |b| grid(b)[1])?;
                Ok(PsfField::Grid)
            }
            _ => {
                self.table("psf_height", "mm", "psf_height", bands, |b| &b.psf_height_mm)?;
                self.counts("azimuth_count", bands, |b| &b.azimuth_count)?;
                self.counts("psf_azimuths", bands, azimuth_samples)?;
                Ok(PsfField::Polar)
            }
        }
    }

    /// Writes a table over the nodes of the maps.
    fn map_table(
        &mut self,
        name: &str,
        unit: &str,
        bands: &[LensBand],
        values: fn(&PlanarMap) -> &Vec<f64>,
    ) -> Result<(), LensPackError> {
        let (height, width) = map_size(bands);
        let mut padded = vec![f64::NAN; bands.len() * height * width];
        for (band, to) in bands.iter().zip(padded.chunks_exact_mut(height * width)) {
            let columns = map(band, |map| &map.x_mm).len();
            for (row, to) in map(band, values).chunks_exact(columns).zip(to.chunks_exact_mut(width)) {
                to[..columns].copy_from_slice(row);
            }
        }
        let bytes: Vec<u8> = padded.into_iter().flat_map(f64::to_ne_bytes).collect();
        let dims = ["wavelength", "map_row", "map_column"];
        self.array(name, "float64", &[bands.len(), height, width], unit, &dims, &bytes)
    }
}

static NONE: Vec<f64> = Vec::new();

/// A table of the map of a band.
fn map(band: &LensBand, table: fn(&PlanarMap) -> &Vec<f64>) -> &Vec<f64> {
    band.planar.as_ref().map_or(&NONE, |planar| table(&planar.map))
}

/// Most rows and columns of the maps.
fn map_size(bands: &[LensBand]) -> (usize, usize) {
    let most =
        |nodes: fn(&PlanarMap) -> &Vec<f64>| bands.iter().map(|b| map(b, nodes).len()).max().unwrap_or(0);
    (most(|map| &map.y_mm), most(|map| &map.x_mm))
}

/// Columns and rows of the grid of PSFs of a band.
fn grid(band: &LensBand) -> [&Vec<f64>; 2] {
    match band.planar.as_ref().map(|planar| &planar.psfs) {
        Some(PsfPlaces::Cartesian { x_mm, y_mm }) => [x_mm, y_mm],
        _ => [&NONE; 2],
    }
}

/// A_k of a band.
fn azimuth_samples(band: &LensBand) -> &[usize] {
    match band.planar.as_ref().map(|planar| &planar.psfs) {
        Some(PsfPlaces::Polar { azimuth_samples }) => azimuth_samples,
        _ => &[],
    }
}
