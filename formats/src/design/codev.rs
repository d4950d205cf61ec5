//! Reader of CODE V sequence files (.seq) that describe a lens: spheres, conics, even aspheres.
//!
//! Commands are separated by line ends or `;`, continued by `&`, commented by `!`, and not case-sensitive. A surface is `S r t glass` (object `SO`, image
//! `SI`): radius (curvature without `RDM`), thickness, glass behind it; commands up to the next surface qualify it. Read: DIM, EPD, FNO, NA,
//! NAO, WL (nm), REF, WTW, PRV to END (private glasses), XAN/YAN, XOB/YOB, XIM/YIM, XRI/YRI, STO, K, A to J (r⁴ to r²⁰), CIR, and RDY, CUY, THI of a surface
//! (`S3`, `SO`, `SI`) or of several (`S1..5`).
//! Rays are aimed at the real stop. The image surface's thickness is the defocus, added to the last gap. A paraxial image solve (PIM) is
//! solved where the saved last gap is 0; otherwise the saved gap holds. Unknown commands are ignored with a note.
//! Lists may number their values (`WL W1 587.6`, `YAN F1 0 F2 14`); a glass may be a glass code, or n_d and V_d.
//! `REFL` for a glass and RMD REFL are mirrors, `CIR OBS` a central obscuration.
//! Tilts and decentres (module `decentre`), toroids and special surfaces (module `free`) and decentred apertures (module `aperture`) give a design
//! without rotational symmetry, but for tilts that leave the surfaces on one axis: returned, reversed, or of plane mirrors.
//! Not supported, with a specific error: gratings, other special surfaces, macros.

mod aperture;
mod command;
mod decentre;
mod free;
mod private;
mod qualifier;

use super::draft::{Draft, DraftSurface, INFINITE_MM, MAX_SURFACES, radial_field};
use super::error::LensFileError;
use super::lens_file::is_zip;
use super::options::ReadOptions;
use super::text::{self, decode};
use command::{Command, cannot_be_curvatures, commands};
use decentre::Decentre;
use free::Free;
use pipeline::design::glass::Glass;
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::system::{Aperture, FieldKind, ImagePlane, RayAiming, System};
use private::PrivateCatalogue;
use std::collections::BTreeMap;

/// Commands that do not change the optics: labels, weights, solves and variables (their saved values hold), display, bookkeeping.
const HARMLESS: &[&str] = &[
    "LEN", "GO", "END", "INI", "SLB", "LBL", "TEM", "WTF", "CCY", "THC", "GLC", "KC", "AC", "BC", "CC", "DC",
    "EC", "FC", "GC", "HC", "JC", "CUM", "THM", "GLM", "VER", "CHK", "OUT", "VIE", "SPH", "CON", "ASP",
    "SUR", "LCT", "MFL", "CUF", "FAB", "PRO", "CA", "NOR", "IFO", "NRD", "CAO", "PRS", "VCO", "SAV", "TOW",
    "TIL", "SSI", "BUF", "WRI", "DEL", "POX", "POY", "DER", "CLS", "PUX", "PUY", "DDM", "RSI", "ZLB", "TMP",
    "PRE", "TCE", "DLF", "DLR", "DLT", "DLN", "DLA", "DLB", "DLX", "DLY", "AUT", "OAL", "EFL", "PIK", "WTA",
    "IMC", "MAX", "MIN", "CCL", "DNG", "GSG", "SPT", "FFO",
];

/// Statements of the macro language, which a saved lens does not have.
const MACRO: &[&str] = &[
    "FOR", "LCL", "GBL", "FCT", "RFD", "RFN", "WHL", "UNT", "EVA", "LSQ", "GOT", "IF", "CALL", "FMT", "RFS",
    "WRL",
];

/// Commands for optics that are not modelled.
const UNSUPPORTED: &[&str] = &[
    "GRT", "GRO", "GRS", "DIF", "HOE", "HWL", "ANA", "SPA", "XYP", "ZRN", "QBF", "QCN", "UDS", "GRN", "FRE",
    "LAR", "INT", "NSS",
];

struct Reader<'a> {
    glasses: &'a GlassLibrary,
    private: PrivateCatalogue,
    draft: Draft,
    /// Lens unit in mm.
    scale: f64,
    /// Surfaces are given by radius, not curvature.
    by_radius: bool,
    x: Vec<f64>,
    y: Vec<f64>,
    wavelengths_nm: Vec<f64>,
    weights: Vec<f64>,
    /// Tilts and decentres by surface.
    decentres: BTreeMap<usize, Decentre>,
    /// Shapes without rotational symmetry by surface.
    free: BTreeMap<usize, Free>,
    /// Apertures by surface.
    apertures: BTreeMap<usize, aperture::Apertures>,
    has_image: bool,
    is_solved_for_image: bool,
}

/// Whether the bytes of a .len file are CODE V's own lens file, which is binary, and not a list of commands.
pub(super) fn is_binary(bytes: &[u8]) -> bool {
    bytes.contains(&0) && !bytes.starts_with(&[0xFF, 0xFE]) && !is_zip(bytes)
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
        private: PrivateCatalogue::default(),
        draft: Draft::default(),
        scale: 1.0,
        by_radius: false,
        x: Vec::new(),
        y: Vec::new(),
        wavelengths_nm: Vec::new(),
        weights: Vec::new(),
        decentres: BTreeMap::new(),
        free: BTreeMap::new(),
        apertures: BTreeMap::new(),
        has_image: false,
        is_solved_for_image: false,
    };
    let (strict, commands) = (options.strict, commands(&text));
    if let Some(command) = commands.iter().find(|c| MACRO.contains(&c.words[0].to_ascii_uppercase().as_str()))
    {
        return Err(
            command.error("this is a CODE V macro, not a lens; save the lens as a sequence file (WRL)")
        );
    }
    // The unit holds for the lengths before it, too.
    if let Some(command) = commands.iter().find(|c| c.words[0].eq_ignore_ascii_case("DIM")) {
        reader.scale = unit_mm(command)?;
    }
    if !commands.iter().any(|c| c.words[0].eq_ignore_ascii_case("RDM")) && cannot_be_curvatures(&commands) {
        reader.by_radius = true;
        reader.draft.notes.push(
            "no RDM command: surfaces are read as radii, as curvatures all would be above 1".to_owned(),
        );
    }
    for command in commands {
        if !reader.read(&command)? {
            let (problem, error) = match command.words[0].eq_ignore_ascii_case("PUI") {
                true => (
                    "the apodisation of the pupil was ignored, its amplitude is uniform",
                    "an apodised pupil is not supported, and --strict allows none",
                ),
                false => (
                    "is not a known command and was ignored",
                    "this command is not known, and --strict allows none",
                ),
            };
            if strict {
                return Err(command.error(error));
            }
            let quote = text::quote(command.text);
            reader.draft.notes.push(format!("line {}: `{quote}` {problem}", command.line));
        }
    }
    reader.finish()
}

impl Reader<'_> {
    /// Reads a command; false if it is not known.
    fn read(&mut self, command: &Command<'_>) -> Result<bool, LensFileError> {
        let key = command.words[0].to_ascii_uppercase();
        if self.private.read(&key, command)? {
            return Ok(true);
        }
        let first = || command.value(1);
        let draft = &mut self.draft;
        match key.as_str() {
            "RDM" => self.by_radius = !command.words.get(1).is_some_and(|w| w.starts_with(['n', 'N'])),
            "TIT" | "TITLE" => {
                let title = command.text.trim()[key.len()..].trim();
                draft.name = title.trim_matches(['\'', '"']).trim().to_owned();
            }
            "DIM" => self.scale = unit_mm(command)?,
            "EPD" => draft.aperture = Some(Aperture::EntrancePupil(first()? * self.scale)),
            "FNO" => draft.aperture = Some(Aperture::ImageFNumber(first()?)),
            "NA" => draft.aperture = Some(Aperture::WorkingFNumber(0.5 / first()?)),
            "NAO" => draft.aperture = Some(Aperture::ObjectNa(first()?)),
            "TEL" => {
                draft.is_telecentric = !command.words.get(1).is_some_and(|w| w.starts_with(['n', 'N']));
            }
            "WL" => command.read_list('W', &mut self.wavelengths_nm)?,
            "WTW" => command.read_list('W', &mut self.weights)?,
            "REF" => draft.primary = first()?.clamp(1.0, 1000.0) as usize - 1,
            "XAN" | "XOB" | "XIM" | "XRI" => {
                draft.field_kind.get_or_insert(field_kind(&key));
                command.read_list('F', &mut self.x)?;
            }
            "YAN" | "YOB" | "YIM" | "YRI" => {
                draft.field_kind = Some(field_kind(&key));
                command.read_list('F', &mut self.y)?;
            }
            "VUX" | "VLX" | "VUY" | "VLY" => {
                let mut factors = Vec::new();
                command.read_list('F', &mut factors)?;
                draft.has_vignetting_factors |= factors.iter().any(|v| *v != 0.0);
            }
            // Intensity at the edge of the pupil.
            "PUI" => return Ok(first()? == 1.0),
            "ZOO" => {
                if command.words.get(1).is_some_and(|n| n.parse::<f64>().is_ok_and(|n| n > 1.0)) {
                    draft.notes.push("zoom lens: the first position is read".to_owned());
                }
            }
            "SO" | "SI" | "S" => self.start_surface(&key, command)?,
            _ if key.len() > 1 && command.surface(0).is_some() => self.start_surface(&key, command)?,
            "RET" | "GLB" => {
                let problem = "a surface placed relative to an earlier one (RET, GLB) is not supported: give its distance from the surface \
                               before as a thickness, without tilts";
                return Err(command.error(problem));
            }
            _ if UNSUPPORTED.contains(&key.as_str()) => {
                return Err(
                    command.error("not supported: lenscube traces refracting and reflecting surfaces")
                );
            }
            _ if HARMLESS.contains(&key.as_str()) => {}
            _ => return self.read_qualifier(&key, command),
        }
        Ok(true)
    }

    fn start_surface(&mut self, key: &str, command: &Command<'_>) -> Result<(), LensFileError> {
        let number = self.draft.surfaces.len();
        if number > MAX_SURFACES {
            return Err(command.error(format!("more than {MAX_SURFACES} surfaces")));
        }
        if self.has_image {
            return Err(command.error("a surface behind the image (SI)"));
        }
        if (key == "SO") != (number == 0) {
            return Err(command.error("expected the object (SO) first, then surfaces (S) and the image (SI)"));
        }
        let value = |i: usize| if command.words.len() > i { command.value_or_infinite(i) } else { Ok(0.0) };
        let mut surface = DraftSurface { thickness_mm: value(2)? * self.scale, ..DraftSurface::default() };
        surface.shape.curvature = curvature(value(1)?, self.by_radius, self.scale);
        if command.words.get(3).is_some_and(|name| name.eq_ignore_ascii_case("REFL")) {
            surface.is_mirror = true;
        } else if let Some(name) = command.words.get(3) {
            // n_d and V_d in two words.
            let model = command.value(3).and_then(|n| Ok(format!("{n}:{}", command.value(4)?)));
            let (glass, note) = self.glass(model.as_deref().unwrap_or(name), command)?;
            surface.glass = glass;
            self.draft.notes.extend(note);
        }
        self.has_image |= key == "SI";
        self.draft.surfaces.push(surface);
        Ok(())
    }

    fn glass(
        &self,
        name: &str,
        command: &Command<'_>,
    ) -> Result<(Option<Glass>, Option<String>), LensFileError> {
        if name.eq_ignore_ascii_case("AIR") {
            return Ok((None, None));
        }
        let name = name.trim_matches(['\'', '"']);
        if let Some(glass) = self.private.get(name) {
            return Ok((Some(glass.clone()), None));
        }
        let (glass, note) = self.glasses.find(name, &[]).map_err(|e| command.error(e.to_string()))?;
        Ok((Some(glass), note.map(|note| format!("line {}: {note}", command.line))))
    }

    fn finish(self) -> Result<System, LensFileError> {
        let incomplete = |problem: &str| LensFileError::Incomplete { problem: problem.to_owned() };
        if self.draft.surfaces.is_empty() {
            return Err(incomplete("has no surfaces (SO, S, SI): is it a CODE V macro instead of a lens?"));
        }
        if !self.has_image {
            return Err(incomplete("has no image surface (SI)"));
        }
        let mut draft = self.draft;
        for (index, decentre) in &self.decentres {
            if let Some(surface) = draft.surfaces.get_mut(*index) {
                decentre.apply(surface, self.scale);
            }
        }
        for (index, free) in &self.free {
            if let Some(surface) = draft.surfaces.get_mut(*index) {
                free.apply(surface, self.scale)?;
            }
        }
        for (index, apertures) in &self.apertures {
            if let Some(surface) = draft.surfaces.get_mut(*index) {
                apertures.apply(surface);
            }
        }
        if let Some(Aperture::ImageFNumber(f)) = draft.aperture
            && draft.surfaces[0].thickness_mm.abs() < INFINITE_MM
        {
            // FNO is that of the paraxial marginal ray at the conjugates used.
            draft.aperture = Some(Aperture::WorkingFNumber(f));
        }
        if draft.stop.is_none() && draft.surfaces.len() > 2 {
            draft.stop = Some(1);
            draft.notes.push("no stop given (STO): the first surface is the stop".to_owned());
        }
        let last = draft.surfaces.len() - 1;
        let is_open = last > 0 && draft.surfaces[last - 1].thickness_mm == 0.0;
        let defocus_mm = std::mem::take(&mut draft.surfaces[last].thickness_mm);
        if last > 0 {
            draft.surfaces[last - 1].thickness_mm += defocus_mm;
        }
        let unit = match draft.field_kind {
            None | Some(FieldKind::Angle) => 1.0,
            Some(_) => self.scale,
        };
        let at = |v: &[f64], i: usize| v.get(i).copied().unwrap_or(0.0);
        let count = self.x.len().max(self.y.len());
        let kind = draft.field_kind;
        draft.fields =
            (0..count).map(|i| unit * radial_field(kind, at(&self.x, i), at(&self.y, i))).collect();
        let weight = |i: usize| self.weights.get(i).copied().unwrap_or(1.0);
        draft.wavelengths_um =
            self.wavelengths_nm.iter().enumerate().map(|(i, nm)| (nm / 1e3, weight(i))).collect();
        draft.aiming = Some(RayAiming::Real);
        let system = draft.finish()?;
        match self.is_solved_for_image && is_open {
            true if system.asymmetry.is_some() => Err(incomplete(
                "has a paraxial image solve (PIM), no saved last gap, and no rotational symmetry: save the lens with its last gap",
            )),
            true => {
                let plane = ImagePlane::Paraxial(system.primary_um());
                let (_, direction) = system.axis()[system.image()];
                Ok(system.with_image_plane(plane, direction * defocus_mm)?)
            }
            false => Ok(system),
        }
    }
}

fn unit_mm(command: &Command<'_>) -> Result<f64, LensFileError> {
    match command.words.get(1).and_then(|w| w.chars().next()) {
        Some('M' | 'm') => Ok(1.0),
        Some('C' | 'c') => Ok(10.0),
        Some('I' | 'i') => Ok(25.4),
        _ => Err(command.error("expected the lens unit M (mm), C (cm) or I (inch)")),
    }
}

/// Kind of the field values of a command such as `YAN`.
fn field_kind(key: &str) -> FieldKind {
    match &key[1..] {
        "AN" => FieldKind::Angle,
        "OB" => FieldKind::ObjectHeight,
        "IM" => FieldKind::ParaxialImageHeight,
        _ => FieldKind::RealImageHeight,
    }
}

/// Curvature in 1/mm from a radius (0 is a plane) or a curvature in lens units.
fn curvature(value: f64, is_radius: bool, scale: f64) -> f64 {
    match (is_radius, value == 0.0 || value.is_infinite()) {
        (_, true) => 0.0,
        (true, false) => 1.0 / (value * scale),
        (false, false) => value / scale,
    }
}

#[cfg(test)]
mod tests;
