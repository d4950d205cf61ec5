//! Reader of sequential .zmx lens files (text): surfaces STANDARD and EVENASPH.
//!
//! Each keyword is either read or listed as not changing the optics; any other is an error with its line. Merit function, tolerances
//! and multi-configuration data follow the last surface. The surfaces already have the saved configuration, so lines there with an
//! operand and numbers are skipped, and more than one configuration is noted.
//! Lengths are converted from lens units to mm. Apertures: CLAP and FLAP (outer radius), and a fixed semi-diameter (DIAM with flag 1)
//! on a refracting surface, which the design program treats as a floating aperture. Of pickups and solves the saved values are used.
//! Wavelengths and indices are relative to air at 20 °C, 1 atm; adjustment of indices to another environment is an error.
//! Not supported, with a specific error: mirrors, tilts, other surface types, apodised pupils, telecentric objects, obscurations, model
//! glasses with dispersion, vignetting factors where no surface has an aperture.

mod line;
mod surface;

use super::error::DesignError;
use super::glass::GlassCatalog;
use super::system::{Aperture, FieldKind, RayAiming, System};
use super::text::decode;
use crate::real;
use line::{Line, UNKNOWN_KEYWORD};
use surface::SurfaceDraft;

/// Header keywords that do not change the optics: bookkeeping, display, weights, polarisation and non-sequential defaults.
const HEADER_SKIPPED: &[&str] = &[
    "VERS", "AUTH", "IWDP", "PFIL", "LANG", "NOTE", "PUPD", "EFFL", "GCAT", "PUSH", "SDMA", "OMMA", "ROPD",
    "HYPR", "PICB", "FWGT", "FWGN", "WWGT", "WWGN", "POLS", "GLRS", "GSTD", "NSCD", "COFN", "LUID", "EERA",
    "BLNK", "DBDT", "FCOM", "VANN", "ZVAN", "TOLS", "SYNC",
];

/// Reads a lens.
///
/// # Errors
/// [`DesignError::Line`] for a wrong or unknown line; [`DesignError::Incomplete`] for a missing part.
pub fn parse(bytes: &[u8], glasses: &GlassCatalog) -> Result<System, DesignError> {
    let text = decode(bytes);
    let mut reader = Reader::default();
    for (i, raw) in text.lines().enumerate() {
        let words: Vec<&str> = raw.split_whitespace().collect();
        let Some(&key) = words.first() else { continue };
        let line = Line { number: i + 1, text: raw.trim(), words: &words };
        // A surface's lines are indented; the first line that is not, after surfaces, ends them.
        if key == "SURF" {
            reader.start_surface(&line)?;
        } else if reader.in_surface && raw.starts_with([' ', '\t']) {
            reader.surface_line(key, &line, glasses)?;
        } else {
            reader.in_surface = false;
            reader.header_line(key, &line)?;
        }
    }
    reader.finish()
}

impl System {
    /// The built-in lens: "Double Gauss 28 degree field".
    pub fn double_gauss_28() -> Self {
        let text = include_bytes!("../../../data/double-gauss-28.zmx");
        parse(text, &GlassCatalog::schott()).expect("the built-in design is valid")
    }
}

#[derive(Default)]
struct Reader {
    name: String,
    scale: Option<f64>,
    sequential: bool,
    aperture: Option<Aperture>,
    aiming: Option<RayAiming>,
    field_kind: Option<FieldKind>,
    field_count: usize,
    x: Vec<f64>,
    y: Vec<f64>,
    wave_count: usize,
    waves: Vec<(usize, f64, f64)>,
    primary: usize,
    surfaces: Vec<SurfaceDraft>,
    stop: Option<usize>,
    in_surface: bool,
    vignetting: Option<(usize, String)>,
    notes: Vec<String>,
}

impl Reader {
    fn start_surface(&mut self, line: &Line<'_>) -> Result<(), DesignError> {
        let index = line.value(1)?;
        if index != self.surfaces.len() as f64 {
            return Err(line.error(format!("expected surface {}", self.surfaces.len())));
        }
        self.surfaces.push(SurfaceDraft::default());
        self.in_surface = true;
        Ok(())
    }

    fn header_line(&mut self, key: &str, line: &Line<'_>) -> Result<(), DesignError> {
        let first = || line.value(1);
        match key {
            "MODE" => match line.words.get(1) {
                Some(&"SEQ") => self.sequential = true,
                _ => return Err(line.error("only sequential designs (MODE SEQ) can be traced")),
            },
            "NAME" => self.name = line.text.get(4..).unwrap_or_default().trim().to_owned(),
            "UNIT" => {
                self.scale = Some(match line.words.get(1) {
                    Some(&"MM") => 1.0,
                    Some(&"CM") => 10.0,
                    Some(&("IN" | "INCH")) => 25.4,
                    Some(&("METER" | "M")) => 1000.0,
                    _ => return Err(line.error("expected the lens unit MM, CM, IN or METER")),
                });
            }
            "ENPD" => self.aperture = Some(Aperture::EntrancePupil(first()?)),
            "FNUM" => {
                let f = first()?;
                let working = line.value_or(2, 0.0)? != 0.0;
                self.aperture =
                    Some(if working { Aperture::WorkingFNumber(f) } else { Aperture::ImageFNumber(f) });
            }
            "OBNA" => {
                if line.value_or(2, 0.0)? != 0.0 {
                    return Err(line.error("an object cone angle is not supported; give the NA"));
                }
                self.aperture = Some(Aperture::ObjectNa(first()?));
            }
            // The semi-diameter of the stop is read later, with its surface.
            "FLOA" => self.aperture = Some(Aperture::StopRadius(0.0)),
            "RAIM" => {
                self.aiming = Some(match line.value_or(2, 0.0)? as i64 {
                    0 => RayAiming::Paraxial,
                    _ => RayAiming::Real,
                });
            }
            "FTYP" => {
                self.field_kind =
                    Some(match line.value(1)? as i64 {
                        0 => FieldKind::Angle,
                        1 => FieldKind::ObjectHeight,
                        2 => FieldKind::ParaxialImageHeight,
                        _ => return Err(line.error(
                            "expected field type 0 (angle), 1 (object height) or 2 (paraxial image height)",
                        )),
                    });
                if line.value_or(2, 0.0)? != 0.0 {
                    return Err(line.error("a telecentric object space is not supported"));
                }
                self.field_count = line.value_or(3, 1.0)?.clamp(0.0, 1000.0) as usize;
                self.wave_count = line.value_or(4, 0.0)?.clamp(0.0, 1000.0) as usize;
            }
            "XFLN" | "XFLD" => self.x = line.values()?,
            "YFLN" | "YFLD" => self.y = line.values()?,
            "WAVM" => {
                let index = line.value(1)?;
                if !(1.0..1000.0).contains(&index) {
                    return Err(line.error("expected a wavelength number from 1"));
                }
                let um = line.value(2)?;
                let weight = line.value_or(3, 1.0)?;
                self.waves.retain(|w| w.0 != index as usize);
                self.waves.push((index as usize, um, weight));
            }
            "WAVL" | "WAVN" => {
                if self.waves.is_empty() {
                    self.waves =
                        line.values()?.into_iter().enumerate().map(|(i, um)| (i + 1, um, 1.0)).collect();
                }
            }
            "PWAV" => self.primary = line.value(1)?.clamp(0.0, 1000.0) as usize,
            "ENVD" => {
                let (t, p) = (first()?, line.value_or(2, 1.0)?);
                if line.value_or(3, 0.0)? != 0.0 && (t != 20.0 || p != 1.0) {
                    return Err(
                        line.error("indices adjusted to another temperature or pressure are not supported")
                    );
                }
            }
            "GFAC" => {
                if first()? != 0.0 {
                    return Err(line.error("an apodised pupil is not supported"));
                }
            }
            "VDXN" | "VDYN" | "VCXN" | "VCYN" | "ZVDX" | "ZVDY" | "ZVCX" | "ZVCY" => {
                if line.values()?.iter().any(|v| *v != 0.0) && self.vignetting.is_none() {
                    self.vignetting = Some((line.number, line.quote()));
                }
            }
            "MNUM" => {
                let (count, current) = (first()?, line.value_or(2, 1.0)?);
                if count > 1.0 {
                    self.notes.push(format!("configuration {current} of {count}, as it was saved"));
                }
            }
            _ if HEADER_SKIPPED.contains(&key) => {}
            _ if !self.surfaces.is_empty() && is_operand(key) => {}
            _ => return Err(line.error(UNKNOWN_KEYWORD)),
        }
        Ok(())
    }

    fn surface_line(
        &mut self,
        key: &str,
        line: &Line<'_>,
        glasses: &GlassCatalog,
    ) -> Result<(), DesignError> {
        let index = self.surfaces.len() - 1;
        match key {
            "STOP" => self.stop = Some(index),
            _ => self.surfaces[index].read_line(key, line, self.scale.unwrap_or(1.0), glasses)?,
        }
        Ok(())
    }

    fn finish(self) -> Result<System, DesignError> {
        let no = |problem: &str| DesignError::Incomplete { problem: problem.to_owned() };
        if !self.sequential {
            return Err(no("has no MODE SEQ line; is it a sequential .zmx file?"));
        }
        let mut notes = self.notes;
        let scale = self.scale.ok_or_else(|| no("has no UNIT line"))?;
        let count = self.surfaces.len();
        if count < 3 {
            return Err(no("has fewer than three surfaces (object, one more, image)"));
        }
        let stop = self
            .stop
            .filter(|s| *s > 0 && *s < count - 1)
            .ok_or_else(|| no("has no STOP among its inner surfaces"))?;
        if self.surfaces[0].glass.is_some() {
            return Err(no("has its object inside glass"));
        }
        let object = self.surfaces[0].thickness;
        let object_distance_mm = object.is_finite().then_some(object);
        let mut surfaces = Vec::new();
        for (i, draft) in self.surfaces.iter().enumerate().skip(1) {
            surfaces.push(draft.surface(i, i == count - 1, scale)?);
        }
        if let Some((line, text)) = self.vignetting {
            if surfaces.iter().all(|s| s.aperture_mm.is_none()) {
                let problem = "vignetting factors without a fixed aperture on any surface: fix the semi-diameters that vignette, or zero the factors";
                return Err(DesignError::Line { line, text, problem: problem.to_owned() });
            }
            notes.push("the design's vignetting factors are not used: its apertures are traced".to_owned());
        }
        let aperture =
            match self.aperture.ok_or_else(|| no("gives no aperture (ENPD, FNUM, OBNA or FLOA)"))? {
                Aperture::EntrancePupil(d) => Aperture::EntrancePupil(d * scale),
                Aperture::StopRadius(_) => Aperture::StopRadius(self.surfaces[stop].semi_diameter),
                other => other,
            };
        let mut waves = self.waves;
        waves.sort_by_key(|w| w.0);
        if self.wave_count > 0 {
            waves.truncate(self.wave_count);
        }
        let field_kind = self.field_kind.ok_or_else(|| no("gives no field type (FTYP)"))?;
        let unit = if field_kind == FieldKind::Angle { 1.0 } else { scale };
        let at = |v: &[f64], i: usize| v.get(i).copied().unwrap_or(0.0);
        let fields = (0..self.field_count.max(1))
            .map(|i| unit * real::hypot(at(&self.x, i), at(&self.y, i)))
            .collect();
        if self.aiming.is_none() {
            notes.push("no ray aiming given: rays are aimed at the paraxial entrance pupil".to_owned());
        }
        let system = System {
            name: self.name,
            object_distance_mm,
            surfaces,
            stop: stop - 1,
            aperture,
            field_kind,
            fields,
            wavelengths_um: waves.into_iter().map(|(_, um, weight)| (um, weight)).collect(),
            primary: self.primary.max(1) - 1,
            aiming: self.aiming.unwrap_or(RayAiming::Paraxial),
            notes,
        };
        system.check()?;
        Ok(system)
    }
}

/// Merit function, tolerance and configuration operands: two to four capital letters or digits.
fn is_operand(key: &str) -> bool {
    (2..=4).contains(&key.len()) && key.bytes().all(|b| b.is_ascii_uppercase() || b.is_ascii_digit())
}
