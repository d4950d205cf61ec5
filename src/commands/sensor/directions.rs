//! The directions of the light of a film, for sensors whose response depends on them: of its lens, or from a table (`--chief-ray-angles`; [`ConeTable::of_chief_rays`]).

use super::film::Film;
use super::geometry::Geometry;
use crate::args::ExposeArgs;
use crate::camera::frame::split_group;
use crate::failure::usage;
use crate::film::{digest, reported};
use crate::job::lens::UntracedLens;
use crate::job::recorded_lens::RecordedLens;
use anyhow::{Context, Result};
use formats::sensor::{SensorFile, chief_ray_angles};
use pipeline::bounds;
use pipeline::design::image_cone::image_cones;
use pipeline::design::skew::image_cone::film_cones;
use pipeline::design::skew::map::FilmRange;
use pipeline::geometry::Size;
use pipeline::lens::cone::ConeTable;
use pipeline::lens::cone_field::ConeField;
use pipeline::real;
use pipeline::sensor::Sensor;
use pipeline::sensor::field_weights::{FieldWeights, Placement};
use pipeline::sensor::response_map::ResponseMap;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// Intervals of the heights at which cones are checked.
const HEIGHTS: usize = 256;
/// Reach beyond the corners, relative: rounding.
const BEYOND: f64 = 1e-6;

/// The directions of a film's light.
pub struct Directions {
    /// By band.
    cones: Vec<ConeField>,
    placement: Placement,
    /// Largest chief-ray angle at the corners, degrees, of the middle band.
    corner_deg: f64,
    weights: OnceLock<Arc<FieldWeights>>,
}

impl Directions {
    /// Those of `film` on the sensor at `geometry`; `None` if it does not depend on them.
    ///
    /// # Errors
    /// Usage: flags for a sensor that does not depend on angles; a lens without them, or with the sensor's plates. The lens cannot be traced; the table cannot be read.
    pub fn of_film(
        film: &Film,
        args: &ExposeArgs,
        (file, sensor): (&SensorFile, &Sensor),
        geometry: &Geometry,
    ) -> Result<Option<Self>> {
        if !sensor.depends_on_angles() {
            return match (&args.chief_ray_angles, &args.lens) {
                (None, None) => Ok(None),
                _ => Err(usage(format!(
                    "--lens and --chief-ray-angles are for sensors whose response depends on the angle of incidence; {} has neither `angle` nor `plate`",
                    sensor.name
                ))),
            };
        }
        let Size { height, width } = geometry.size();
        let placement = Placement {
            size: Size::new(height, width),
            pitch_mm: geometry.rows.pitch_um * 1e-3,
            centre_mm: geometry.centre_mm,
        };
        let reach_mm = placement.reach_mm() * (1.0 + BEYOND);
        let cones = match &args.chief_ray_angles {
            Some(path) => vec![of_table(path, reach_mm)?; film.wavelengths_nm.len()],
            None => of_lens(film, args, (file, sensor), &placement)?,
        };
        let mut sines = cones.iter().flat_map(|field| field.sines(placement.corners_mm(), reach_mm, HEIGHTS));
        if let Some(([x, y], _)) = sines.find(|(_, sine)| *sine >= 1.0) {
            return Err(usage(format!(
                "{}: at {:.4} mm from the axis the cone of light reaches 90 degrees from the normal of the film: expected smaller chief-ray angles or larger F-numbers",
                args.chief_ray_angles.as_ref().map_or("the lens".into(), |path| path.display().to_string()),
                real::hypot(x, y)
            )));
        }
        let corner_deg = real::asin(corner_sine(&cones[cones.len() / 2], &placement).min(1.0)).to_degrees();
        Ok(Some(Self { cones, placement, corner_deg, weights: OnceLock::new() }))
    }

    /// What it adds to the identity of a signal.
    pub fn identity(&self) -> Value {
        let numbers: Vec<Vec<f64>> = self.cones.iter().map(ConeField::numbers).collect();
        digest(&json!(numbers)).into()
    }

    /// What is printed.
    pub fn note(&self) -> String {
        format!("largest chief-ray angle at a corner {:.1} degrees", self.corner_deg)
    }

    /// The weights of the bands of `film` over `sensor`.
    pub fn weights(&self, film: &Film, sensor: &Sensor, threads: usize) -> Arc<FieldWeights> {
        let bands = (&film.wavelengths_nm[..], &film.factors[..]);
        let new = || Arc::new(FieldWeights::new(sensor, bands, &self.cones, &self.placement, threads));
        Arc::clone(self.weights.get_or_init(new))
    }

    /// The response of the filters of `sensor`, for developments.
    pub fn response_map(&self, film: &Film, sensor: &Sensor, threads: usize) -> ResponseMap {
        let bands = (&film.wavelengths_nm[..], &film.factors[..]);
        ResponseMap::new(sensor, self.placement.size, &self.weights(film, sensor, threads), bands)
    }
}

/// Fails for a sensor that depends on angles where the lens `name` of a film that will be made gives none, or has the sensor's plates.
///
/// # Errors
/// Usage.
pub fn check_lens((file, sensor): (&SensorFile, &Sensor), lens: &UntracedLens, name: &str) -> Result<()> {
    check_plates((file, sensor), lens, name)?;
    match lens {
        UntracedLens::Pack(pack)
            if sensor.depends_on_angles() && pack.lens().bands.iter().any(|band| band.cones.is_none()) =>
        {
            Err(usage(format!(
                "lens pack {name} gives no directions of light at the film, which sensor {} depends on: give a design, or a pack of `lens trace --cones`",
                sensor.name
            )))
        }
        _ => Ok(()),
    }
}

/// Fails for a design whose plates take from the light what those of the sensor would.
///
/// # Errors
/// Usage.
fn check_plates((file, sensor): (&SensorFile, &Sensor), lens: &UntracedLens, name: &str) -> Result<()> {
    let UntracedLens::Design(design) = lens else { return Ok(()) };
    let system = &design.system;
    let is_lossy = system.surfaces.iter().any(|surface| surface.coating.is_some());
    match system.image_plates().first().filter(|_| is_lossy && file.may_repeat_plates()) {
        None => Ok(()),
        Some(surface) => Err(usage(format!(
            "sensor {} has a plate in front of its pixels, and the film loses the light that the plate of lens {name} takes (its surface {}): the same plate would count twice. Remove \
             `plate` from the sensor's description, or write `besides_lens = true` in it where both are there",
            sensor.name,
            surface + 1
        ))),
    }
}

/// The largest sine of a chief ray at a corner of the sensor.
fn corner_sine(cones: &ConeField, placement: &Placement) -> f64 {
    let sine = |[x, y]: [f64; 2]| {
        let height_mm = real::hypot(x, y);
        let away = if height_mm > 0.0 { [x / height_mm, y / height_mm] } else { [1.0, 0.0] };
        let [l, m] = cones.at([x, y], (height_mm, away)).chief;
        real::hypot(l, m)
    };
    let [[left, top], [right, bottom]] = placement.corners_mm();
    [[left, top], [right, top], [left, bottom], [right, bottom]].map(sine).into_iter().fold(0.0, f64::max)
}

fn of_lens(
    film: &Film,
    args: &ExposeArgs,
    of_sensor: (&SensorFile, &Sensor),
    placement: &Placement,
) -> Result<Vec<ConeField>> {
    let reach_mm = placement.reach_mm() * (1.0 + BEYOND);
    let [first, last] = placement.corners_mm();
    let (path, _) = split_group(args.film.as_deref().unwrap_or_default());
    let recorded = RecordedLens::new(&reported::film(Path::new(path))?, args.lens.as_deref())?;
    let other = || {
        usage(format!(
            "lens pack {} gives no directions of light at the film, which the sensor depends on: give them by --chief-ray-angles FILE.csv \
             (columns height_mm, cra_deg, f_number), or make the film with the design or a pack of `lens trace --cones` at its wavelengths and up to its corners",
            recorded.name
        ))
    };
    let lens = recorded.open()?;
    check_plates(of_sensor, &lens, &recorded.name)?;
    let design = match &lens {
        UntracedLens::Pack(pack) => {
            let of = |nm: &f64| {
                let band = pack.lens().bands.iter().find(|band| band.wavelength_nm == *nm)?;
                band.cones.clone().filter(|cones| cones.covers([first, last], reach_mm, 2.0 * BEYOND))
            };
            let all: Option<Vec<ConeField>> = film.wavelengths_nm.iter().map(of).collect();
            return all.ok_or_else(other);
        }
        UntracedLens::Design(design) => design,
    };
    let context = |nm: &f64| format!("directions of the light of lens {} at {nm} nm", recorded.name);
    if let Some(built) = lens.asymmetric_design() {
        let range = FilmRange { x_mm: [first[0], last[0]], y_mm: [first[1], last[1]] };
        let of = |nm: &f64| {
            let cones = film_cones(built, nm * 1e-3, range).with_context(|| context(nm))?;
            Ok(ConeField::Planar(cones))
        };
        return film.wavelengths_nm.iter().map(of).collect();
    }
    let of = |nm: &f64| {
        let cones = image_cones(&design.system, nm * 1e-3, reach_mm).with_context(|| context(nm))?;
        Ok(ConeField::Symmetric(cones))
    };
    film.wavelengths_nm.iter().map(of).collect()
}

fn of_table(path: &Path, reach_mm: f64) -> Result<ConeField> {
    let rows = chief_ray_angles(path).map_err(|e| usage(e.to_string()))?;
    for [height_mm, cra_deg, f_number] in &rows {
        bounds::F_NUMBER.check(*f_number).map_err(|e| usage(format!("{}: f_number {e}", path.display())))?;
        if cra_deg.abs() > 85.0 {
            return Err(usage(format!(
                "{}: at {height_mm} mm: expected a cra_deg of -85 to 85, found {cra_deg}",
                path.display()
            )));
        }
    }
    let (first, last) = (rows[0][0], rows[rows.len() - 1][0]);
    if first != 0.0 || last < reach_mm / (1.0 + 2.0 * BEYOND) {
        return Err(usage(format!(
            "{}: expected heights from 0 to the farthest corner of the sensor, {reach_mm:.4} mm, found {first} to {last} mm",
            path.display()
        )));
    }
    let chief_ray = |height_mm: f64| {
        let height = height_mm.min(last);
        let i = rows.partition_point(|row| row[0] <= height).clamp(1, rows.len() - 1);
        let (a, b) = (rows[i - 1], rows[i]);
        let t = (height - a[0]) / (b[0] - a[0]);
        (a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2]))
    };
    Ok(ConeField::Symmetric(ConeTable::of_chief_rays(reach_mm, chief_ray)))
}
