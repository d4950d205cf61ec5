//! Chart specifications as text, `KIND?key=value&key=value`: parsing of kinds and settings.

use super::depth_scene::ScenePart;
use super::error::{ChartError, bad_value};
use super::sine_star::StarProfile;
use super::spec::{ChartSpec, KINDS, Kind, MAX_SIDE, SIZE_EXPECTED};
use super::targets::{EdgePlaces, PointShape};
use crate::geometry::Size;
use crate::wavelengths;
use crate::words::edit_distance;

/// Settings of every kind.
const COMMON_KEYS: [&str; 7] =
    ["size", "wavelengths", "pitch_um", "overscan", "illuminant", "noise", "fiducials"];

impl Kind {
    /// The kind of this name, with default settings.
    ///
    /// # Errors
    /// [`ChartError::UnknownKind`] with the nearest name.
    pub fn named(name: &str) -> Result<Self, ChartError> {
        Ok(match name {
            "uniform" => Self::Uniform { value: 1.0 },
            "points" => Self::Points { count: 9, shape: PointShape::Gaussian, width_px: 3.0 },
            "slanted-edge" => Self::SlantedEdge {
                angle_deg: 5.0,
                contrast: 4.0,
                places: EdgePlaces::Grid(1),
                patch_px: None,
            },
            "iso12233-esfr" => Self::Esfr { angle_deg: 5.0, contrast: 4.0, grid: 5 },
            "dot-grid" => Self::DotGrid { count: 25, width_px: 20.0 },
            "black-spots" => Self::BlackSpots { along: 3, diameter: 0.05 },
            "lamp" => Self::Lamp { radius_px: 10.0, column: None, row: None },
            "siemens" => Self::Siemens { spokes: 72, grid: 1, profile: StarProfile::Square },
            "dead-leaves" => Self::DeadLeaves { seed: 0, r_min_px: 2.0, r_max_px: 128.0, contrast: 4.0 },
            "oecf" => Self::Oecf { patches: 20, density: 3.0 },
            "checker" => Self::Checker,
            "composite" => Self::Composite,
            "depth-scene" => Self::DepthScene { near_m: 0.1, far_m: 1.0, part: ScenePart::Chart },
            _ => {
                let names = KINDS.map(|(name, _)| name);
                let (nearest, valid) = (nearest(name, &names), names.join(", "));
                return Err(ChartError::UnknownKind { name: name.into(), nearest, valid });
            }
        })
    }
}

impl std::str::FromStr for ChartSpec {
    type Err = ChartError;

    fn from_str(text: &str) -> Result<Self, ChartError> {
        let text = text.strip_prefix("gen:").unwrap_or(text);
        let (kind, settings) = text.split_once('?').unwrap_or((text, ""));
        let mut spec = Self::new(Kind::named(kind)?);
        let mut seen = Vec::new();
        for setting in settings.split('&').filter(|s| !s.is_empty()) {
            let Some((key, value)) = setting.split_once('=') else {
                return Err(ChartError::NotASetting { text: setting.into() });
            };
            if seen.contains(&key) {
                return Err(ChartError::Twice { key: key.into() });
            }
            seen.push(key);
            spec.set(key, value)?;
        }
        spec.check()?;
        Ok(spec)
    }
}

impl ChartSpec {
    /// Sets one setting from text.
    ///
    /// # Errors
    /// [`ChartError`] if this kind has no such setting, or the setting does not admit this value.
    pub fn set(&mut self, key: &str, value: &str) -> Result<(), ChartError> {
        let name = self.kind.name();
        match (key, &mut self.kind) {
            ("size", _) => self.film = size(value)?,
            ("wavelengths", _) => self.wavelengths_nm = wavelengths::parse(value)?,
            ("pitch_um", _) => self.pitch_um = number("pitch_um", value)?,
            ("overscan", _) => self.overscan_px = Some(count("overscan", value)?),
            ("illuminant", _) => {
                self.illuminant = value.parse().map_err(|_| bad_value("illuminant", value, "D65, A or E"))?;
            }
            ("noise", _) => self.noise = number("noise", value)?,
            ("fiducials", _) => self.fiducials_px = number("fiducials", value)?,
            ("value", Kind::Uniform { value: v }) => *v = number("value", value)?,
            ("count", Kind::Points { count: n, .. } | Kind::DotGrid { count: n, .. }) => {
                *n = count("count", value)?
            }
            ("width_px", Kind::Points { width_px, .. } | Kind::DotGrid { width_px, .. }) => {
                *width_px = number("width_px", value)?
            }
            ("blob", Kind::Points { shape, .. }) => {
                *shape = match value {
                    "gaussian" => PointShape::Gaussian,
                    "disc" => PointShape::Disc,
                    _ => return Err(bad_value("blob", value, "gaussian or disc")),
                }
            }
            ("angle_deg", Kind::SlantedEdge { angle_deg, .. } | Kind::Esfr { angle_deg, .. }) => {
                *angle_deg = number("angle_deg", value)?
            }
            (
                "contrast",
                Kind::SlantedEdge { contrast, .. }
                | Kind::Esfr { contrast, .. }
                | Kind::DeadLeaves { contrast, .. },
            ) => *contrast = number("contrast", value)?,
            ("seed", Kind::DeadLeaves { seed, .. }) => {
                let number = value.trim().parse().ok();
                *seed =
                    number.ok_or_else(|| bad_value("seed", value, "a whole number from 0 to 2^64 - 1"))?;
            }
            ("r_min_px", Kind::DeadLeaves { r_min_px, .. }) => *r_min_px = number("r_min_px", value)?,
            ("r_max_px", Kind::DeadLeaves { r_max_px, .. }) => *r_max_px = number("r_max_px", value)?,
            ("patches", Kind::Oecf { patches, .. }) => *patches = count("patches", value)?,
            ("density", Kind::Oecf { density, .. }) => *density = number("density", value)?,
            ("profile", Kind::Siemens { profile, .. }) => {
                *profile = match value {
                    "square" => StarProfile::Square,
                    "sine" => StarProfile::Sine,
                    _ => return Err(bad_value("profile", value, "square or sine")),
                }
            }
            ("grid", Kind::SlantedEdge { places, .. }) => *places = EdgePlaces::Grid(count("grid", value)?),
            ("centers", Kind::SlantedEdge { places, .. }) => *places = EdgePlaces::Centres(centres(value)?),
            ("patch_px", Kind::SlantedEdge { patch_px, .. }) => *patch_px = Some(count("patch_px", value)?),
            ("spots", Kind::BlackSpots { along, .. }) => {
                let spots = count("spots", value)?;
                *along = spots.isqrt();
                if *along * *along != spots {
                    return Err(bad_value("spots", value, "a square number of discs: 1, 4, 9, 16, …"));
                }
            }
            ("diameter", Kind::BlackSpots { diameter, .. }) => {
                *diameter = match value.trim().strip_suffix('%') {
                    Some(percent) => number("diameter", percent)? / 100.0,
                    None => number("diameter", value)?,
                };
            }
            ("radius", Kind::Lamp { radius_px, .. }) => *radius_px = number("radius", value)?,
            ("x", Kind::Lamp { column, .. }) => *column = Some(number("x", value)?),
            ("y", Kind::Lamp { row, .. }) => *row = Some(number("y", value)?),
            ("spokes", Kind::Siemens { spokes, .. }) => *spokes = count("spokes", value)?,
            ("near_m", Kind::DepthScene { near_m, .. }) => *near_m = number("near_m", value)?,
            ("far_m", Kind::DepthScene { far_m, .. }) => {
                *far_m = if value.trim() == "inf" { f64::INFINITY } else { number("far_m", value)? };
            }
            ("part", Kind::DepthScene { part, .. }) => {
                let found = ScenePart::ALL.iter().find(|(name, _)| *name == value);
                let names = ScenePart::ALL.map(|(name, _)| name).join(", ");
                *part = found.ok_or_else(|| bad_value("part", value, &format!("one of {names}")))?.1;
            }
            ("grid", Kind::Siemens { grid, .. } | Kind::Esfr { grid, .. }) => *grid = count("grid", value)?,
            _ => {
                let specific = KINDS.iter().find(|k| k.0 == name).map_or(&[][..], |k| k.1);
                let keys: Vec<_> = COMMON_KEYS.iter().chain(specific).copied().collect();
                let (nearest, valid) = (nearest(key, &keys), keys.join(", "));
                return Err(ChartError::UnknownKey { kind: name, name: key.into(), nearest, valid });
            }
        }
        Ok(())
    }
}

fn size(value: &str) -> Result<Size, ChartError> {
    let (w, h) = value.split_once('x').unwrap_or((value, value));
    match (h.trim().parse(), w.trim().parse()) {
        (Ok(h), Ok(w)) if (1..=MAX_SIDE).contains(&h) && (1..=MAX_SIDE).contains(&w) => Ok(Size::new(h, w)),
        _ => Err(bad_value("size", value, SIZE_EXPECTED)),
    }
}

fn number(key: &'static str, value: &str) -> Result<f64, ChartError> {
    value.trim().parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| bad_value(key, value, "a number"))
}

fn count(key: &'static str, value: &str) -> Result<usize, ChartError> {
    let number = value.trim().parse().ok().filter(|n| *n <= MAX_SIDE);
    number.ok_or_else(|| bad_value(key, value, "a whole number, at most 1000000"))
}

/// `X,Y;X,Y` as (row, column).
fn centres(value: &str) -> Result<Vec<(f64, f64)>, ChartError> {
    let place = |pair: &str| {
        let (x, y) = pair
            .split_once(',')
            .ok_or_else(|| bad_value("centers", value, "places X,Y;X,Y in film pixels"))?;
        Ok((number("centers", y)?, number("centers", x)?))
    };
    value.split(';').map(place).collect()
}

/// The name of the smallest edit distance.
fn nearest(name: &str, names: &[&'static str]) -> &'static str {
    names.iter().min_by_key(|n| edit_distance(name, n)).copied().unwrap_or_default()
}
