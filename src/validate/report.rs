//! `report.html`: one file with its pictures inside, for a screen of 1280 px and for paper.

use super::distortion::mean_max;
use super::figures::Figures;
use super::require::worst;
use super::tables::{bands_table, blame_table, edges_table, escape, times_table};
use super::{Band, Setup, title};
use crate::args::{Quantity, ValidateArgs};
use formats::picture::style::{Colour, Style, hex};
use formats::picture::text::font_css;
use serde_json::Value;

const STYLE: &str = "body{font:15px/1.5 Inter,'DejaVu Sans',Helvetica,Arial,sans-serif;color:#111;max-width:1200px;margin:0 auto;\
padding:24px}h1{font-size:26px}h2{font-size:20px;margin-top:40px;border-bottom:1px solid #bbb}h3{font-size:16px;margin:24px 0 4px}\
table{border-collapse:collapse;margin:12px 0;font-size:13px}th,td{padding:3px 9px;border:1px solid #ccc;text-align:right;\
font-variant-numeric:tabular-nums}th{background:#f2f2f2;font-weight:600}td:first-child,th:first-child{text-align:left}\
.pair{display:grid;grid-template-columns:1fr 1fr;gap:12px;align-items:start}.pair svg{width:100%;height:auto}\
.miss{color:#a00;font-weight:600}p{max-width:900px}code{font-size:13px}\
@media print{body{padding:0;font-size:11px}table{font-size:9px}th,td{padding:2px 5px}.pair,tr,h3{break-inside:avoid}\
h2,h3{break-after:avoid}}";

/// The page.
pub fn html(args: &ValidateArgs, setup: &Setup, bands: &[Band], missed: &[String], times: &Value) -> String {
    let against = args.against.as_ref().unwrap_or(&args.lens);
    let head = format!(
        "<p>Films made by <b>{}</b>, compared with <b>{}</b>: {}. Film {n} &times; {n} px of {} &micro;m, {}; {} band{}: {} nm. \
         Program: lenscube {}.</p>",
        escape(&args.lens),
        escape(against),
        setup.truth.words(),
        setup.pitch_um,
        if args.full { "whole films" } else { "windows of it out to the corners" },
        bands.len(),
        if bands.len() == 1 { "" } else { "s" },
        pipeline::wavelengths::format(&setup.wavelengths_nm),
        env!("CARGO_PKG_VERSION"),
        n = setup.size,
    );
    let verdict = match (args.require.is_empty(), missed.is_empty()) {
        (true, _) => String::new(),
        (false, true) => "<p>All that was required is met.</p>".into(),
        (false, false) => {
            let lines: Vec<String> = missed.iter().map(|m| format!("<li>{}</li>", escape(m))).collect();
            format!("<p class=\"miss\">Required and missed:</p><ul class=\"miss\">{}</ul>", lines.concat())
        }
    };
    let figures = Figures { setup, style: args.style.into() };
    let body = [
        head,
        verdict,
        summary(bands),
        illumination(&figures, bands),
        distortion(&figures, bands),
        edges(&figures, bands),
        times_table(times),
        each_band(&figures, bands),
    ];
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
         content=\"width=device-width\"><title>lenscube validate: {title}</title><style>{}{STYLE}{}</style></head><body>\n\
         <h1>Validation of {title}</h1>\n{}</body></html>\n",
        font_css(),
        dark(figures.style),
        body.join("\n"),
        title = escape(&args.lens),
    )
}

/// What a dark page has otherwise.
fn dark(style: Style) -> String {
    let colour = |c| hex(style.rgb(c));
    match style {
        Style::Light => String::new(),
        Style::Dark => format!(
            "body{{background:{};color:{}}}th{{background:#2a2d31}}th,td,h2{{border-color:{}}}.miss{{color:#f88}}",
            colour(Colour::Paper),
            colour(Colour::Ink),
            colour(Colour::Grid)
        ),
    }
}

fn pairs(pictures: &[String]) -> String {
    pictures.chunks(2).map(|two| format!("<div class=\"pair\">{}</div>\n", two.concat())).collect()
}

/// Table 1 of the paper and its counterpart.
fn summary(bands: &[Band]) -> String {
    let (ri, distortion, esf) =
        (worst(bands, Quantity::Ri), worst(bands, Quantity::Distortion), worst(bands, Quantity::Esf));
    let longest = |of: &dyn Fn(&Band) -> f64| bands.iter().map(of).fold(0.0, f64::max);
    let most_px = longest(&|b| mean_max(&b.points).1);
    let with_psf_px = longest(&|b| mean_max(&b.psf_points).1);
    let edges = || bands.iter().flat_map(|b| &b.edges);
    let most = edges().map(|e| e.agreement.max_difference).fold(0.0, f64::max);
    let ri_most = longest(&|b| b.illumination.agreement.max_difference);
    format!(
        "<h2>Summary</h2><p>The worst of all bands and places. The paper: Lens Simulation for High Resolution and \
         Multispectral Image using Distributed Multi-GPU Computing System, its Tables 1 to 3, of the same design (Double Gauss \
         28&deg;), film and bands.</p>\
         <table><tr><th>Quantity</th><th>Here</th><th>Where</th><th>The paper</th></tr>\
         <tr><td>Relative illumination, IoU</td><td>{:.6} %</td><td>{}</td><td>99.9 %</td></tr>\
         <tr><td>Relative illumination, largest difference</td><td>{ri_most:.1e}</td><td></td><td></td></tr>\
         <tr><td>Distortion, mean error of the worst band</td><td>{:.5} px</td><td>{}</td><td>0.1 px</td></tr>\
         <tr><td>Distortion, largest error</td><td>{most_px:.5} px</td><td></td><td></td></tr>\
         <tr><td>The same with the PSF, its centroid taken off</td><td>{with_psf_px:.5} px</td><td></td><td></td></tr>\
         <tr><td>Edge spread function, IoU</td><td>{:.4} %</td><td>{}</td><td>98.7 %</td></tr>\
         <tr><td>Edge spread function, largest difference</td><td>{most:.1e}</td><td></td><td></td></tr></table>",
        100.0 * ri.value,
        ri.at,
        distortion.value,
        distortion.at,
        100.0 * esf.value,
        esf.at,
    )
}

fn illumination(figures: &Figures<'_>, bands: &[Band]) -> String {
    let mut pictures = figures.illumination(bands);
    pictures.push(figures.departure(bands));
    format!(
        "<h2>Relative illumination</h2><p>A uniform chart of 1 through relative illumination and distortion, nothing else. The \
         film is read along a strip from the axis to its right edge, along one to its lower edge, and in squares along the four \
         half-diagonals to the corners; means over 80 bins of real image height, each direction for itself, against R at the \
         root mean square height of the bin's pixels (R is even in height). R of a design: the projected solid angle of its pupil over that on the axis, traced at \
         that height (Rimmer, Proc. SPIE 655, 1986); of a pack: its table. IoU = &Sigma; min / &Sigma; max over all bins.</p>\
         <p>With the PSF on, the film of a uniform chart is not R and must not be: every pixel scatters its own PSF, whose \
         centroid lies c(r) outwards of the chief ray, so light moves, and film/R &minus; 1 = &minus;(1/R)&middot;div(R&middot;c) \
         + &frac12;(1/R)&middot;div div(R&middot;M), M the PSF's second moments about the chief ray (a Taylor series; the second \
         term counts where the lens is far out of focus). The dashed curves are that, the moments taken apart from any film; the \
         windows lie \
         on the diagonal to the lower right corner.</p>{}",
        pairs(&pictures)
    )
}

fn distortion(figures: &Figures<'_>, bands: &[Band]) -> String {
    let worst = bands.iter().max_by(|a, b| mean_max(&a.points).1.total_cmp(&mean_max(&b.points).1));
    let pictures = worst.map(|b| figures.distortion(b)).unwrap_or_default();
    format!(
        "<h2>Distortion</h2><p>A chart of 9 &times; 9 points through relative illumination and distortion. The centroid of each \
         point on the film (the film as it is, not divided by R, whose slope moves a centroid by less than 1e-4 px) against the \
         film place of the chief ray of that field point: traced at that field for a design, the table's for a pack. With the \
         PSF {}: there a point moves by its PSF's centroid, which is taken off. The vectors are those of the band with the \
         largest error.</p>{}",
        if figures.setup.films.full {
            "all points again"
        } else {
            "the points to the right and to the lower right corner again"
        },
        pairs(&pictures)
    )
}

fn edges(figures: &Figures<'_>, bands: &[Band]) -> String {
    let mut out = format!(
        "<h2>Edge spread function</h2><p>Slanted edges of contrast 4, 5&deg; off the radius (normal radial) and off the tangent \
         (normal tangential), as in ISO 12233: at the centre, at mid-field and in a corner. The film is divided by R; a pixel's \
         distance from the edge is that of its chart point, found by the chief ray, over the local scale. Nothing is fitted, so a \
         displaced edge counts as an error. Means over bins of 1/4 px, normalised by the plateaus beyond the PSF's half window + \
         3 px, compared within the half window.</p>\
         <p>The lens's curve is summed straight from its PSF at that place and azimuth, in the window that the film's kernels \
         have: shares of whole film pixels, with the chart pixel's square, the bin of 1/4 px and the mean of the bicubic remap's \
         weights at the phases that the pixels really have. No rotation, no interpolation between PSFs, no convolution of the \
         program's is used for it. IoU = &Sigma; min / &Sigma; max; area = &int; |film &minus; lens|, px. MTF: e-SFR of ISO \
         12233 of both curves; short vertical lines: MTF50 of the film; dotted line: the film's Nyquist frequency.</p>{}{}\
         <p>Where the largest difference comes from, worst over the bands: <i>heights</i>, the run's PSFs linear between their \
         heights; <i>kernels</i>, all that makes its kernels (heights, azimuths, turning, integration over the pixel); \
         <i>rest</i>, the remap and the PSF's change within its own window. <i>Sampling</i> is no error of the program: it is how \
         far the curve would lie off if PSF and apertures were integrated over the plane instead of summed over whole pixels, \
         which chart and film are made of.</p>{}",
        edges_table(bands, "IoU (%)", |e| format!("{:.4}", 100.0 * e.agreement.iou)),
        edges_table(bands, "largest difference (1e-3)", |e| {
            format!("{:.3}", 1e3 * e.agreement.max_difference)
        }),
        blame_table(bands),
    );
    let places: Vec<String> = bands[0].edges.iter().map(|e| title(&e.place)).collect();
    for (k, place) in places.iter().enumerate() {
        let words = format!("{place}, r = {:.1} mm", bands[0].edges[k].height_mm);
        out += &pairs(&figures.edge_overlays(bands, k, &words));
    }
    out
}

fn each_band(figures: &Figures<'_>, bands: &[Band]) -> String {
    let one = |b: &Band| {
        let pictures = pairs(&figures.band_edges(b));
        format!("<h3>{} nm, PSF window {} px</h3>{pictures}", b.nm, b.window_px)
    };
    let each: String = bands.iter().map(one).collect();
    format!("<h2>By wavelength</h2>{}{each}", bands_table(bands))
}
