//! Two films, or charts: difference by band and region, MTF of edges.
//!
//! ```text
//! d = B − A of each pixel, in the unit of the films, in the bands that both have
//! RMS d = √(Σ d²/n),    share: RMS d over the RMS of A
//! MTF: e-SFR of an edge in each film, by the estimators of `lenscube measure`
//! ```
//! Films of other pixels are seen at common ones ([`super::common_pixels`]). The picture shows the mean of d over the bands.

use super::common_pixels::{CommonPixels, common_pixels, note_other_axes};
use super::regions::{Difference, MAX_SIDE, ROWS, cell_rects, draw};
use crate::args::CompareArgs;
use crate::commands::measure::{Measurement, edge};
use crate::failure::{line as message, usage};
use crate::machine::threads;
use crate::open::{self, Chart};
use crate::progress::{log_line, number};
use anyhow::{Context, Result, bail};
use formats::chart::NanPolicy;
use formats::parallel;
use pipeline::geometry::{Rect, Size};
use serde_json::{Value, json};
use std::fmt::Write;
use std::sync::Mutex;

/// Cache of decoded chunks of each film.
const CACHE_BYTES: usize = 128 << 20;
/// Difference within which two bands have one wavelength, nm.
const SAME_NM: f64 = 0.05;
/// Relative difference within which two pitches are one.
const SAME_PITCH: f64 = 1e-9;

/// Sums over pixels.
#[derive(Clone, Copy, Default)]
pub struct Sums {
    pixels: u64,
    a: f64,
    b: f64,
    a2: f64,
    d2: f64,
    largest: f64,
}

/// A band of both films.
pub struct Band {
    /// Its wavelength, nm.
    pub nm: f64,
    /// Sums over all pixels.
    pub all: Sums,
    regions: Vec<Sums>,
}

/// An edge in both films.
pub struct Edge {
    line: [f64; 4],
    /// Wavelength in nm, and the measurement in each film, or why there is none.
    pub bands: Vec<(f64, [Result<Measurement, String>; 2])>,
}

/// What was measured.
pub struct Comparison {
    /// Names of the films.
    pub names: [String; 2],
    /// Their units, where stated.
    pub units: [Option<String>; 2],
    /// Common pixels of films of other ones, as they are reported.
    pub common: Option<Value>,
    /// Bands.
    pub bands: Vec<Band>,
    rects: Vec<Rect>,
    /// Edges.
    pub edges: Vec<Edge>,
    /// The picture of the difference.
    pub difference: Difference,
}

/// Compares the films of `args`.
///
/// # Errors
/// Usage: flags of raws; films without a pixel or a band in common, edges of films of other pixels. A film that is not complete; a read error.
pub fn compare(args: &CompareArgs) -> Result<Comparison> {
    if !args.patch.is_empty() || args.frame != 0 {
        return Err(usage(
            "--patch and --frame are for raws: films have neither frames nor the colours of a sensor",
        ));
    }
    let films = Films::open(args)?;
    let edges =
        args.edge.iter().map(|line| films.edge(*line, args.half_px as usize)).collect::<Result<Vec<_>>>()?;
    films.measure(args.grid as usize, threads(args.threads), edges)
}

/// Two films.
struct Films {
    charts: [Chart; 2],
    /// Where their pixels differ.
    common: Option<CommonPixels>,
    names: [String; 2],
    /// Wavelength in nm, and the band's index in each film.
    bands: Vec<(f64, [usize; 2])>,
}

impl Films {
    fn open(args: &CompareArgs) -> Result<Self> {
        let names = [args.first.clone(), args.second.clone()];
        let open = |name: &String| open::chart(name, None, NanPolicy::Keep, CACHE_BYTES);
        let charts = [open(&names[0])?, open(&names[1])?];
        let [a, b] = &charts;
        let same_pitch = match (a.pitch_um(), b.pitch_um()) {
            (Some(a), Some(b)) => (a - b).abs() <= SAME_PITCH * a,
            _ => true,
        };
        let common = match a.size() != b.size() || !same_pitch {
            true => Some(common_pixels(args, &names, &charts)?),
            false => {
                note_other_axes(&names, &charts);
                None
            }
        };
        let nm = |chart: &Chart, name: &String| {
            let nm = chart.wavelengths_nm();
            nm.map_err(|e| open::without_chart_flags(&["--wavelengths"], name, e.into()))
        };
        let (nm_a, nm_b) = (nm(a, &names[0])?, nm(b, &names[1])?);
        let in_b = |nm: f64| nm_b.iter().position(|other| (other - nm).abs() <= SAME_NM);
        let in_both = nm_a.iter().enumerate().filter_map(|(i, nm)| Some((*nm, [i, in_b(*nm)?])));
        let bands: Vec<_> = in_both.collect();
        let listed = |nm: &[f64]| nm.iter().map(|v| number(*v).to_string()).collect::<Vec<_>>().join(", ");
        if bands.is_empty() {
            return Err(usage(format!(
                "{} and {}: no band of one is in the other: {} nm and {} nm",
                names[0],
                names[1],
                listed(&nm_a),
                listed(&nm_b)
            )));
        }
        let others = nm_a.len() + nm_b.len() - 2 * bands.len();
        if others > 0 {
            log_line(format!("note: {others} bands that only one of the films has are left out"));
        }
        if let (Some(first), Some(second)) = (a.units(), b.units())
            && first != second
        {
            log_line(format!(
                "note: the films are in other units, {first} and {second}: their values are compared as they are"
            ));
        }
        Ok(Self { charts, common, names, bands })
    }

    /// MTF of the edge near a line in each film.
    ///
    /// # Errors
    /// Usage: it can be measured in no band of either film.
    fn edge(&self, line: [f64; 4], half: usize) -> Result<Edge> {
        let ends = ((line[1], line[0]), (line[3], line[2]));
        let bands: Vec<_> = self
            .bands
            .iter()
            .map(|(nm, index)| {
                let one =
                    |k: usize| edge(&self.charts[k], index[k], *nm, ends, half).map_err(|e| message(&e));
                (*nm, [one(0), one(1)])
            })
            .collect();
        let mut all = bands.iter().flat_map(|(_, both)| both);
        match (all.clone().all(Result::is_err), all.next()) {
            (true, Some(Err(why))) => {
                let [x0, y0, x1, y1] = line;
                Err(usage(format!("--edge {x0},{y0},{x1},{y1}: {why}")))
            }
            _ => Ok(Edge { line, bands }),
        }
    }

    /// Rows of the finer film for one that is compared.
    fn ratio(&self) -> f64 {
        let finest = self.charts.iter().filter_map(Chart::pitch_um).fold(f64::INFINITY, f64::min);
        self.common.as_ref().map_or(1.0, |common| common.pitch_um / finest)
    }

    /// Differences of all bands and regions.
    fn measure(self, grid: usize, threads: usize, edges: Vec<Edge>) -> Result<Comparison> {
        let size = self.common.as_ref().map_or(self.charts[0].size(), |common| common.size);
        let cells = (grid.min(size.height), grid.min(size.width));
        let block = size.height.max(size.width).div_ceil(MAX_SIDE);
        // About as many rows of the finer film.
        let rows = (ROWS as f64 / self.ratio()).max(1.0) as usize;
        let step = rows.next_multiple_of(block);
        let strips = size.height.div_ceil(step);
        let wide = size.width.div_ceil(block);
        let mut picture = vec![0f64; size.height.div_ceil(block) * wide];
        let mut bands = Vec::new();
        for (nm, index) in &self.bands {
            let found: Mutex<Vec<Option<Strip>>> = Mutex::new((0..strips).map(|_| None).collect());
            parallel::for_each::<anyhow::Error>(threads.min(strips), strips, &|_, _| (), |k| {
                let rect = Rect::new((k * step) as i64, 0, step.min(size.height - k * step), size.width);
                let strip = self.strip(index, rect, size, cells, block);
                let strip = strip.with_context(|| format!("comparing the bands at {} nm", number(*nm)))?;
                found.lock().expect("no panic while held")[k] = Some(strip);
                Ok(())
            })?;
            // In the order of the strips, so that sums have the same bits for any number of threads.
            let mut regions = vec![Sums::default(); cells.0 * cells.1];
            let strips = found.into_inner().expect("no panic while held").into_iter().flatten().enumerate();
            for (k, strip) in strips {
                regions.iter_mut().zip(&strip.sums).for_each(|(all, one)| all.add(one));
                let first = k * step / block * wide;
                picture[first..].iter_mut().zip(&strip.picture).for_each(|(all, one)| *all += one);
            }
            let mut all = Sums::default();
            regions.iter().for_each(|one| all.add(one));
            bands.push(Band { nm: *nm, all, regions });
        }
        let picture: Vec<f32> = picture.iter().map(|sum| (sum / bands.len() as f64) as f32).collect();
        Ok(Comparison {
            units: [0, 1].map(|k| self.charts[k].units().map(str::to_owned)),
            names: self.names,
            common: self.common.as_ref().map(CommonPixels::json),
            bands,
            rects: cell_rects(size, cells),
            edges,
            difference: draw(&picture, wide, block),
        })
    }

    fn strip(
        &self,
        bands: &[usize; 2],
        rect: Rect,
        size: Size,
        cells: (usize, usize),
        block: usize,
    ) -> Result<Strip> {
        let (a, b) = (self.read(0, bands[0], rect)?, self.read(1, bands[1], rect)?);
        let wide = size.width.div_ceil(block);
        let mut sums = vec![Sums::default(); cells.0 * cells.1];
        let mut picture = vec![(0f64, 0u32); rect.height.div_ceil(block) * wide];
        for (i, (a, b)) in std::iter::zip(a.chunks(size.width), b.chunks(size.width)).enumerate() {
            let region = (rect.y as usize + i) * cells.0 / size.height * cells.1;
            for (x, (a, b)) in std::iter::zip(a, b).enumerate() {
                let (a, d) = (f64::from(*a), f64::from(*b) - f64::from(*a));
                let sum = &mut sums[region + x * cells.1 / size.width];
                sum.pixels += 1;
                sum.a += a;
                sum.b += f64::from(*b);
                sum.a2 += a * a;
                sum.d2 += d * d;
                sum.largest = sum.largest.max(d.abs());
                let shown = &mut picture[i / block * wide + x / block];
                *shown = (shown.0 + d, shown.1 + 1);
            }
        }
        let picture = picture.into_iter().map(|(sum, n)| sum / f64::from(n.max(1))).collect();
        Ok(Strip { sums, picture })
    }

    fn read(&self, film: usize, band: usize, rect: Rect) -> Result<Vec<f32>> {
        let source = self.charts[film].source();
        let pixels = match &self.common {
            Some(common) => common.views[film].read(source, band, rect),
            None => {
                let mut pixels = vec![0f32; rect.size().pixels()];
                source.read(band, rect, &mut pixels).map(|()| pixels)
            }
        };
        let pixels = pixels.map_err(anyhow::Error::from_boxed)?;
        if let Some(i) = pixels.iter().position(|v| !v.is_finite()) {
            let of = if self.common.is_some() { " of the common pixels" } else { "" };
            bail!(
                "{}: row {}, column {}{of} is {}: the film is not complete; finish its run first",
                self.names[film],
                rect.y + (i / rect.width) as i64,
                i % rect.width,
                pixels[i]
            );
        }
        Ok(pixels)
    }
}

/// Sums of a strip of rows by region, and its rows of the picture.
struct Strip {
    sums: Vec<Sums>,
    picture: Vec<f64>,
}

impl Sums {
    fn add(&mut self, other: &Self) {
        self.pixels += other.pixels;
        (self.a, self.b) = (self.a + other.a, self.b + other.b);
        (self.a2, self.d2) = (self.a2 + other.a2, self.d2 + other.d2);
        self.largest = self.largest.max(other.largest);
    }

    /// Mean of each film.
    pub fn means(&self) -> [f64; 2] {
        [self.a, self.b].map(|sum| sum / self.pixels as f64)
    }

    /// RMS of the difference.
    pub fn rms(&self) -> f64 {
        (self.d2 / self.pixels as f64).sqrt()
    }

    /// Largest size of the difference.
    pub fn largest(&self) -> f64 {
        self.largest
    }

    /// RMS of the difference over that of the first film; none where this is dark.
    pub fn share(&self) -> Option<f64> {
        (self.a2 > 0.0).then(|| (self.d2 / self.a2).sqrt())
    }

    fn json(&self) -> Value {
        let [a, b] = self.means();
        json!({
            "mean": [a, b],
            "difference_mean": b - a,
            "difference_rms": self.rms(),
            "difference_rms_share": self.share(),
            "difference_largest": self.largest,
        })
    }
}

impl Edge {
    /// Frequency of modulation 1/2 in a film, cycles per pixel, or why there is none.
    pub fn mtf50(measured: &Result<Measurement, String>) -> String {
        match measured.as_ref().map(|m| m.figures["mtf50_cy_px"].as_f64()) {
            Err(why) => format!("none ({why})"),
            Ok(None) => "above 1".to_owned(),
            Ok(Some(f)) => format!("{f:.4}"),
        }
    }
}

impl Comparison {
    /// What the picture shows.
    pub fn caption(&self) -> String {
        format!(
            "{} minus {}: mean over the bands of {n} x {n} pixels, red above, blue below 0, full colour at {:.3e}",
            self.names[1],
            self.names[0],
            self.difference.scale,
            n = self.difference.block
        )
    }

    /// All figures.
    pub fn json(&self) -> Value {
        let band = |band: &Band| {
            let mut value = band.all.json();
            value["wavelength_nm"] = json!(band.nm);
            let region = |(rect, sums): (&Rect, &Sums)| {
                let mut value = sums.json();
                value["region"] = json!([rect.x, rect.y, rect.width, rect.height]);
                value
            };
            value["regions"] = std::iter::zip(&self.rects, &band.regions).map(region).collect();
            value
        };
        let one = |m: &Result<Measurement, String>| match m {
            Ok(m) => json!({ "figures": m.figures, "mtf": m.mtf }),
            Err(why) => json!({ "error": why }),
        };
        let edge = |edge: &Edge| {
            let bands = edge
                .bands
                .iter()
                .map(|(nm, [a, b])| json!({ "wavelength_nm": nm, "a": one(a), "b": one(b) }));
            json!({ "line": edge.line, "bands": bands.collect::<Vec<_>>() })
        };
        json!({
            "films": self.names,
            "units": self.units,
            "common_pixels": self.common,
            "bands": self.bands.iter().map(band).collect::<Vec<_>>(),
            "edges": self.edges.iter().map(edge).collect::<Vec<_>>(),
        })
    }

    /// The regions of each band.
    pub fn regions_csv(&self) -> String {
        let mut text = String::from(
            "wavelength_nm,x,y,width,height,mean_a,mean_b,difference_mean,difference_rms,difference_largest\n",
        );
        for band in &self.bands {
            for (r, sums) in std::iter::zip(&self.rects, &band.regions) {
                let [a, b] = sums.means();
                // Writing to a String cannot fail.
                let _ = writeln!(
                    text,
                    "{},{},{},{},{},{a:e},{b:e},{:e},{:e},{:e}",
                    number(band.nm),
                    r.x,
                    r.y,
                    r.width,
                    r.height,
                    b - a,
                    sums.rms(),
                    sums.largest
                );
            }
        }
        text
    }

    /// The MTF of each edge, band and film.
    pub fn mtf_csv(&self) -> String {
        let mut text = String::from("edge,wavelength_nm,film,frequency_cy_px,modulation\n");
        for (k, edge) in self.edges.iter().enumerate() {
            for (nm, both) in &edge.bands {
                for (film, measured) in ["a", "b"].iter().zip(both) {
                    for (f, m) in measured.iter().flat_map(|m| &m.mtf) {
                        let _ = writeln!(text, "{k},{},{film},{f},{m:.6}", number(*nm));
                    }
                }
            }
        }
        text
    }
}
