//! Synthetic lens pack of one band, with parameters that perturb its tables and PSFs.

use formats::lens::{LensPackError, PackAttributes};
use pipeline::lens::{Lens, LensBand, PsfSample, PsfStack};
use std::path::Path;

const FILM_PITCH_UM: f64 = 2.0;
/// Sample pitch of the PSFs, film pixels: 0.5 µm.
const STEP_PX: f64 = 0.25;

/// Parameters of the lens.
#[derive(Clone, Copy)]
pub struct SyntheticLens {
    /// Distortion at 20 mm, as a ratio.
    pub distortion: f64,
    /// Scale of the image, for lateral colour.
    pub scale: f64,
    /// Shift of the illumination table, table nodes.
    pub illumination_shift: usize,
    /// Rotation of the PSFs, degrees.
    pub psf_rotation_deg: f64,
    /// Whether PSF samples are means over the film pixel, although the pack declares point samples.
    pub integrated: bool,
}

/// Lens without perturbation.
pub const UNPERTURBED: SyntheticLens = SyntheticLens {
    distortion: -0.01,
    scale: 1.0,
    illumination_shift: 0,
    psf_rotation_deg: 0.0,
    integrated: false,
};

/// Gaussian of σ = 2.4 × 1.2 px, offset outwards in proportion to the height, in a window of 21 film pixels.
fn psf(height_mm: f64, lens: SyntheticLens) -> Vec<f32> {
    let n = 83usize;
    let (sin, cos) = lens.psf_rotation_deg.to_radians().sin_cos();
    let value = |y: f64, x: f64| {
        let (u, v) = (x * cos + y * sin - 0.02 * height_mm, y * cos - x * sin);
        (-0.5 * ((u / 2.4).powi(2) + (v / 1.2).powi(2))).exp()
    };
    let mean = |y: f64, x: f64| {
        let at = |i: usize| (i as f64 + 0.5) / 8.0 - 0.5;
        (0..64).map(|i| value(y + at(i / 8), x + at(i % 8))).sum::<f64>()
    };
    let place = |i: usize| (i as f64 - (n / 2) as f64) * STEP_PX;
    let one = |i: usize| {
        let (y, x) = (place(i / n), place(i % n));
        if lens.integrated { mean(y, x) } else { value(y, x) }
    };
    let all: Vec<f64> = (0..n * n).map(one).collect();
    let sum: f64 = all.iter().sum();
    all.iter().map(|v| (v / sum) as f32).collect()
}

/// Writes the lens as a pack.
pub fn write(path: &Path, synthetic: SyntheticLens) {
    let ideal: Vec<f64> = (0..=1000).map(|i| 0.021 * f64::from(i)).collect();
    let real = |h: &f64| h * synthetic.scale * (1.0 + synthetic.distortion * (h / 20.0).powi(2));
    let illumination = |i: usize| {
        let h = ideal[i.saturating_sub(synthetic.illumination_shift)];
        1.0 - 0.15 * (h / 20.0).powi(2)
    };
    let heights: Vec<f64> = (0..=8).map(|k| 2.59 * f64::from(k)).collect();
    let band = LensBand {
        relative_illumination: (0..ideal.len()).map(illumination).collect(),
        ideal_height_mm: ideal.clone(),
        azimuth_count: (0..heights.len()).map(|k| if k == 0 { 1 } else { 72 }).collect(),
        psf_size: 83,
        psf_pitch_um: STEP_PX * FILM_PITCH_UM,
        kernel_pitch_um: None,
        psf_energy: vec![1.0; heights.len()],
        psf_height_mm: heights.clone(),
        ..LensBand::ideal(550.0, ideal.iter().map(real).collect())
    };
    let samples = heights.iter().flat_map(|h| psf(*h, synthetic)).collect();
    let stack = PsfStack { size: 83, pitch_um: band.psf_pitch_um, sample: PsfSample::Point, samples };
    let lens = Lens {
        name: "synthetic".into(),
        distortion_focal_length_mm: 50.0,
        effective_focal_length_mm: 50.0,
        f_number: 2.0,
        primary_wavelength_nm: 550.0,
        object_distance_mm: None,
        magnification: 0.0,
        psf_sample: PsfSample::Point,
        bands: vec![band],
        depth: None,
    };
    formats::lens::write(path, &lens, &PackAttributes::default(), [Ok::<_, LensPackError>(stack)]).unwrap();
}
