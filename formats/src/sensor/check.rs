//! Ranges of a description's fields, the mosaic, and that no quantum efficiency is above 1.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::path::Path;

use pipeline::sensor::Pattern;

use super::text::{CfaText, FilterText, PitchText, QuantityText, SensorText};
use super::{SensorError, SensorFile};

/// Greatest period of a mosaic, rows and columns.
const MAX_PERIOD: usize = 8;
/// Greatest quantum efficiency that rounding of tables explains.
const MAX_EFFICIENCY: f64 = 1.0 + 1e-9;

pub(super) fn wrong(path: &Path, field: &str, expected: impl Display, found: impl Display) -> SensorError {
    let (expected, found) = (expected.to_string(), found.to_string());
    SensorError::Field { path: path.into(), field: field.into(), expected, found }
}

/// All numbers within their ranges.
pub(super) fn fields(path: &Path, t: &SensorText) -> Result<(), SensorError> {
    let within = |field: &str, value: f64, (low, high): (f64, f64)| match (low..=high).contains(&value) {
        true => Ok(()),
        false => Err(wrong(path, field, format!("{low} to {high}"), value)),
    };
    let above = |field: &str, value: f64, max: f64| match value > 0.0 && value <= max {
        true => Ok(()),
        false => Err(wrong(path, field, format!("above 0, at most {max}"), value)),
    };
    let (p, a, s) = (&t.pixel, &t.adc, &t.spectral);
    if t.name.is_empty() {
        return Err(wrong(path, "name", "a name", "nothing"));
    }
    if let PitchText::Um(pitch) = p.pitch_um {
        within("pixel.pitch_um", pitch, (0.1, 1000.0))?;
        if let Some(aperture) = p.aperture_um.filter(|a| !(*a > 0.0 && *a <= pitch)) {
            return Err(wrong(
                path,
                "pixel.aperture_um",
                format!("above 0, at most the pitch of {pitch} µm"),
                aperture,
            ));
        }
    } else if let Some(aperture) = p.aperture_um {
        return Err(wrong(path, "pixel.aperture_um", "none where pitch_um is \"film\"", aperture));
    }
    if let Some((rows, columns)) = p.size {
        for side in [rows, columns] {
            within("pixel.size", side as f64, (1.0, 1e6))?;
        }
    }
    above("pixel.full_well_e", p.full_well_e, 1e9)?;
    above("pixel.knee", p.knee, 1.0)?;
    within("pixel.blooming", p.blooming, (0.0, 1.0))?;
    within("pixel.dark_current_e_per_s", p.dark_current_e_per_s, (0.0, 1e9))?;
    within("pixel.dark_reference_c", p.dark_reference_c, (-273.0, 200.0))?;
    within("pixel.dark_doubling_k", p.dark_doubling_k, (1.0, 100.0))?;
    for (row, value) in t.noise.rows() {
        within(&format!("noise.{}", row.field), value, (0.0, row.max))?;
    }
    let spectrum = t.noise_spectrum.unwrap_or_default();
    within("noise_spectrum.row_exponent", spectrum.row_exponent, (0.0, 2.0))?;
    within("noise_spectrum.column_exponent", spectrum.column_exponent, (0.0, 2.0))?;
    let d = t.defects.unwrap_or_default();
    within("defects.hot_pixels", d.hot_pixels, (0.0, 1.0))?;
    within("defects.hot_dark_e_per_s", d.hot_dark_e_per_s, (0.0, 1e9))?;
    within("defects.telegraph_pixels", d.telegraph_pixels, (0.0, 1.0))?;
    within("defects.telegraph_e", d.telegraph_e, (0.0, 1e6))?;
    if let Some(shutter) = t.shutter {
        within("shutter.row_time_us", shutter.row_time_us, (0.0, 1e6))?;
    }
    within("adc.bits", f64::from(a.bits), (1.0, 16.0))?;
    above("adc.gain_dn_per_e", a.gain_dn_per_e, 1e6)?;
    for gain in &a.gains {
        within("adc.gains", *gain, (1.0, 64.0))?;
    }
    if let Some(iso) = a.base_iso {
        within("adc.base_iso", iso, (1.0, 1e6))?;
    }
    if let Some(constant) = s.constant {
        above("spectral.constant", constant, 1.0)?;
        if s.file.is_some() {
            return Err(wrong(path, "spectral", "either `file` or `constant`", "both"));
        }
    }
    if s.filters.len() + t.plate.len() > 2 {
        let found = s.filters.len() + t.plate.len();
        return Err(wrong(path, "spectral.filters and plate", "at most two in all", found));
    }
    let files: Vec<&String> = s.filters.iter().chain(t.plate.iter().map(|plate| &plate.file)).collect();
    if let [first, second] = files[..]
        && first == second
    {
        let expected = "each table once; of two that are alike one table with their product";
        return Err(wrong(path, "spectral.filters and plate", expected, format!("{first} twice")));
    }
    match (s.quantity, s.peak_quantum_efficiency) {
        (None, _) if s.file.is_some() => {
            let words = "\"quantum_efficiency\" or \"relative_response\"";
            Err(wrong(path, "spectral.quantity", words, "nothing"))
        }
        (Some(QuantityText::RelativeResponse), None) => Err(wrong(
            path,
            "spectral.peak_quantum_efficiency",
            "a share where quantity is \"relative_response\"",
            "nothing",
        )),
        (Some(QuantityText::QuantumEfficiency) | None, Some(peak)) => Err(wrong(
            path,
            "spectral.peak_quantum_efficiency",
            "none, unless quantity is \"relative_response\"",
            peak,
        )),
        (_, Some(peak)) => above("spectral.peak_quantum_efficiency", peak, 1.0),
        _ => Ok(()),
    }
}

/// Filters in the order in which they first appear, and the mosaic.
#[allow(clippy::type_complexity, reason = "filters with their fields, and the mosaic of them")]
pub(super) fn pattern(
    path: &Path,
    cfa: &BTreeMap<String, CfaText>,
) -> Result<(Vec<(String, FilterText)>, Pattern), SensorError> {
    let rows = match cfa.get("pattern") {
        Some(CfaText::Pattern(rows)) => rows,
        Some(CfaText::Filter(_)) => return Err(wrong(path, "cfa.pattern", "rows of names", "a filter")),
        None => {
            return Err(wrong(
                path,
                "cfa.pattern",
                "rows of names, e.g. [[\"R\", \"G\"], [\"G\", \"B\"]]",
                "nothing",
            ));
        }
    };
    let columns = rows.first().map_or(0, Vec::len);
    let sides = 1..=MAX_PERIOD;
    if !sides.contains(&rows.len()) || !sides.contains(&columns) || rows.iter().any(|r| r.len() != columns) {
        let found: Vec<usize> = rows.iter().take(MAX_PERIOD + 1).map(Vec::len).collect();
        let expected = format!("1 to {MAX_PERIOD} rows of as many names each, 1 to {MAX_PERIOD}");
        return Err(wrong(path, "cfa.pattern", expected, format!("{} rows of {found:?} names", rows.len())));
    }
    let mut names: Vec<(String, FilterText)> = Vec::new();
    let mut channels = Vec::new();
    for name in rows.iter().flatten() {
        let known = names.iter().position(|(own, _)| own == name);
        let channel = match (known, cfa.get(name)) {
            (Some(channel), _) => channel,
            (None, Some(CfaText::Filter(filter))) => {
                names.push((name.clone(), filter.clone()));
                names.len() - 1
            }
            (None, _) => {
                return Err(wrong(
                    path,
                    &format!("cfa.{name}"),
                    "a filter, for it is in the pattern",
                    "nothing",
                ));
            }
        };
        channels.push(channel);
    }
    for (name, entry) in cfa.iter().filter(|(name, _)| *name != "pattern") {
        match entry {
            CfaText::Pattern(_) => {
                return Err(wrong(path, &format!("cfa.{name}"), "a filter", "rows of names"));
            }
            CfaText::Filter(_) if !names.iter().any(|(own, _)| own == name) => {
                return Err(wrong(
                    path,
                    &format!("cfa.{name}"),
                    "a name of the pattern",
                    "one that is not in it",
                ));
            }
            CfaText::Filter(_) => {}
        }
    }
    Ok((names, Pattern { rows: rows.len(), columns, channels }))
}

/// Saturation is at least one digital number above black, and no channel gives more than one electron a photon.
pub(super) fn sensor(path: &Path, file: &SensorFile) -> Result<(), SensorError> {
    let sensor = file.sensor(1.0);
    let (black, white) = (sensor.adc.black_dn, sensor.white_dn(1.0));
    if white < black + 1.0 {
        let found = format!(
            "{}, whose saturation of {} e- is {white} DN",
            sensor.adc.gain_dn_per_e,
            sensor.saturation_e(1.0)
        );
        let expected = format!("a white at least 1 DN above the black of {black} DN");
        return Err(wrong(path, "adc.gain_dn_per_e", expected, found));
    }
    for (k, channel) in sensor.channels.iter().enumerate() {
        for nm in &channel.curve.wavelengths_nm {
            let found = sensor.quantum_efficiency(k, *nm);
            if found > MAX_EFFICIENCY {
                let field = format!("quantum efficiency of {} at {nm} nm", channel.name);
                return Err(wrong(path, &field, "at most 1", found));
            }
        }
    }
    Ok(())
}
