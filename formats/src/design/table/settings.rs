//! Settings of a lens table: lines before its header row.
//!
//! name; source, note (for people); unit (mm, cm, m, in); catalogues; one of f-number, working f-number, entrance pupil diameter (epd), object na, stop radius;
//! one of field deg, object height, paraxial image height, real image height, each with its values; wavelengths nm; weights; primary nm; object
//! distance; aiming (real, paraxial); object space (telecentric); focal length (as printed: it is compared).

use std::collections::BTreeMap;

use super::columns::plain;
use super::line::Line;
use super::units::{self, Unit};
use crate::design::draft::Draft;
use crate::design::error::LensFileError;
use crate::design::text;
use pipeline::design::system::{Aperture, FieldKind, RayAiming};

/// F, d and C lines, nm.
const DEFAULT_NM: [f64; 3] = [486.132_7, 587.561_8, 656.272_5];

#[derive(Default)]
pub(super) struct Settings {
    /// Lines of what is given once.
    given: BTreeMap<&'static str, usize>,
    name: String,
    scale: Option<f64>,
    pub(super) catalogues: Vec<String>,
    aperture: Option<Aperture>,
    fields: Option<(FieldKind, Vec<f64>)>,
    nm: Vec<f64>,
    weights: Vec<f64>,
    primary_nm: Option<f64>,
    object_distance: Option<f64>,
    focal_length: Option<f64>,
    aiming: Option<RayAiming>,
    is_telecentric: bool,
    notes: Vec<String>,
}

pub(super) fn is_catalogues(name: &str) -> bool {
    matches!(plain(name).as_str(), "catalogues" | "catalogs" | "glasscatalogues")
}

impl Settings {
    /// Lens unit in mm.
    pub(super) fn scale(&self) -> f64 {
        self.scale.unwrap_or(1.0)
    }

    pub(super) fn focal_length_mm(&self) -> Option<f64> {
        self.focal_length.map(|f| f * self.scale())
    }

    /// Object distance in lens units.
    pub(super) fn object_distance(&self) -> Result<Option<f64>, LensFileError> {
        Ok(self.object_distance)
    }

    /// Checks the unit in the name of a setting, when all settings have been read.
    pub(super) fn check_unit(&self, line: &Line<'_>) -> Result<(), LensFileError> {
        let expected = match plain(line.cell(0)).as_str() {
            "entrancepupildiameter"
            | "epd"
            | "stopradius"
            | "objectheight"
            | "paraxialimageheight"
            | "imageheight"
            | "realimageheight"
            | "objectdistance"
            | "focallength"
            | "efl"
            | "f" => Unit::Length(self.scale()),
            "fielddeg" | "fielddegrees" | "fieldangle" | "fieldangledeg" => Unit::Degrees,
            "wavelengthsnm" | "wavelengthnm" | "wavelengths" | "primarynm" | "primarywavelengthnm" => {
                Unit::Length(1e-6)
            }
            _ => return Ok(()),
        };
        units::check(line, line.cell(0), expected)
    }

    pub(super) fn read(&mut self, line: &Line<'_>, strict: bool) -> Result<(), LensFileError> {
        let values = || -> Result<Vec<f64>, LensFileError> {
            let cells = line.cells[1..].iter().filter(|c| !c.is_empty());
            cells.map(|c| line.number(c).and_then(|v| finite(line, v))).collect()
        };
        let value = || match values()?[..] {
            [v] => Ok(v),
            _ => Err(line.error("expected one number")),
        };
        let word = || line.cells[1..].join(", ").trim_end_matches([',', ' ']).to_owned();
        let mut once = |what: &'static str| match self.given.insert(what, line.number) {
            None => Ok(()),
            Some(before) => {
                Err(line.error(format!("{what} was given before, in line {before}; remove one of the two")))
            }
        };
        match plain(line.cell(0)).as_str() {
            "name" | "title" => self.name = word(),
            "source" | "reference" | "patent" | "note" | "notes" | "comment" | "glasses" | "" => {}
            "unit" | "units" => {
                once("the unit")?;
                self.scale = Some(match word().to_lowercase().as_str() {
                    "mm" => 1.0,
                    "cm" => 10.0,
                    "m" => 1000.0,
                    "in" | "inch" => 25.4,
                    _ => return Err(line.error("expected the unit mm, cm, m or in")),
                });
            }
            "catalogues" | "catalogs" | "glasscatalogues" => {
                self.catalogues = line.cells[1..].iter().filter(|c| !c.is_empty()).cloned().collect();
            }
            setting @ ("fnumber"
            | "fno"
            | "fnum"
            | "imagespacefnumber"
            | "workingfnumber"
            | "entrancepupildiameter"
            | "epd"
            | "objectna"
            | "stopradius") => {
                once("the aperture")?;
                let aperture = match setting {
                    "workingfnumber" => Aperture::WorkingFNumber,
                    "entrancepupildiameter" | "epd" => Aperture::EntrancePupil,
                    "objectna" => Aperture::ObjectNa,
                    "stopradius" => Aperture::StopRadius,
                    _ => Aperture::ImageFNumber,
                };
                self.aperture = Some(aperture(value()?));
            }
            setting @ ("fielddeg"
            | "fielddegrees"
            | "fieldangle"
            | "fieldangledeg"
            | "objectheight"
            | "paraxialimageheight"
            | "imageheight"
            | "realimageheight") => {
                once("the field")?;
                let kind = match setting {
                    "objectheight" => FieldKind::ObjectHeight,
                    "paraxialimageheight" => FieldKind::ParaxialImageHeight,
                    "imageheight" | "realimageheight" => FieldKind::RealImageHeight,
                    _ => FieldKind::Angle,
                };
                self.fields = Some((kind, values()?));
            }
            "wavelengthsnm" | "wavelengthnm" | "wavelengths" => {
                once("the list of wavelengths")?;
                self.nm = values()?;
            }
            "weights" => {
                once("the list of weights")?;
                self.weights = values()?;
            }
            "primarynm" | "primarywavelengthnm" => {
                once("the primary wavelength")?;
                self.primary_nm = Some(value()?);
            }
            "objectdistance" => {
                once("the object distance")?;
                let is_finite = !line.cells[1..].iter().any(|c| text::is_infinite(c));
                self.object_distance = Some(if is_finite { value()? } else { f64::INFINITY });
            }
            "objectspace" => {
                once("the object space")?;
                self.is_telecentric = match word().to_lowercase().as_str() {
                    "telecentric" => true,
                    "normal" => false,
                    _ => return Err(line.error("expected telecentric or normal")),
                };
            }
            "focallength" | "efl" | "f" => {
                once("the focal length")?;
                self.focal_length = Some(value()?);
            }
            "aiming" => {
                once("the aiming")?;
                self.aiming = Some(match word().to_lowercase().as_str() {
                    "real" => RayAiming::Real,
                    "paraxial" => RayAiming::Paraxial,
                    _ => return Err(line.error("expected real or paraxial")),
                });
            }
            _ if strict => return Err(line.error("this setting is not known, and --strict allows none")),
            _ => {
                let text = text::quote(line.text);
                let note = format!("line {}: `{text}` is not a known setting and was ignored", line.number);
                self.notes.push(note);
            }
        }
        Ok(())
    }

    pub(super) fn finish(self, draft: &mut Draft) -> Result<(), LensFileError> {
        let scale = self.scale();
        draft.name = self.name;
        draft.notes.extend(self.notes);
        draft.is_telecentric = self.is_telecentric;
        draft.aiming = self.aiming.or(draft.aiming.filter(|_| !self.is_telecentric));
        let (kind, fields) = self.fields.unwrap_or((FieldKind::Angle, vec![0.0]));
        draft.field_kind = Some(kind);
        let unit = if kind == FieldKind::Angle { 1.0 } else { scale };
        draft.fields = fields.iter().map(|f| f * unit).collect();
        let mut nm = self.nm;
        if nm.is_empty() {
            nm = DEFAULT_NM.to_vec();
            draft.notes.push("no wavelengths given: the lines F, d and C".to_owned());
        }
        let weight = |i: usize| self.weights.get(i).copied().unwrap_or(1.0);
        draft.wavelengths_um = nm.iter().enumerate().map(|(i, nm)| (nm / 1e3, weight(i))).collect();
        draft.primary = match self.primary_nm {
            None => nm.len() / 2,
            Some(primary) => {
                nm.iter().position(|v| *v == primary).ok_or_else(|| LensFileError::Incomplete {
                    problem: format!(
                        "has a primary wavelength of {primary} nm that is not among its wavelengths"
                    ),
                })?
            }
        };
        draft.aperture = match self.aperture {
            Some(Aperture::EntrancePupil(d)) => Some(Aperture::EntrancePupil(d * scale)),
            Some(Aperture::StopRadius(r)) => {
                set_stop_radius(draft, r * scale);
                Some(Aperture::StopRadius(r * scale))
            }
            Some(other) => Some(other),
            // A stop of a given size is an aperture, too.
            None => {
                let stop = draft.stop.and_then(|i| draft.surfaces.get(i));
                let radius = stop.map(|s| s.clear_mm.unwrap_or(s.semi_diameter_mm)).filter(|r| *r > 0.0);
                if let Some(radius) = radius {
                    set_stop_radius(draft, radius);
                    draft.notes.push("no aperture given: the stop's own radius".to_owned());
                }
                radius.map(Aperture::StopRadius)
            }
        };
        Ok(())
    }
}

fn set_stop_radius(draft: &mut Draft, radius_mm: f64) {
    if let Some(stop) = draft.stop.and_then(|i| draft.surfaces.get_mut(i)) {
        stop.semi_diameter_mm = radius_mm;
    }
}

fn finite(line: &Line<'_>, value: f64) -> Result<f64, LensFileError> {
    if value.is_finite() { Ok(value) } else { Err(line.error("expected a finite number")) }
}
