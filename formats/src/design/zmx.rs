//! Reader of sequential .zmx lens files (text): surfaces STANDARD, EVENASPH, ODDASPHE, XASPHERE and XODDASPH, and those of module `free`.
//!
//! Keywords are read, or known not to change the optics (module `keywords`), or unknown: an unknown one is ignored with a note that names its line,
//! or an error where the caller is strict. Merit function and tolerances follow the last surface and are skipped. So does the multi-configuration
//! editor (module `configuration`): the surfaces have the saved configuration, its operands give the others; the first is read by default.
//! Lengths are converted from lens units to mm. Apertures: CLAP and FLAP (outer radius), the inner radius of a ring-shaped OBSC, the circle
//! inside SQAP and ELAP (themselves, with the decentre OBDC, where the design has no rotational symmetry), and a fixed semi-diameter (DIAM with flag 1) where rays bend. Of pickups and solves the saved values are used.
//! Wavelengths and indices are relative to air at 20 °C, 1 atm. Coordinate breaks, and the tilts of surfaces (SCBD), that fold the
//! axis at plane mirrors or are undone leave a symmetric lens; others give one without symmetry.
//! Paraxial ray aiming (RAIM 1) is real aiming at the paraxial radius of the stop, which becomes the aperture.
//! The inner radius of CLAP and OBSC from 0 are central obscurations. `GLAS MIRROR` reflects into the medium before it.
//! An apodised pupil is read as a uniform one, with a note. Not supported, with a specific error: other surface types,
//! indices adjusted to another pressure.

mod configuration;
mod free;
mod keywords;
mod line;
mod surface;
mod write;

use super::draft::{Draft, MAX_SURFACES, radial_field};
use super::error::LensFileError;
use super::options::ReadOptions;
use super::text::decode;
use line::Line;
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::paraxial::Paraxial;
use pipeline::design::system::{Aperture, FieldKind, RayAiming, System};
use pipeline::real;

pub use write::write;

/// Temperatures so near 20 °C change no index by more than about 1e-5, K.
const TEMPERATURE_TOLERANCE_K: f64 = 5.0;

/// Reads a lens.
///
/// # Errors
/// [`LensFileError::Line`] for a line that is wrong or not supported; [`LensFileError::Incomplete`] for a missing part.
pub fn parse(bytes: &[u8], glasses: &GlassLibrary, options: &ReadOptions) -> Result<System, LensFileError> {
    let text = decode(bytes);
    let mut reader = Reader { scale: 1.0, requested: options.configuration, ..Reader::default() };
    for (i, raw) in text.lines().enumerate() {
        let words: Vec<&str> = raw.split_whitespace().collect();
        let Some(&key) = words.first() else { continue };
        let line = Line { number: i + 1, text: raw.trim(), words: &words };
        let is_indented = raw.starts_with([' ', '\t']);
        let note = if key == "SURF" {
            reader.start_surface(&line)?;
            None
        } else if reader.is_in_surface(key, is_indented) {
            reader.surface_line(key, &line, glasses)?
        } else if reader.surface_count > 0 {
            reader.in_surface = false;
            reader.configurations.read_line(key, &line)?
        } else {
            reader.header_line(key, &line)?
        };
        if let Some(note) = note {
            reader.add_note(note, &line, options.strict)?;
        }
    }
    reader.finish(glasses, options.strict)
}

/// The glass catalogues that a design names, in its order.
pub fn catalogues(bytes: &[u8]) -> Vec<String> {
    let text = decode(bytes);
    let lists = text.lines().filter_map(|line| line.strip_prefix("GCAT "));
    lists.flat_map(str::split_whitespace).map(str::to_owned).collect()
}

/// The coating file that a design names; none if it names none.
pub fn coating_file(bytes: &[u8]) -> Option<String> {
    let text = decode(bytes);
    let line = text.lines().find_map(|line| line.trim_start().strip_prefix("COFN "))?;
    let quoted = line.split_once('"').and_then(|(_, rest)| rest.split_once('"')).map(|(name, _)| name);
    let name = quoted.or_else(|| line.split_whitespace().find(|w| *w != "QF"))?;
    Some(name.to_owned())
}

/// Keywords that end the last surface where lines are not indented.
fn is_section(key: &str) -> bool {
    matches!(key, "TOL" | "MNUM" | "MOFF" | "BLNK" | "CONF" | "EFFL" | "DMFS" | "EFFT" | "CSUM")
}

#[derive(Default)]
struct Reader {
    draft: Draft,
    /// Lens unit in mm.
    scale: f64,
    is_sequential: Option<bool>,
    has_unit: bool,
    catalogues: Vec<String>,
    field_count: usize,
    x: Vec<f64>,
    y: Vec<f64>,
    wave_count: usize,
    waves: Vec<(usize, f64, f64)>,
    open: surface::Reader,
    in_surface: bool,
    /// Whether rays are aimed at the paraxial radius of the stop, not at that of the real marginal ray.
    has_paraxial_stop: bool,
    /// Whether the lines of surfaces are indented, once the first has been read.
    are_surfaces_indented: Option<bool>,
    surface_count: usize,
    /// Configuration to read.
    requested: Option<usize>,
    configurations: configuration::Configurations,
}

impl Reader {
    /// Whether a line belongs to the open surface: in old files lines are not indented.
    fn is_in_surface(&mut self, key: &str, is_indented: bool) -> bool {
        let are_indented = self.in_surface && *self.are_surfaces_indented.get_or_insert(is_indented);
        self.in_surface && (is_indented || (!are_indented && !is_section(key)))
    }

    fn add_note(&mut self, note: String, line: &Line<'_>, strict: bool) -> Result<(), LensFileError> {
        if strict && note.contains(line::IGNORED) {
            return Err(line.error("this keyword is not known or not supported, and --strict allows none"));
        }
        self.draft.notes.push(note);
        Ok(())
    }

    fn start_surface(&mut self, line: &Line<'_>) -> Result<(), LensFileError> {
        if line.value(1)? != self.surface_count as f64 {
            return Err(line.error(format!("expected surface {}", self.surface_count)));
        }
        if self.surface_count > MAX_SURFACES {
            return Err(line.error(format!("more than {MAX_SURFACES} surfaces")));
        }
        self.close_surface()?;
        self.surface_count += 1;
        self.in_surface = true;
        Ok(())
    }

    fn close_surface(&mut self) -> Result<(), LensFileError> {
        if self.surface_count > self.draft.surfaces.len() {
            let surface = std::mem::take(&mut self.open).finish(self.scale)?;
            self.draft.surfaces.push(surface);
        }
        Ok(())
    }

    fn surface_line(
        &mut self,
        key: &str,
        line: &Line<'_>,
        glasses: &GlassLibrary,
    ) -> Result<Option<String>, LensFileError> {
        if key == "STOP" {
            self.draft.stop = Some(self.surface_count - 1);
            return Ok(None);
        }
        let context = surface::Context { scale: self.scale, glasses, catalogues: &self.catalogues };
        self.open.read_line(key, line, &context)
    }

    /// Reads a line of the system; a note comes back where something was assumed or ignored.
    fn header_line(&mut self, key: &str, line: &Line<'_>) -> Result<Option<String>, LensFileError> {
        let first = || line.value(1);
        let draft = &mut self.draft;
        match key {
            "MODE" => match line.words.get(1) {
                Some(&"SEQ") => self.is_sequential = Some(true),
                _ => return Err(line.error("only sequential designs (MODE SEQ) can be traced")),
            },
            "NAME" => draft.name = line.text.get(4..).unwrap_or_default().trim().to_owned(),
            "UNIT" => {
                self.has_unit = true;
                self.scale = match line.words.get(1).map(|w| w.to_ascii_uppercase()).as_deref() {
                    Some("MM") => 1.0,
                    Some("CM") => 10.0,
                    Some("IN" | "INCH") => 25.4,
                    Some("METER" | "M") => 1000.0,
                    _ => return Err(line.error("expected the lens unit MM, CM, IN or METER")),
                };
            }
            "GCAT" => self.catalogues.extend(line.words[1..].iter().map(|w| (*w).to_owned())),
            "ENPD" => draft.aperture = Some(Aperture::EntrancePupil(first()?)),
            "FNUM" => {
                let is_working = line.value_or(2, 0.0)? != 0.0;
                let f = first()?;
                draft.aperture =
                    Some(if is_working { Aperture::WorkingFNumber(f) } else { Aperture::ImageFNumber(f) });
            }
            "OBNA" => {
                let is_angle = line.value_or(2, 0.0)? != 0.0;
                let value = first()?;
                if is_angle && !(value > 0.0 && value < 90.0) {
                    return Err(line.error("expected an object cone angle above 0 and below 90 degrees"));
                }
                draft.aperture =
                    Some(Aperture::ObjectNa(if is_angle { real::sin(value.to_radians()) } else { value }));
            }
            // The radius is that of the stop's surface, read later.
            "FLOA" => draft.aperture = Some(Aperture::StopRadius(0.0)),
            "RAIM" => {
                // 0: off, 1: paraxial, 2: real.
                let mode = line.value_or(2, 0.0)?;
                draft.aiming = Some(if mode == 0.0 { RayAiming::Paraxial } else { RayAiming::Real });
                self.has_paraxial_stop = mode == 1.0;
            }
            "FTYP" => {
                draft.field_kind = Some(match first()? as i64 {
                    // 4: theodolite angles, which differ from field angles only off both axes.
                    0 | 4 => FieldKind::Angle,
                    1 => FieldKind::ObjectHeight,
                    2 => FieldKind::ParaxialImageHeight,
                    3 => FieldKind::RealImageHeight,
                    _ => return Err(line.error("expected a field type from 0 to 4")),
                });
                draft.is_telecentric = line.value_or(2, 0.0)? != 0.0;
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
                let (um, weight) = (line.value(2)?, line.value_or(3, 1.0)?);
                self.waves.retain(|w| w.0 != index as usize);
                self.waves.push((index as usize, um, weight));
            }
            "WAVL" | "WAVN" => {
                if self.waves.is_empty() {
                    self.waves =
                        line.values()?.into_iter().enumerate().map(|(i, um)| (i + 1, um, 1.0)).collect();
                }
            }
            "PWAV" => draft.primary = line.value(1)?.clamp(1.0, 1000.0) as usize - 1,
            "ENVD" => return environment(line),
            "GFAC" => {
                // Factor, type: 0 uniform, 1 Gaussian, 2 cosine cubed. A Gaussian of factor 0 is uniform.
                let (factor, kind) = (first()?, line.value_or(2, 0.0)?);
                if kind != 0.0 && (factor != 0.0 || kind != 1.0) {
                    return Ok(Some(format!(
                        "line {}: `{}`: the apodisation of the pupil {}, its amplitude is uniform",
                        line.number,
                        line.quote(),
                        line::IGNORED
                    )));
                }
            }
            "VDXN" | "VDYN" | "VCXN" | "VCYN" | "ZVDX" | "ZVDY" | "ZVCX" | "ZVCY" => {
                draft.has_vignetting_factors |= line.values()?.iter().any(|v| *v != 0.0);
            }
            _ if keywords::is_harmless_in_header(key) => {}
            _ => return Ok(Some(line.ignored())),
        }
        Ok(None)
    }

    fn finish(mut self, glasses: &GlassLibrary, strict: bool) -> Result<System, LensFileError> {
        let incomplete = |problem: &str| LensFileError::Incomplete { problem: problem.to_owned() };
        if self.surface_count == 0 {
            return Err(incomplete("has no surfaces (SURF); is it a sequential .zmx file?"));
        }
        if self.is_sequential.is_none() {
            self.draft.notes.push("no MODE line: read as a sequential design".to_owned());
        }
        if !self.has_unit {
            return Err(incomplete("has no UNIT line"));
        }
        self.close_surface()?;
        self.waves.sort_by_key(|w| w.0);
        if self.wave_count > 0 {
            self.waves.truncate(self.wave_count);
        }
        // UNIT may stand behind it.
        if let Some(Aperture::EntrancePupil(diameter)) = &mut self.draft.aperture {
            *diameter *= self.scale;
        }
        self.apply_configuration(glasses, strict)?;
        let mut draft = self.draft;
        draft.wavelengths_um = self.waves.into_iter().map(|(_, um, weight)| (um, weight)).collect();
        let unit = match draft.field_kind {
            None if self.x.iter().chain(&self.y).any(|v| *v != 0.0) => {
                return Err(incomplete("has field points and no field type (FTYP)"));
            }
            None | Some(FieldKind::Angle) => 1.0,
            Some(_) => self.scale,
        };
        let at = |v: &[f64], i: usize| v.get(i).copied().unwrap_or(0.0);
        let radius = |i| unit * radial_field(draft.field_kind, at(&self.x, i), at(&self.y, i));
        draft.fields = (0..self.field_count.max(1)).map(radius).collect();
        if draft.aiming.is_none() {
            draft.notes.push("no ray aiming given: rays are aimed at the paraxial entrance pupil".to_owned());
        }
        let mut system = draft.finish()?;
        if self.has_paraxial_stop && !system.is_telecentric {
            let primary = Paraxial::new(&system, system.primary_um())?;
            system.aperture = Aperture::StopRadius(primary.stop_radius_mm);
        }
        Ok(system)
    }

    /// Changes the saved configuration into the requested one.
    fn apply_configuration(&mut self, glasses: &GlassLibrary, strict: bool) -> Result<(), LensFileError> {
        let configurations = std::mem::take(&mut self.configurations);
        let (number, note) = configurations.choose(self.requested)?;
        self.draft.notes.extend(note);
        for operand in configurations.changes(number) {
            let context = surface::Context { scale: self.scale, glasses, catalogues: &self.catalogues };
            let note =
                configuration::apply(operand, &mut self.draft, &mut self.waves, &mut self.y, &context)?;
            if let Some(note) = note {
                if strict && note.contains(line::IGNORED) {
                    return Err(operand.error("this operand is not supported, and --strict allows none"));
                }
                self.draft.notes.push(note);
            }
        }
        Ok(())
    }
}

/// Temperature, pressure, and whether indices are adjusted to them.
fn environment(line: &Line<'_>) -> Result<Option<String>, LensFileError> {
    let (celsius, atmospheres) = (line.value(1)?, line.value_or(2, 1.0)?);
    let is_adjusted = line.value_or(3, 0.0)? != 0.0;
    if !is_adjusted || (celsius == 20.0 && atmospheres == 1.0) {
        return Ok(None);
    }
    if atmospheres != 1.0 || (celsius - 20.0).abs() > TEMPERATURE_TOLERANCE_K {
        return Err(line.error("indices adjusted to another temperature or pressure are not supported"));
    }
    Ok(Some(format!("line {}: indices are those at 20 °C, not at {celsius} °C", line.number)))
}
