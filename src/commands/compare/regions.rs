//! Difference, SNR and noise-equivalent difference of the regions of a grid, and the difference as a picture.

use super::Pair;
use crate::camera::frame::Frame;
use anyhow::Result;
use formats::parallel;
use formats::picture::image::Image;
use pipeline::geometry::{Rect, Size};
use serde_json::{Value, json};
use std::fmt::Write;
use std::sync::Mutex;

/// Longest side of the picture of the difference.
pub const MAX_SIDE: usize = 1600;
/// Rows that a worker reads, about.
pub const ROWS: usize = 512;
/// Share of the picture's pixels within the scale of its colours.
const SHOWN: f64 = 0.995;

/// A plane of a region.
#[derive(Clone, Debug)]
pub struct Region {
    /// Its pixels.
    pub rect: Rect,
    /// Its plane.
    pub plane: String,
    /// Distance of its middle from the optical axis, mm.
    pub height_mm: f64,
    /// Mean electrons in each raw.
    pub mean_e: [f64; 2],
    /// Mean and standard deviation of the difference, e-.
    pub difference_e: (f64, f64),
    /// Standard deviation of a pixel's noise in each raw, e-.
    pub sigma_e: [f64; 2],
}

impl Region {
    /// SNR of a pixel, dB; NaN in the dark.
    pub fn snr_db(&self, raw: usize) -> f64 {
        20.0 * (self.mean_e[raw] / self.sigma_e[raw]).log10()
    }

    /// Noise-equivalent difference, e-.
    pub fn equivalent_e(&self) -> f64 {
        self.sigma_e[0].hypot(self.sigma_e[1])
    }

    pub fn json(&self) -> Value {
        let r = self.rect;
        json!({
            "region": [r.x, r.y, r.width, r.height],
            "plane": self.plane,
            "image_height_mm": self.height_mm,
            "mean_e": self.mean_e,
            "difference_mean_e": self.difference_e.0,
            "difference_sigma_e": self.difference_e.1,
            "snr_db": [self.snr_db(0), self.snr_db(1)],
            "noise_equivalent_difference_e": self.equivalent_e(),
        })
    }
}

/// The table of all regions.
pub fn csv(regions: &[Region]) -> String {
    let mut text = String::from(
        "x,y,width,height,plane,image_height_mm,mean_a_e,mean_b_e,difference_mean_e,difference_sigma_e,snr_a_db,snr_b_db,noise_equivalent_difference_e\n",
    );
    for g in regions {
        let r = g.rect;
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{},{},{},{},{},{:.4},{:.3},{:.3},{:.4},{:.4},{:.3},{:.3},{:.4}",
            r.x,
            r.y,
            r.width,
            r.height,
            g.plane,
            g.height_mm,
            g.mean_e[0],
            g.mean_e[1],
            g.difference_e.0,
            g.difference_e.1,
            g.snr_db(0),
            g.snr_db(1),
            g.equivalent_e()
        );
    }
    text
}

/// The difference as a picture.
pub struct Difference {
    /// Red where the second raw has more light, blue where the first has.
    pub image: Image,
    /// Pixels of the raw along a side of one of the picture's.
    pub block: usize,
    /// Difference of full colour: e-, of films in their unit.
    pub scale: f64,
}

impl Difference {
    /// What the picture shows.
    pub fn caption(&self, pair: &Pair) -> String {
        format!(
            "{} minus {}: mean of {n} x {n} pixels, red above, blue below 0, full colour at {:.1} e-",
            pair.names[1],
            pair.names[0],
            self.scale,
            n = self.block
        )
    }
}

/// Sums of a filter plane in a region.
#[derive(Clone, Copy, Default)]
struct Sums {
    pixels: u64,
    a: f64,
    b: f64,
    d2: f64,
}

/// Sums of a strip of rows: regions by planes, and rows of the picture.
struct Strip {
    sums: Vec<Sums>,
    picture: Vec<f32>,
}

/// Measures all regions.
pub fn measure(pair: &Pair, grid: usize, threads: usize) -> Result<(Vec<Region>, Difference)> {
    let frame = &pair.frames[0];
    let size = frame.rect.size();
    let (rows, columns) = (grid.min(size.height), grid.min(size.width));
    let planes: Vec<String> = frame.sensor.planes().iter().map(|p| (*p).to_owned()).collect();
    let period = frame.sensor.pattern.rows.max(frame.sensor.pattern.columns);
    let block = size.height.max(size.width).div_ceil(MAX_SIDE).next_multiple_of(period);
    let step = ROWS.next_multiple_of(block);
    let strips = size.height.div_ceil(step);
    let work = Work { pair, size, grid: (rows, columns), planes: planes.len(), block };
    let found: Mutex<Vec<Option<Strip>>> = Mutex::new((0..strips).map(|_| None).collect());
    parallel::for_each::<anyhow::Error>(threads.min(strips), strips, &|_, _| (), |k| {
        let rect = Rect::new((k * step) as i64, 0, step.min(size.height - k * step), size.width);
        let strip = work.strip(rect)?;
        found.lock().expect("no panic while held")[k] = Some(strip);
        Ok(())
    })?;
    // In the order of the strips, so that sums have the same bits for any number of threads.
    let mut sums = vec![Sums::default(); rows * columns * planes.len()];
    let mut picture = Vec::new();
    for strip in found.into_inner().expect("no panic while held").into_iter().flatten() {
        for (all, one) in std::iter::zip(&mut sums, &strip.sums) {
            all.pixels += one.pixels;
            (all.a, all.b, all.d2) = (all.a + one.a, all.b + one.b, all.d2 + one.d2);
        }
        picture.extend(strip.picture);
    }
    let regions = work.regions(&sums, &planes);
    Ok((regions, draw(&picture, size.width.div_ceil(block), block)))
}

struct Work<'a> {
    pair: &'a Pair,
    size: Size,
    grid: (usize, usize),
    planes: usize,
    block: usize,
}

impl Work<'_> {
    fn strip(&self, rect: Rect) -> Result<Strip> {
        let (a, b) = (electrons(&self.pair.frames[0], rect)?, electrons(&self.pair.frames[1], rect)?);
        let frame = &self.pair.frames[0];
        let (of, p) = (frame.sensor.plane_of_channels(), &frame.sensor.pattern);
        let (down, across) = self.grid;
        let mut sums = vec![Sums::default(); down * across * self.planes];
        let wide = self.size.width.div_ceil(self.block);
        let mut picture = vec![(0f64, 0u32); rect.height.div_ceil(self.block) * wide];
        for i in 0..rect.height {
            let y = rect.y as usize + i;
            let row = (frame.rect.y as usize + y) % p.rows;
            let own: Vec<usize> =
                (0..p.columns).map(|x| of[p.channel(row, frame.rect.x as usize + x)]).collect();
            let region = y * down / self.size.height * across;
            let line = i * rect.width..(i + 1) * rect.width;
            for (x, (a, b)) in std::iter::zip(&a[line.clone()], &b[line]).enumerate() {
                let d = f64::from(*b) - f64::from(*a);
                let cell = region + x * across / self.size.width;
                let sum = &mut sums[cell * self.planes + own[x % p.columns]];
                sum.pixels += 1;
                sum.a += f64::from(*a);
                sum.b += f64::from(*b);
                sum.d2 += d * d;
                let shown = &mut picture[i / self.block * wide + x / self.block];
                *shown = (shown.0 + d, shown.1 + 1);
            }
        }
        let picture = picture.into_iter().map(|(sum, n)| (sum / f64::from(n.max(1))) as f32).collect();
        Ok(Strip { sums, picture })
    }

    fn regions(&self, sums: &[Sums], planes: &[String]) -> Vec<Region> {
        let frame = &self.pair.frames[0];
        let rects = cell_rects(self.size, self.grid);
        let mut regions = Vec::new();
        for (k, sum) in sums.iter().enumerate().filter(|(_, s)| s.pixels > 0) {
            let plane = k % self.planes;
            let rect = rects[k / self.planes];
            let n = sum.pixels as f64;
            let mean_e = [sum.a / n, sum.b / n];
            let mean = mean_e[1] - mean_e[0];
            regions.push(Region {
                rect,
                plane: planes[plane].clone(),
                height_mm: height_mm(frame, rect),
                mean_e,
                difference_e: (mean, (sum.d2 / n - mean * mean).max(0.0).sqrt()),
                sigma_e: [0, 1].map(|f| self.pair.frames[f].sigma_e(mean_e[f])),
            });
        }
        regions
    }
}

/// Distance of a region's middle from the optical axis.
fn height_mm(frame: &Frame, rect: Rect) -> f64 {
    let (spec, pitch_mm) = (&frame.spec, frame.spec.pitch_um * 1e-3);
    let middle = |first: i64, own: i64, n: usize, side: usize, centre: f64| {
        ((first + own) as f64 + n as f64 / 2.0 - side as f64 / 2.0) * pitch_mm + centre
    };
    let y = middle(frame.rect.y, rect.y, rect.height, spec.sensor.height, spec.centre_mm.0);
    let x = middle(frame.rect.x, rect.x, rect.width, spec.sensor.width, spec.centre_mm.1);
    y.hypot(x)
}

/// Electrons of the pixels `rect` of the array.
pub fn electrons(frame: &Frame, rect: Rect) -> Result<Vec<f32>> {
    let adc = &frame.sensor.adc;
    let (black, k) = (adc.black_dn as f32, (frame.gain * adc.gain_dn_per_e) as f32);
    Ok(frame.read(rect)?.iter().map(|v| (v - black) / k).collect())
}

/// Rectangles of a grid of `cells` (down, across), row by row.
pub fn cell_rects(size: Size, cells: (usize, usize)) -> Vec<Rect> {
    let edge = |k: usize, cells: usize, n: usize| (k * n).div_ceil(cells) as i64;
    let cell = |k: usize| {
        let (i, j) = (k / cells.1, k % cells.1);
        let (y, bottom) = (edge(i, cells.0, size.height), edge(i + 1, cells.0, size.height));
        let (x, right) = (edge(j, cells.1, size.width), edge(j + 1, cells.1, size.width));
        Rect::new(y, x, (bottom - y) as usize, (right - x) as usize)
    };
    (0..cells.0 * cells.1).map(cell).collect()
}

/// The difference in blocks, `width` of them a row, each of `block` pixels a side.
pub fn draw(picture: &[f32], width: usize, block: usize) -> Difference {
    let mut sizes: Vec<f32> = picture.iter().map(|v| v.abs()).collect();
    sizes.sort_by(f32::total_cmp);
    let rank = ((SHOWN * sizes.len() as f64).ceil() as usize).clamp(1, sizes.len()) - 1;
    let scale = f64::from(sizes[rank]).max(f64::from(f32::MIN_POSITIVE));
    let mut image = Image::new(Size::new(picture.len() / width, width), [0; 3]);
    for (y, line) in picture.chunks_exact(width).enumerate() {
        for (pixel, v) in image.row_mut(y).iter_mut().zip(line) {
            let t = (f64::from(*v) / scale).clamp(-1.0, 1.0);
            let rest = (255.0 * (1.0 - t.abs())).round() as u8;
            *pixel = if t > 0.0 { [255, rest, rest] } else { [rest, rest, 255] };
        }
    }
    Difference { image, block, scale }
}
