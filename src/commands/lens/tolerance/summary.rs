//! `summary.json`, and what the command prints: percentiles with the lens of each, yield.

use super::request::Request;
use super::rows::{Figures, Row};
use super::sensitivity::Sensitivity;
use crate::args::KeptLens;
use crate::progress::{number, short_number};
use pipeline::design::tolerance::CriterionKind;
use pipeline::design::tolerance::statistics::{
    Better, PERCENTILES, Summary as Statistics, lens_at, summary, yield_at,
};
use serde_json::{Map, Value, json};

/// A figure of a lens.
type OfLens = fn(&Figures) -> f64;

/// Figures whose percentiles are given.
const FIGURES: [(&str, OfLens); 6] = [
    ("criterion", |f| f.criterion),
    ("film_shift_mm", |f| f.film_shift_mm),
    ("mean_rms_wavefront_waves", |f| {
        f.fields.iter().map(|f| f.rms_wavefront).sum::<f64>() / f.fields.len() as f64
    }),
    ("boresight_mm", |f| f.boresight_mm[0].hypot(f.boresight_mm[1])),
    ("shift_beyond_boresight_mm", |f| f.shift_mm),
    ("relative_illumination_change", |f| f.illumination_change),
];

/// A figure over the lenses.
struct Figure {
    name: &'static str,
    statistics: Option<Statistics>,
    /// The lens at each percentile.
    samples: [Option<u64>; 9],
    nominal: Option<f64>,
}

/// Statistics of a batch.
pub struct Summary {
    figures: Vec<Figure>,
    /// Criterion by sample.
    criterion: Vec<Option<f64>>,
    failures: Vec<(u64, String)>,
    at_limit: usize,
    places: Vec<[f64; 2]>,
    sensitivity: Option<Value>,
    estimate: Option<f64>,
}

impl Summary {
    /// Of the lenses `rows`.
    pub fn new(
        request: &Request<'_>,
        rows: &[Row],
        nominal: &Row,
        sensitivity: Option<&Sensitivity>,
    ) -> Self {
        let of = |(name, value): (&'static str, OfLens)| {
            let values: Vec<Option<f64>> = rows.iter().map(|row| row.figure(value)).collect();
            Figure {
                name,
                statistics: summary(&values),
                samples: PERCENTILES.map(|p| lens_at(&values, p).map(|i| rows[i].sample)),
                nominal: nominal.figure(value),
            }
        };
        let failure = |row: &Row| Some((row.sample, row.outcome.as_ref().err()?.clone()));
        let places = nominal.outcome.iter().flat_map(|f| f.fields.iter().map(|field| field.place_mm));
        Self {
            figures: FIGURES.map(of).into(),
            criterion: rows.iter().map(|row| row.figure(|f| f.criterion)).collect(),
            failures: rows.iter().filter_map(failure).collect(),
            at_limit: rows.iter().filter(|row| row.outcome.as_ref().is_ok_and(|f| f.at_limit)).count(),
            places: places.collect(),
            sensitivity: sensitivity.map(|s| s.json(request.tolerances)),
            estimate: sensitivity.map(|s| s.root_sum_square),
        }
    }

    /// The lens that `kept` names; none if all failed.
    pub fn sample(&self, kept: KeptLens, better: Better) -> Option<u64> {
        let at = |percent| lens_at(&self.criterion, percent).map(|i| i as u64);
        match (kept, better) {
            (KeptLens::Sample(sample), _) => Some(sample),
            (KeptLens::Percentile(percent), _) => at(percent),
            (KeptLens::Worst, Better::Greater) | (KeptLens::Best, Better::Less) => at(0),
            (KeptLens::Best, Better::Greater) | (KeptLens::Worst, Better::Less) => at(100),
        }
    }

    /// Share of the lenses that are as good as `--pass`.
    fn yield_share(&self, request: &Request<'_>) -> Option<f64> {
        request.args.pass.map(|limit| yield_at(&self.criterion, limit, request.better()))
    }

    /// As JSON.
    pub fn json(&self, request: &Request<'_>) -> Value {
        let args = request.args;
        let (kind, frequency) = match request.criterion().kind {
            CriterionKind::Mtf { frequency_per_mm } => ("mtf", Some(frequency_per_mm)),
            CriterionKind::RmsSpot => ("rms-spot", None),
            CriterionKind::RmsWavefront => ("rms-wavefront", None),
        };
        let figure = |f: &Figure| {
            let values = f.statistics.as_ref().map(|s| {
                let at = |(i, percent): (usize, &u32)| {
                    json!({ "percent": percent, "value": number(s.percentiles[i]), "sample": f.samples[i] })
                };
                json!({
                    "nominal": f.nominal.map(number),
                    "mean": number(s.mean),
                    "deviation": number(s.deviation),
                    "least": number(s.least),
                    "greatest": number(s.greatest),
                    "percentiles": PERCENTILES.iter().enumerate().map(at).collect::<Vec<_>>(),
                })
            });
            (f.name.to_owned(), values.unwrap_or(Value::Null))
        };
        let mut json = json!({
            "design": args.design,
            "tolerances": args.tolerances.as_ref().map(|p| p.display().to_string()),
            "tolerances_digest": request.read.digest,
            "seed": args.seed,
            "samples": self.criterion.len(),
            "failed": self.failures.len(),
            "film_shift_at_limit": self.at_limit,
            "criterion": { "kind": kind, "frequency_per_mm": frequency, "places_mm": self.places },
            "corner_mm": number(request.corner_mm),
            "figures": self.figures.iter().map(figure).collect::<Map<_, _>>(),
        });
        if let (Some(limit), Some(share)) = (args.pass, self.yield_share(request)) {
            json["yield"] = json!({ "pass": limit, "share": share });
        }
        if let Some(sensitivity) = &self.sensitivity {
            json["sensitivity"] = sensitivity.clone();
        }
        json
    }

    /// Lines for people.
    pub fn text(&self, request: &Request<'_>) -> Vec<String> {
        let name = criterion_name(request);
        let mut lines = vec![format!(
            "{}: {} lenses of seed {}, {} fields to {:.2} mm",
            request.system.name,
            self.criterion.len(),
            request.args.seed,
            self.places.len(),
            request.corner_mm
        )];
        let [criterion, shift, _, boresight, beyond, light] = &self.figures[..] else { return lines };
        if let Some(s) = &criterion.statistics {
            let at = |percent: u32| {
                let i = PERCENTILES.iter().position(|p| *p == percent).unwrap_or(0);
                let lens = criterion.samples[i].map_or(String::new(), |k| format!(" (lens {k})"));
                format!("{}{lens}", figures_of(s.percentiles[i]))
            };
            let nominal =
                criterion.nominal.map_or(String::new(), |v| format!("; without errors {}", figures_of(v)));
            lines.push(format!(
                "{name}: percentile 10 {}, median {}, percentile 90 {}{nominal}",
                at(10),
                at(50),
                at(90)
            ));
        }
        if let (Some(limit), Some(share)) = (request.args.pass, self.yield_share(request)) {
            let sign = if request.better() == Better::Greater { "at least" } else { "at most" };
            lines.push(format!("yield with {sign} {}: {:.1} %", short_number(limit), 100.0 * share));
        }
        if let Some(estimate) = self.estimate {
            lines.push(format!("root of the sum of squares of the errors alone: {}", figures_of(estimate)));
        }
        if let Some(s) = &shift.statistics {
            lines.push(format!(
                "film shift: mean {:.1} µm, deviation {:.1} µm",
                1e3 * s.mean,
                1e3 * s.deviation
            ));
        }
        let median = |f: &Figure| f.statistics.as_ref().map(|s| s.percentiles[4]);
        if let (Some(boresight), Some(beyond), Some(light)) =
            (median(boresight), median(beyond), median(light))
        {
            lines.push(format!(
                "median boresight {:.1} µm, largest shift beyond it {:.1} µm, largest change of the relative illumination {light:.1e}",
                1e3 * boresight,
                1e3 * beyond
            ));
        }
        if self.at_limit > 0 {
            lines.push(format!("film shift at its limit: {}", count(self.at_limit)));
        }
        if let Some((sample, reason)) = self.failures.first() {
            lines.push(format!(
                "failed: {}, the first is lens {sample}: {reason}",
                count(self.failures.len())
            ));
        }
        lines
    }
}

/// A number of lenses.
pub fn count(n: usize) -> String {
    format!("{n} {}", if n == 1 { "lens" } else { "lenses" })
}

/// Four digits.
fn figures_of(v: f64) -> String {
    if v != 0.0 && v.abs() < 0.01 { format!("{v:.3e}") } else { format!("{v:.4}") }
}

/// The criterion with its unit.
pub fn criterion_name(request: &Request<'_>) -> String {
    match request.criterion().kind {
        CriterionKind::Mtf { frequency_per_mm } => format!("MTF at {} /mm", short_number(frequency_per_mm)),
        CriterionKind::RmsSpot => "RMS spot radius (µm)".to_owned(),
        CriterionKind::RmsWavefront => "RMS wavefront error (waves)".to_owned(),
    }
}
