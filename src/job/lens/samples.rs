//! Tables and PSFs of a lens at some wavelengths and heights, read from a pack or traced from a design.

use crate::args::{DESIGN_FILES, DesignArgs};
use crate::design;
use crate::failure::usage;
use crate::open;
use anyhow::{Context, Result};
use formats::lens::LensPack;
use pipeline::design::describe::{Description, describe, field_tan};
use pipeline::design::paraxial::Paraxial;
use pipeline::design::ray::Tracer;
use pipeline::design::spots::{Spot, spot};
use pipeline::design::trace::{Azimuths, LensTrace, PsfHeights, TraceOptions, TracedBand};
use pipeline::design::{DesignError, System};
use pipeline::figures::PsfWindow;
use pipeline::lens::{Lens, LensBand};
use serde_json::{Value, json};
use std::path::Path;

/// Lens pack or design.
pub enum LensData {
    Pack(Box<LensPack>),
    /// A design and its first-order data.
    Design(Box<System>, Box<Description>),
}

/// A lens sampled at some wavelengths and heights.
pub struct LensSamples {
    /// Tables of the sampled bands, ascending by wavelength.
    pub lens: Lens,
    /// Band of the primary wavelength, the reference of lateral colour.
    pub primary: LensBand,
    /// Field points by band and height.
    pub fields: Vec<Vec<Field>>,
}

/// One field point at one wavelength.
pub struct Field {
    /// REAL image height, mm.
    pub height_mm: f64,
    pub psf: PsfWindow,
    /// Spot diagram; only of a design.
    pub spot: Option<Spot>,
}

/// Figures of one field point.
pub struct FieldFigures {
    pub wavelength_nm: f64,
    /// REAL image height.
    pub height_mm: f64,
    pub ideal_height_mm: f64,
    pub illumination: f64,
    /// Projected solid angle of the bundle at the film relative to the axis; only of a design.
    pub relative_projected_solid_angle: Option<f64>,
    pub distortion_percent: f64,
    pub lateral_colour_um: f64,
    /// RMS radius: of the spot for a design, of the PSF inside its window for a pack.
    pub rms_um: f64,
    /// Maximum radius of the spot; only of a design.
    pub geo_um: Option<f64>,
    /// Strehl ratio; none if the pack's samples do not determine it.
    pub strehl: Option<f64>,
    /// Working F-numbers along and across the meridian; only of a design.
    pub f_numbers: Option<[f64; 2]>,
    /// Side of the PSF window.
    pub window_um: f64,
    /// Share of the light inside the window.
    pub energy: f64,
}

/// At most `max` indices below `count`, evenly spaced, including the first and the last.
pub fn evenly_spaced(count: usize, max: usize) -> Vec<usize> {
    let shown = count.min(max);
    (0..shown).map(|i| (i * (count - 1) + (shown - 1) / 2) / (shown - 1).max(1)).collect()
}

/// Index of the band nearest `nm`; 0 for an empty list.
pub fn nearest_band(bands: &[LensBand], nm: f64) -> usize {
    nearest(bands.iter().map(|b| b.wavelength_nm), nm)
}

/// Index of the wavelength nearest `nm`; 0 for an empty list.
pub fn nearest(wavelengths_nm: impl Iterator<Item = f64>, nm: f64) -> usize {
    let distances = wavelengths_nm.map(|w| (w - nm).abs()).enumerate();
    distances.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |nearest| nearest.0)
}

impl LensData {
    /// Opens the lens `name`; design flags are an error for a pack.
    pub fn open(name: &str, args: &DesignArgs) -> Result<Self> {
        match design::is_design(name) {
            true => Self::of_design(name, design::open(name, args)?),
            false => Self::of_pack(name, open::symmetric_lens(name)?, args),
        }
    }

    /// The design `system`, read as `name`.
    ///
    /// # Errors
    /// It has no rotational symmetry or no first-order properties.
    pub fn of_design(name: &str, mut system: System) -> Result<Self> {
        // A design without a name has that of its file in titles.
        if system.name.trim().is_empty() {
            system.name =
                Path::new(name).file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        }
        let description = describe(&system).with_context(|| format!("design {name}"))?;
        Ok(Self::Design(Box::new(system), Box::new(description)))
    }

    /// The pack opened as `name`.
    ///
    /// # Errors
    /// Usage: flags of designs.
    pub fn of_pack(name: &str, pack: LensPack, args: &DesignArgs) -> Result<Self> {
        if *args != DesignArgs::default() {
            return Err(usage(format!(
                "`{name}` is a lens pack with a fixed film plane and object distance; the flags for film plane, object, aiming \
                 and glasses apply to designs only ({DESIGN_FILES}, {} and other built-in ones)",
                design::BUILTIN
            )));
        }
        Ok(Self::Pack(Box::new(pack)))
    }

    pub fn name(&self) -> &str {
        match self {
            Self::Pack(pack) => &pack.lens().name,
            Self::Design(system, _) => &system.name,
        }
    }

    pub fn primary_nm(&self) -> f64 {
        match self {
            Self::Pack(pack) => pack.lens().primary_wavelength_nm,
            Self::Design(system, _) => system.primary_um() * 1e3,
        }
    }

    /// Wavelengths of the pack's bands or of the design, ascending.
    pub fn wavelengths_nm(&self) -> Vec<f64> {
        let mut nm: Vec<f64> = match self {
            Self::Pack(pack) => pack.lens().bands.iter().map(|b| b.wavelength_nm).collect(),
            // Without the digits of rounding: 486.1, not 486.09999999999997.
            Self::Design(system, _) => {
                system.wavelengths_um.iter().map(|(um, _)| (um * 1e9).round() / 1e6).collect()
            }
        };
        nm.sort_by(f64::total_cmp);
        nm.dedup();
        nm
    }

    /// Maximum REAL height, mm, that all bands of a pack reach; of a design, that of its outermost field point, 0 if all are on the axis.
    pub fn reach_mm(&self) -> Result<f64> {
        match self {
            Self::Pack(pack) => {
                Ok(pack.lens().bands.iter().map(LensBand::reach_mm).fold(f64::INFINITY, f64::min))
            }
            Self::Design(system, _) => design_reach_mm(system),
        }
    }

    /// Band at `nm` with the heights and azimuths of the nodes; those of a design are chosen by the tolerance.
    pub fn nodes(&self, nm: f64, reach_mm: f64) -> Result<LensBand> {
        match self {
            Self::Pack(pack) => Ok(pack.lens().bands[nearest_band(&pack.lens().bands, nm)].clone()),
            Self::Design(system, _) => {
                let options = TraceOptions::new(vec![nm], reach_mm);
                Ok(traced_band(system, &options, 0)?.tables)
            }
        }
    }

    /// Samples at `heights_mm` (ascending) and `nm` (ascending).
    pub fn sample(&self, nm: &[f64], heights_mm: &[f64]) -> Result<LensSamples> {
        match self {
            Self::Pack(pack) => sample_pack(pack, nm, heights_mm),
            Self::Design(system, _) => {
                sample_design(system, nm, heights_mm).with_context(|| format!("tracing {}", system.name))
            }
        }
    }
}

/// REAL height of the outermost field point of a design, mm; 0 if all are on the axis.
pub fn design_reach_mm(system: &System) -> Result<f64> {
    let primary = Paraxial::new(system, system.primary_um())?;
    let tan = system.fields.iter().map(|f| field_tan(system, &primary, *f).abs()).fold(0.0, f64::max);
    let tracer = Tracer::new(system, system.primary_um())?;
    // The outermost chief ray may end inside the lens: then the outermost one that arrives.
    let (farthest_mm, farthest_tan) = tracer.farthest_field();
    let height = if tan < farthest_tan { tracer.chief_height_mm(tan).ok() } else { None };
    Ok(height.filter(|mm| *mm >= 0.0).unwrap_or(farthest_mm))
}

impl LensSamples {
    /// Figures of field point `k` of band `b`.
    pub fn figures(&self, b: usize, k: usize) -> FieldFigures {
        let (band, field) = (&self.lens.bands[b], &self.fields[b][k]);
        let r = field.height_mm;
        FieldFigures {
            wavelength_nm: band.wavelength_nm,
            height_mm: r,
            ideal_height_mm: band.ideal_height_at(r),
            illumination: band.illumination_at(r),
            relative_projected_solid_angle: None,
            distortion_percent: band.distortion_percent(r),
            lateral_colour_um: band.lateral_colour_um(&self.primary, r),
            rms_um: field.spot.map_or_else(|| field.psf.rms_um(), |s| s.rms_um),
            geo_um: field.spot.map(|s| s.geo_um),
            f_numbers: None,
            strehl: field.spot.map_or_else(|| field.psf.strehl(band, r), |s| Some(s.strehl)),
            window_um: field.psf.size as f64 * field.psf.pitch_um,
            energy: field.psf.energy,
        }
    }
}

impl FieldFigures {
    pub fn json(&self) -> Value {
        json!({
            "wavelength_nm": self.wavelength_nm,
            "image_height_mm": self.height_mm,
            "ideal_height_mm": self.ideal_height_mm,
            "relative_illumination": self.illumination,
            "relative_projected_solid_angle": self.relative_projected_solid_angle,
            "distortion_percent": self.distortion_percent,
            "lateral_colour_um": self.lateral_colour_um,
            "rms_um": self.rms_um,
            "geo_um": self.geo_um,
            "strehl": self.strehl,
            "working_f_number_tangential": self.f_numbers.map(|f| f[0]),
            "working_f_number_sagittal": self.f_numbers.map(|f| f[1]),
            "psf_window_um": self.window_um,
            "energy_in_window": self.energy,
        })
    }
}

fn sample_pack(pack: &LensPack, nm: &[f64], heights_mm: &[f64]) -> Result<LensSamples> {
    let all = &pack.lens().bands;
    let (mut bands, mut fields) = (Vec::new(), Vec::new());
    for &nm in nm {
        let b = nearest_band(all, nm);
        let band = &all[b];
        if (band.wavelength_nm - nm).abs() > 1e-6 {
            return Err(usage(format!(
                "{} has no band at {nm} nm, the nearest is at {} nm; its bands are at {} nm",
                pack.path().display(),
                band.wavelength_nm,
                pipeline::wavelengths::format(&all.iter().map(|b| b.wavelength_nm).collect::<Vec<_>>())
            )));
        }
        let reach = band.reach_mm();
        if let Some(far) = heights_mm.iter().find(|h| **h > reach * (1.0 + 1e-9)) {
            return Err(usage(format!(
                "{} has data up to {reach:.4} mm image height at {nm} nm, requested are {far} mm; give smaller `--heights`",
                pack.path().display()
            )));
        }
        let stack = pack.psf(b)?;
        let field = |&h: &f64| Field { height_mm: h, psf: band.psf_at(&stack, h), spot: None };
        fields.push(heights_mm.iter().map(field).collect());
        bands.push(band.clone());
    }
    let primary = all[nearest_band(all, pack.lens().primary_wavelength_nm)].clone();
    Ok(LensSamples { lens: Lens { bands, ..pack.lens().clone() }, primary, fields })
}

/// Band `index` of a design; if no window holds its light, in the largest one: figures then show a part of the PSF.
fn traced_band(system: &System, options: &TraceOptions, index: usize) -> Result<TracedBand, DesignError> {
    match LensTrace::new(system, options)?.band(index, &mut |_| ()) {
        Err(DesignError::Window { max_px, .. }) => {
            let cropped = TraceOptions { window_px: Some(max_px), ..options.clone() };
            LensTrace::new(system, &cropped)?.band(index, &mut |_| ())
        }
        band => band,
    }
}

fn sample_design(system: &System, nm: &[f64], heights_mm: &[f64]) -> Result<LensSamples, DesignError> {
    let last = heights_mm.iter().fold(0.0, |a: f64, b| a.max(*b));
    let mut heights = heights_mm.to_vec();
    if heights.first() != Some(&0.0) {
        heights.insert(0, 0.0);
    }
    if heights.len() < 2 {
        // Tables need a second height besides the axis.
        heights.push(last.max(1e-3));
    }
    let mut options = TraceOptions::new(nm.to_vec(), last.max(1e-3));
    options.heights = PsfHeights::Given(heights);
    options.azimuths = Azimuths::Given(8);
    let trace = LensTrace::new(system, &options)?;
    let (mut lens, mut fields) = (trace.header(), Vec::new());
    for (b, nm) in nm.iter().enumerate() {
        let traced = traced_band(system, &options, b)?;
        let tracer = Tracer::new(system, nm / 1e3)?;
        let field = |&h: &f64| -> Result<Field, DesignError> {
            let spot = spot(&tracer, tracer.field_of_height(h)?)?;
            Ok(Field { height_mm: h, psf: traced.tables.psf_at(&traced.psf, h), spot: Some(spot) })
        };
        fields.push(heights_mm.iter().map(field).collect::<Result<_, _>>()?);
        lens.bands.push(traced.tables);
    }
    // Reference of lateral colour, which may not be among the sampled wavelengths.
    let primary = TraceOptions {
        wavelengths_nm: vec![system.primary_um() * 1e3],
        window_px: Some(3),
        heights: PsfHeights::Given(vec![0.0, last.max(1e-3)]),
        ..options.clone()
    };
    let primary = LensTrace::new(system, &primary)?.band(0, &mut |_| ())?.tables;
    Ok(LensSamples { lens, primary, fields })
}
