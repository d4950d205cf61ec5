//! The film on which PSFs are exported, and their places.

use crate::args::{LensExportArgs, ModelArg};
use crate::failure::usage;
use anyhow::Result;
use formats::psf_grid::fits::MAX_PLACES;
use pipeline::bounds::FILM_SIDE_PX;
use pipeline::geometry::Size;

/// Samples a film pixel by default: odd, so that the kernels of the film are among the samples; of isetcam, whose files have all field heights.
const OVERSAMPLE: usize = 5;
const ISETCAM_OVERSAMPLE: usize = 2;
/// Places by default.
const GRID: Size = Size { height: 5, width: 5 };
/// Fewest samples a side that `GriddedPSFModel` takes.
const MIN_SIDE: usize = 4;

/// A film with its middle on the axis.
pub struct PsfFilm {
    pub size: Size,
    pub pitch_um: f64,
    pub oversample: usize,
    /// Columns and rows of the places, film pixels.
    pub x_px: Vec<f64>,
    pub y_px: Vec<f64>,
}

impl PsfFilm {
    /// The film of `args`; `half_sides_mm` are half the sides (X, Y) of the default one, mm.
    ///
    /// # Errors
    /// Usage: a lens without a field off the axis and no `--film-size`; more places than pixels.
    pub fn new(args: &LensExportArgs, half_sides_mm: impl FnOnce() -> Result<[f64; 2]>) -> Result<Self> {
        let pitch_um = args.film_pitch_um;
        let size = match args.film_size {
            Some(size) => size,
            None => {
                // The centres of the outermost pixels lie within.
                let side = half_sides_mm()?.map(|mm| (2e3 * mm / pitch_um).floor() + 1.0);
                if side.iter().any(|side| *side < 2.0 || !FILM_SIDE_PX.contains(*side)) {
                    return Err(usage(format!(
                        "{}: the field points of the lens give no film of 2 to {} px a side; give --film-size",
                        args.lens, FILM_SIDE_PX.max
                    )));
                }
                Size::new(side[1] as usize, side[0] as usize)
            }
        };
        let is_isetcam = args.model == ModelArg::IsetCam;
        let grid = args.grid.filter(|_| !is_isetcam).unwrap_or(GRID);
        if !is_isetcam && (grid.width > size.width || grid.height > size.height) {
            return Err(usage(format!("--grid {grid}: expected at most the pixels of the film, {size}")));
        }
        let default = if is_isetcam { ISETCAM_OVERSAMPLE } else { OVERSAMPLE };
        let oversample = args.oversample.unwrap_or(default);
        let film = Self {
            x_px: places(grid.width, size.width),
            y_px: places(grid.height, size.height),
            size,
            pitch_um,
            oversample,
        };
        match args.model == ModelArg::PsfFits {
            true => film.check_gridded(grid).map(|()| film),
            false => Ok(film),
        }
    }

    /// Checks that the places are a grid of `GriddedPSFModel`.
    fn check_gridded(&self, grid: Size) -> Result<()> {
        let count = grid.pixels();
        let is_grid = count == 1 || (grid.width >= 2 && grid.height >= 2);
        match is_grid && count <= MAX_PLACES {
            true => Ok(()),
            false => Err(usage(format!(
                "--grid {grid}: psf-fits has one place, or 2 or more along each side and {MAX_PLACES} at most; psf-npy and psf-zarr have any"
            ))),
        }
    }

    /// Checks that a PSF of `window_px` has the samples that `GriddedPSFModel` interpolates between.
    ///
    /// # Errors
    /// Usage: it has fewer.
    pub fn check_side(&self, window_px: usize) -> Result<()> {
        match window_px * self.oversample >= MIN_SIDE {
            true => Ok(()),
            false => Err(usage(format!(
                "psf-fits: PSFs of {window_px} px with {} samples a pixel have fewer than {MIN_SIDE} samples a side, which photutils needs; give a larger \
                 --psf-window or --oversample",
                self.oversample
            ))),
        }
    }

    /// Distance of the outermost pixels from the axis, mm.
    pub fn corner_mm(&self) -> f64 {
        let half = [self.size.width, self.size.height].map(|n| (n - 1) as f64 / 2.0);
        half[0].hypot(half[1]) * 1e-3 * self.pitch_um
    }

    /// Places in mm from the axis, row after row.
    pub fn places_mm(&self) -> Vec<[f64; 2]> {
        let mm = |px: f64, count: usize| (px - (count - 1) as f64 / 2.0) * 1e-3 * self.pitch_um;
        let row = |y: &f64| {
            let y = mm(*y, self.size.height);
            self.x_px.iter().map(move |x| [mm(*x, self.size.width), y]).collect::<Vec<_>>()
        };
        self.y_px.iter().flat_map(row).collect()
    }
}

/// `count` places from the first of `pixels` pixels to the last; one place is in the middle.
fn places(count: usize, pixels: usize) -> Vec<f64> {
    let last = (pixels - 1) as f64;
    match count {
        1 => vec![last / 2.0],
        _ => (0..count).map(|i| last * i as f64 / (count - 1) as f64).collect(),
    }
}
