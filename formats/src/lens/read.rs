//! Conversion of a pack's arrays and attributes to the pipeline's tables, with validation of all values.
//!
//! Tables are (bands, field points) or (bands, heights). A band with fewer of them ends its rows with NaN: its number of
//! heights is the number of entries of `psf_height` before the first NaN, and `psf/<band>` has that many windows.

mod cones;
mod depth;
mod ghosts;
mod planar;
mod psfs;
mod pupils;
mod tail;

use super::array::PackArray;
use super::attributes::{Attributes, PackAttributes};
use super::error::LensPackError;
use super::store::PackStore;
pub use ghosts::PackGhosts;
pub(super) use ghosts::{operator as ghost_operator, paths as ghost_paths};
use pipeline::bounds;
use pipeline::lens::{Lens, LensBand};
pub(crate) use planar::MAP_NUMBERS;
pub(super) use psfs::{SUM_TOLERANCE, psf, psfs_of, windows};
pub(super) use pupils::{check_together, pupils};
use std::f64::consts::PI;

/// What a pack has but its PSFs or pupil functions.
pub(super) struct Tables {
    pub(super) lens: Lens,
    pub(super) attributes: PackAttributes,
    pub(super) ghosts: Option<PackGhosts>,
    /// Whether it has pupil functions in place of PSFs.
    pub(super) has_pupils: bool,
    /// Bytes of memory for reading the PSFs of each band, in addition to the samples.
    pub(super) reading_bytes: Vec<usize>,
}

/// Maximum of J_k, and in words.
const AZIMUTHS: (f64, &str) = (bounds::AZIMUTHS.max, "a whole number up to 7200");

/// Chunks in memory while an array is read: a decoded one, and an encoded one, which may have twice its length.
const CHUNKS: usize = 3;

/// Reads every table. `notes` lists the defaults used.
pub(super) fn tables(store: &PackStore, notes: &mut Vec<String>) -> Result<Tables, LensPackError> {
    let head = Attributes::of_group(store)?;
    let wavelength = PackArray::open(store, "wavelength")?;
    let bands = match wavelength.shape[..] {
        [n] if bounds::BANDS.contains(n as f64) => n as usize,
        _ => return Err(wavelength.shape_error(format!("[bands], {}", bounds::BANDS))),
    };
    let tables = Arrays { store, bands };
    let wavelength_nm = tables.per_band("wavelength")?;
    if let Some(b) = (1..bands).find(|&b| wavelength_nm[b] <= wavelength_nm[b - 1]) {
        let expected = "ascending wavelengths";
        return Err(tables.value("wavelength", b, 0, wavelength_nm[b], expected));
    }
    let mut fields = match head.psf_field {
        None => Fields::Radial(FieldTables::open(&tables, &head)?),
        Some(field) => Fields::Planar(planar::PlanarTables::open(&tables, field)?),
    };
    let f_number = head.positive("f_number")?;
    bounds::F_NUMBER.check(f_number).map_err(|e| head.out_of_bounds("f_number", &e))?;
    let solid_angle = tables.per_band_or("solid_angle", || {
        notes.push(format!("solid_angle is missing: default π/(4N²) with N = {f_number}"));
        PI / (4.0 * f_number * f_number)
    })?;
    let transmission = tables.per_band_or("transmission", || {
        notes.push("transmission is missing: default 1".into());
        1.0
    })?;
    let kernel_pitch = tables.per_band_or("kernel_pitch", || 0.0)?;
    let sample = head.sample()?;
    let extras = head.extras()?;
    let mut cones = match extras.has_cones {
        true => cones::read(&tables, head.psf_field.is_none())?,
        false => vec![None; bands],
    };
    let ghosts = extras.has_ghosts.then(|| ghosts::read(&tables)).transpose()?;
    let mut tails = match extras.has_tail {
        true => tail::read(&tables, extras.has_middle)?,
        false => vec![None; bands],
    };
    let (mut lens_bands, mut reading_bytes) = (Vec::with_capacity(bands), Vec::with_capacity(bands));
    for b in 0..bands {
        let mut band = LensBand {
            wavelength_nm: wavelength_nm[b],
            ideal_height_mm: Vec::new(),
            image_height_mm: Vec::new(),
            relative_illumination: Vec::new(),
            azimuth_count: Vec::new(),
            psf_size: 1,
            psf_pitch_um: 1.0,
            kernel_pitch_um: Some(kernel_pitch[b]).filter(|pitch_um| *pitch_um != 0.0),
            psf_energy: Vec::new(),
            solid_angle_sr: solid_angle[b],
            transmission: transmission[b],
            psf_height_mm: Vec::new(),
            tail: tails[b].take(),
            cones: cones[b].take(),
            planar: None,
        };
        let bytes = match &mut fields {
            Fields::Radial(fields) => fields.fill(b, &mut band)?,
            Fields::Planar(fields) => Some(fields.fill(b, &mut band)?),
        };
        if let Some(bytes) = bytes {
            reading_bytes.push(bytes);
            band.check().map_err(|source| LensPackError::Table { path: store.path.clone(), source })?;
        }
        lens_bands.push(band);
    }
    let depth = match &fields {
        Fields::Radial(fields) if head.has_depth => {
            let points = fields.ideal.width;
            Some(depth::read(&tables, &head, points, &mut lens_bands, &mut reading_bytes)?)
        }
        _ => None,
    };
    let has_pupils = match &fields {
        Fields::Radial(_) => head.has_pupils,
        Fields::Planar(fields) => fields.has_pupils(),
    };
    let lens = Lens {
        name: head.text("name").unwrap_or_else(|| {
            notes.push("attribute `name` is missing: default, the file's name".into());
            store.path.file_name().map_or("lens".into(), |n| n.to_string_lossy().into_owned())
        }),
        distortion_focal_length_mm: head.positive("distortion_focal_length_mm")?,
        effective_focal_length_mm: head.positive("effective_focal_length_mm")?,
        f_number,
        primary_wavelength_nm: head.positive("primary_wavelength_nm")?,
        object_distance_mm: head.number_or_null("object_distance_mm")?,
        magnification: head.number_or_null("magnification")?.unwrap_or(0.0),
        psf_sample: sample,
        bands: lens_bands,
        depth,
    };
    lens.check_head().map_err(|(name, e)| head.out_of_bounds(name, &e))?;
    let defocus_mm = head.number_or_null("defocus_mm")?;
    if let Some(Err(e)) = defocus_mm.map(|v| bounds::DEFOCUS_MM.check(v)) {
        return Err(head.out_of_bounds("defocus_mm", &e));
    }
    let attributes = PackAttributes {
        image_plane: head.text("image_plane"),
        defocus_mm,
        frame: head.text("frame"),
        psf_tolerance: head.any("psf_tolerance"),
        source: head.any("source"),
        reference_point: head.reference_point()?,
        errors: head.any("errors"),
        compensators: head.any("compensators"),
        sealed: head.sealed()?,
    };
    Ok(Tables { lens, attributes, ghosts, has_pupils, reading_bytes })
}

/// Tables over image height, or over the film.
enum Fields<'a> {
    Radial(FieldTables<'a>),
    Planar(planar::PlanarTables<'a>),
}

/// Tables over image height.
struct FieldTables<'a> {
    ideal: Rows<'a>,
    image: Rows<'a>,
    illumination: Rows<'a>,
    /// None: those of depth nodes.
    psfs: Option<PsfTables<'a>>,
}

impl<'a> FieldTables<'a> {
    fn open(tables: &'a Arrays<'a>, head: &Attributes<'_>) -> Result<Self, LensPackError> {
        let ideal = tables.rows("ideal_height", None)?;
        let same = Some((ideal.width, "bands, field points of ideal_height"));
        let image = tables.rows("image_height", same)?;
        let illumination = tables.rows("relative_illumination", same)?;
        let psfs = if head.has_depth { None } else { Some(PsfTables::open(tables, head.has_pupils)?) };
        Ok(Self { ideal, image, illumination, psfs })
    }

    /// Fills the tables of band `b`; the bytes for reading its PSFs, if they are not those of depth nodes.
    fn fill(&self, b: usize, band: &mut LensBand) -> Result<Option<usize>, LensPackError> {
        band.ideal_height_mm = self.ideal.numbers(b)?;
        band.image_height_mm = self.image.numbers(b)?;
        band.relative_illumination = self.illumination.numbers(b)?;
        self.psfs.as_ref().map(|psfs| psfs.fill(b, band)).transpose()
    }
}

/// PSF tables of a pack without depth nodes.
struct PsfTables<'a> {
    heights: Rows<'a>,
    azimuths: Rows<'a>,
    energy: Rows<'a>,
    pitch: Vec<f64>,
    /// Sides of the windows that pupil functions have.
    sides: Option<Vec<f64>>,
}

impl<'a> PsfTables<'a> {
    fn open(tables: &'a Arrays<'a>, has_pupils: bool) -> Result<Self, LensPackError> {
        let heights = tables.rows("psf_height", None)?;
        let same = Some((heights.width, "bands, heights of psf_height"));
        Ok(Self {
            azimuths: tables.rows("azimuth_count", same)?,
            energy: tables.rows("psf_energy", same)?,
            pitch: tables.per_band("psf_pitch")?,
            sides: if has_pupils { Some(tables.per_band("psf_size")?) } else { None },
            heights,
        })
    }

    /// Fills the PSF tables of band `b`; the bytes for reading its PSFs.
    fn fill(&self, b: usize, band: &mut LensBand) -> Result<usize, LensPackError> {
        let heights = self.heights.numbers(b)?;
        let k = heights.len();
        let tables = self.heights.tables;
        let (size, reading_bytes) = match &self.sides {
            Some(sides) => pupils::side(tables, b, k, sides[b])?,
            None => psfs::size(tables.store, &format!("psf/{b}"), (k, "heights of psf_height"))?,
        };
        (band.psf_size, band.psf_pitch_um, band.psf_height_mm) = (size, self.pitch[b], heights);
        (band.azimuth_count, band.psf_energy) =
            (self.azimuths.counts(b, k, AZIMUTHS)?, self.energy.first(b, k)?);
        Ok(reading_bytes)
    }
}

struct Arrays<'a> {
    store: &'a PackStore,
    bands: usize,
}

/// A (bands, width) table, or a (bands, nodes, width) one.
struct Rows<'a> {
    tables: &'a Arrays<'a>,
    name: &'static str,
    /// Rows of a band.
    per_band: usize,
    width: usize,
    values: Vec<f64>,
}

impl Arrays<'_> {
    fn value(
        &self,
        array: &'static str,
        band: usize,
        index: usize,
        value: f64,
        expected: &'static str,
    ) -> LensPackError {
        LensPackError::Value {
            path: self.store.path.clone(),
            array: array.into(),
            band,
            index,
            value,
            expected,
        }
    }

    fn finite(&self, name: &'static str, values: Vec<f64>) -> Result<Vec<f64>, LensPackError> {
        match values.iter().position(|v| !v.is_finite()) {
            Some(b) => Err(self.value(name, b, 0, values[b], "a finite number")),
            None => Ok(values),
        }
    }

    /// A required array of one number per band.
    fn per_band(&self, name: &'static str) -> Result<Vec<f64>, LensPackError> {
        let array = PackArray::open(self.store, name)?;
        array.expect_shape(&[self.bands], "bands")?;
        self.finite(name, array.read()?)
    }

    /// An optional array of one number per band.
    fn per_band_or(
        &self,
        name: &'static str,
        default: impl FnOnce() -> f64,
    ) -> Result<Vec<f64>, LensPackError> {
        match PackArray::open_optional(self.store, name)? {
            Some(_) => self.per_band(name),
            // Values without their metadata are what is left of a damaged pack.
            None if matches!(self.store.size(&format!("{name}/c/0")), Ok(Some(_))) => self.per_band(name),
            None => Ok(vec![default(); self.bands]),
        }
    }

    /// A required (bands, width) array; `width` with a description of the axes if it is known already.
    fn rows(&self, name: &'static str, width: Option<(usize, &str)>) -> Result<Rows<'_>, LensPackError> {
        let array = PackArray::open(self.store, name)?;
        let (width, axes) = match (width, &array.shape[..]) {
            (Some(known), _) => known,
            (None, [_, found]) => (*found as usize, "bands, then at least 2"),
            _ => return Err(array.shape_error(format!("[{}, at least 2]", self.bands))),
        };
        array.expect_shape(&[self.bands, width], axes)?;
        array.expect_at_most(&bounds::TABLE_NUMBERS)?;
        Ok(Rows { tables: self, name, per_band: 1, width, values: array.read()? })
    }
}

impl Rows<'_> {
    /// Error of a value of row `row`.
    fn value(&self, row: usize, index: usize, value: f64, expected: &'static str) -> LensPackError {
        let (band, node) = (row / self.per_band, row % self.per_band);
        self.tables.value(self.name, band, node * self.width + index, value, expected)
    }

    fn row(&self, b: usize) -> &[f64] {
        &self.values[b * self.width..][..self.width]
    }

    /// The numbers of a row before its NaN padding, at least 2.
    fn numbers(&self, b: usize) -> Result<Vec<f64>, LensPackError> {
        self.at_least(b, (2, "at least 2 numbers"))
    }

    /// As [`numbers`](Self::numbers), at least `least` of them.
    fn at_least(&self, b: usize, (least, words): (usize, &'static str)) -> Result<Vec<f64>, LensPackError> {
        let row = self.row(b);
        let count = row.iter().position(|v| v.is_nan()).unwrap_or(self.width);
        if let Some(i) = (count..self.width).find(|&i| !row[i].is_nan()) {
            return Err(self.value(b, i, row[i], "NaN to the end of the row after the first NaN"));
        }
        if let Some(i) = row[..count].iter().position(|v| v.is_infinite()) {
            return Err(self.value(b, i, row[i], "a finite number"));
        }
        if count < least {
            let found = row.get(count).copied().unwrap_or(f64::NAN);
            return Err(self.value(b, count, found, words));
        }
        Ok(row[..count].to_vec())
    }

    /// The first `k` numbers, all finite; the padding is ignored.
    fn first(&self, b: usize, k: usize) -> Result<Vec<f64>, LensPackError> {
        let row = &self.row(b)[..k];
        match row.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(self.value(b, i, row[i], "a finite number")),
            None => Ok(row.to_vec()),
        }
    }

    /// The first `k` numbers, all whole up to a maximum that is given in words, too; the padding is ignored.
    fn counts(
        &self,
        b: usize,
        k: usize,
        (max, words): (f64, &'static str),
    ) -> Result<Vec<usize>, LensPackError> {
        let row = &self.row(b)[..k];
        let is_count = |v: f64| (0.0..=max).contains(&v) && v.fract() == 0.0;
        match row.iter().position(|v| !is_count(*v)) {
            Some(i) => Err(self.value(b, i, row[i], words)),
            None => Ok(row.iter().map(|&v| v as usize).collect()),
        }
    }
}
