//! Tables of the report.

use super::band::Band;
use super::distortion::mean_max;
use super::edge::EdgeResult;
use super::timing;
use crate::progress::plural;
use formats::picture::text::escape;
use serde_json::Value;

fn row(tag: &str, cells: impl IntoIterator<Item = String>) -> String {
    let cells: String = cells.into_iter().map(|c| format!("<{tag}>{c}</{tag}>")).collect();
    format!("<tr>{cells}</tr>")
}

/// A value of every edge, one row per band.
pub fn edges_table(bands: &[Band], what: &str, value: impl Fn(&EdgeResult) -> String) -> String {
    let places = bands[0].edges.iter().map(|e| e.place.title());
    let head = row("th", [format!("wavelength (nm) | {what}")].into_iter().chain(places));
    let one = |b: &Band| row("td", [b.nm.to_string()].into_iter().chain(b.edges.iter().map(&value)));
    format!("<table>{head}{}</table>", bands.iter().map(one).collect::<String>())
}

/// Attribution of the differences by edge, maximum over the bands.
pub fn error_budget_table(bands: &[Band]) -> String {
    let head = [
        "edge | maximum change (1e-3)",
        "film &minus; lens",
        "heights",
        "kernels",
        "rest",
        "sampling (not an error)",
    ];
    let one = |k: usize| {
        let max = |value: fn(&EdgeResult) -> f64| {
            let max = bands.iter().map(|b| value(&b.edges[k])).fold(0.0, f64::max);
            format!("{:.3}", 1e3 * max)
        };
        row(
            "td",
            [
                bands[0].edges[k].place.title(),
                max(|e| e.agreement.max_difference),
                max(|e| e.error_budget.heights),
                max(|e| e.error_budget.kernels),
                max(|e| e.error_budget.rest),
                max(|e| e.error_budget.sampling),
            ],
        )
    };
    let rows: String = (0..bands[0].edges.len()).map(one).collect();
    format!("<table>{}{rows}</table>", row("th", head.map(String::from)))
}

/// Results by wavelength, one row per band.
pub fn bands_table(bands: &[Band]) -> String {
    let head = [
        "wavelength (nm)",
        "PSF window (px)",
        "relative illumination: IoU (%)",
        "maximum difference",
        "distortion: mean error (px)",
        "maximum error (px)",
        "with PSF: mean error (px)",
        "maximum error (px)",
        "ESF: minimum IoU (%)",
        "maximum difference",
        "area between the curves (px)",
    ];
    let one = |b: &Band| {
        let ((mean, max), (psf_mean, psf_max)) = (mean_max(&b.points), mean_max(&b.psf_points));
        let a = b.edges.iter().map(|e| e.agreement);
        row(
            "td",
            [
                b.nm.to_string(),
                b.window_px.to_string(),
                format!("{:.6}", 100.0 * b.illumination.agreement.iou),
                format!("{:.1e}", b.illumination.agreement.max_difference),
                format!("{mean:.5}"),
                format!("{max:.5}"),
                format!("{psf_mean:.5}"),
                format!("{psf_max:.5}"),
                format!("{:.4}", 100.0 * a.clone().map(|a| a.iou).fold(1.0, f64::min)),
                format!("{:.1e}", a.clone().map(|a| a.max_difference).fold(0.0, f64::max)),
                format!("{:.4}", a.map(|a| a.area_between).fold(0.0, f64::max)),
            ],
        )
    };
    let rows: String = bands.iter().map(one).collect();
    format!("<table>{}{rows}</table>", row("th", head.map(String::from)))
}

/// Times of the run beside Table 2 of the paper.
pub fn times_table(times: &Value) -> String {
    let heading = "<h2>Times</h2>";
    if times.is_null() {
        return format!(
            "{heading}<p>No full run recorded: give a film that was made completely by one run with <code>--timing FILM</code>.</p>"
        );
    }
    let number = |key: &str| times[key].as_f64().unwrap_or(f64::NAN);
    let core = |key: &str| {
        let share = number(key) / number("threads");
        format!("{} core time ({} per core)", clock(number(key)), clock(share))
    };
    let windows = &times["psf_window_px"];
    let film =
        format!("{}x{} px, {}", times["film_px"][1], times["film_px"][0], plural(&times["bands"], "band"));
    let psf = match (windows["least"].as_u64(), windows["most"].as_u64()) {
        (Some(a), Some(b)) => format!("{a} to {b} px"),
        _ => "none".into(),
    };
    let peak =
        times["peak_resident_bytes"].as_f64().map_or("?".into(), |b| format!("{:.2} GiB", b / 1073741824.0));
    let device = format!("{}, {} threads", times["device"].as_str().unwrap_or("?"), times["threads"]);
    let rows = [
        ["Film", &film, "14141 x 14141 px, 31 bands"],
        ["PSF window", &psf, "50 px"],
        ["Relative illumination + distortion", &core(timing::REMAP.0), "27 min 31 s (3.75 Mpx/s)"],
        ["SVPSF", &core(timing::SVPSF.0), "46 min 15 s (2.23 Mpx/s)"],
        ["Input and output", &core(timing::IO.0), ""],
        ["Total", &clock(number("wall_s")), "73 min 46 s"],
        ["Rate", &format!("{:.2} Mpx/s", number("mpx_per_s")), "1.40 Mpx/s"],
        ["Peak memory", &peak, "2 TB installed"],
        ["Device", &device, "ten RTX A6000"],
    ];
    let rows: String = rows.into_iter().map(|r| row("td", r.map(escape))).collect();
    let head = row("th", ["", "newest complete run", "paper"].map(String::from));
    format!(
        "{heading}<p>From the record of the run that made the complete film. Stages overlap: core time is the sum over all \
         cores.</p><table>{head}{rows}</table>"
    )
}

fn clock(seconds: f64) -> String {
    match seconds {
        s if !s.is_finite() => "?".into(),
        s if s < 60.0 => format!("{s:.1} s"),
        s => format!("{:.0} min {:02.0} s", (s / 60.0).floor(), (s % 60.0).floor()),
    }
}
