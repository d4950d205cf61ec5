//! Tables of the wavefront: figures, Zernike coefficients, map.

use super::request::{Request, number, places, tracers};
use super::table::Table;
use crate::args::TableName;
use anyhow::Result;
use pipeline::design::ray::Tracer;
use pipeline::design::wavefront::{Wavefront, strehl_of_rms};
use pipeline::design::zernike::{TERMS, fit, fringe, noll, rms_of_standard};
use pipeline::design::{DesignError, System};
use rayon::prelude::*;
use serde_json::{Value, json};

/// The table `name` of the wavefront.
///
/// # Errors
/// Invalid `--wavefront-samples`.
pub fn table(name: TableName, system: &System, request: &Request<'_>) -> Result<Table> {
    let (side, azimuth_rad) = (request.args.wavefront_samples, request.args.azimuth_deg.to_radians());
    let tracers = tracers(system, request)?;
    let of_place = |(nm, mm, tracer, tan): (f64, f64, &Tracer<'_>, f64)| {
        match Wavefront::trace(tracer, tan, side, azimuth_rad) {
            Ok(wavefront) => Ok(rows(name, [nm, mm], &wavefront)),
            // Said of the whole table; of a field point, rays that do not reach the film.
            Err(e @ DesignError::Option { .. }) => Err(e),
            Err(_) => Ok(Vec::new()),
        }
    };
    let all: Vec<Vec<Vec<Value>>> =
        places(&tracers, request).into_par_iter().map(of_place).collect::<Result<_, _>>()?;
    Ok(Table::new(name, columns(name), all.concat()))
}

fn columns(name: TableName) -> &'static [&'static str] {
    match name {
        TableName::ZernikeStandard | TableName::ZernikeFringe => {
            &["wavelength_nm", "image_height_mm", "index", "n", "m", "coefficient_waves"]
        }
        TableName::WavefrontMap => {
            &["wavelength_nm", "image_height_mm", "pupil_x", "pupil_y", "wavefront_waves"]
        }
        _ => &[
            "wavelength_nm",
            "image_height_mm",
            "rays",
            "reference_radius_mm",
            "rms_waves",
            "rms_without_tilt_waves",
            "peak_to_valley_waves",
            "rms_of_zernike_waves",
            "rms_of_zernike_without_tilt_waves",
            "strehl_of_rms",
        ],
    }
}

fn rows(name: TableName, place: [f64; 2], wavefront: &Wavefront) -> Vec<Vec<Value>> {
    let start = || place.map(number).to_vec();
    let order = if name == TableName::ZernikeFringe { fringe } else { noll };
    match name {
        TableName::WavefrontMap => {
            let row = |s: &pipeline::design::wavefront::WavefrontSample| {
                [start(), [s.x, s.y, s.waves].map(number).to_vec()].concat()
            };
            wavefront.samples.iter().map(row).collect()
        }
        TableName::ZernikeStandard | TableName::ZernikeFringe => {
            let Some(coefficients) = fit(&wavefront.samples, order, TERMS) else { return Vec::new() };
            let row = |(i, c): (usize, f64)| {
                let z = order(i + 1);
                [start(), vec![json!(i + 1), json!(z.n), json!(z.m), number(c)]].concat()
            };
            coefficients.into_iter().enumerate().map(row).collect()
        }
        _ => {
            let fitted = fit(&wavefront.samples, order, TERMS).map(|c| rms_of_standard(&c));
            let rms = fitted.map_or_else(|| wavefront.rms_waves(), |[rms, _]| rms);
            let figures = [
                json!(wavefront.samples.len()),
                number(wavefront.radius_mm),
                number(wavefront.rms_waves()),
                json!(wavefront.rms_without_tilt_waves()),
                number(wavefront.peak_to_valley_waves()),
                json!(fitted.map(|f| f[0])),
                json!(fitted.map(|f| f[1])),
                number(strehl_of_rms(rms)),
            ];
            vec![[start(), figures.to_vec()].concat()]
        }
    }
}
