//! Figure of the PSFs of a lens by field height and wavelength.

use crate::job::lens::samples::{LensSamples, evenly_spaced};
use crate::progress::short_number;
use formats::picture::figure::{Anchor, Figure, Text};
use formats::picture::image::Image;
use formats::picture::plot::colour_bar;
use formats::picture::style::{Style, inferno};
use pipeline::figures::PsfWindow;
use pipeline::geometry::Size;

/// Maximum number of wavelengths and heights.
const MAX_ROWS: usize = 6;
const MAX_COLUMNS: usize = 5;
/// Side of a PSF, and the gap between two, pixels of the figure.
const CELL: usize = 112;
const GAP: usize = 6;

/// PSFs by field height (columns) and wavelength (rows), all at one scale, with a colour bar.
pub fn psf_figure(samples: &LensSamples, name: &str, style: Style) -> Figure {
    let bands = evenly_spaced(samples.fields.len(), MAX_ROWS);
    let heights = evenly_spaced(samples.fields[0].len(), MAX_COLUMNS);
    let all = || bands.iter().flat_map(|&b| heights.iter().map(move |&k| &samples.fields[b][k].psf));
    // The scale follows the median width: a band far out of focus is cropped and does not shrink the others to dots.
    let mut halves: Vec<f64> = all().map(half_width_um).collect();
    halves.sort_by(f64::total_cmp);
    let side_um = (3.0 * halves[halves.len() / 2] / 10.0).ceil() * 10.0;
    let (left, top) = (104, 92);
    let step = CELL + GAP;
    let (right, below) = (left + heights.len() * step, top + bands.len() * step);
    let size = Size::new(below + 64, (right + 110).max(560));
    let mut figure = Figure::new(size, style);
    let title = format!("{name}: PSF");
    let most = size.width as f64 - 32.0;
    figure.text(Text { size: 17.0, max_width: most, ..Text::new((16.0, 22.0), Anchor::Start, &title) });
    let middle = (left + (right - GAP)) as f64 / 2.0;
    figure.text(Text::new((middle, 54.0), Anchor::Middle, "real image height (mm)"));
    figure.text(Text {
        upwards: true,
        max_width: below as f64,
        ..Text::new((18.0, (top + below - GAP) as f64 / 2.0), Anchor::Middle, "wavelength (nm)")
    });
    for (column, &k) in heights.iter().enumerate() {
        let x = (left + column * step + CELL / 2) as f64;
        let number = format!("{:.2}", samples.fields[0][k].height_mm);
        figure.text(Text::new((x, 78.0), Anchor::Middle, &number));
    }
    for (row, &b) in bands.iter().enumerate() {
        let y = top + row * step;
        let number = short_number(samples.lens.bands[b].wavelength_nm);
        figure.text(Text::new((left as f64 - 10.0, (y + CELL / 2) as f64), Anchor::End, &number));
        for (column, &k) in heights.iter().enumerate() {
            let at = ((left + column * step) as f64, y as f64);
            figure.picture(at, &cell(&samples.fields[b][k].psf, side_um), 1);
        }
    }
    // Brightness is the square root of the value, so that faint light is visible; so are the positions of the labels.
    let labels = [0.0, 0.01, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0f64];
    let high = (below - GAP - top) as f64;
    let all: Vec<_> = labels.iter().map(|v| (v.sqrt(), format!("{v}"))).collect();
    // A single row is too low for all labels.
    let shown: Vec<_> = if high < 200.0 { [0, 3, 5, 8].map(|i| all[i].clone()).into() } else { all };
    let bar = [right as f64 + 12.0, top as f64, 16.0, high];
    colour_bar(&mut figure, bar, "PSF / peak", &shown, inferno);
    for (row, line) in [
        format!("Each square: {side_um:.0} µm × {side_um:.0} µm about the chief ray,"),
        "the direction away from the axis to the right".into(),
    ]
    .iter()
    .enumerate()
    {
        let at = (left as f64, below as f64 + 16.0 + 22.0 * row as f64);
        figure.text(Text::new(at, Anchor::Start, line));
    }
    figure
}

/// Half the side of the centred square with 85 % of the light of the window, µm.
fn half_width_um(psf: &PsfWindow) -> f64 {
    let (n, half) = (psf.size, psf.size / 2);
    let mut rings = vec![0.0; half + 1];
    for (i, &v) in psf.samples.iter().enumerate() {
        rings[(i / n).abs_diff(half).max((i % n).abs_diff(half))] += f64::from(v);
    }
    let mut energy = 0.0;
    let inside = rings.iter().take_while(|r| {
        energy += **r;
        energy < 0.85
    });
    (inside.count() as f64 + 1.0) * psf.pitch_um
}

fn cell(psf: &PsfWindow, side_um: f64) -> Image {
    let peak = psf.samples.iter().fold(0.0f32, |a, &b| a.max(b));
    let half = (psf.size / 2) as f64;
    let sample = |i: usize| {
        let at = ((i as f64 + 0.5) / CELL as f64 - 0.5) * side_um / psf.pitch_um + half;
        (at.round() >= 0.0 && at.round() < psf.size as f64).then_some(at.round() as usize)
    };
    let mut image = Image::new(Size::new(CELL, CELL), inferno(0.0));
    for y in 0..CELL {
        let row = sample(y);
        for (x, pixel) in image.row_mut(y).iter_mut().enumerate() {
            if let (Some(row), Some(column)) = (row, sample(x)) {
                let v = psf.samples[row * psf.size + column].max(0.0) / peak;
                *pixel = inferno(f64::from(v.sqrt()));
            }
        }
    }
    image
}
