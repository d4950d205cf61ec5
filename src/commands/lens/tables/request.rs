//! What tables are computed for, and their field points.

use crate::args::ShowArgs;
use anyhow::Result;
use pipeline::design::System;
use pipeline::design::ray::Tracer;
use serde_json::{Value, json};

/// What the tables are computed for.
pub struct Request<'a> {
    /// Wavelengths, nm.
    pub nm: &'a [f64],
    /// REAL image heights, mm.
    pub heights_mm: &'a [f64],
    /// The flags.
    pub args: &'a ShowArgs,
}

/// Tracers of the wavelengths of `request`.
pub fn tracers<'a>(system: &'a System, request: &Request<'_>) -> Result<Vec<(f64, Tracer<'a>)>> {
    request.nm.iter().map(|nm| Ok((*nm, Tracer::new(system, nm / 1e3)?))).collect()
}

/// Wavelength and height of each field point, with its tracer and the tangent of its field angle; without those that no chief ray reaches.
pub fn places<'a, 't>(
    tracers: &'t [(f64, Tracer<'a>)],
    request: &Request<'_>,
) -> Vec<(f64, f64, &'t Tracer<'a>, f64)> {
    let heights_mm = request.heights_mm.to_vec();
    let of_band = |(nm, tracer): &'t (f64, Tracer<'a>)| {
        let place = |mm: &f64| Some((*nm, *mm, tracer, tracer.field_of_height(*mm).ok()?));
        heights_mm.iter().filter_map(place).collect::<Vec<_>>()
    };
    tracers.iter().flat_map(of_band).collect()
}

/// A number, or null if it is not finite.
pub fn number(v: f64) -> Value {
    json!(v)
}
