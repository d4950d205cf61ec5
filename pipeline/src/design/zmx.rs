//! Reader of sequential .zmx lens files (text): surfaces STANDARD and EVENASPH.
//!
//! Every word is on one of two lists: read, or known not to change the optics. Anything else is an error with its line. After the last surface
//! come merit function, tolerances and multi-configuration data: the surfaces already hold the configuration as it was saved,
//! so a line there that is a word followed by numbers is skipped, and more than one configuration is noted.
//! Lens units become mm. Apertures: CLAP and FLAP (outer radius), and a fixed semi-diameter (DIAM with flag 1) on a surface
//! that bends light, which the design program treats as a floating aperture. Pickups and solves: their saved values are taken.
//! Wavelengths and indices are relative to air at 20 °C, 1 atm; a system that adjusts indices to another environment is refused.
//! Refused by name: mirrors, tilts, other surface types, apodised pupils, telecentric objects, obscurations, model glasses with
//! dispersion, vignetting factors where no surface has an aperture to trace the vignetting with.

use super::error::DesignError;
use super::glass::{Dispersion, Glass, GlassCatalog};
use super::surface::Shape;
use super::system::{Aperture, FieldKind, Medium, RayAiming, Surface, System};
use super::text::decode;
use crate::real;

/// Header words that do not change the optics: bookkeeping, display, weights, polarisation and non-sequential defaults.
const HEADER_SKIPPED: &[&str] = &[
    "VERS", "AUTH", "IWDP", "PFIL", "LANG", "NOTE", "PUPD", "EFFL", "GCAT", "PUSH", "SDMA", "OMMA", "ROPD",
    "HYPR", "PICB", "FWGT", "FWGN", "WWGT", "WWGN", "POLS", "GLRS", "GSTD", "NSCD", "COFN", "LUID", "EERA",
    "BLNK", "DBDT", "FCOM", "VANN", "ZVAN", "TOLS", "SYNC",
];

/// Surface words that do not change the optics: comments, drawing, coatings (transmission is not modelled), saved solves.
const SURFACE_SKIPPED: &[&str] = &[
    "SSID", "COMM", "FIMP", "HIDE", "MIRR", "SLAB", "POPS", "MEMA", "COAT", "PZUP", "PKUP", "MAZH", "SCOL",
    "SDRW", "SPID", "TPRI", "CSHP",
];

/// Reads a lens.
///
/// # Errors
/// [`DesignError::Line`] for what is wrong or not understood; [`DesignError::UnknownGlass`]; [`DesignError::Incomplete`].
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

struct Line<'a> {
    number: usize,
    text: &'a str,
    words: &'a [&'a str],
}

impl Line<'_> {
    fn bad(&self, problem: impl Into<String>) -> DesignError {
        let text = self.text.chars().take(80).collect();
        DesignError::Line { line: self.number, text, problem: problem.into() }
    }

    fn value(&self, i: usize) -> Result<f64, DesignError> {
        let word =
            self.words.get(i).ok_or_else(|| self.bad(format!("expected a number as word {}", i + 1)))?;
        self.finite(word)
    }

    /// A trailing number that older files leave out.
    fn value_or(&self, i: usize, missing: f64) -> Result<f64, DesignError> {
        self.words.get(i).map_or(Ok(missing), |w| self.finite(w))
    }

    fn finite(&self, word: &str) -> Result<f64, DesignError> {
        let v: Option<f64> = word.parse().ok();
        v.filter(|v| v.is_finite()).ok_or_else(|| self.bad(format!("`{word}` is not a number")))
    }

    fn values(&self) -> Result<Vec<f64>, DesignError> {
        self.words[1..].iter().map(|w| self.finite(w)).collect()
    }
}

#[derive(Default)]
struct Draft {
    shape: Shape,
    asphere: bool,
    thickness: f64,
    glass: Option<Glass>,
    fixed: Option<f64>,
    semi_diameter: f64,
    clear: Option<f64>,
    parameters: Vec<(usize, f64, usize, String)>,
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
    surfaces: Vec<Draft>,
    stop: Option<usize>,
    in_surface: bool,
    vignetting: Option<(usize, String)>,
    notes: Vec<String>,
}

impl Reader {
    fn start_surface(&mut self, line: &Line<'_>) -> Result<(), DesignError> {
        let index = line.value(1)?;
        if index != self.surfaces.len() as f64 {
            return Err(line.bad(format!("expected surface {}", self.surfaces.len())));
        }
        self.surfaces.push(Draft::default());
        self.in_surface = true;
        Ok(())
    }

    fn header_line(&mut self, key: &str, line: &Line<'_>) -> Result<(), DesignError> {
        let first = || line.value(1);
        match key {
            "MODE" => match line.words.get(1) {
                Some(&"SEQ") => self.sequential = true,
                _ => return Err(line.bad("only sequential designs (MODE SEQ) can be traced")),
            },
            "NAME" => self.name = line.text.get(4..).unwrap_or_default().trim().to_owned(),
            "UNIT" => {
                self.scale = Some(match line.words.get(1) {
                    Some(&"MM") => 1.0,
                    Some(&"CM") => 10.0,
                    Some(&("IN" | "INCH")) => 25.4,
                    Some(&("METER" | "M")) => 1000.0,
                    _ => return Err(line.bad("expected the lens unit MM, CM, IN or METER")),
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
                    return Err(line.bad("an object cone angle is not supported; give the NA"));
                }
                self.aperture = Some(Aperture::ObjectNa(first()?));
            }
            // The stop's semi-diameter is known once its surface is read.
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
                        _ => return Err(line.bad(
                            "expected field type 0 (angle), 1 (object height) or 2 (paraxial image height)",
                        )),
                    });
                if line.value_or(2, 0.0)? != 0.0 {
                    return Err(line.bad("a telecentric object space is not supported"));
                }
                self.field_count = line.value_or(3, 1.0)?.clamp(0.0, 1000.0) as usize;
                self.wave_count = line.value_or(4, 0.0)?.clamp(0.0, 1000.0) as usize;
            }
            "XFLN" | "XFLD" => self.x = line.values()?,
            "YFLN" | "YFLD" => self.y = line.values()?,
            "WAVM" => {
                let index = line.value(1)?;
                if !(1.0..1000.0).contains(&index) {
                    return Err(line.bad("expected a wavelength number from 1"));
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
                        line.bad("indices adjusted to another temperature or pressure are not supported")
                    );
                }
            }
            "GFAC" => {
                if first()? != 0.0 {
                    return Err(line.bad("an apodised pupil is not supported"));
                }
            }
            "VDXN" | "VDYN" | "VCXN" | "VCYN" | "ZVDX" | "ZVDY" | "ZVCX" | "ZVCY" => {
                if line.values()?.iter().any(|v| *v != 0.0) && self.vignetting.is_none() {
                    self.vignetting = Some((line.number, line.text.chars().take(80).collect()));
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
            _ => {
                return Err(line.bad(
                    "this word is not understood, and it might change the optics; remove it if it does not",
                ));
            }
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
        let scale = self.scale.unwrap_or(1.0);
        let s = &mut self.surfaces[index];
        match key {
            "TYPE" => match line.words.get(1) {
                Some(&"STANDARD") => s.asphere = false,
                Some(&"EVENASPH") => s.asphere = true,
                Some(kind) => {
                    return Err(
                        line.bad(format!("surface type {kind} is not supported, only STANDARD and EVENASPH"))
                    );
                }
                None => return Err(line.bad("expected a surface type")),
            },
            "CURV" => s.shape.curvature = line.value(1)? / scale,
            "CONI" => s.shape.conic = line.value(1)?,
            "DISZ" => {
                s.thickness = match line.words.get(1) {
                    Some(&"INFINITY") => f64::INFINITY,
                    _ => line.value(1)? * scale,
                };
            }
            "PARM" => {
                let (i, v) = (line.value(1)?, line.value(2)?);
                if v != 0.0 {
                    s.parameters.push((
                        i.clamp(0.0, 99.0) as usize,
                        v,
                        line.number,
                        line.text.chars().take(80).collect(),
                    ));
                }
            }
            "GLAS" => s.glass = Some(glass(line, glasses)?),
            "DIAM" => {
                s.semi_diameter = line.value(1)? * scale;
                s.fixed = (line.value_or(2, 0.0)? == 1.0 && s.semi_diameter > 0.0).then_some(s.semi_diameter);
            }
            "CLAP" | "FLAP" => {
                if line.value(1)? != 0.0 {
                    return Err(line.bad("a central obscuration is not supported"));
                }
                s.clear = Some(line.value(2)? * scale);
            }
            "STOP" => self.stop = Some(index),
            _ if SURFACE_SKIPPED.contains(&key) => {}
            _ => {
                return Err(line.bad(
                    "this word is not understood, and it might change the optics; remove it if it does not",
                ));
            }
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

impl Draft {
    fn surface(&self, index: usize, is_image: bool, scale: f64) -> Result<Surface, DesignError> {
        let mut shape = self.shape.clone();
        for (i, v, line, text) in &self.parameters {
            if !self.asphere || !(1..=8).contains(i) {
                let problem = "a parameter that this surface type does not have".to_owned();
                return Err(DesignError::Line { line: *line, text: text.clone(), problem });
            }
            if shape.aspheric.len() < *i {
                shape.aspheric.resize(*i, 0.0);
            }
            shape.aspheric[i - 1] = *v / scale.powi(2 * *i as i32 - 1);
        }
        if !is_image && !self.thickness.is_finite() {
            let problem = format!("has an infinite gap behind surface {index}");
            return Err(DesignError::Incomplete { problem });
        }
        let bends = !shape.is_flat() || self.glass.is_some();
        let aperture_mm = self.clear.or(self.fixed.filter(|_| bends)).filter(|_| !is_image);
        Ok(Surface {
            shape,
            thickness_mm: if is_image { 0.0 } else { self.thickness },
            medium: self.glass.clone().map_or(Medium::Air, Medium::Glass),
            aperture_mm,
            semi_diameter_mm: self.semi_diameter,
        })
    }
}

fn glass(line: &Line<'_>, glasses: &GlassCatalog) -> Result<Glass, DesignError> {
    let name = *line.words.get(1).ok_or_else(|| line.bad("expected a glass name"))?;
    if name.eq_ignore_ascii_case("MIRROR") {
        return Err(line.bad("mirrors are not supported"));
    }
    let solve = line.value_or(2, 0.0)?;
    if solve == 1.0 {
        // A model glass: nd, Vd and a deviation of partial dispersion. Its dispersion formula is the design program's own.
        let (nd, vd, deviation) = (line.value(4)?, line.value_or(5, 0.0)?, line.value_or(6, 0.0)?);
        if vd != 0.0 || deviation != 0.0 {
            // Old files print a nominal model beside every catalogue glass.
            return glasses.find(name).cloned().map_err(|_| {
                line.bad("a model glass with dispersion is not supported; name a catalogue glass (its catalogue may be missing)")
            });
        }
        return Ok(Glass {
            name: format!("n={nd}"),
            dispersion: Dispersion::constant(nd),
            range_um: (0.0, 1e3),
        });
    }
    glasses.find(name).cloned().map_err(|e| line.bad(e.to_string()))
}

/// Merit function, tolerance and configuration operands: four letters, digits or less.
fn is_operand(key: &str) -> bool {
    (2..=4).contains(&key.len()) && key.bytes().all(|b| b.is_ascii_uppercase() || b.is_ascii_digit())
}
