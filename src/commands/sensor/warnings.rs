//! Warnings and notes before a raw is made: light that the film does not hold, a low black.

use crate::failure::usage;
use anyhow::Result;
use pipeline::sensor::Sensor;
use std::path::Path;

/// Share of the response outside the film's bands that is warned of.
const OUTSIDE: f64 = 0.01;
/// Share of charge beyond the reach of crosstalk that is warned of.
const FARTHER: f64 = 0.01;
/// Black must lie this many standard deviations of the dark above 0.
const BLACK_SIGMAS: f64 = 4.0;

/// The share of each channel's response outside the film's bands; a sensor without response to a band, or to all bands, is an error.
pub fn of_spectrum(sensor: &Sensor, bands_nm: &[f64], film: &Path) -> Result<Vec<String>> {
    let weights: Vec<Vec<f64>> =
        (0..sensor.channels.len()).map(|c| sensor.band_weights(c, bands_nm)).collect();
    let ranges: Vec<String> = sensor
        .channels
        .iter()
        .map(|c| format!("{} {}-{} nm", c.name, c.curve.range_nm().0, c.curve.range_nm().1))
        .collect();
    let within = |nm: f64| {
        let covers = |c: &pipeline::sensor::Curve| (c.range_nm().0..=c.range_nm().1).contains(&nm);
        sensor.channels.iter().any(|c| covers(&c.curve)) && sensor.filters.iter().all(covers)
    };
    if let Some(nm) = bands_nm
        .iter()
        .enumerate()
        .find(|(b, nm)| !within(**nm) && weights.iter().all(|w| w[*b] == 0.0))
        .map(|b| b.1)
    {
        return Err(usage(format!(
            "film {}: its band of {nm} nm lies outside all curves of sensor {} ({}); compute the film for the bands of the sensor \
             (`lenscube run --bands`), or extend the curves",
            film.display(),
            sensor.name,
            ranges.join(", ")
        )));
    }
    if weights.iter().flatten().all(|w| *w <= 0.0) {
        return Err(usage(format!(
            "film {}: sensor {} has no response in its bands ({})",
            film.display(),
            sensor.name,
            ranges.join(", ")
        )));
    }
    let shares: Vec<(String, f64)> = (0..sensor.channels.len())
        .map(|c| (sensor.channels[c].name.clone(), sensor.share_outside(c, bands_nm)))
        .collect();
    // A constant has no range.
    let endless = sensor.channels.iter().all(|c| c.curve.range_nm().1 >= 1e5);
    if endless {
        return Ok(vec!["note: the sensor's efficiency is one constant at all wavelengths; light outside the film's bands is not counted".into()]);
    }
    let by_name: Vec<String> =
        shares.iter().map(|(name, share)| format!("{name} {:.2} %", 100.0 * share)).collect();
    let warning = shares.iter().any(|s| s.1 > OUTSIDE);
    let kind = if warning { "warning" } else { "note" };
    Ok(vec![format!(
        "{kind}: share of each filter's response (equal energy) outside the film's bands: {}",
        by_name.join(", ")
    )])
}

/// Charge that spreads farther than crosstalk reaches.
pub fn of_crosstalk(sensor: &Sensor, bands_nm: &[f64]) -> Option<String> {
    let crosstalk = sensor.crosstalk.as_ref()?;
    let share = |nm: &f64| (crosstalk.farther_at(*nm), *nm);
    let (share, nm) = bands_nm.iter().map(share).fold((0.0, 0.0), |a, b| if b.0 > a.0 { b } else { a });
    let kind = if share > FARTHER { "warning" } else { "note" };
    (share > FARTHER / 10.0).then(|| {
        format!(
            "{kind}: {:.2} % of the charge of {nm} nm spreads farther than {} pixels; it is counted at its own pixel",
            100.0 * share,
            crosstalk.radius
        )
    })
}

/// A black that cuts the dark's noise off.
pub fn of_black(sensor: &Sensor, gain: f64, temperature_c: Option<f64>) -> Option<String> {
    let sigma = sensor.dark_sigma_dn(gain, 0.0, temperature_c);
    (sensor.adc.black_dn < BLACK_SIGMAS * sigma).then(|| {
        format!(
            "warning: black is {} DN, {:.1} standard deviations of the dark ({sigma:.2} DN): noise is cut off at 0; give e.g. --set adc.black_dn={:.0}",
            sensor.adc.black_dn,
            sensor.adc.black_dn / sigma,
            (BLACK_SIGMAS * sigma).ceil()
        )
    })
}
