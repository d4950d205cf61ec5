//! The report's tables.

use super::distortion::mean_max;
use super::esf::Edge;
use super::{Band, title};
use serde_json::Value;

/// Text as HTML.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn row(tag: &str, cells: impl IntoIterator<Item = String>) -> String {
    let cells: String = cells.into_iter().map(|c| format!("<{tag}>{c}</{tag}>")).collect();
    format!("<tr>{cells}</tr>")
}

/// A figure of every edge, band by band.
pub fn edges_table(bands: &[Band], what: &str, of: impl Fn(&Edge) -> String) -> String {
    let places = bands[0].edges.iter().map(|e| title(&e.place));
    let head = row("th", [format!("nm | {what}")].into_iter().chain(places));
    let one = |b: &Band| row("td", [b.nm.to_string()].into_iter().chain(b.edges.iter().map(&of)));
    format!("<table>{head}{}</table>", bands.iter().map(one).collect::<String>())
}

/// What the differences come from, by place, the worst band each.
pub fn blame_table(bands: &[Band]) -> String {
    let words =
        ["edge | largest change (1e-3)", "film - lens", "heights", "kernels", "rest", "sampling (no error)"];
    let one = |k: usize| {
        let most = |of: fn(&Edge) -> f64| {
            let worst = bands.iter().map(|b| of(&b.edges[k])).fold(0.0, f64::max);
            format!("{:.3}", 1e3 * worst)
        };
        row(
            "td",
            [
                title(&bands[0].edges[k].place),
                most(|e| e.agreement.max_difference),
                most(|e| e.blame.heights),
                most(|e| e.blame.kernels),
                most(|e| e.blame.rest),
                most(|e| e.blame.sampling),
            ],
        )
    };
    let rows: String = (0..bands[0].edges.len()).map(one).collect();
    format!("<table>{}{rows}</table>", row("th", words.map(String::from)))
}

/// One line a band.
pub fn bands_table(bands: &[Band]) -> String {
    let words = [
        "nm",
        "PSF window (px)",
        "RI: IoU (%)",
        "RI: largest",
        "distortion: mean (px)",
        "largest (px)",
        "with PSF: mean (px)",
        "largest (px)",
        "ESF: least IoU (%)",
        "ESF: largest",
        "ESF: area (px)",
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
    format!("<table>{}{rows}</table>", row("th", words.map(String::from)))
}

/// Table 2 of the paper and its counterpart.
pub fn times_table(times: &Value) -> String {
    let heading = "<h2>Times</h2>";
    if times.is_null() {
        return format!(
            "{heading}<p>No full run recorded: name a film that one run made whole by <code>--timing FILM</code>.</p>"
        );
    }
    let number = |key: &str| times[key].as_f64().unwrap_or(f64::NAN);
    let core = |key: &str| {
        let share = number(key) / number("threads");
        format!("{} core time ({} a core)", clock(number(key)), clock(share))
    };
    let windows = &times["psf_window_px"];
    let film = format!("{} x {} px, {} bands", times["film_px"][1], times["film_px"][0], times["bands"]);
    let psf = match (windows["least"].as_u64(), windows["most"].as_u64()) {
        (Some(a), Some(b)) => format!("{a} to {b} px"),
        _ => "none".into(),
    };
    let peak =
        times["peak_resident_bytes"].as_f64().map_or("?".into(), |b| format!("{:.2} GiB", b / 1073741824.0));
    let device = format!("{}, {} threads", times["device"].as_str().unwrap_or("?"), times["threads"]);
    let rows = [
        ["Film", &film, "14141 x 14141 px, 31 bands"],
        ["PSF size", &psf, "50 px"],
        ["RI + distortion", &core("ri_distortion_core_s"), "27 min 31 s (3.75 Mpx/s)"],
        ["SVPSF", &core("svpsf_core_s"), "46 min 15 s (2.23 Mpx/s)"],
        ["Input and output", &core("io_core_s"), ""],
        ["Total", &clock(number("wall_s")), "73 min 46 s"],
        ["Rate", &format!("{:.2} Mpx/s", number("mpx_per_s")), "1.40 Mpx/s"],
        ["Peak memory", &peak, "2 TB installed"],
        ["Device", &device, "ten RTX A6000"],
    ];
    let rows: String = rows.into_iter().map(|r| row("td", r.map(escape))).collect();
    let head = row("th", ["", "the newest full run", "the paper"].map(String::from));
    format!(
        "{heading}<p>Of the run that made the film whole, from its own record. Stages overlap here: core time is what each took \
         of all cores together.</p><table>{head}{rows}</table>"
    )
}

fn clock(seconds: f64) -> String {
    match seconds {
        s if !s.is_finite() => "?".into(),
        s if s < 60.0 => format!("{s:.1} s"),
        s => format!("{:.0} min {:02.0} s", (s / 60.0).floor(), (s % 60.0).floor()),
    }
}
