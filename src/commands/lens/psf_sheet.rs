//! A figure of PSFs in columns and rows, each over its own peak, with a colour bar.

use formats::picture::figure::{Anchor, Figure, Text};
use formats::picture::image::Image;
use formats::picture::plot::colour_bar;
use formats::picture::style::{Style, inferno};
use pipeline::geometry::Size;

/// Side of a PSF, and the gap between two, pixels of the figure.
const CELL: usize = 112;
const GAP: usize = 6;

/// Samples of a PSF about the chief ray, row down.
#[derive(Clone, Copy)]
pub struct Samples<'a> {
    /// Side, odd.
    pub size: usize,
    pub pitch_um: f64,
    pub values: &'a [f32],
}

/// What stands along an axis of the figure: its name, and a number at each column or row.
pub struct Labels {
    pub name: &'static str,
    pub numbers: Vec<String>,
}

/// PSFs row after row.
pub struct PsfSheet<'a> {
    pub title: String,
    pub columns: Labels,
    pub rows: Labels,
    pub psfs: Vec<Samples<'a>>,
    /// What the squares show, after their size.
    pub note: [&'static str; 2],
}

impl PsfSheet<'_> {
    /// The figure.
    pub fn figure(&self, style: Style) -> Figure {
        // The scale follows the median width: a band far out of focus is cropped and does not shrink the others to dots.
        let mut halves: Vec<f64> = self.psfs.iter().map(half_width_um).collect();
        halves.sort_by(f64::total_cmp);
        let side_um = (3.0 * halves[halves.len() / 2] / 10.0).ceil() * 10.0;
        let (columns, rows) = (self.columns.numbers.len(), self.rows.numbers.len());
        let (left, top) = (104, 92);
        let step = CELL + GAP;
        let (right, below) = (left + columns * step, top + rows * step);
        let size = Size::new(below + 64, (right + 110).max(560));
        let mut figure = Figure::new(size, style);
        let most = size.width as f64 - 32.0;
        let title = Text::new((16.0, 22.0), Anchor::Start, &self.title);
        figure.text(Text { size: 17.0, max_width: most, ..title });
        let middle = (left + (right - GAP)) as f64 / 2.0;
        figure.text(Text::new((middle, 54.0), Anchor::Middle, self.columns.name));
        figure.text(Text {
            upwards: true,
            max_width: below as f64,
            ..Text::new((18.0, (top + below - GAP) as f64 / 2.0), Anchor::Middle, self.rows.name)
        });
        for (column, number) in self.columns.numbers.iter().enumerate() {
            let x = (left + column * step + CELL / 2) as f64;
            figure.text(Text::new((x, 78.0), Anchor::Middle, number));
        }
        for (row, number) in self.rows.numbers.iter().enumerate() {
            let y = top + row * step;
            figure.text(Text::new((left as f64 - 10.0, (y + CELL / 2) as f64), Anchor::End, number));
            for (column, psf) in self.psfs[row * columns..][..columns].iter().enumerate() {
                let at = ((left + column * step) as f64, y as f64);
                figure.picture(at, &cell(psf, side_um), 1);
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
        let [first, second] = self.note;
        let lines = [format!("Each square: {side_um:.0} µm × {side_um:.0} µm {first}"), second.to_owned()];
        for (row, line) in lines.iter().enumerate() {
            let at = (left as f64, below as f64 + 16.0 + 22.0 * row as f64);
            figure.text(Text::new(at, Anchor::Start, line));
        }
        figure
    }
}

/// Half the side of the centred square with 85 % of the light of the window, µm.
fn half_width_um(psf: &Samples<'_>) -> f64 {
    let (n, half) = (psf.size, psf.size / 2);
    let mut rings = vec![0.0; half + 1];
    for (i, &v) in psf.values.iter().enumerate() {
        rings[(i / n).abs_diff(half).max((i % n).abs_diff(half))] += f64::from(v);
    }
    let mut energy = 0.0;
    let inside = rings.iter().take_while(|r| {
        energy += **r;
        energy < 0.85
    });
    (inside.count() as f64 + 1.0) * psf.pitch_um
}

fn cell(psf: &Samples<'_>, side_um: f64) -> Image {
    let peak = psf.values.iter().fold(0.0f32, |a, &b| a.max(b));
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
                let v = psf.values[row * psf.size + column].max(0.0) / peak;
                *pixel = inferno(f64::from(v.sqrt()));
            }
        }
    }
    image
}
