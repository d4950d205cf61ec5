//! Figures of the report, as SVG elements.

use super::band::Band;
use super::distortion::Point;
use super::illumination::DIRECTIONS;
use crate::commands::measure::frequency_axes;
use formats::picture::bands::{band_key, band_series};
use formats::picture::plot::{Axis, Plot, Series, Shape};
use formats::picture::style::{Colour, PALETTE, Style};
use pipeline::measure::sfr::{Mtf, line_spread};

/// Range of the edge overlays, in which the PSF windows of the bands differ.
const MAX_EDGE_PX: f64 = 50.0;
/// Range of the MTFs, cycles per px: above the film's Nyquist frequency they are aliased.
const MAX_CY_PX: f64 = 0.6;
/// Names of the solid and the dashed lines.
const FILM_AND_LENS: Option<[&str; 2]> = Some(["film", "lens"]);

/// Figures of a film of `size` px with `pitch_um`.
pub struct Figures {
    /// Side of the film, px.
    pub size: usize,
    /// Film pixel pitch, µm.
    pub pitch_um: f64,
    pub style: Style,
}

fn height_axis() -> Axis {
    Axis::new("real image height (mm)", 0.0, 0.0)
}

/// Curves of all bands, film solid and lens dashed.
fn overlay(bands: &[Band], plot: Plot, curve: impl Fn(&Band, bool) -> Vec<(f64, f64)>) -> Plot {
    let nm: Vec<f64> = bands.iter().map(|b| b.nm).collect();
    let one = |i: usize, lens: bool| {
        let series = band_series(&nm, i, curve(&bands[i], lens)).dashed(usize::from(lens));
        // Markers distinguish a few bands, lightness many.
        if nm.len() < PALETTE { series.marked(i) } else { series }
    };
    let series = (0..bands.len()).flat_map(|i| [one(i, false), one(i, true)]).collect();
    Plot { series, key: band_key(&nm), styles: FILM_AND_LENS, ..plot }
}

/// Curves of all edges, film solid and lens dashed.
fn edge_overlay(names: &[String], plot: Plot, curve: impl Fn(usize, bool) -> Vec<(f64, f64)>) -> Plot {
    let one = |k: usize, lens: bool| {
        Series::line(&names[k], curve(k, lens), Colour::Palette(k)).dashed(usize::from(lens)).marked(k)
    };
    let series = (0..names.len()).flat_map(|k| [one(k, false), one(k, true)]).collect();
    Plot { series, styles: FILM_AND_LENS, ..plot }
}

fn esf(samples: &[(f64, f64, f64)], max_px: f64, lens: bool) -> Vec<(f64, f64)> {
    let near = samples.iter().filter(|s| s.0.abs() <= max_px);
    near.map(|s| (s.0, if lens { s.2 } else { s.1 })).collect()
}

/// Largest number of 1, 2 or 5 times a power of ten that is not above `v`.
fn round_down(v: f64) -> f64 {
    let ten = 10f64.powf(v.log10().floor());
    [5.0, 2.0, 1.0].map(|k| k * ten).into_iter().find(|r| *r <= v * (1.0 + 1e-9)).unwrap_or(ten)
}

impl Figures {
    fn svg(&self, plot: &Plot) -> String {
        plot.figure(self.style).to_svg_element()
    }

    /// R over height to the lower right corner, film and lens, and their difference in all directions.
    pub fn illumination(&self, bands: &[Band]) -> Vec<String> {
        let value = |b: &Band, lens: bool| {
            let diagonal = b.illumination.bins.iter().filter(|b| b.direction + 1 == DIRECTIONS.len());
            diagonal.map(|b| (b.height_mm, if lens { b.lens } else { b.film })).collect()
        };
        let axis = Axis::new("relative illumination", 0.0, 1.05);
        let curves = overlay(
            bands,
            Plot::new("Relative illumination to the lower right corner", height_axis(), axis),
            value,
        );
        let shown = &bands[bands.len() / 2];
        let difference = DIRECTIONS.iter().enumerate().map(|(d, name)| {
            let here = shown.illumination.bins.iter().filter(|b| b.direction == d);
            let points = here.map(|b| (b.height_mm, b.film - b.lens)).collect();
            Series::distinct(*name, points, d)
        });
        let title = format!("Film − lens by direction, {} nm", shown.nm);
        let axis = Axis::new("difference of relative illumination", 0.0, 0.0);
        let difference = Plot { series: difference.collect(), ..Plot::new(title, height_axis(), axis) };
        vec![self.svg(&curves), self.svg(&difference)]
    }

    /// Departure of the film from R with the PSF stage.
    pub fn departure(&self, bands: &[Band]) -> String {
        let value = |b: &Band, lens: bool| {
            let all = b.illumination.departures.iter();
            all.map(|d| (d.height_mm, if lens { d.lens } else { d.film })).collect()
        };
        let axis = Axis::new("film / R − 1", 0.0, 0.0);
        let plot = Plot::new("Uniform chart with the PSF: film / R − 1", height_axis(), axis);
        self.svg(&overlay(bands, plot, value))
    }

    /// Displacements and errors of the points of one band.
    pub fn distortion(&self, band: &Band) -> Vec<String> {
        vec![
            self.vectors(&format!("Displacement by the lens, {} nm", band.nm), &band.points, true),
            self.vectors(&format!("Error, film − lens, {} nm", band.nm), &band.points, false),
        ]
    }

    /// Exaggerated displacement vectors: from chart to lens position (`lens`), or from lens to film position.
    fn vectors(&self, title: &str, points: &[Point], lens: bool) -> String {
        let displacement = |p: &Point| match lens {
            true => (p.lens_px.0 - p.chart_px.0, p.lens_px.1 - p.chart_px.1),
            false => p.error_px(),
        };
        let size = self.size as f64;
        let length = |(y, x): (f64, f64)| y.hypot(x);
        let max = points.iter().map(|p| length(displacement(p))).fold(1e-12, f64::max);
        let factor = round_down(0.1 * size / max);
        let longest = if max < 0.1 { format!("{max:.1e}") } else { format!("{max:.1}") };
        // Rows increase downwards, the axis of the plot upwards.
        let place = |(y, x): (f64, f64)| (x, size - 1.0 - y);
        let start = |p: &Point| if lens { p.chart_px } else { p.lens_px };
        let moved = |p: &Point, (y, x): (f64, f64)| place((start(p).0 + factor * y, start(p).1 + factor * x));
        let dots = |name: &str, points, colour, radius| {
            Series::line(name, points, colour).shaped(Shape::Dots(radius))
        };
        let mut vectors = Vec::new();
        for p in points {
            // NaN separates the vectors.
            vectors.extend([place(start(p)), moved(p, displacement(p)), (f64::NAN, f64::NAN)]);
        }
        let mut series = vec![
            dots(
                if lens { "chart" } else { "lens" },
                points.iter().map(|p| place(start(p))).collect(),
                Colour::Muted,
                2.2,
            ),
            Series::line(if lens { "to the lens" } else { "to the film" }, vectors, Colour::Palette(0)),
        ];
        if lens {
            let film = |p: &Point| (p.film_px.0 - p.chart_px.0, p.film_px.1 - p.chart_px.1);
            let ends = points.iter().map(|p| moved(p, film(p))).collect();
            series.push(dots("film", ends, Colour::Palette(4), 3.2));
        }
        let title = format!("{title}: {factor} × exaggerated, longest {longest} px");
        let axis = |name: &str| Axis::new(name, 0.0, size);
        let plot = Plot::new(title, axis("column (px)"), axis("row from the bottom (px)"));
        self.svg(&Plot { series, equal_scale: true, ..plot })
    }

    /// Empty plot across an edge: px below and µm above.
    fn across(&self, title: &str, y: Axis) -> Plot {
        let top = Some(("distance from the edge (µm)".into(), self.pitch_um));
        Plot { top, ..Plot::new(title, Axis::new("distance from the edge (px)", 0.0, 0.0), y) }
    }

    /// Empty plot of an MTF: lp/mm below and cycles/px above.
    fn modulation(&self, title: &str) -> Plot {
        let (x, top, _) = frequency_axes(Some(self.pitch_um));
        Plot { top, ..Plot::new(title, x, Axis::new("MTF", 0.0, 1.05)) }
    }

    fn mtf(&self, mtf: &Mtf) -> Vec<(f64, f64)> {
        let all = mtf.frequency_cy_px.iter().copied().zip(mtf.modulation.iter().copied());
        let lp_mm = 1e3 / self.pitch_um;
        all.take_while(|p| p.0 <= MAX_CY_PX).map(|(f, m)| (f * lp_mm, m)).collect()
    }

    /// Adds a line at the film's Nyquist frequency, and short lines at MTF50 of the film's curves.
    fn mark_mtf<'m>(&self, mut plot: Plot, films: impl Iterator<Item = (&'m Mtf, Colour)>) -> Plot {
        let lp_mm = 1e3 / self.pitch_um;
        let nyquist = vec![(0.5 * lp_mm, 0.0), (0.5 * lp_mm, 1.05)];
        plot.series.push(Series::line("", nyquist, Colour::Muted).dashed(2));
        plot.series.extend(films.filter_map(|(m, colour)| {
            let f = m.mtf50_cy_px()? * lp_mm;
            Some(Series::line("", vec![(f, 0.44), (f, 0.56)], colour))
        }));
        plot
    }

    /// ESF and MTF of all bands at edge `k`.
    pub fn edge_overlays(&self, bands: &[Band], k: usize, title: &str) -> Vec<String> {
        let spread = |b: &Band, lens: bool| esf(&b.edges[k].samples, MAX_EDGE_PX, lens);
        let transfer = |b: &Band, lens: bool| {
            let e = &b.edges[k];
            self.mtf(if lens { &e.lens_mtf } else { &e.film_mtf })
        };
        let across = self.across(&format!("ESF, {title}"), Axis::new("edge spread function", -0.05, 1.05));
        let transfers = overlay(bands, self.modulation(&format!("MTF, {title}")), transfer);
        let colours: Vec<Colour> = transfers.series.iter().step_by(2).map(|s| s.colour).collect();
        let films = bands.iter().map(|b| &b.edges[k].film_mtf).zip(colours);
        let transfers = self.mark_mtf(transfers, films);
        vec![self.svg(&overlay(bands, across, spread)), self.svg(&transfers)]
    }

    /// ESF, LSF, their difference and MTF of all edges in one band.
    pub fn band_edges(&self, band: &Band) -> Vec<String> {
        // Short names for the legend.
        let names: Vec<String> =
            band.edges.iter().map(|e| format!("{}, {}.", e.place.name, &e.place.direction[..3])).collect();
        let samples = |k: usize| &band.edges[k].samples;
        let near = |k: usize, lens: bool| esf(samples(k), band.edges[k].half_px, lens);
        let lsf = |k: usize, lens: bool| {
            let values: Vec<f64> = samples(k).iter().map(|s| if lens { s.2 } else { s.1 }).collect();
            let places = samples(k).iter().map(|s| s.0);
            places.zip(line_spread(&values)).filter(|p| p.0.abs() <= band.edges[k].half_px).collect()
        };
        let transfer = |k: usize, lens: bool| {
            let e = &band.edges[k];
            self.mtf(if lens { &e.lens_mtf } else { &e.film_mtf })
        };
        let difference = (0..names.len()).map(|k| {
            let inside = samples(k).iter().filter(|s| s.0.abs() <= band.edges[k].half_px);
            Series::distinct(&names[k], inside.map(|s| (s.0, s.1 - s.2)).collect(), k)
        });
        let at = |what: &str| format!("{what}, {} nm", band.nm);
        let spread = self.across(&at("ESF"), Axis::new("edge spread function", -0.05, 1.05));
        let differences = self.across(&at("ESF, film − lens"), Axis::new("difference of ESF", 0.0, 0.0));
        let line = self.across(&at("LSF"), Axis::new("line spread function (1/px)", 0.0, 0.0));
        let transfers = edge_overlay(&names, self.modulation(&at("MTF")), transfer);
        let films = band.edges.iter().enumerate().map(|(k, e)| (&e.film_mtf, Colour::Palette(k)));
        vec![
            self.svg(&edge_overlay(&names, spread, near)),
            self.svg(&Plot { series: difference.collect(), ..differences }),
            self.svg(&edge_overlay(&names, line, lsf)),
            self.svg(&self.mark_mtf(transfers, films)),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_down_gives_1_2_or_5_times_a_power_of_ten() {
        for (v, expected) in [(7.3, 5.0), (2.0, 2.0), (0.019, 0.01), (99_999.0, 50_000.0)] {
            assert!((round_down(v) / expected - 1.0).abs() < 1e-12, "{v}: {}", round_down(v));
        }
    }
}
