//! Tables of a pack of a lens without rotational symmetry: maps over the film, and the places of the PSFs.
//!
//! The nodes of the maps and the places of the PSFs of a band may be fewer than those of others: the rows of `map_x`, `map_y`, `psf_height`, `psf_x`
//! and `psf_y` then end with NaN, and the numbers of the other tables beyond them are padding. A pack with `psf_size` has pupil functions.

use super::{AZIMUTHS, Arrays, PackArray, Rows, psfs, pupils};
use crate::lens::attributes::PsfField;
use crate::lens::error::LensPackError;
use pipeline::bounds::{self, Bound};
use pipeline::lens::LensBand;
use pipeline::lens::planar::{PlanarBand, PlanarMap, PsfPlaces};

/// Numbers of a table of maps, all bands: 32 of 1025 × 1025 nodes.
pub const MAP_NUMBERS: Bound =
    Bound { name: "the size of the maps", unit: "numbers", min: 1.0, max: 33_620_000.0 };
/// Maximum of A_k, and in words.
const AZIMUTH_SAMPLES: (f64, &str) = (bounds::AZIMUTH_SAMPLES.max, "a whole number up to 2880");
/// Minimum of columns and of rows of PSFs, and in words.
const ONE: (usize, &str) = (1, "at least 1 number");

/// Tables of all bands.
pub(super) struct PlanarTables<'a> {
    /// Of each band that is not filled yet.
    maps: Vec<Option<PlanarMap>>,
    places: Places<'a>,
    energy: Rows<'a>,
    pitch: Vec<f64>,
    /// Sides of the windows that pupil functions have.
    sides: Option<Vec<f64>>,
}

/// Places of the PSFs.
enum Places<'a> {
    Polar { heights: Rows<'a>, azimuths: Rows<'a>, samples: Rows<'a> },
    Grid { x: Rows<'a>, y: Rows<'a> },
}

impl<'a> PlanarTables<'a> {
    pub(super) fn open(tables: &'a Arrays<'a>, field: PsfField) -> Result<Self, LensPackError> {
        let maps = maps(tables)?;
        let places = Places::open(tables, field)?;
        let counts = (0..tables.bands).map(|b| places.count(b)).collect::<Result<Vec<_>, _>>()?;
        let most = counts.iter().copied().max().unwrap_or(0);
        let has_sides = PackArray::open_optional(tables.store, "psf_size")?.is_some();
        Ok(Self {
            maps,
            energy: tables.rows("psf_energy", Some((most, places.sum())))?,
            places,
            pitch: tables.per_band("psf_pitch")?,
            sides: if has_sides { Some(tables.per_band("psf_size")?) } else { None },
        })
    }

    /// Whether the pack has pupil functions in place of PSFs.
    pub(super) fn has_pupils(&self) -> bool {
        self.sides.is_some()
    }

    /// Fills the tables of band `b`; the bytes for reading its PSFs.
    pub(super) fn fill(&mut self, b: usize, band: &mut LensBand) -> Result<usize, LensPackError> {
        let psfs = self.places.fill(b, band)?;
        let count = psfs.count();
        let tables = self.energy.tables;
        let (size, reading_bytes) = match &self.sides {
            // A band may have more than are read at once: those of a height, or of a place, are computed together.
            Some(sides) => pupils::side(tables, b, largest_set(&psfs), sides[b])?,
            None => psfs::size(tables.store, &format!("psf/{b}"), (count, self.places.sum()))?,
        };
        (band.psf_size, band.psf_pitch_um) = (size, self.pitch[b]);
        band.psf_energy = self.energy.first(b, count)?;
        band.planar = self.maps[b].take().map(|map| PlanarBand { map, psfs });
        Ok(reading_bytes)
    }
}

impl<'a> Places<'a> {
    fn open(tables: &'a Arrays<'a>, field: PsfField) -> Result<Self, LensPackError> {
        match field {
            PsfField::Polar => {
                let heights = tables.rows("psf_height", None)?;
                let same = Some((heights.width, "bands, heights of psf_height"));
                let azimuths = tables.rows("azimuth_count", same)?;
                let samples = tables.rows("psf_azimuths", same)?;
                Ok(Self::Polar { heights, azimuths, samples })
            }
            PsfField::Grid => {
                Ok(Self::Grid { x: tables.rows("psf_x", None)?, y: tables.rows("psf_y", None)? })
            }
        }
    }

    /// What the number of PSFs is.
    fn sum(&self) -> &'static str {
        match self {
            Self::Polar { .. } => "PSFs: the sum of psf_azimuths",
            Self::Grid { .. } => "PSFs: columns of psf_x times rows of psf_y",
        }
    }

    /// Number of PSFs of band `b`, within its bound.
    fn count(&self, b: usize) -> Result<usize, LensPackError> {
        let (rows, count) = match self {
            Self::Polar { heights, samples, .. } => {
                let k = heights.numbers(b)?.len();
                (samples, samples.counts(b, k, AZIMUTH_SAMPLES)?.iter().sum())
            }
            Self::Grid { x, y } => (y, x.at_least(b, ONE)?.len() * y.at_least(b, ONE)?.len()),
        };
        match count as f64 <= bounds::PSF_ROWS.max {
            true => Ok(count),
            false => Err(LensPackError::TooLarge {
                path: rows.tables.store.path.clone(),
                array: rows.name.into(),
                stated: format!("{count} PSFs of band {b}"),
                limit: bounds::PSF_ROWS.max.to_string(),
            }),
        }
    }

    /// Fills heights and azimuths of band `b`.
    fn fill(&self, b: usize, band: &mut LensBand) -> Result<PsfPlaces, LensPackError> {
        match self {
            Self::Polar { heights, azimuths, samples } => {
                band.psf_height_mm = heights.numbers(b)?;
                let k = band.psf_height_mm.len();
                band.azimuth_count = azimuths.counts(b, k, AZIMUTHS)?;
                Ok(PsfPlaces::Polar { azimuth_samples: samples.counts(b, k, AZIMUTH_SAMPLES)? })
            }
            Self::Grid { x, y } => {
                Ok(PsfPlaces::Cartesian { x_mm: x.at_least(b, ONE)?, y_mm: y.at_least(b, ONE)? })
            }
        }
    }
}

/// PSFs of a band that are read together: of all azimuths of a height, or one of a grid.
fn largest_set(psfs: &PsfPlaces) -> usize {
    match psfs {
        PsfPlaces::Polar { azimuth_samples } => azimuth_samples.iter().copied().max().unwrap_or(1),
        PsfPlaces::Cartesian { .. } => 1,
    }
}

/// The maps of all bands.
fn maps(tables: &Arrays<'_>) -> Result<Vec<Option<PlanarMap>>, LensPackError> {
    let [x, y] = [nodes(tables, "map_x")?, nodes(tables, "map_y")?];
    let (height, width) = (y.width, x.width);
    let mut maps = (0..tables.bands)
        .map(|b| {
            let (x_mm, y_mm) = (x.numbers(b)?, y.numbers(b)?);
            Ok(PlanarMap {
                x_mm,
                y_mm,
                ideal_x_mm: vec![],
                ideal_y_mm: vec![],
                relative_illumination: vec![],
            })
        })
        .collect::<Result<Vec<_>, LensPackError>>()?;
    type Field = fn(&mut PlanarMap) -> &mut Vec<f64>;
    let fields: [(_, Field); 3] = [
        ("map_ideal_x", |map| &mut map.ideal_x_mm),
        ("map_ideal_y", |map| &mut map.ideal_y_mm),
        ("map_relative_illumination", |map| &mut map.relative_illumination),
    ];
    for (name, field) in fields {
        let array = PackArray::open(tables.store, name)?;
        array.expect_shape(&[tables.bands, height, width], "bands, nodes of map_y, nodes of map_x")?;
        array.expect_at_most(&MAP_NUMBERS)?;
        let values = array.read()?;
        for (b, (map, values)) in maps.iter_mut().zip(values.chunks_exact(height * width)).enumerate() {
            let (rows, columns) = (map.y_mm.len(), map.x_mm.len());
            let table: Vec<f64> =
                values.chunks_exact(width).take(rows).flat_map(|row| &row[..columns]).copied().collect();
            if let Some(i) = table.iter().position(|v| !v.is_finite()) {
                let index = i / columns * width + i % columns;
                return Err(tables.value(name, b, index, table[i], "a finite number"));
            }
            *field(map) = table;
        }
    }
    Ok(maps.into_iter().map(Some).collect())
}

/// Nodes of the maps in one direction, (bands, nodes).
fn nodes<'a>(tables: &'a Arrays<'a>, name: &'static str) -> Result<Rows<'a>, LensPackError> {
    let array = PackArray::open(tables.store, name)?;
    match array.shape[..] {
        [_, width] if bounds::MAP_NODES.contains(width as f64) => tables.rows(name, None),
        _ => Err(array.shape_error(format!("[{}, {} nodes]", tables.bands, bounds::MAP_NODES))),
    }
}
