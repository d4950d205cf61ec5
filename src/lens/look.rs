//! A lens looked at: its tables and PSFs at a few wavelengths and heights, of a pack or freshly traced from a design.

use crate::args::DesignArgs;
use crate::design;
use crate::failure::usage;
use crate::open;
use anyhow::{Context, Result};
use formats::lens::LensPack;
use pipeline::design::describe::{Description, describe, field_tan};
use pipeline::design::paraxial::Paraxial;
use pipeline::design::ray::Tracer;
use pipeline::design::spots::{Spot, spot};
use pipeline::design::trace::{Azimuths, LensTrace, PsfHeights, TraceOptions};
use pipeline::design::{DesignError, System};
use pipeline::figures::PsfWindow;
use pipeline::lens::{Lens, LensBand};
use serde_json::{Value, json};

/// What can be looked at.
pub enum Subject {
    /// A lens pack.
    Pack(Box<LensPack>),
    /// A design and its first-order figures.
    Design(Box<System>, Box<Description>),
}

/// A lens at some wavelengths and heights.
pub struct Look {
    /// Tables of the bands looked at, ascending; `primary` among them or beside.
    pub lens: Lens,
    /// The band that lateral colour is measured from.
    pub primary: LensBand,
    /// What was found, band by band, height by height.
    pub fields: Vec<Vec<Field>>,
}

/// One field point at one wavelength.
pub struct Field {
    /// REAL image height, mm.
    pub height_mm: f64,
    /// Its PSF.
    pub psf: PsfWindow,
    /// Its rays, where there is a design.
    pub spot: Option<Spot>,
}

/// Figures of one field point; what is not known is none.
pub struct Figures {
    pub wavelength_nm: f64,
    pub height_mm: f64,
    pub ideal_height_mm: f64,
    pub illumination: f64,
    pub distortion_percent: f64,
    pub lateral_colour_um: f64,
    /// Geometric for a design, of the PSF inside its window for a pack.
    pub rms_um: f64,
    pub geo_um: Option<f64>,
    pub strehl: Option<f64>,
    pub window_um: f64,
    pub energy: f64,
}

impl Subject {
    /// Opens what `name` says; design flags on a pack are refused.
    pub fn open(name: &str, args: &DesignArgs) -> Result<Self> {
        if design::is_design(name) {
            let system = design::open(name, args)?;
            let description = describe(&system).with_context(|| format!("design {name}"))?;
            return Ok(Self::Design(Box::new(system), Box::new(description)));
        }
        let pack = open::lens(name)?;
        if *args != DesignArgs::default() {
            return Err(usage(format!(
                "`{name}` is a lens pack, made for one film plane and object already; film plane, object, aiming and glasses \
                 are for designs (.zmx, {})",
                design::BUILTIN
            )));
        }
        Ok(Self::Pack(Box::new(pack)))
    }

    /// Name shown to people.
    pub fn name(&self) -> &str {
        match self {
            Self::Pack(pack) => &pack.lens().name,
            Self::Design(system, _) => &system.name,
        }
    }

    /// Primary wavelength, nm.
    pub fn primary_nm(&self) -> f64 {
        match self {
            Self::Pack(pack) => pack.lens().primary_wavelength_nm,
            Self::Design(system, _) => system.primary_um() * 1e3,
        }
    }

    /// Wavelengths it has: a pack's bands, a design's own, ascending.
    pub fn wavelengths_nm(&self) -> Vec<f64> {
        let mut nm: Vec<f64> = match self {
            Self::Pack(pack) => pack.lens().bands.iter().map(|b| b.wavelength_nm).collect(),
            Self::Design(system, _) => system.wavelengths_um.iter().map(|(um, _)| um * 1e3).collect(),
        };
        nm.sort_by(f64::total_cmp);
        nm.dedup();
        nm
    }

    /// The REAL height that all of it reaches, mm: the least of a pack's bands, a design's outermost field point.
    pub fn reach_mm(&self) -> Result<f64> {
        match self {
            Self::Pack(pack) => {
                Ok(pack.lens().bands.iter().map(LensBand::reach_mm).fold(f64::INFINITY, f64::min))
            }
            Self::Design(system, _) => {
                let primary = Paraxial::new(system, system.primary_um())?;
                let tan =
                    system.fields.iter().map(|f| field_tan(system, &primary, *f).abs()).fold(0.0, f64::max);
                let height = Tracer::new(system, system.primary_um())?.chief_height_mm(tan)?;
                match height > 0.0 {
                    true => Ok(height),
                    false => Err(usage(format!(
                        "design `{}` has no field point off the axis; say the heights, e.g. `--heights 0,5,10`",
                        system.name
                    ))),
                }
            }
        }
    }

    /// The band at `nm` with the heights and azimuths that a film's kernels hang on; a design's are chosen by error.
    pub fn nodes(&self, nm: f64, reach_mm: f64) -> Result<LensBand> {
        match self {
            Self::Pack(pack) => Ok(pack.lens().bands[nearest(&pack.lens().bands, nm)].clone()),
            Self::Design(system, _) => {
                let options = TraceOptions::new(vec![nm], reach_mm);
                Ok(LensTrace::new(system, &options)?.band(0, &mut |_| ())?.tables)
            }
        }
    }

    /// Looks at `heights_mm` (ascending) at `nm` (ascending).
    pub fn look(&self, nm: &[f64], heights_mm: &[f64]) -> Result<Look> {
        match self {
            Self::Pack(pack) => of_pack(pack, nm, heights_mm),
            Self::Design(system, _) => {
                of_design(system, nm, heights_mm).with_context(|| format!("tracing {}", system.name))
            }
        }
    }
}

impl Look {
    /// The figures of field point `k` of band `b`.
    pub fn figures(&self, b: usize, k: usize) -> Figures {
        let (band, field) = (&self.lens.bands[b], &self.fields[b][k]);
        let r = field.height_mm;
        Figures {
            wavelength_nm: band.wavelength_nm,
            height_mm: r,
            ideal_height_mm: band.ideal_of(r),
            illumination: band.illumination_of(r),
            distortion_percent: band.distortion_percent(r),
            lateral_colour_um: band.lateral_colour_um(&self.primary, r),
            rms_um: field.spot.map_or_else(|| field.psf.rms_um(), |s| s.rms_um),
            geo_um: field.spot.map(|s| s.geo_um),
            strehl: field.spot.map_or_else(|| field.psf.strehl(band, r), |s| Some(s.strehl)),
            window_um: field.psf.size as f64 * field.psf.pitch_um,
            energy: field.psf.energy,
        }
    }
}

impl Figures {
    /// As JSON.
    pub fn json(&self) -> Value {
        json!({
            "wavelength_nm": self.wavelength_nm,
            "image_height_mm": self.height_mm,
            "ideal_height_mm": self.ideal_height_mm,
            "relative_illumination": self.illumination,
            "distortion_percent": self.distortion_percent,
            "lateral_colour_um": self.lateral_colour_um,
            "rms_um": self.rms_um,
            "geo_um": self.geo_um,
            "strehl": self.strehl,
            "psf_window_um": self.window_um,
            "energy_in_window": self.energy,
        })
    }
}

fn nearest(bands: &[LensBand], nm: f64) -> usize {
    let off = |b: usize| (bands[b].wavelength_nm - nm).abs();
    (0..bands.len()).min_by(|&a, &b| off(a).total_cmp(&off(b))).unwrap_or(0)
}

fn of_pack(pack: &LensPack, nm: &[f64], heights_mm: &[f64]) -> Result<Look> {
    let all = &pack.lens().bands;
    let (mut bands, mut fields) = (Vec::new(), Vec::new());
    for &nm in nm {
        let b = nearest(all, nm);
        let band = &all[b];
        if (band.wavelength_nm - nm).abs() > 1e-6 {
            return Err(usage(format!(
                "{} has no band at {nm} nm, the nearest is {} nm; there are {} nm",
                pack.path().display(),
                band.wavelength_nm,
                pipeline::wavelengths::format(&all.iter().map(|b| b.wavelength_nm).collect::<Vec<_>>())
            )));
        }
        let reach = band.reach_mm();
        if let Some(far) = heights_mm.iter().find(|h| **h > reach * (1.0 + 1e-9)) {
            return Err(usage(format!(
                "{} reaches {reach:.4} mm at {nm} nm, asked for {far} mm; take smaller `--heights`",
                pack.path().display()
            )));
        }
        let stack = pack.psf(b)?;
        let field = |&h: &f64| Field { height_mm: h, psf: band.psf_of(&stack, h), spot: None };
        fields.push(heights_mm.iter().map(field).collect());
        bands.push(band.clone());
    }
    let primary = all[nearest(all, pack.lens().primary_wavelength_nm)].clone();
    Ok(Look { lens: Lens { bands, ..pack.lens().clone() }, primary, fields })
}

fn of_design(system: &System, nm: &[f64], heights_mm: &[f64]) -> Result<Look, DesignError> {
    let last = heights_mm.iter().fold(0.0, |a: f64, b| a.max(*b));
    let mut heights = heights_mm.to_vec();
    if heights.first() != Some(&0.0) {
        heights.insert(0, 0.0);
    }
    if heights.len() < 2 {
        // Only the axis: tables need a second height.
        heights.push(last.max(1e-3));
    }
    let mut options = TraceOptions::new(nm.to_vec(), last.max(1e-3));
    options.heights = PsfHeights::Given(heights);
    options.azimuths = Azimuths::Given(8);
    let trace = LensTrace::new(system, &options)?;
    let (mut lens, mut fields) = (trace.header(), Vec::new());
    for (b, nm) in nm.iter().enumerate() {
        let traced = trace.band(b, &mut |_| ())?;
        let tracer = Tracer::new(system, nm / 1e3)?;
        let field = |&h: &f64| -> Result<Field, DesignError> {
            let spot = spot(&tracer, tracer.field_of_height(h)?)?;
            Ok(Field { height_mm: h, psf: traced.tables.psf_of(&traced.psf, h), spot: Some(spot) })
        };
        fields.push(heights_mm.iter().map(field).collect::<Result<_, _>>()?);
        lens.bands.push(traced.tables);
    }
    // Lateral colour is measured from the design's own primary, looked at or not.
    let alone = TraceOptions {
        wavelengths_nm: vec![system.primary_um() * 1e3],
        window_px: Some(3),
        heights: PsfHeights::Given(vec![0.0, last.max(1e-3)]),
        ..options.clone()
    };
    let primary = LensTrace::new(system, &alone)?.band(0, &mut |_| ())?.tables;
    Ok(Look { lens, primary, fields })
}
