//! Reader of OSLO lens files (.len, text): spheres, conics, even aspheres, mirrors.
//!
//! Commands are separated by line ends or `;`, commented by `//`. `LEN NEW "name" <focal length> <surfaces>` begins the lens, `NXT` goes to the next
//! surface (the first is the object), `END` ends it. Read: UNI (mm in a lens unit), EBR (entrance beam radius), NAO, NAP, FNB, ANG (degrees), OBH,
//! GIH, WV (µm; the first is the primary wavelength), WW; of a surface RD, CV, TH, AST (stop), AIR, GLA, RFL and RFH (mirrors), AP CHK (an aperture that
//! blocks rays; without CHK it is drawn), CC, AD to AG (r⁴ to r¹⁰), ASP ASR with AS0, AS1, … (r⁰, r², …), pickups (PK) of these, and the solve
//! `PY 0` of the last gap. Glasses: a name, a glass code, one index, an index for each wavelength, `MOD` with a name and the same, or with n_d and V_d.
//! Field points at 0, 0.7 and 1 of the largest. Rays are aimed at the real stop. Unknown commands are ignored with a note.
//! Not supported, with a specific error: tilts and decentres, perfect lenses (PFL), other surface types, afocal modes.

mod command;
mod glass;
mod pickup;
mod surface;

use super::draft::{Draft, DraftSurface, MAX_SURFACES};
use super::error::LensFileError;
use super::options::ReadOptions;
use super::text::decode;
use command::{Command, commands};
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::system::{Aperture, FieldKind, ImagePlane, RayAiming, System};
use pipeline::real;

/// Gaps from here on are infinite, lens units.
const INFINITE: f64 = 1e8;
/// Wavelengths of files without WV, µm: d, F, C.
const DEFAULT_UM: [f64; 3] = [0.587_56, 0.486_13, 0.656_27];
/// Field points, of the largest.
const FIELD_POINTS: [f64; 3] = [0.0, 0.7, 1.0];

/// Commands of the system that do not change its optics.
const HARMLESS: [&str; 24] = [
    "DES", "SNO", "NOT", "APCK", "AMO", "EVZ", "EPR", "IMS", "FNO", "TEM", "PRE", "ASI", "PUR", "CVF",
    "DLRS", "DLFD", "DLMN", "DLMX", "SDAD", "WRSP", "IPC", "PKP", "XPT", "CFG",
];

struct Reader<'a> {
    glasses: &'a GlassLibrary,
    draft: Draft,
    /// Lens unit in mm; as UNI stands before the surfaces or behind them, lengths are converted at the end.
    scale: f64,
    /// Surface that commands belong to.
    at: usize,
    um: Vec<f64>,
    weights: Vec<f64>,
    /// In lens units or degrees.
    aperture: Option<(BeamKind, f64)>,
    field: Option<(FieldKind, f64)>,
    pickups: Vec<pickup::Pickup>,
    glass_lines: Vec<(usize, glass::Line)>,
    is_solved: bool,
    solved_at: usize,
}

#[derive(Clone, Copy, PartialEq)]
enum BeamKind {
    Radius,
    ObjectNa,
    ImageNa,
    FNumber,
}

/// Whether the text of a .len file is one of OSLO: other files of that ending are lists of CODE V commands.
pub(super) fn is_oslo(bytes: &[u8]) -> bool {
    let begins =
        |line: &str| line.starts_with("// OSLO") || line.trim_start().to_uppercase().starts_with("LEN NEW");
    decode(bytes).lines().take(20).any(begins)
}

/// Reads a lens.
///
/// # Errors
/// [`LensFileError::Line`] for a line that is wrong or not supported; [`LensFileError::Incomplete`] for a missing part.
pub fn parse(bytes: &[u8], glasses: &GlassLibrary, options: &ReadOptions) -> Result<System, LensFileError> {
    options.only_one_configuration()?;
    let text = decode(bytes);
    let mut reader = Reader {
        glasses,
        draft: Draft { surfaces: vec![DraftSurface::default()], ..Draft::default() },
        scale: 1.0,
        at: 0,
        um: DEFAULT_UM.to_vec(),
        weights: Vec::new(),
        aperture: None,
        field: None,
        pickups: Vec::new(),
        glass_lines: Vec::new(),
        is_solved: false,
        solved_at: 0,
    };
    let mut is_lens = false;
    for command in commands(&text) {
        let key = command.words[0].to_ascii_uppercase();
        is_lens |= key == "LEN";
        if !is_lens {
            return Err(command.error("expected LEN NEW: is it an OSLO lens file?"));
        }
        if key == "END" {
            return reader.finish();
        }
        if !reader.read(&key, &command)? {
            if options.strict {
                return Err(command.error("this command is not known, and --strict allows none"));
            }
            let note = format!(
                "line {}: `{}` is not a known command and was ignored",
                command.line,
                command.quote()
            );
            reader.draft.notes.push(note);
        }
    }
    Err(LensFileError::Incomplete { problem: "has no END: is it an OSLO lens file?".to_owned() })
}

impl Reader<'_> {
    /// Reads a command; false if it is not known.
    fn read(&mut self, key: &str, command: &Command<'_>) -> Result<bool, LensFileError> {
        let first = || command.value(1);
        match key {
            "LEN" => self.draft.name = command.words.get(2).map_or("", |w| w).trim_matches('"').to_owned(),
            "UNI" => {
                self.scale = first()?;
                if !(1e-6..=1e6).contains(&self.scale) {
                    return Err(command.error("expected the length of a lens unit in mm"));
                }
            }
            "EBR" => self.aperture = Some((BeamKind::Radius, first()?)),
            "NAO" => self.aperture = Some((BeamKind::ObjectNa, first()?)),
            "NAP" => self.aperture = Some((BeamKind::ImageNa, first()?)),
            "FNB" => self.aperture = Some((BeamKind::FNumber, first()?)),
            "ANG" => self.field = Some((FieldKind::Angle, first()?)),
            "OBH" => self.field = Some((FieldKind::ObjectHeight, first()?)),
            "GIH" => self.field = Some((FieldKind::ParaxialImageHeight, first()?)),
            "WV" => {
                self.um = command.values(1)?;
                if self.um.is_empty() || self.um.len() > 1000 {
                    return Err(command.error("expected 1 to 1000 wavelengths in µm"));
                }
            }
            "WW" => self.weights = command.values(1)?,
            "TELE" => self.draft.is_telecentric = command.is_on(),
            "AFO" | "AFC" if command.is_on() => {
                let problem = "afocal modes are not supported";
                return Err(command.error(problem));
            }
            "AFO" | "AFC" => {}
            "NXT" => {
                if self.draft.surfaces.len() >= MAX_SURFACES {
                    return Err(command.error(format!("more than {MAX_SURFACES} surfaces")));
                }
                self.draft.surfaces.push(DraftSurface::default());
                self.at = self.draft.surfaces.len() - 1;
            }
            "GTO" => {
                self.at = first()?.clamp(0.0, 1e6) as usize;
                if self.at >= self.draft.surfaces.len() {
                    return Err(command.error("a surface that is not there"));
                }
            }
            _ if HARMLESS.contains(&key) || key.starts_with("SNO") => {}
            _ => return surface::read(self, key, command),
        }
        Ok(true)
    }

    fn finish(mut self) -> Result<System, LensFileError> {
        let glass_lines = std::mem::take(&mut self.glass_lines);
        for (i, line) in glass_lines {
            let (glass, note) = line.glass(self.glasses, &self.um)?;
            self.draft.surfaces[i].glass = glass;
            self.draft.notes.extend(note);
        }
        for pickup in std::mem::take(&mut self.pickups) {
            pickup.apply(&mut self.draft.surfaces)?;
        }
        let (scale, draft) = (self.scale, &mut self.draft);
        for surface in &mut draft.surfaces {
            surface::convert(surface, scale);
        }
        let object_mm = draft.surfaces[0].thickness_mm;
        let is_finite = object_mm.is_finite();
        draft.aperture = match self.aperture {
            None => None,
            Some((BeamKind::Radius, r)) if is_finite => {
                Some(Aperture::ObjectNa(real::sin(real::atan(r * scale / object_mm))))
            }
            Some((BeamKind::Radius, r)) => Some(Aperture::EntrancePupil(2.0 * r * scale)),
            Some((BeamKind::ObjectNa, na)) => Some(Aperture::ObjectNa(na)),
            Some((BeamKind::ImageNa, na)) => Some(Aperture::WorkingFNumber(0.5 / na)),
            Some((BeamKind::FNumber, f)) => Some(Aperture::ImageFNumber(f)),
        };
        if let Some((kind, largest)) = self.field {
            draft.field_kind = Some(kind);
            let unit = if kind == FieldKind::Angle { 1.0 } else { scale };
            draft.fields = FIELD_POINTS.iter().map(|part| part * largest.abs() * unit).collect();
        }
        if draft.stop.is_none() && draft.surfaces.len() > 2 {
            draft.stop = Some(1);
            draft.notes.push("no stop given (AST): the first surface is the stop".to_owned());
        }
        let weight = |i: usize| self.weights.get(i).copied().unwrap_or(1.0);
        draft.wavelengths_um = self.um.iter().enumerate().map(|(i, um)| (*um, weight(i))).collect();
        draft.aiming = Some(RayAiming::Real);
        let is_solved = self.is_solved;
        if is_solved && self.solved_at + 2 != draft.surfaces.len() {
            return Err(LensFileError::Incomplete {
                problem: format!(
                    "has a solve (PY 0) on surface {}, which is not the last before the image: save the lens without solves",
                    self.solved_at
                ),
            });
        }
        // The image surface's TH is the defocus.
        let last = draft.surfaces.len() - 1;
        let defocus_mm = std::mem::take(&mut draft.surfaces[last].thickness_mm);
        if last > 0 && !is_solved {
            draft.surfaces[last - 1].thickness_mm += defocus_mm;
        }
        let system = self.draft.finish()?;
        if !is_solved {
            return Ok(system);
        }
        let (_, direction) = system.axis()[system.image()];
        Ok(system.with_image_plane(ImagePlane::Paraxial(system.primary_um()), direction * defocus_mm)?)
    }
}

#[cfg(test)]
mod tests;
