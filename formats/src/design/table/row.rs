//! Rows of a lens table: surfaces.

use super::columns::{Column, Columns};
use super::line::Line;
use crate::design::draft::{Draft, DraftSurface, MAX_SURFACES};
use crate::design::error::LensFileError;
use pipeline::design::glass::Glass;
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::model_glass::{LINES_UM, constant_glass, model_glass};

/// A glass whose n_d differs from the printed one by more is noted.
const INDEX_TOLERANCE: f64 = 5e-4;

/// What a row is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Role {
    Object,
    Surface,
    Stop,
    Image,
}

fn role(cell: &str) -> Role {
    let words: Vec<String> = cell.to_lowercase().split_whitespace().map(str::to_owned).collect();
    let has = |names: &[&str]| words.iter().any(|w| names.contains(&w.as_str()));
    match () {
        () if has(&["object", "obj"]) => Role::Object,
        () if has(&["image", "img", "ima", "film", "sensor"]) => Role::Image,
        () if has(&["stop", "sto", "diaphragm", "iris"]) => Role::Stop,
        () => Role::Surface,
    }
}

/// Reads rows into a draft.
pub(super) struct Table<'a> {
    columns: &'a Columns,
    /// Lens unit in mm.
    scale: f64,
    glasses: &'a GlassLibrary,
    catalogues: Vec<String>,
    has_image: bool,
    /// Whether the last surface has no thickness.
    is_open: bool,
}

impl<'a> Table<'a> {
    pub(super) fn new(
        columns: &'a Columns,
        scale: f64,
        glasses: &'a GlassLibrary,
        catalogues: Vec<String>,
    ) -> Self {
        Self { columns, scale, glasses, catalogues, has_image: false, is_open: false }
    }

    /// Reads a row.
    pub(super) fn read(&mut self, line: &Line<'_>, draft: &mut Draft) -> Result<(), LensFileError> {
        if self.has_image {
            return Err(line.error("a surface behind the image"));
        }
        if self.is_open {
            return Err(line.error("the surface before this one has no thickness"));
        }
        if draft.surfaces.len() > MAX_SURFACES {
            return Err(line.error(format!("more than {MAX_SURFACES} surfaces")));
        }
        let role = role(self.columns.cell(line, Column::Surface));
        if draft.surfaces.is_empty() && role != Role::Object {
            draft.surfaces.push(DraftSurface { thickness_mm: f64::INFINITY, ..DraftSurface::default() });
        } else if !draft.surfaces.is_empty() && role == Role::Object {
            return Err(line.error("the object is not the first row"));
        }
        if role == Role::Stop && draft.stop.replace(draft.surfaces.len()).is_some() {
            return Err(line.error("a second stop"));
        }
        self.has_image = role == Role::Image;
        let surface = self.surface(line, role, &mut draft.notes)?;
        draft.surfaces.push(surface);
        Ok(())
    }

    fn surface(
        &mut self,
        line: &Line<'_>,
        role: Role,
        notes: &mut Vec<String>,
    ) -> Result<DraftSurface, LensFileError> {
        let (columns, scale) = (self.columns, self.scale);
        let optional = |column| match columns.cell(line, column) {
            "" | "-" => Ok(None),
            cell => line.number(cell).map(Some),
        };
        let finite = |column| match optional(column)? {
            Some(v) if !v.is_finite() => Err(line.error(format!("{column:?} is infinite"))),
            value => Ok(value),
        };
        let mut surface = DraftSurface::default();
        surface.shape.curvature = match (self.radius(line)?, finite(Column::Curvature)?) {
            (Some(_), Some(_)) => return Err(line.error("a radius and a curvature")),
            (Some(r), None) => 1.0 / (r * scale),
            (None, curvature) => curvature.unwrap_or(0.0) / scale,
        };
        surface.shape.conic = finite(Column::Conic)?.unwrap_or(0.0);
        for power in columns.powers() {
            let a = finite(Column::Coefficient(power))?.unwrap_or(0.0);
            if a != 0.0 {
                let shape = &mut surface.shape;
                let coefficients = if power % 2 == 0 { &mut shape.aspheric } else { &mut shape.odd };
                let index = (power - 1) / 2;
                coefficients.resize(coefficients.len().max(index + 1), 0.0);
                coefficients[index] = a / scale.powi(power as i32 - 1);
            }
        }
        let thickness = optional(Column::Thickness)?;
        self.is_open = thickness.is_none() && matches!(role, Role::Surface | Role::Stop);
        surface.thickness_mm = match thickness {
            Some(t) => t * scale,
            None if role == Role::Object => f64::INFINITY,
            None => 0.0,
        };
        let drawn = (finite(Column::SemiDiameter)?, finite(Column::Diameter)?);
        surface.semi_diameter_mm = drawn.0.or(drawn.1.map(|d| 0.5 * d)).unwrap_or(0.0) * scale;
        surface.clear_mm = finite(Column::ApertureRadius)?.map(|r| r * scale);
        surface.ideal_focal_mm = finite(Column::IdealFocalLength)?.map(|f| f * scale);
        surface.obscuration_mm = finite(Column::ObscurationRadius)?.map(|r| r * scale);
        surface.is_mirror =
            ["mirror", "refl"].contains(&columns.cell(line, Column::Glass).to_lowercase().as_str());
        let (glass, note) = if surface.is_mirror { (None, None) } else { self.glass(line)? };
        surface.glass = glass;
        notes.extend(note.map(|note| format!("line {}: {note}", line.number)));
        Ok(surface)
    }

    /// The radius; none for a plane.
    fn radius(&self, line: &Line<'_>) -> Result<Option<f64>, LensFileError> {
        let cell = self.columns.cell(line, Column::Radius);
        match cell.to_lowercase().as_str() {
            "" | "-" | "plano" | "plane" | "flat" => Ok(None),
            _ => Ok(Some(line.number(cell)?).filter(|r| *r != 0.0 && r.is_finite())),
        }
    }

    fn glass(&self, line: &Line<'_>) -> Result<(Option<Glass>, Option<String>), LensFileError> {
        let number = |column| match self.columns.cell(line, column) {
            "" | "-" => Ok(None),
            cell => line.number(cell).map(Some),
        };
        let (n, v) = (number(Column::Index)?, number(Column::Abbe)?);
        let delta = number(Column::PartialDispersion)?.unwrap_or(0.0);
        let name = self.columns.cell(line, Column::Glass);
        let printed = || -> Result<(Option<Glass>, Option<String>), LensFileError> {
            match (n, v) {
                (None | Some(1.0), _) => Ok((None, None)),
                (Some(n), None | Some(0.0)) if n > 1.0 && n < 10.0 => {
                    Ok((Some(constant_glass(n)), Some(format!("n = {n} without V: no dispersion"))))
                }
                (Some(n), v) => {
                    let v = v.unwrap_or(0.0);
                    let glass = model_glass(&format!("n={n},V={v}"), n, v, delta);
                    let note = format!("n_d = {n}, V_d = {v}: a model glass of these values");
                    Ok((Some(glass.map_err(|e| line.error(e.to_string()))?), Some(note)))
                }
            }
        };
        match name.to_lowercase().as_str() {
            "" | "-" => return printed(),
            "air" => return Ok((None, None)),
            _ => (),
        }
        match self.glasses.find(name, &self.catalogues) {
            Ok((glass, note)) => {
                let apart = n.map(|n| (glass.dispersion.index(LINES_UM[1]) - n, n));
                let differs = apart.filter(|(d, _)| d.abs() > INDEX_TOLERANCE).map(|(d, n)| {
                    format!("glass {name}: its n_d is {d:+.5} off the table's {n}, and is used")
                });
                Ok((Some(glass), differs.or(note)))
            }
            Err(e) if n.is_none() => Err(line.error(e.to_string())),
            // A glass that no catalogue has, with its values.
            Err(_) => printed(),
        }
    }

    /// Adds what the table may leave out; returns whether the film's distance is to be found.
    pub(super) fn finish(
        &self,
        draft: &mut Draft,
        object_distance: Option<f64>,
    ) -> Result<bool, LensFileError> {
        let incomplete = |problem: &str| LensFileError::Incomplete { problem: problem.to_owned() };
        if draft.surfaces.is_empty() {
            return Err(incomplete("has no surfaces below the header row"));
        }
        if draft.stop.is_none() {
            return Err(incomplete(
                "has no row of the aperture stop: write `stop` there in a first column `surface`",
            ));
        }
        if !self.has_image {
            draft.surfaces.push(DraftSurface::default());
        }
        if let Some(distance) = object_distance {
            draft.surfaces[0].thickness_mm = distance * self.scale;
        }
        Ok(self.is_open)
    }
}
