//! The worst figures over all bands, and what of `--require` they miss.

use super::distortion::mean_max;
use super::{Band, title};
use crate::args::Quantity;

/// The worst of a quantity, and where it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Worst {
    /// The figure.
    pub value: f64,
    /// Wavelength and place.
    pub at: String,
}

/// The worst over all bands (and edges).
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
                let at = |e: &super::esf::Edge| format!("{} nm, {}", b.nm, title(&e.place));
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

/// What is missed, in words.
pub fn missed(bands: &[Band], required: &[(Quantity, f64)]) -> Vec<String> {
    let words = |&(what, limit): &(Quantity, f64)| {
        let Worst { value, at } = worst(bands, what);
        // A figure that is no number meets nothing.
        let (met, name, asked) = match what {
            Quantity::Ri => (value >= limit, "ri: IoU", "at least"),
            Quantity::Distortion => (value <= limit, "distortion: mean error (px)", "at most"),
            Quantity::Esf => (value >= limit, "esf: IoU", "at least"),
        };
        (!met).then(|| format!("{name} {value:.7} at {at}, {asked} {limit} asked"))
    };
    required.iter().filter_map(words).collect()
}
