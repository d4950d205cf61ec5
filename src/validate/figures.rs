//! The report's figures, as SVG elements.

use super::distortion::Point;
use super::ri::DIRECTIONS;
use super::{Band, Setup};
use crate::measure::frequency_axes;
use formats::picture::bands::{band_key, band_series};
use formats::picture::plot::{Axis, Plot, Series, Shape};
use formats::picture::style::{Colour, PALETTE, Style};
use pipeline::measure::sfr::{Mtf, line_spread};

/// Edges are shown to this distance in overlays of bands whose windows differ.
const NEAR_PX: f64 = 50.0;
/// MTFs are shown to here, cycles per px: past the film's Nyquist frequency they are aliases.
const SHOWN_CY_PX: f64 = 0.6;
/// Solid and dashed.
const FILM_AND_LENS: Option<[&str; 2]> = Some(["film", "lens"]);

/// Draws the report's figures.
pub struct Figures<'a> {
    /// What was made.
    pub setup: &'a Setup,
    /// Colours.
    pub style: Style,
}

fn height() -> Axis {
    Axis::new("real image height (mm)", 0.0, 0.0)
}

/// Two curves a band, film solid and lens dashed.
fn overlay(bands: &[Band], plot: Plot, of: impl Fn(&Band, bool) -> Vec<(f64, f64)>) -> Plot {
    let nm: Vec<f64> = bands.iter().map(|b| b.nm).collect();
    let one = |i: usize, lens: bool| {
        let series = band_series(&nm, i, of(&bands[i], lens)).dashed(usize::from(lens));
        // Few bands have a marker each; many follow the lightness of the scale.
        if nm.len() < PALETTE { series.marked(i) } else { series }
    };
    let series = (0..bands.len()).flat_map(|i| [one(i, false), one(i, true)]).collect();
    Plot { series, key: band_key(&nm), styles: FILM_AND_LENS, ..plot }
}

/// Film solid and lens dashed of several edges.
fn both(names: &[String], plot: Plot, of: impl Fn(usize, bool) -> Vec<(f64, f64)>) -> Plot {
    let one = |k: usize, lens: bool| {
        Series::line(&names[k], of(k, lens), Colour::Palette(k)).dashed(usize::from(lens)).marked(k)
    };
    let series = (0..names.len()).flat_map(|k| [one(k, false), one(k, true)]).collect();
    Plot { series, styles: FILM_AND_LENS, ..plot }
}

fn esf(samples: &[(f64, f64, f64)], most_px: f64, lens: bool) -> Vec<(f64, f64)> {
    let near = samples.iter().filter(|s| s.0.abs() <= most_px);
    near.map(|s| (s.0, if lens { s.2 } else { s.1 })).collect()
}

/// The round number below `v`: 1, 2 or 5 times a power of ten.
fn round(v: f64) -> f64 {
    let ten = 10f64.powf(v.log10().floor());
    [5.0, 2.0, 1.0].map(|k| k * ten).into_iter().find(|r| *r <= v * (1.0 + 1e-9)).unwrap_or(ten)
}

impl Figures<'_> {
    fn svg(&self, plot: &Plot) -> String {
        plot.figure(self.style).to_svg_element()
    }

    /// R over height to the lower right corner, film and lens, and their difference everywhere.
    pub fn illumination(&self, bands: &[Band]) -> Vec<String> {
        let value = |b: &Band, lens: bool| {
            let diagonal = b.illumination.bins.iter().filter(|b| b.direction + 1 == DIRECTIONS.len());
            diagonal.map(|b| (b.height_mm, if lens { b.lens } else { b.film })).collect()
        };
        let axis = Axis::new("relative illumination", 0.0, 1.05);
        let curves = overlay(
            bands,
            Plot::new("Relative illumination to the lower right corner", height(), axis),
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
        let difference = Plot { series: difference.collect(), ..Plot::new(title, height(), axis) };
        vec![self.svg(&curves), self.svg(&difference)]
    }

    /// The film's departure from R with the PSF on.
    pub fn departure(&self, bands: &[Band]) -> String {
        let value = |b: &Band, lens: bool| {
            let all = b.illumination.departures.iter();
            all.map(|d| (d.height_mm, if lens { d.lens } else { d.film })).collect()
        };
        let axis = Axis::new("film / R − 1", 0.0, 0.0);
        let plot = Plot::new("Uniform chart with the PSF: film / R − 1", height(), axis);
        self.svg(&overlay(bands, plot, value))
    }

    /// Displacements and errors of the points of one band.
    pub fn distortion(&self, band: &Band) -> Vec<String> {
        vec![
            self.vectors(&format!("Displacement by the lens, {} nm", band.nm), &band.points, true),
            self.vectors(&format!("Error, film − lens, {} nm", band.nm), &band.points, false),
        ]
    }

    /// The film with a vector at each point, exaggerated.
    fn vectors(&self, title: &str, points: &[Point], lens: bool) -> String {
        let of = |p: &Point| match lens {
            true => (p.lens_px.0 - p.chart_px.0, p.lens_px.1 - p.chart_px.1),
            false => p.error_px(),
        };
        let size = self.setup.size as f64;
        let most = points.iter().map(|p| of(p).0.hypot(of(p).1)).fold(1e-12, f64::max);
        let factor = round(0.1 * size / most);
        let longest = if most < 0.1 { format!("{most:.1e}") } else { format!("{most:.1}") };
        // Rows count downwards, the axis upwards.
        let place = |(y, x): (f64, f64)| (x, size - 1.0 - y);
        let start = |p: &Point| if lens { p.chart_px } else { p.lens_px };
        let moved = |p: &Point, (y, x): (f64, f64)| place((start(p).0 + factor * y, start(p).1 + factor * x));
        let dots = |name: &str, points, colour, radius| {
            Series::line(name, points, colour).shaped(Shape::Dots(radius))
        };
        let mut vectors = Vec::new();
        for p in points {
            // A gap after each.
            vectors.extend([place(start(p)), moved(p, of(p)), (f64::NAN, f64::NAN)]);
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

    /// Axes of a plot across an edge, px below and µm above.
    fn across(&self, title: &str, y: Axis) -> Plot {
        let top = Some(("distance from the edge (µm)".into(), self.setup.pitch_um));
        Plot { top, ..Plot::new(title, Axis::new("distance from the edge (px)", 0.0, 0.0), y) }
    }

    /// Axes of an MTF, lp/mm below and cycles/px above.
    fn modulation(&self, title: &str) -> Plot {
        let (x, top, _) = frequency_axes(Some(self.setup.pitch_um));
        Plot { top, ..Plot::new(title, x, Axis::new("MTF", 0.0, 1.05)) }
    }

    fn mtf(&self, mtf: &Mtf) -> Vec<(f64, f64)> {
        let all = mtf.frequency_cy_px.iter().copied().zip(mtf.modulation.iter().copied());
        let lp_mm = 1e3 / self.setup.pitch_um;
        all.take_while(|p| p.0 <= SHOWN_CY_PX).map(|(f, m)| (f * lp_mm, m)).collect()
    }

    /// A line at the film's Nyquist frequency, and short lines where the film's curves fall to 1/2.
    fn mark_mtf<'m>(&self, mut plot: Plot, films: impl Iterator<Item = (&'m Mtf, Colour)>) -> Plot {
        let lp_mm = 1e3 / self.setup.pitch_um;
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
        let spread = |b: &Band, lens: bool| esf(&b.edges[k].samples, NEAR_PX, lens);
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
        // As short as a legend.
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
        let apart = self.across(&at("ESF, film − lens"), Axis::new("difference of ESF", 0.0, 0.0));
        let line = self.across(&at("LSF"), Axis::new("line spread function (1/px)", 0.0, 0.0));
        let transfers = both(&names, self.modulation(&at("MTF")), transfer);
        let films = band.edges.iter().enumerate().map(|(k, e)| (&e.film_mtf, Colour::Palette(k)));
        vec![
            self.svg(&both(&names, spread, near)),
            self.svg(&Plot { series: difference.collect(), ..apart }),
            self.svg(&both(&names, line, lsf)),
            self.svg(&self.mark_mtf(transfers, films)),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_round() {
        for (v, want) in [(7.3, 5.0), (2.0, 2.0), (0.019, 0.01), (99_999.0, 50_000.0)] {
            assert!((round(v) / want - 1.0).abs() < 1e-12, "{v}: {}", round(v));
        }
    }
}
