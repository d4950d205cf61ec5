//! Worst figures over all bands, and the limits of `--require` that they miss.

use super::band::Band;
use super::distortion::mean_max;
use super::edge::EdgeResult;
use super::light::Check;
use super::{Results, light};
use crate::args::Quantity;
use crate::progress::plural;

/// Worst value of a quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Worst {
    pub value: f64,
    /// Wavelength and edge.
    pub at: String,
}

/// Worst value over all bands and edges; of light, the largest difference over its limit.
pub fn worst(results: &Results, what: Quantity) -> Worst {
    let bands = &results.bands;
    let all: Vec<(f64, String)> = match what {
        Quantity::Ri => {
            bands.iter().map(|b: &Band| (b.illumination.agreement.iou, format!("{} nm", b.nm))).collect()
        }
        Quantity::Distortion => {
            bands.iter().map(|b| (mean_max(&b.points).0, format!("{} nm", b.nm))).collect()
        }
        Quantity::Esf => bands
            .iter()
            .flat_map(|b| {
                let at = |e: &EdgeResult| format!("{} nm, {}", b.nm, e.place.title());
                b.edges.iter().map(move |e| (e.agreement.iou, at(e)))
            })
            .collect(),
        Quantity::Light => light::worst(&results.light)
            .map(|check: &Check| (check.of_limit(), check.name.clone()))
            .into_iter()
            .collect(),
    };
    let larger_is_worse = matches!(what, Quantity::Distortion | Quantity::Light);
    let pick =
        all.into_iter().reduce(|a, b| if (b.0 > a.0) == larger_is_worse && b.0 != a.0 { b } else { a });
    let (value, at) = pick.unwrap_or((f64::NAN, "no band".into()));
    Worst { value, at }
}

/// The worst values in one line.
pub fn summary(results: &Results) -> String {
    let all = [Quantity::Ri, Quantity::Distortion, Quantity::Esf, Quantity::Light];
    let [ri, distortion, esf, light] = all.map(|q| worst(results, q));
    format!(
        "worst of {}: relative illumination, IoU {:.6} % ({}); distortion, mean error {:.5} px ({}); edge spread function, IoU \
         {:.4} % ({}); light, difference over its limit {:.2} ({})",
        plural(results.bands.len(), "band"),
        100.0 * ri.value,
        ri.at,
        distortion.value,
        distortion.at,
        100.0 * esf.value,
        esf.at,
        light.value,
        light.at
    )
}

/// Messages of the limits that are missed.
pub fn missed(results: &Results, required: &[(Quantity, f64)]) -> Vec<String> {
    let message = |&(what, limit): &(Quantity, f64)| {
        let Worst { value, at } = worst(results, what);
        // A NaN meets no limit.
        let (met, name, bound) = match what {
            Quantity::Ri => (value >= limit, "ri: IoU", "minimum"),
            Quantity::Distortion => (value <= limit, "distortion: mean error (px)", "maximum"),
            Quantity::Esf => (value >= limit, "esf: IoU", "minimum"),
            Quantity::Light => (value <= limit, "light: difference over its limit", "maximum"),
        };
        (!met).then(|| format!("{name} {value:.7} at {at}, required {bound} {limit}"))
    };
    required.iter().filter_map(message).collect()
}
