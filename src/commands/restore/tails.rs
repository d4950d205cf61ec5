//! The light that a film has from the tails of PSFs, at pixels on it: subtracted before restoration.
//!
//! Tails vary over many pixels, so at pixels of another pitch they are those of the film interpolated linearly between its pixels, at the pixel's middle.

use super::planes::Grid;
use anyhow::{Context, Result};
use formats::film::FilmStore;
use pipeline::buffer::ShardPixels;
use pipeline::geometry::Rect;
use pipeline::layer::{Layer, Taps};
use std::sync::{Arc, Mutex};

/// The layers of a plane: share and layer of each band.
type Layers = Arc<Vec<(f64, Layer)>>;

/// The layers of the plane that was read last.
#[derive(Default)]
pub struct FilmTails(Mutex<Option<(usize, Layers)>>);

impl FilmTails {
    /// Subtracts the tails of `film` from the `values` of the pixels `rect` of `grid`, of a plane with its bands.
    ///
    /// # Errors
    /// A layer is missing or damaged.
    pub fn subtract(
        &self,
        film: &FilmStore,
        (plane, bands): (usize, &[(usize, f64)]),
        (grid, rect): (Grid, Rect),
        values: &mut [f32],
    ) -> Result<()> {
        let layers = self.layers(film, plane, bands)?;
        if layers.is_empty() {
            return Ok(());
        }
        let spec = film.spec();
        // Rows and columns of the film at those of the pixels.
        let scale = grid.pitch_um / spec.pitch_um;
        let at = |k: i64, axis: f64, film_axis: f64| (k as f64 - axis) * scale + film_axis;
        let rows: Vec<f64> = (rect.y..rect.bottom()).map(|y| at(y, grid.axis_px.0, spec.axis_px.0)).collect();
        let columns: Vec<f64> =
            (rect.x..rect.right()).map(|x| at(x, grid.axis_px.1, spec.axis_px.1)).collect();
        let range = |at: &[f64], side: usize| {
            let within = |v: f64| (v as i64).clamp(0, side as i64 - 1);
            let (first, last) = (within(at[0].floor()), within(at[at.len() - 1].floor() + 1.0));
            (first, (last - first + 1) as usize)
        };
        let ((top, height), (left, width)) =
            (range(&rows, spec.film.height), range(&columns, spec.film.width));
        let on_film = Rect::new(top, left, height, width);
        let mut light = vec![0.0f64; on_film.size().pixels()];
        for (share, layer) in layers.iter() {
            let mut pixels = ShardPixels::new(on_film.size());
            pixels.reach(height, Vec::new);
            layer.add(on_film, &mut pixels);
            for (y, row) in light.chunks_exact_mut(width).enumerate() {
                row.iter_mut().zip(pixels.row(y)).for_each(|(sum, v)| *sum += share * f64::from(*v));
            }
        }
        let between = |at: f64, first: i64, n: usize| {
            let at = (at - first as f64).clamp(0.0, (n - 1) as f64);
            (at as usize, (at as usize + 1).min(n - 1), at.fract())
        };
        for (row, y) in values.chunks_exact_mut(rect.width).zip(&rows) {
            let (above, below, down) = between(*y, top, height);
            for (value, x) in row.iter_mut().zip(&columns) {
                let (before, after, across) = between(*x, left, width);
                let line =
                    |y: usize| light[y * width + before] * (1.0 - across) + light[y * width + after] * across;
                *value -= (line(above) * (1.0 - down) + line(below) * down) as f32;
            }
        }
        Ok(())
    }

    fn layers(&self, film: &FilmStore, plane: usize, bands: &[(usize, f64)]) -> Result<Layers> {
        let mut known = self.0.lock().expect("no panic while held");
        if let Some((of, layers)) = &*known
            && *of == plane
        {
            return Ok(Arc::clone(layers));
        }
        let mut layers = Vec::new();
        for (index, _) in film.spec().layers.iter().enumerate() {
            for &(band, share) in bands {
                let coefficients =
                    film.read_layer(index, band)?.context("the film lacks its layer of tails")?;
                let grid = film.spec().layer_grid(index, band);
                layers.push((share, Layer::new(grid, Taps::Lagrange, coefficients)));
            }
        }
        let layers = Arc::new(layers);
        *known = Some((plane, Arc::clone(&layers)));
        Ok(layers)
    }
}
