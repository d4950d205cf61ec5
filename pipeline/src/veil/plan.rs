//! Sizes of a veil, and the layer of a band.

use super::fft::{self, Planes};
use super::ghosts::ghosts_on_bins;
use super::kernel::ScatterKernel;
use super::light::{light_of_bins, mean_over_film};
use crate::design::ghost::rings::RingOperator;
use crate::extended_chart::ExtendedChart;
use crate::field::Field;
use crate::geometry::{Frame, Size};
use crate::layer::BinGrid;
use crate::lens::LensBand;
use crate::options::Options;
use crate::reduced_chart::ReducedChart;
use crate::stage::Stage;
use std::sync::OnceLock;

/// Stored bins around those of the film: what its interpolation reads.
pub const VEIL_MARGIN_BINS: usize = 2;
/// Sides of bins, film pixels.
const BINS_PX: [usize; 4] = [8, 16, 32, 64];
/// Most bins along the larger side of a film with the bin that is chosen.
const MAX_CHOSEN_BINS: usize = 512;
/// Least reach of scatter, bins.
const MIN_REACH_BINS: f64 = 4.0;
/// Bins that the reach of scatter leaves of the larger side of the film.
const BINS_BEYOND_REACH: f64 = 2.0;
/// Bins of the larger side of a film with scatter, at least.
const LEAST_SIDE_BINS: usize = (MIN_REACH_BINS + BINS_BEYOND_REACH) as usize;

/// A veil that does not fit the film.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum VeilError {
    /// A bin larger than the film.
    #[error("bins of {bin_px} film pixels are larger than the film of {film}")]
    Bin {
        /// Side of a bin, film pixels.
        bin_px: usize,
        /// Film size.
        film: Size,
    },
    /// A film too small for any reach.
    #[error(
        "scatter needs a film of at least {least_px} px, {LEAST_SIDE_BINS} bins of {bin_px} film pixels; the film has {film} px: make it larger, or its bins smaller (8 px at least)"
    )]
    Small {
        /// Side of a bin, film pixels.
        bin_px: usize,
        /// The least of the film's larger side, px.
        least_px: usize,
        /// Film size.
        film: Size,
    },
    /// A reach that the grid cannot hold.
    #[error(
        "a reach of {reach_mm:.4} mm is not within {least_mm:.4} to {greatest_mm:.4} mm: at least {MIN_REACH_BINS} bins of {bin_px} film pixels, at most the larger side of the film less {BINS_BEYOND_REACH} bins"
    )]
    Reach {
        /// The reach, mm.
        reach_mm: f64,
        /// Its minimum, mm.
        least_mm: f64,
        /// Its maximum, mm.
        greatest_mm: f64,
        /// Side of a bin, film pixels.
        bin_px: usize,
    },
}

/// Shares of the light of a band.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VeilShares {
    /// Spread evenly over the film.
    pub glare: f64,
    /// Scattered.
    pub scatter: f64,
}

impl VeilShares {
    /// What they take from the image.
    pub fn taken(&self) -> f64 {
        self.glare + self.scatter
    }
}

/// Grids of the veil of a film, the same for all bands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VeilPlan {
    /// Bins of the stored layer.
    pub grid: BinGrid,
    /// Scatter, if there is any.
    pub scatter: Option<ScatterKernel>,
    /// Bins around those of the film whose light reaches the layer.
    light_margin: usize,
    /// Side of the cells of the reduced chart, chart pixels.
    pub reduced_px: usize,
    bin_mm: f64,
}

/// Half the diagonal of the film, or what the bins hold of it: the reach of scatter unless it is given, mm.
fn usual_reach_mm(frame: &Frame, bin_px: usize) -> f64 {
    let (height, width) = (frame.film.height as f64, frame.film.width as f64);
    let greatest = height.max(width) - BINS_BEYOND_REACH * bin_px as f64;
    ((height * height + width * width).sqrt() / 2.0).min(greatest) * frame.pitch_mm()
}

impl VeilPlan {
    /// The bin that is chosen for a film: at most 512 along its larger side, if possible.
    pub fn usual_bin_px(film: Size) -> usize {
        let side = film.height.max(film.width);
        BINS_PX.into_iter().find(|bin| side.div_ceil(*bin) <= MAX_CHOSEN_BINS).unwrap_or(BINS_PX[3])
    }

    /// A veil on the film of `frame`, in bins of `bin_px`; `scatter` has the shoulder (mm), the slope, and the reach (mm) if it is given.
    ///
    /// # Errors
    /// [`VeilError`]: the bin is larger than the film; the reach does not fit.
    pub fn new(
        frame: &Frame,
        bin_px: usize,
        scatter: Option<(f64, f64, Option<f64>)>,
    ) -> Result<Self, VeilError> {
        let (film, side) = (frame.film, frame.film.height.max(frame.film.width));
        if bin_px > side {
            return Err(VeilError::Bin { bin_px, film });
        }
        let least_px = LEAST_SIDE_BINS * bin_px;
        if scatter.is_some() && side < least_px {
            return Err(VeilError::Small { bin_px, least_px, film });
        }
        let bin_mm = bin_px as f64 * frame.pitch_mm();
        let kernel = |(shoulder_mm, slope, reach_mm): (f64, f64, Option<f64>)| {
            let reach_mm = reach_mm.unwrap_or_else(|| usual_reach_mm(frame, bin_px));
            let least_mm = MIN_REACH_BINS * bin_mm;
            let greatest_mm = side as f64 * frame.pitch_mm() - BINS_BEYOND_REACH * bin_mm;
            match reach_mm >= least_mm && reach_mm <= greatest_mm * (1.0 + 1e-12) {
                true => Ok(ScatterKernel { shoulder_mm, slope, reach_mm }),
                false => Err(VeilError::Reach { reach_mm, least_mm, greatest_mm, bin_px }),
            }
        };
        let scatter = scatter.map(kernel).transpose()?;
        let reach = scatter.map_or(0, |kernel| kernel.reach_bins(bin_mm));
        let bin_on_chart = bin_px as f64 / frame.scale.0.max(frame.scale.1);
        Ok(Self {
            grid: BinGrid::new(film, bin_px, VEIL_MARGIN_BINS),
            scatter,
            light_margin: VEIL_MARGIN_BINS + reach,
            reduced_px: ReducedChart::side_within(bin_on_chart),
            bin_mm,
        })
    }

    /// Bins whose light is computed.
    fn light_size(&self) -> Size {
        let bins = self.grid.bins();
        Size::new(bins.height + 2 * self.light_margin, bins.width + 2 * self.light_margin)
    }

    /// The padded grid of the convolution.
    fn padded(&self) -> Size {
        let light = self.light_size();
        Size::new(fft::side(light.height), fft::side(light.width))
    }

    /// Bytes of computing the layer of a band of a chart of `chart` px on `threads` threads: reduced chart and its reading, light, and of scatter the
    /// padded grid and the spectrum of the kernel.
    pub fn making_bytes(&self, chart: Size, threads: usize) -> usize {
        let (reduced, reading) = ReducedChart::bytes(chart, self.reduced_px, threads);
        let light = 8 * self.light_size().pixels();
        // Spectrum of the light, factors of the kernel, and the plane that one of them comes from or goes to.
        let convolution = if self.scatter.is_some() { 24 * self.padded().pixels() } else { 0 };
        let extended = ExtendedChart::bytes(chart, self.reduced_px);
        reduced + extended + light + reading.max(convolution) + 4 * self.grid.size().pixels()
    }

    /// Core seconds of computing the layer of a band after its chart is read, on a 2.2 GHz Xeon.
    pub fn making_s(&self) -> f64 {
        let convolution = if self.scatter.is_some() { self.padded().pixels() } else { 0 };
        1e-9 * (LIGHT_NS * self.light_size().pixels() as f64 + TRANSFORMS_NS * convolution as f64)
    }
}

/// The light of a bin, ns.
const LIGHT_NS: f64 = 400.0;
/// A forward and an inverse transform, per value of the padded grid, ns.
const TRANSFORMS_NS: f64 = 150.0;

/// Computes the layers of the bands of a job.
#[derive(Debug)]
pub struct VeilMaker {
    plan: VeilPlan,
    /// Transform of the scatter kernel, which is real: the kernel is even. The same for all bands.
    spectrum: OnceLock<Vec<f64>>,
}

impl VeilMaker {
    /// For the veil `plan`.
    pub fn new(plan: VeilPlan) -> Self {
        Self { plan, spectrum: OnceLock::new() }
    }

    /// Its grids.
    pub fn plan(&self) -> &VeilPlan {
        &self.plan
    }

    /// The coefficients of the layer of the band with the tables `band` from its reduced chart, row by row on the stored bins; `gain` is that of the
    /// whole light of the image, `ghosts` the operator of the lens's ghosts.
    #[allow(
        clippy::too_many_arguments,
        reason = "film, lens, options, light, chart, ghosts and threads are independent"
    )]
    pub fn layer(
        &self,
        frame: &Frame,
        band: &LensBand,
        options: &Options,
        (gain, shares): (f64, VeilShares),
        reduced: &ReducedChart,
        ghosts: Option<&RingOperator>,
        threads: usize,
    ) -> Vec<f32> {
        let ghosts = ghosts.map(|operator| ghosts_on_bins(frame, &self.plan.grid, operator, gain, reduced));
        if let (Some(ghosts), true) = (&ghosts, shares.taken() == 0.0) {
            return ghosts.iter().map(|ghosts| *ghosts as f32).collect();
        }
        let stages = options.stages;
        let (distortion, illumination) = (stages.has(Stage::Distortion), stages.has(Stage::Ri));
        let field = Field::on_chart(band, frame, distortion, illumination, gain);
        let (grid, surround) = (&self.plan.grid, options.interpolation.surround);
        let glare = match shares.glare > 0.0 {
            true => shares.glare * mean_over_film(frame, &field, (reduced, surround), grid.bin_px),
            false => 0.0,
        };
        let scattered = match (self.plan.scatter, shares.scatter > 0.0) {
            (Some(kernel), true) => {
                let (chart, bins) =
                    (ExtendedChart::new(reduced, surround), (grid.bin_px, self.plan.light_margin));
                let light = light_of_bins(frame, &field, &chart, bins, self.plan.light_size(), threads);
                self.convolved(&kernel, &light)
            }
            _ => vec![0.0; grid.size().pixels()],
        };
        let spread = scattered.iter().map(|scattered| shares.scatter * scattered + glare);
        match ghosts {
            None => spread.map(|light| light as f32).collect(),
            Some(ghosts) => spread.zip(ghosts).map(|(light, ghosts)| (light + ghosts) as f32).collect(),
        }
    }

    /// `kernel` convolved with `light`, at the stored bins. The padded grid is circular: bins that are not stored receive wrong light.
    fn convolved(&self, kernel: &ScatterKernel, light: &[f64]) -> Vec<f64> {
        let (size, padded) = (self.plan.light_size(), self.plan.padded());
        let planes = Planes::new(padded.height, padded.width);
        let factors = self.spectrum.get_or_init(|| self.spectrum(kernel, &planes));
        let mut spectrum = planes.forward(light, size.width);
        spectrum.iter_mut().zip(factors).for_each(|(value, factor)| *value *= factor);
        let (stored, first) = (self.plan.grid.size(), self.plan.light_margin - VEIL_MARGIN_BINS);
        let plane = planes.inverse(&mut spectrum, first + stored.height);
        let rows = plane.chunks_exact(padded.width).skip(first);
        rows.flat_map(|row| &row[first..][..stored.width]).copied().collect()
    }

    /// Transform of the kernel about bin (0, 0) of the circular grid, over the number of its values.
    fn spectrum(&self, kernel: &ScatterKernel, planes: &Planes) -> Vec<f64> {
        let padded = self.plan.padded();
        let side = kernel.reach_bins(self.plan.bin_mm) + 1;
        let mut plane = vec![0.0; padded.pixels()];
        for (k, value) in kernel.quadrant(self.plan.bin_mm).into_iter().enumerate() {
            let (i, j) = (k / side, k % side);
            for y in [i, (padded.height - i) % padded.height] {
                for x in [j, (padded.width - j) % padded.width] {
                    plane[y * padded.width + x] = value;
                }
            }
        }
        let spectrum = planes.forward(&plane, padded.width);
        spectrum.iter().map(|value| value.re / padded.pixels() as f64).collect()
    }
}

#[cfg(test)]
mod tests;
