//! Share of the light in the windows of a traced band, against the one requested.

use pipeline::design::trace::TraceOptions;

/// Part of the light outside the requested window that windows may lack in addition: between the field points where they are examined. At most
/// [`BETWEEN`].
const OF_REST: f64 = 0.1;
/// Largest share that counts as that between field points.
const BETWEEN: f64 = 1e-4;

/// A window with less light than requested.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MissedEnergy {
    /// Its share of the light.
    pub least: f64,
    /// The requested share.
    pub requested: f64,
    /// Whether the window is the largest allowed one; else the samples of a PSF limit it.
    pub is_widest: bool,
}

impl MissedEnergy {
    /// That of a window of `window_px` film pixels with the share `least`; none if it has what `options` request.
    pub fn new(options: &TraceOptions, least: f64, window_px: usize) -> Option<Self> {
        let requested = options.energy;
        let is_missed = requested - least > BETWEEN.min(OF_REST * (1.0 - requested));
        // The samples of a window end up to a pixel before it.
        let is_widest = window_px + 1 >= options.max_window_px;
        is_missed.then_some(Self { least, requested, is_widest })
    }

    /// The requested share and what limits the window.
    pub fn request(self) -> String {
        let limit = if self.is_widest { "--max-window-px" } else { "the samples of a PSF, --max-nodes" };
        format!("requested {}, limited by {limit}", percent(self.requested))
    }
}

/// A share in per cent, with the digits by which it differs from all of the light.
pub fn percent(share: f64) -> String {
    let digits = (2..8).find(|n| (1.0 - share) * 10f64.powi(n + 2) >= 0.999).unwrap_or(2) as usize;
    format!("{:.digits$} %", 100.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn energy_is_missed_beyond_what_lies_between_field_points() {
        let asked = |energy: f64, least: f64| {
            let options = TraceOptions { energy, ..TraceOptions::new(vec![550.0], 1.0) };
            MissedEnergy::new(&options, least, 401).map(MissedEnergy::request)
        };
        assert_eq!(asked(0.99, 0.98995), None);
        assert_eq!(asked(0.9999, 0.9999), None);
        assert_eq!(asked(0.9999, 0.9975).unwrap(), "requested 99.99 %, limited by --max-window-px");
        assert_eq!([percent(0.99), percent(0.9975), percent(1.0)], ["99.00 %", "99.75 %", "100.00 %"]);
    }
}
