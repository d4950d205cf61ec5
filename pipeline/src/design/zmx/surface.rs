//! A surface of a .zmx file.

use super::line::{Line, UNKNOWN_KEYWORD};
use crate::design::error::DesignError;
use crate::design::glass::{Dispersion, Glass, GlassCatalog};
use crate::design::surface::Shape;
use crate::design::system::{Medium, Surface};

/// Surface keywords that do not change the optics: comments, drawing, coatings (transmission is not modelled), saved solves.
const SURFACE_SKIPPED: &[&str] = &[
    "SSID", "COMM", "FIMP", "HIDE", "MIRR", "SLAB", "POPS", "MEMA", "COAT", "PZUP", "PKUP", "MAZH", "SCOL",
    "SDRW", "SPID", "TPRI", "CSHP",
];

#[derive(Default)]
pub(super) struct SurfaceDraft {
    shape: Shape,
    asphere: bool,
    pub(super) thickness: f64,
    pub(super) glass: Option<Glass>,
    fixed: Option<f64>,
    pub(super) semi_diameter: f64,
    clear: Option<f64>,
    parameters: Vec<(usize, f64, usize, String)>,
}

impl SurfaceDraft {
    /// Reads a line of the surface; `scale` is the lens unit in mm.
    pub(super) fn read_line(
        &mut self,
        key: &str,
        line: &Line<'_>,
        scale: f64,
        glasses: &GlassCatalog,
    ) -> Result<(), DesignError> {
        match key {
            "TYPE" => match line.words.get(1) {
                Some(&"STANDARD") => self.asphere = false,
                Some(&"EVENASPH") => self.asphere = true,
                Some(kind) => {
                    return Err(line
                        .error(format!("surface type {kind} is not supported, only STANDARD and EVENASPH")));
                }
                None => return Err(line.error("expected a surface type")),
            },
            "CURV" => self.shape.curvature = line.value(1)? / scale,
            "CONI" => self.shape.conic = line.value(1)?,
            "DISZ" => {
                self.thickness = match line.words.get(1) {
                    Some(&"INFINITY") => f64::INFINITY,
                    _ => line.value(1)? * scale,
                };
            }
            "PARM" => {
                let (i, v) = (line.value(1)?, line.value(2)?);
                if v != 0.0 {
                    self.parameters.push((i.clamp(0.0, 99.0) as usize, v, line.number, line.quote()));
                }
            }
            "GLAS" => self.glass = Some(glass(line, glasses)?),
            "DIAM" => {
                self.semi_diameter = line.value(1)? * scale;
                self.fixed =
                    (line.value_or(2, 0.0)? == 1.0 && self.semi_diameter > 0.0).then_some(self.semi_diameter);
            }
            "CLAP" | "FLAP" => {
                if line.value(1)? != 0.0 {
                    return Err(line.error("a central obscuration is not supported"));
                }
                self.clear = Some(line.value(2)? * scale);
            }
            _ if SURFACE_SKIPPED.contains(&key) => {}
            _ => return Err(line.error(UNKNOWN_KEYWORD)),
        }
        Ok(())
    }

    /// The surface with number `index`; `scale` is the lens unit in mm.
    pub(super) fn surface(&self, index: usize, is_image: bool, scale: f64) -> Result<Surface, DesignError> {
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
    let name = *line.words.get(1).ok_or_else(|| line.error("expected a glass name"))?;
    if name.eq_ignore_ascii_case("MIRROR") {
        return Err(line.error("mirrors are not supported"));
    }
    let solve = line.value_or(2, 0.0)?;
    if solve == 1.0 {
        // A model glass: nd, Vd and a deviation of partial dispersion. Its dispersion formula is internal to the design program.
        let (nd, vd, deviation) = (line.value(4)?, line.value_or(5, 0.0)?, line.value_or(6, 0.0)?);
        if vd != 0.0 || deviation != 0.0 {
            // Old files have a nominal model beside every catalogue glass.
            return glasses.find(name).cloned().map_err(|_| {
                line.error("a model glass with dispersion is not supported; name a catalogue glass (its catalogue may be missing)")
            });
        }
        return Ok(Glass {
            name: format!("n={nd}"),
            dispersion: Dispersion::constant(nd),
            range_um: (0.0, 1e3),
        });
    }
    glasses.find(name).cloned().map_err(|e| line.error(e.to_string()))
}
