//! Worst figures over all bands, and the limits of `--require` that they miss.

use super::band::Band;
use super::distortion::mean_max;
use super::edge::EdgeResult;
use crate::args::Quantity;
use crate::progress::plural;

/// Worst value of a quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Worst {
    pub value: f64,
    /// Wavelength and edge.
    pub at: String,
}

/// Worst value over all bands and edges.
pub fn worst(bands: &[Band], what: Quantity) -> Worst {
    let all: Vec<(f64, String)> = match what {
        Quantity::Ri => {
            bands.iter().map(|b| (b.illumination.agreement.iou, format!("{} nm", b.nm))).collect()
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
    };
    let larger_is_worse = what == Quantity::Distortion;
    let pick =
        all.into_iter().reduce(|a, b| if (b.0 > a.0) == larger_is_worse && b.0 != a.0 { b } else { a });
    let (value, at) = pick.unwrap_or((f64::NAN, "no band".into()));
    Worst { value, at }
}

/// The worst values in one line.
pub fn summary(bands: &[Band]) -> String {
    let [ri, distortion, esf] = [Quantity::Ri, Quantity::Distortion, Quantity::Esf].map(|q| worst(bands, q));
    format!(
        "worst of {}: relative illumination, IoU {:.6} % ({}); distortion, mean error {:.5} px ({}); edge spread function, IoU \
         {:.4} % ({})",
        plural(bands.len(), "band"),
        100.0 * ri.value,
        ri.at,
        distortion.value,
        distortion.at,
        100.0 * esf.value,
        esf.at
    )
}

/// Messages of the limits that are missed.
pub fn missed(bands: &[Band], required: &[(Quantity, f64)]) -> Vec<String> {
    let message = |&(what, limit): &(Quantity, f64)| {
        let Worst { value, at } = worst(bands, what);
        // A NaN meets no limit.
        let (met, name, bound) = match what {
            Quantity::Ri => (value >= limit, "ri: IoU", "minimum"),
            Quantity::Distortion => (value <= limit, "distortion: mean error (px)", "maximum"),
            Quantity::Esf => (value >= limit, "esf: IoU", "minimum"),
        };
        (!met).then(|| format!("{name} {value:.7} at {at}, required {bound} {limit}"))
    };
    required.iter().filter_map(message).collect()
}
