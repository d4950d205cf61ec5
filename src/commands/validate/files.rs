//! Data files of a validation: `summary.json`, `curves/*.csv`.

use super::Results;
use super::band::Band;
use super::distortion::mean_max;
use super::illumination::DIRECTIONS;
use super::light::Check;
use super::limits::worst;
use super::setup::Setup;
use crate::args::{Quantity, ValidateArgs};
use anyhow::Result;
use formats::durable::{AtomicFile, create_directories};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::Path;

/// Content of `summary.json`.
pub fn summary(
    args: &ValidateArgs,
    setup: &Setup,
    results: &Results,
    missed: &[String],
    times: &Value,
) -> Value {
    let band = |b: &Band| {
        let ((mean, max), (psf_mean, psf_max)) = (mean_max(&b.points), mean_max(&b.psf_points));
        let edges: Vec<Value> = b
            .edges
            .iter()
            .map(|e| {
                json!({
                    "position": e.place.name, "normal": e.place.direction, "image_height_mm": e.height_mm,
                    "iou": e.agreement.iou, "max_difference": e.agreement.max_difference,
                    "area_between_px": e.agreement.area_between,
                    "mtf50_cy_px": { "film": e.film_mtf.mtf50_cy_px(), "lens": e.lens_mtf.mtf50_cy_px() },
                    "error_budget": {
                        "sampling": e.error_budget.sampling, "heights": e.error_budget.heights,
                        "kernels": e.error_budget.kernels, "rest": e.error_budget.rest,
                    },
                })
            })
            .collect();
        let departure = b.illumination.departures.iter().map(|d| (d.film - d.lens).abs()).fold(0.0, f64::max);
        json!({
            "wavelength_nm": b.nm,
            "psf_window_px": b.window_px,
            "ri": {
                "iou": b.illumination.agreement.iou,
                "max_difference": b.illumination.agreement.max_difference,
                "departure_max_difference": departure,
            },
            "distortion_px": { "mean": mean, "max": max, "with_psf_mean": psf_mean, "with_psf_max": psf_max },
            "esf": edges,
        })
    };
    let check = |c: &Check| {
        json!({
            "name": c.name, "found": c.found, "expected": c.expected, "difference": c.difference, "limit": c.limit,
        })
    };
    let worst = |what| {
        let w = worst(results, what);
        json!({ "value": w.value, "at": w.at })
    };
    json!({
        "program": concat!("lenscube ", env!("CARGO_PKG_VERSION")),
        "lens": args.lens,
        "against": args.against.as_ref().unwrap_or(&args.lens),
        "film_px": setup.size,
        "film_pitch_um": setup.pitch_um,
        "worst": {
            "ri_iou": worst(Quantity::Ri),
            "distortion_mean_px": worst(Quantity::Distortion),
            "esf_iou": worst(Quantity::Esf),
            "light": worst(Quantity::Light),
        },
        "paper": setup.of_paper.then(|| json!({ "ri_iou": 0.999, "distortion_px": 0.1, "esf_iou": 0.987 })),
        "missed": missed,
        "times": times,
        "light": results.light.iter().map(check).collect::<Vec<_>>(),
        "bands": results.bands.iter().map(band).collect::<Vec<_>>(),
    })
}

/// Curves as CSV, one file per quantity with all bands; written under temporary names until they are finished.
pub fn curves(dir: &Path, bands: &[Band]) -> Result<Vec<AtomicFile>> {
    create_directories(dir, true)?;
    let mut ri = String::from("wavelength_nm,direction,image_height_mm,film,lens\n");
    let mut departure = String::from("wavelength_nm,image_height_mm,film_over_r_minus_1,of_the_moments\n");
    let mut points =
        String::from("wavelength_nm,psf,chart_row,chart_column,film_row,film_column,lens_row,lens_column\n");
    let mut esf = String::from("wavelength_nm,edge,distance_px,film,lens\n");
    let mut mtf = String::from("wavelength_nm,edge,frequency_cy_px,film,lens\n");
    // Writing to a String cannot fail.
    for b in bands {
        let nm = b.nm;
        for bin in &b.illumination.bins {
            let direction = DIRECTIONS[bin.direction];
            let _ = writeln!(ri, "{nm},{direction},{:.6},{:.9},{:.9}", bin.height_mm, bin.film, bin.lens);
        }
        for d in &b.illumination.departures {
            let _ = writeln!(departure, "{nm},{:.6},{:.4e},{:.4e}", d.height_mm, d.film, d.lens);
        }
        for (psf, all) in [("no", &b.points), ("yes", &b.psf_points)] {
            for p in all {
                let ((a, b), (c, d), (e, f)) = (p.chart_px, p.film_px, p.lens_px);
                let _ = writeln!(points, "{nm},{psf},{a},{b},{c:.6},{d:.6},{e:.6},{f:.6}");
            }
        }
        for e in &b.edges {
            let title = e.place.title();
            for (d, film, lens) in &e.samples {
                let _ = writeln!(esf, "{nm},\"{title}\",{d:.5},{film:.7},{lens:.7}");
            }
            let both = e.film_mtf.modulation.iter().zip(&e.lens_mtf.modulation);
            for (f, (film, lens)) in e.film_mtf.frequency_cy_px.iter().zip(both) {
                let _ = writeln!(mtf, "{nm},\"{title}\",{f:.4},{film:.6},{lens:.6}");
            }
        }
    }
    let all = [
        ("ri.csv", ri),
        ("departure.csv", departure),
        ("distortion.csv", points),
        ("esf.csv", esf),
        ("mtf.csv", mtf),
    ];
    Ok(all
        .into_iter()
        .map(|(name, text)| AtomicFile::with_text(&dir.join(name), &text))
        .collect::<Result<_, _>>()?)
}
