//! A lens whose distortion is exported.

use crate::args::LensExportArgs;
use crate::commands::lens::comparison::WAVELENGTH_TOLERANCE_NM;
use crate::design;
use crate::failure::usage;
use crate::job::lens::samples::{design_reach_mm, nearest_band};
use crate::open;
use crate::progress::log_line;
use anyhow::{Context, Result};
use formats::lens::LensPack;
use pipeline::camera_model::field_map::FieldSource;
use pipeline::design::System;
use pipeline::design::ray::Tracer;
use pipeline::design::trace::lens_header;
use pipeline::lens::{Lens, LensBand};

/// A lens with rotational symmetry.
pub enum Opened {
    Pack(Box<LensPack>),
    /// A design and its first-order data.
    Design(Box<System>, Box<Lens>),
}

impl Opened {
    /// Opens the lens of `args`.
    ///
    /// # Errors
    /// Usage: a lens without rotational symmetry or with telecentric object space; flags of designs for a pack.
    pub fn new(args: &LensExportArgs) -> Result<Self> {
        let name = &args.lens;
        if !design::is_design(name) {
            let pack = open::symmetric_lens(name)?;
            if args.focus_m.is_some() || args.parameters != Default::default() {
                return Err(usage(format!(
                    "`{name}` is a lens pack, whose film plane and object distance were set when it was traced; the flags for film plane, object, aiming, \
                     glasses and coatings apply to designs only"
                )));
            }
            return Ok(Self::Pack(Box::new(pack)));
        }
        let (system, _) = design::focused(name, &args.parameters, args.focus_m)?;
        if system.asymmetry.is_some() {
            return Err(usage(format!(
                "lens export: expected a lens with rotational symmetry, `{name}` has none: its distortion is no function of the image height"
            )));
        }
        if system.is_telecentric {
            return Err(usage(format!(
                "lens export: `{name}` is telecentric on the object side: it has no centre of projection, and so no camera model"
            )));
        }
        system.notes.iter().for_each(|note| log_line(format!("note: {note}")));
        let header = lens_header(&system).with_context(|| format!("design {name}"))?;
        Ok(Self::Design(Box::new(system), Box::new(header)))
    }

    /// First-order data.
    pub fn lens(&self) -> &Lens {
        match self {
            Self::Pack(pack) => pack.lens(),
            Self::Design(_, lens) => lens,
        }
    }

    /// The wavelength of a pack's band at `nm`, or `nm` itself of a design.
    ///
    /// # Errors
    /// Usage: a pack without such a band.
    pub fn exact_nm(&self, name: &str, nm: f64) -> Result<f64> {
        let nearest = self.nearest_nm(nm);
        match (nearest - nm).abs() < WAVELENGTH_TOLERANCE_NM {
            true => Ok(nearest),
            false => {
                let all: Vec<f64> = self.lens().bands.iter().map(|band| band.wavelength_nm).collect();
                let list = pipeline::wavelengths::format(&all);
                Err(usage(format!("{name} has no band at {nm} nm; its bands are at {list} nm")))
            }
        }
    }

    /// The wavelength of a pack's band next to `nm`, or `nm` itself of a design.
    pub fn nearest_nm(&self, nm: f64) -> f64 {
        match self {
            Self::Pack(pack) => band(pack, nm).wavelength_nm,
            Self::Design(..) => nm,
        }
    }

    /// The chief rays at a wavelength that the lens has.
    ///
    /// # Errors
    /// A glass without an index there.
    pub fn source(&self, nm: f64) -> Result<FieldSource<'_>> {
        Ok(match self {
            Self::Pack(pack) => FieldSource::Band {
                band: band(pack, nm),
                distortion_focal_length_mm: pack.lens().distortion_focal_length_mm,
            },
            Self::Design(system, _) => FieldSource::Design(Box::new(Tracer::new(system, nm / 1e3)?)),
        })
    }

    /// REAL height of the outermost field point of a design, mm, 0 if all are on the axis; that of the tables of a pack.
    pub fn reach_mm(&self) -> Result<f64> {
        match self {
            Self::Pack(pack) => {
                Ok(pack.lens().bands.iter().map(LensBand::reach_mm).fold(f64::INFINITY, f64::min))
            }
            Self::Design(system, _) => design_reach_mm(system),
        }
    }
}

fn band(pack: &LensPack, nm: f64) -> &LensBand {
    &pack.lens().bands[nearest_band(&pack.lens().bands, nm)]
}
