//! Curves of a lens: tables against height, MTF, nodes of the PSF field.

use crate::job::lens::samples::{LensSamples, evenly_spaced};
use crate::progress::short_number;
use formats::picture::bands::{band_key, band_series};
use formats::picture::plot::{Axis, Plot, Series, Shape};
use formats::picture::style::{Colour, PALETTE};
use pipeline::figures::Direction;
use pipeline::lens::{Lens, LensBand};
use std::f64::consts::TAU;

/// Points of a curve.
const POINTS: usize = 200;
/// Values up to here, in the unit of their axis, are those of rounding errors.
const ROUNDING: f64 = 1e-9;

/// Points whose rounding errors are 0, so that they do not fill the axis where all values vanish.
pub fn without_rounding(points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    points.into_iter().map(|(x, y)| (x, if y.abs() < ROUNDING { 0.0 } else { y })).collect()
}

/// Heights, with the field angle of the largest for an object at infinity.
pub fn height_axis(lens: &Lens, primary: &LensBand, max_mm: f64) -> Axis {
    let name = match lens.object_distance_mm {
        None => {
            let tan = primary.ideal_height_at(max_mm) / lens.distortion_focal_length_mm;
            format!("real image height (mm); {max_mm:.2} mm: {:.2}°", tan.atan().to_degrees())
        }
        Some(_) => "real image height (mm)".to_owned(),
    };
    Axis::new(name, 0.0, 0.0)
}

/// A table of each band against REAL height, up to `max_mm`; `x` is the axis of heights.
pub fn against_height(
    bands: &[LensBand],
    title: &str,
    (x, y): (Axis, Axis),
    max_mm: f64,
    value: impl Fn(&LensBand, f64) -> f64,
) -> Plot {
    let nm: Vec<f64> = bands.iter().map(|b| b.wavelength_nm).collect();
    let height = |i: usize| max_mm * i as f64 / (POINTS - 1) as f64;
    let points = |b: usize| (0..POINTS).map(|i| (height(i), value(&bands[b], height(i)))).collect::<Vec<_>>();
    let series = (0..bands.len()).map(|b| band_series(&nm, b, without_rounding(points(b)))).collect();
    Plot { series, key: band_key(&nm), ..Plot::new(title, x, y) }
}

const DIRECTIONS: Option<[&str; 2]> = Some(["sagittal", "tangential"]);

/// Sagittal (solid) and tangential (dashed) curve in the `i`-th colour and marker.
fn directions(curve: impl Fn(Direction) -> Vec<(f64, f64)>, name: &str, i: usize) -> [Series; 2] {
    [(Direction::Sagittal, 0), (Direction::Tangential, 1)].map(|(direction, dash)| {
        Series::line(name, curve(direction), Colour::Palette(i)).dashed(dash).marked(i)
    })
}

fn mtf_axis() -> Axis {
    Axis::new("MTF", 0.0, 1.05)
}

/// MTF against field height at the frequencies `lp_mm`.
pub fn mtf_field(samples: &LensSamples, name: &str, lp_mm: &[f64]) -> Plot {
    let fields = &samples.fields[0];
    let series = lp_mm.iter().enumerate().flat_map(|(i, lp)| {
        let curve = |d| fields.iter().map(|f| (f.height_mm, f.psf.mtf(*lp, d))).collect();
        directions(curve, &format!("{} lp/mm", short_number(*lp)), i)
    });
    let title = format!("{name}: MTF at {} nm", short_number(samples.lens.bands[0].wavelength_nm));
    let max_mm = fields.iter().map(|f| f.height_mm).fold(0.0, f64::max);
    let x = height_axis(&samples.lens, &samples.primary, max_mm);
    Plot { series: series.collect(), styles: DIRECTIONS, ..Plot::new(title, x, mtf_axis()) }
}

/// MTF against frequency at the heights of `samples`.
pub fn mtf_frequency(samples: &LensSamples, name: &str, lp_mm: &[f64]) -> Plot {
    let max_lp_mm = 2.5 * lp_mm.iter().fold(0.0, |a: f64, b| a.max(*b));
    let fields = &samples.fields[0];
    let series = evenly_spaced(fields.len(), PALETTE).into_iter().enumerate().flat_map(|(i, k)| {
        let frequency = |i: usize| max_lp_mm * i as f64 / (POINTS - 1) as f64;
        let curve = |d| (0..POINTS).map(|i| (frequency(i), fields[k].psf.mtf(frequency(i), d))).collect();
        directions(curve, &format!("{:.2} mm", fields[k].height_mm), i)
    });
    let title =
        format!("{name}: MTF at {} nm by image height", short_number(samples.lens.bands[0].wavelength_nm));
    let x = Axis::new("spatial frequency on the film (lp/mm)", 0.0, 0.0);
    Plot { series: series.collect(), styles: DIRECTIONS, ..Plot::new(title, x, mtf_axis()) }
}

/// Nodes of a band on the film.
pub fn nodes(name: &str, band: &LensBand) -> Plot {
    let reach_mm = band.psf_height_mm[band.psf_height_mm.len() - 1];
    let circle = |r_mm: f64, count: usize| {
        (0..count)
            .map(move |j| (TAU * j as f64 / count as f64).sin_cos())
            .map(move |(s, c)| (r_mm * c, r_mm * s))
    };
    let mut edge: Vec<_> = circle(reach_mm, 180).collect();
    edge.push(edge[0]);
    let places = std::iter::zip(&band.psf_height_mm, &band.azimuth_count);
    let dots = places.flat_map(|(&r, &count)| circle(r, count)).collect();
    let title = format!(
        "{name}: {} kernels at {} heights, {} nm",
        band.azimuth_count.iter().sum::<usize>(),
        band.psf_height_mm.len(),
        short_number(band.wavelength_nm)
    );
    let max_mm = 1.04 * reach_mm;
    Plot {
        series: vec![
            Series::line("edge of the field", edge, Colour::Muted),
            Series::line("kernel", dots, Colour::Palette(0)).shaped(Shape::Dots(1.3)),
        ],
        equal_scale: true,
        ..Plot::new(
            title,
            Axis::new("x on the film (mm)", -max_mm, max_mm),
            Axis::new("y on the film (mm)", -max_mm, max_mm),
        )
    }
}
