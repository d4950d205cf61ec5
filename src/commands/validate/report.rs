//! `report.html`: a single file with embedded figures, for a screen of 1280 px and for print.

use super::Results;
use super::band::Band;
use super::distortion::mean_max;
use super::figures::Figures;
use super::light::Check;
use super::limits::worst;
use super::setup::Setup;
use super::tables::{bands_table, edges_table, error_budget_table, times_table};
use crate::args::{Quantity, ValidateArgs};
use formats::picture::style::{Colour, Style, hex};
use formats::picture::text::{escape, font_css};
use serde_json::Value;

const STYLE: &str = "body{font:15px/1.5 Inter,'DejaVu Sans',Helvetica,Arial,sans-serif;color:#111;max-width:1200px;margin:0 auto;\
padding:24px}h1{font-size:26px}h2{font-size:20px;margin-top:40px;border-bottom:1px solid #bbb}h3{font-size:16px;margin:24px 0 4px}\
table{border-collapse:collapse;margin:12px 0;font-size:13px}th,td{padding:3px 9px;border:1px solid #ccc;text-align:right;\
font-variant-numeric:tabular-nums}th{background:#f2f2f2;font-weight:600}td:first-child,th:first-child{text-align:left}\
.pair{display:grid;grid-template-columns:1fr 1fr;gap:12px;align-items:start}.pair svg{width:100%;height:auto}\
.miss{color:#a00;font-weight:600}p{max-width:900px}code{font-size:13px}\
@media print{body{padding:0;font-size:11px}table{font-size:9px}th,td{padding:2px 5px}.pair,tr,h3{break-inside:avoid}\
h2,h3{break-after:avoid}}";

pub fn html(
    args: &ValidateArgs,
    setup: &Setup,
    results: &Results,
    missed: &[String],
    times: &Value,
) -> String {
    let bands = &results.bands;
    let against = args.against.as_ref().unwrap_or(&args.lens);
    let head = format!(
        "<p>Films simulated with <b>{}</b>, compared with <b>{}</b> ({}). Film (sensor-plane image) of {n} &times; {n} px, pixel \
         pitch {} &micro;m, {}; {} band{}: {} nm. Program: lenscube {}.</p>",
        escape(&args.lens),
        escape(against),
        setup.reference.description(),
        setup.pitch_um,
        if args.full { "complete films" } else { "regions of it out to the corners" },
        bands.len(),
        if bands.len() == 1 { "" } else { "s" },
        pipeline::wavelengths::format(&setup.wavelengths_nm),
        env!("CARGO_PKG_VERSION"),
        n = setup.size,
    );
    let verdict = match (args.require.is_empty(), missed.is_empty()) {
        (true, _) => String::new(),
        (false, true) => "<p>All requirements are met.</p>".into(),
        (false, false) => {
            let lines: Vec<String> = missed.iter().map(|m| format!("<li>{}</li>", escape(m))).collect();
            format!("<p class=\"miss\">Not met:</p><ul class=\"miss\">{}</ul>", lines.concat())
        }
    };
    let figures = Figures { size: setup.size, pitch_um: setup.pitch_um, style: args.style };
    let body = [
        head,
        verdict,
        summary(results, setup.of_paper),
        illumination(&figures, bands),
        distortion(&figures, bands, args.full),
        edges(&figures, bands),
        light(results, setup.light_band()),
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

/// Style sheet additions of a dark page.
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

/// Worst values, beside Table 1 of the paper if design, film and bands are its own.
fn summary(results: &Results, of_paper: bool) -> String {
    let bands = &results.bands;
    let all = [Quantity::Ri, Quantity::Distortion, Quantity::Esf, Quantity::Light];
    let [ri, distortion, esf, light] = all.map(|quantity| worst(results, quantity));
    let max = |value: &dyn Fn(&Band) -> f64| bands.iter().map(value).fold(0.0, f64::max);
    let max_px = max(&|b| mean_max(&b.points).1);
    let with_psf_px = max(&|b| mean_max(&b.psf_points).1);
    let edges = || bands.iter().flat_map(|b| &b.edges);
    let max_esf = edges().map(|e| e.agreement.max_difference).fold(0.0, f64::max);
    let max_ri = max(&|b| b.illumination.agreement.max_difference);
    let rows = [
        ("Relative illumination, IoU", format!("{:.6} %", 100.0 * ri.value), &*ri.at, "99.9 %"),
        ("Relative illumination, maximum difference", format!("{max_ri:.1e}"), "", ""),
        (
            "Distortion, mean error of the worst band",
            format!("{:.5} px", distortion.value),
            &distortion.at,
            "0.1 px",
        ),
        ("Distortion, maximum error", format!("{max_px:.5} px"), "", ""),
        (
            "Distortion with the PSF, its centroid subtracted, maximum error",
            format!("{with_psf_px:.5} px"),
            "",
            "",
        ),
        ("Edge spread function, IoU", format!("{:.4} %", 100.0 * esf.value), &esf.at, "98.7 %"),
        ("Edge spread function, maximum difference", format!("{max_esf:.1e}"), "", ""),
        ("Light, difference over its limit", format!("{:.2}", light.value), &light.at, ""),
    ];
    let (paper, heading) = match of_paper {
        true => (
            " The paper: Lens Simulation for High Resolution and Multispectral Image using Distributed Multi-GPU Computing System, \
             Tables 1 to 3, for the same design, film and bands.",
            "<th>Paper</th>",
        ),
        false => ("", ""),
    };
    let rows: String = rows
        .iter()
        .map(|(name, value, at, paper)| {
            let paper = if of_paper { format!("<td>{paper}</td>") } else { String::new() };
            format!("<tr><td>{name}</td><td>{value}</td><td>{at}</td>{paper}</tr>")
        })
        .collect();
    format!(
        "<h2>Summary</h2><p>Worst values over all bands and edges.{paper} IoU: intersection over union of two curves, &Sigma; min / \
         &Sigma; max.</p><table><tr><th>Quantity</th><th>Result</th><th>Band, edge</th>{heading}</tr>{rows}</table>"
    )
}

/// Light beside the image.
fn light(results: &Results, band: usize) -> String {
    let row = |check: &Check| {
        let class = if check.of_limit() <= 1.0 { "" } else { " class=\"miss\"" };
        format!(
            "<tr{class}><td>{}</td><td>{:.7e}</td><td>{:.7e}</td><td>{:.1e}</td><td>{:.0e}</td></tr>",
            escape(&check.name),
            check.found,
            check.expected,
            check.difference,
            check.limit
        )
    };
    let rows: String = results.light.iter().map(row).collect();
    format!(
        "<h2>Light</h2><p>Scatter and veiling glare of films at {} nm without PSF, against closed forms: the index of black discs, a uniform field, and the sum of \
         the layer that is added to the film. Of a design with a quarter wave of MgF2 on its surfaces: transmission over 25 &times; 33 rays of the pupil, and the five \
         largest ghosts of two reflections from the axis, integrated over 4000 radii of the first surface. Differences are relative, of the uniform field \
         absolute.</p><table><tr><th>Quantity</th><th>Program</th><th>Expected</th><th>Difference</th><th>Limit</th></tr>{rows}</table>",
        results.bands[band].nm
    )
}

fn illumination(figures: &Figures, bands: &[Band]) -> String {
    let mut pictures = figures.illumination(bands);
    pictures.push(figures.departure(bands));
    format!(
        "<h2>Relative illumination</h2><p>A uniform chart of value 1 passes the relative illumination and distortion stages \
         only. The film is read along two lines from the axis, to the right edge and to the lower edge, and in squares along the \
         four half-diagonals to the corners. Means over 80 bins of real image height, each direction separately, are compared \
         with R at the root mean square height of the bin's pixels (R is even in height). R of a design: light of a \
         field element over the film area of its chief rays, relative to the axis, traced at that height; of a pack: its table. IoU = \
         &Sigma; min / &Sigma; max over all bins.</p>\
         <p>With the PSF stage the film of a uniform chart is not R: every pixel scatters its own PSF, whose centroid has the \
         radial offset c(r) from the chief ray, so film/R &minus; 1 = &minus;(1/R)&middot;div(R&middot;c) + \
         &frac12;(1/R)&middot;div div(R&middot;M), where M are the PSF's second moments about the chief ray (a Taylor series; the \
         second term matters where the lens is far out of focus). The dashed curves show this expression with the moments of the \
         reference PSFs; the measured regions are on the diagonal to the lower right corner.</p>{}",
        pairs(&pictures)
    )
}

fn distortion(figures: &Figures, bands: &[Band], full: bool) -> String {
    let worst = bands.iter().max_by(|a, b| mean_max(&a.points).1.total_cmp(&mean_max(&b.points).1));
    let pictures = worst.map(|b| figures.distortion(b)).unwrap_or_default();
    format!(
        "<h2>Distortion</h2><p>A chart of 9 &times; 9 points passes the relative illumination and distortion stages. The centroid \
         of each point on the film (not divided by R, whose slope moves a centroid by less than 1e-4 px) is compared with the \
         chief ray of that field point: traced for a design, from the table for a pack. With the PSF stage {} measured again; the \
         offset of the PSF's centroid from the chief ray is subtracted. The vectors are those of the band with the largest \
         error.</p>{}",
        if full { "all points are" } else { "the points to the right and to the lower right corner are" },
        pairs(&pictures)
    )
}

fn edges(figures: &Figures, bands: &[Band]) -> String {
    let mut out = format!(
        "<h2>Edge spread function</h2><p>Slanted edges of contrast 4 with normals 5&deg; off the radial and off the tangential \
         direction, as in ISO 12233: at the centre, at mid-field and in a corner. The film is divided by R. The distance of a \
         film pixel from the edge is that of its chart point, found by the chief ray, divided by the local scale; it is not \
         fitted, so a displaced edge counts as an error. Means over bins of 1/4 px, normalised by the plateaus beyond the PSF's \
         half window + 3 px, are compared within the half window.</p>\
         <p>The expected curve is summed directly from the PSF of the lens at that field point, in the window of the film \
         kernels: shares of entire film pixels, with the square of the chart pixel, the bin of 1/4 px and the mean of the \
         bicubic interpolation weights at the phases of the pixels. It uses no rotation, interpolation between PSFs or \
         convolution of the simulation. IoU = &Sigma; min / &Sigma; max; area = &int; |film &minus; lens|, px. MTF: e-SFR of ISO \
         12233 of both curves; short vertical lines: MTF50 of the film; dotted line: the film's Nyquist frequency.</p>{}{}\
         <p>Attribution of the difference, maximum over the bands: <i>heights</i>, linear interpolation of the PSFs between \
         heights; <i>kernels</i>, all steps from PSFs to kernels (heights, azimuths, rotation, integration over the pixel); \
         <i>rest</i>, the remap and the change of the PSF within its window. <i>Sampling</i> is not an error of the program: it \
         is the change of the curve if PSF and apertures were integrated over the plane instead of summed over entire pixels, as \
         chart and film are.</p>{}",
        edges_table(bands, "IoU (%)", |e| format!("{:.4}", 100.0 * e.agreement.iou)),
        edges_table(bands, "maximum difference (1e-3)", |e| {
            format!("{:.3}", 1e3 * e.agreement.max_difference)
        }),
        error_budget_table(bands),
    );
    for (k, edge) in bands[0].edges.iter().enumerate() {
        let title = format!("{}, r = {:.1} mm", edge.place.title(), edge.height_mm);
        out += &pairs(&figures.edge_overlays(bands, k, &title));
    }
    out
}

fn each_band(figures: &Figures, bands: &[Band]) -> String {
    let one = |b: &Band| {
        let pictures = pairs(&figures.band_edges(b));
        format!("<h3>{} nm, PSF window {} px</h3>{pictures}", b.nm, b.window_px)
    };
    let each: String = bands.iter().map(one).collect();
    format!("<h2>By wavelength</h2>{}{each}", bands_table(bands))
}
