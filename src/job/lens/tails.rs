//! Bands of a traced lens without tails.

use super::energy::percent;
use crate::progress::{number, plural};
use pipeline::design::trace::BandReport;

/// A note of the bands of `reports` that have no tail though tails were asked for: how many, why, and the error that remains. None if all have
/// one.
pub fn note(reports: &[BandReport]) -> Option<String> {
    let without = || reports.iter().filter_map(|r| Some((r, r.no_tail?)));
    let worst =
        without().max_by(|a, b| (a.1.blur_um / a.1.half_um).total_cmp(&(b.1.blur_um / b.1.half_um)))?;
    let least = without().map(|(r, _)| r.min_energy).fold(1.0, f64::min);
    let (report, tail) = worst;
    Some(format!(
        "note: {} of {} without tails: rays at the edge of the pupil land up to {:.0} µm from the chief ray ({} nm), and the windows have {:.0} µm to either side, \
         too little for the light between. It is scaled into the windows: edges are up to {} of white wrong. `--energy` above 0.99 makes windows wider",
        plural(without().count(), "band"),
        reports.len(),
        tail.blur_um,
        number(report.wavelength_nm),
        tail.half_um,
        percent(0.5 * (1.0 - least)),
    ))
}
