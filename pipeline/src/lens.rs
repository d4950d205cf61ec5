//! Tables of a lens per wavelength: heights, relative illumination, PSFs.
//!
//! ```text
//! ideal_height_mm[i]  f·tan(field angle), f = the DISTORTION focal length (one f for all bands)
//! image_height_mm[i]  REAL chief-ray height of the same field point; both ascend from 0
//! relative_illumination[i]  R, 1 on axis; belongs to the field point
//! psf(k)              PSF of a field point on +x at REAL height psf_height_mm[k]; row down, column right
//! ```
//! Tables are dense: linear interpolation between field points is within 1e-4 px (about 1000 points to 25 mm).
//! The PSF stack of one band may be large (traced: 60 MB), so stacks are read separately, band by band.

mod check;
pub mod cone;
pub mod cone_field;
pub mod depth;
pub mod middle;
pub mod planar;
pub mod tail;

use crate::bounds::{self, OutOfBounds};
use cone_field::ConeField;
use depth::LensDepth;
use planar::{PlanarBand, PlanarMap, PsfPlaces};
use tail::BandTail;
use thiserror::Error;

/// Meaning of one PSF sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PsfSample {
    /// The PSF at a point; samples are finer than Nyquist and are integrated over the film pixel when a kernel is computed.
    Point,
    /// The PSF's mean over the square of one psf pitch.
    Integrated,
}

/// A lens without its PSF samples.
///
/// ```
/// # use lenscube_pipeline::lens::{Lens, LensBand, PsfSample};
/// # let heights = vec![0.0, 1.0];
/// # let band = LensBand {
/// #     wavelength_nm: 550.0, ideal_height_mm: heights.clone(), image_height_mm: heights.clone(), relative_illumination: vec![1.0, 0.9],
/// #     psf_height_mm: heights, azimuth_count: vec![1, 4], psf_size: 9, psf_pitch_um: 2.0, kernel_pitch_um: None, psf_energy: vec![1.0, 1.0],
/// #     solid_angle_sr: 0.1, transmission: 1.0,
/// #     tail: None, cones: None, planar: None,
/// # };
/// # let lens = Lens {
/// #     name: "ideal".into(), distortion_focal_length_mm: 50.0, effective_focal_length_mm: 50.0, f_number: 2.8, primary_wavelength_nm: 550.0,
/// #     object_distance_mm: None, magnification: 0.0, psf_sample: PsfSample::Integrated, bands: vec![band], depth: None,
/// # };
/// // An ideal lens of 50 mm: no distortion, an illumination of 0.9 at 1 mm, PSFs of 9 x 9 samples of 2 µm.
/// lens.check_head().unwrap();
/// lens.bands[0].check()?;
/// let darker = |at_mm| lenscube_pipeline::lens::linear(&lens.bands[0].image_height_mm, &lens.bands[0].relative_illumination, at_mm);
/// assert!((darker(0.5) - 0.95).abs() < 1e-12);
/// # Ok::<(), lenscube_pipeline::lens::LensError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Lens {
    /// Display name.
    pub name: String,
    /// Slope of the paraxial chief ray in this image plane at the primary wavelength, mm.
    pub distortion_focal_length_mm: f64,
    /// Effective focal length without its sign, which is negative for a relay or a Gregorian telescope, mm.
    pub effective_focal_length_mm: f64,
    /// Image-space F-number.
    pub f_number: f64,
    /// Wavelength of the focal lengths, nm.
    pub primary_wavelength_nm: f64,
    /// Object distance in mm; `None` = infinity.
    pub object_distance_mm: Option<f64>,
    /// Ideal height over object height in this image plane, negative for an image upside down (0 for an object at infinity).
    pub magnification: f64,
    /// Meaning of one PSF sample.
    pub psf_sample: PsfSample,
    /// The wavelengths, ascending.
    pub bands: Vec<LensBand>,
    /// PSFs at several object distances, if it has them; the tables of [`Lens::bands`] are then those of the node nearest to focus.
    pub depth: Option<LensDepth>,
}

impl Lens {
    /// Whether the tables of all bands are over image height: those of a lens with rotational symmetry.
    pub fn is_symmetric(&self) -> bool {
        self.bands.iter().all(LensBand::is_symmetric)
    }

    /// Checks the numbers that are common to all bands.
    ///
    /// # Errors
    /// The name of the attribute, as in the lens pack, and its bound.
    pub fn check_head(&self) -> Result<(), (&'static str, OutOfBounds)> {
        let all = [
            ("distortion_focal_length_mm", bounds::FOCAL_LENGTH_MM, self.distortion_focal_length_mm),
            ("effective_focal_length_mm", bounds::FOCAL_LENGTH_MM, self.effective_focal_length_mm),
            ("f_number", bounds::F_NUMBER, self.f_number),
            ("primary_wavelength_nm", bounds::WAVELENGTH_NM, self.primary_wavelength_nm),
            ("object_distance_mm", bounds::OBJECT_DISTANCE_MM, self.object_distance_mm.unwrap_or(0.0)),
            ("magnification", bounds::MAGNIFICATION, self.magnification),
        ];
        all.into_iter().try_for_each(|(name, bound, v)| bound.check(v).map(drop).map_err(|e| (name, e)))
    }
}

/// A lens at one wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct LensBand {
    /// Wavelength in nm.
    pub wavelength_nm: f64,
    /// Ideal heights of the field points, mm, ascending from 0.
    pub ideal_height_mm: Vec<f64>,
    /// Real chief-ray heights of the same field points, mm, ascending from 0.
    pub image_height_mm: Vec<f64>,
    /// Relative illumination of the same field points, 1 on axis.
    pub relative_illumination: Vec<f64>,
    /// REAL image heights of the PSFs, mm, ascending from 0.
    pub psf_height_mm: Vec<f64>,
    /// Azimuths J_k per height: 1 on the axis, else a multiple of 4.
    pub azimuth_count: Vec<usize>,
    /// Side of the PSF window in samples, odd.
    pub psf_size: usize,
    /// Sample pitch in µm.
    pub psf_pitch_um: f64,
    /// Pitch in µm of the samples that films make kernels from ([`crate::psf::coarse`]), if the band states one: the pitch of the film that it was
    /// traced for over 3, 2 or 1.5.
    pub kernel_pitch_um: Option<f64>,
    /// Share of all the light that the window held before normalisation, per height.
    pub psf_energy: Vec<f64>,
    /// Irradiance of the film on the axis over radiance of the object, sr: π·NA² of a lens in focus.
    pub solid_angle_sr: f64,
    /// Lens transmission, 1 if unknown.
    pub transmission: f64,
    /// Light of the PSFs beyond their windows, if known: films then hold it, and kernels are not scaled to sum 1.
    pub tail: Option<BandTail>,
    /// Directions of the light at the film, if the pack has them: for sensors whose response depends on them.
    pub cones: Option<ConeField>,
    /// Tables of a lens without rotational symmetry, in place of those over image height, which are then empty.
    pub planar: Option<PlanarBand>,
}

/// PSF samples of one band: windows of n × n, each of sum 1, chief ray at the centre sample. The rows of the stack are the windows: one a height;
/// for PSFs that depend on the azimuth A_k a height, of (k, a) with a fastest; of a Cartesian grid of nodes one a node, of (row, column).
#[derive(Clone, Debug, PartialEq)]
pub struct PsfStack {
    /// Side n of a window, odd.
    pub size: usize,
    /// Sample pitch in µm.
    pub pitch_um: f64,
    /// Meaning of a sample.
    pub sample: PsfSample,
    /// Windows × n × n samples, row down; field point on +x, but for Cartesian grids.
    pub samples: Vec<f32>,
}

impl PsfStack {
    /// Number of windows: of heights, if each has one.
    pub fn heights(&self) -> usize {
        self.samples.len() / (self.size * self.size)
    }

    /// The window `k`, that of height `k` if each has one.
    pub fn window(&self, k: usize) -> &[f32] {
        let n = self.size * self.size;
        &self.samples[k * n..][..n]
    }

    /// The windows, whose memory is that of the stack.
    pub(crate) fn into_windows(self) -> Vec<Vec<f32>> {
        let (n, mut samples) = (self.size * self.size, self.samples);
        let mut windows = Vec::with_capacity(samples.len() / n);
        while !samples.is_empty() {
            windows.push(samples.split_off(samples.len() - n));
            samples.shrink_to_fit();
        }
        windows.reverse();
        windows
    }
}

/// Invalid or insufficient lens tables.
#[derive(Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum LensError {
    /// A table violates its contract.
    #[error("lens band {wavelength_nm} nm: {table} {problem}")]
    Table {
        /// The band.
        wavelength_nm: f64,
        /// Name of the table, as in the lens pack.
        table: &'static str,
        /// The violation.
        problem: String,
    },
    /// The film extends beyond the tables.
    #[error(
        "the film with its margin reaches {needed_mm:.6} mm from the axis, but the lens's {table} at {wavelength_nm} nm ends at {last_mm:.6} mm; use a smaller film or a lens pack with more field, or use the last values with `--outside clamp`"
    )]
    Outside {
        /// The table that ends too early.
        table: &'static str,
        /// The band.
        wavelength_nm: f64,
        /// Required real image height, mm.
        needed_mm: f64,
        /// Last real image height of the table, mm.
        last_mm: f64,
    },
    /// The film extends beyond the map of a lens without rotational symmetry.
    #[error(
        "the film with its margin reaches from ({:.6}, {:.6}) to ({:.6}, {:.6}) mm, but the lens's map at {wavelength_nm} nm from ({:.6}, {:.6}) to ({:.6}, {:.6}) mm; use a smaller film or a lens pack with a larger map, or use the last values with `--outside clamp`",
        x[0], y[0], x[1], y[1], map_x[0], map_y[0], map_x[1], map_y[1]
    )]
    OutsideMap {
        /// The band.
        wavelength_nm: f64,
        /// First and last X of the film, mm.
        x: [f64; 2],
        /// First and last Y of the film, mm.
        y: [f64; 2],
        /// First and last X of the map, mm.
        map_x: [f64; 2],
        /// First and last Y of the map, mm.
        map_y: [f64; 2],
    },
    /// A chart band lies outside the lens's wavelengths.
    #[error("chart band {wavelength_nm} nm lies outside the lens's {first_nm}..{last_nm} nm")]
    Wavelength {
        /// The chart band, nm.
        wavelength_nm: f64,
        /// First of the lens, nm.
        first_nm: f64,
        /// Last of the lens, nm.
        last_nm: f64,
    },
    /// A chart band lies between two lens bands: a PSF is interpolated on request only.
    #[error(
        "chart band {wavelength_nm} nm lies between the lens's {below_nm} and {above_nm} nm; a PSF is not interpolated over wavelength unless `--interpolate-psf` is given (over 20 nm it can be wrong by 30-100 % in the blue)"
    )]
    BetweenBands {
        /// The chart band, nm.
        wavelength_nm: f64,
        /// The band below, nm.
        below_nm: f64,
        /// The band above, nm.
        above_nm: f64,
    },
    /// The PSFs of two bands cannot be interpolated.
    #[error("cannot interpolate the PSF between {below_nm} and {above_nm} nm: their {what} differ")]
    Blend {
        /// The band below, nm.
        below_nm: f64,
        /// The band above, nm.
        above_nm: f64,
        /// The differing property.
        what: &'static str,
    },
    /// The lens has one object distance only.
    #[error(
        "the lens has no depth nodes: its PSFs are those of one object distance, so it cannot image surfaces at several"
    )]
    NoDepth,
    /// A chart band lies between two lens bands with depth nodes.
    #[error(
        "chart band {wavelength_nm} nm lies between the lens's {below_nm} and {above_nm} nm; PSFs of depth nodes are not interpolated over wavelength"
    )]
    BetweenDepthBands {
        /// The chart band, nm.
        wavelength_nm: f64,
        /// The band below, nm.
        below_nm: f64,
        /// The band above, nm.
        above_nm: f64,
    },
    /// Surfaces lie beyond the depth nodes.
    #[error(
        "the surfaces lie {nearest_m:.6} to {farthest_m:.6} m from the entrance pupil, the lens's depth nodes at {wavelength_nm} nm reach from {lens_nearest_m:.6} to {lens_farthest_m:.6} m; use a lens pack with more nodes, or the nearest node with `--outside clamp`"
    )]
    Vergence {
        /// The band.
        wavelength_nm: f64,
        /// Nearest surface, m.
        nearest_m: f64,
        /// Farthest surface, m.
        farthest_m: f64,
        /// Nearest node, m.
        lens_nearest_m: f64,
        /// Farthest node, m.
        lens_farthest_m: f64,
    },
}

impl LensBand {
    /// A band of an ideal lens, of real heights ascending from 0: no distortion, no loss of light, PSFs of one sample at the axis and the last height.
    ///
    /// # Panics
    /// No height.
    pub fn ideal(wavelength_nm: f64, image_height_mm: Vec<f64>) -> Self {
        let last_mm = *image_height_mm.last().expect("at least one height");
        Self {
            wavelength_nm,
            ideal_height_mm: image_height_mm.clone(),
            relative_illumination: vec![1.0; image_height_mm.len()],
            image_height_mm,
            psf_height_mm: vec![0.0, last_mm],
            azimuth_count: vec![1, 4],
            psf_size: 1,
            psf_pitch_um: 2.0,
            kernel_pitch_um: None,
            psf_energy: vec![1.0; 2],
            solid_angle_sr: 0.1,
            transmission: 1.0,
            tail: None,
            cones: None,
            planar: None,
        }
    }

    /// The band with `map` in place of its tables over image height, and with its PSFs, one a height.
    #[must_use]
    pub fn with_map(self, map: PlanarMap) -> Self {
        let psfs = PsfPlaces::Polar { azimuth_samples: vec![1; self.psf_height_mm.len()] };
        Self {
            ideal_height_mm: Vec::new(),
            image_height_mm: Vec::new(),
            relative_illumination: Vec::new(),
            planar: Some(PlanarBand { map, psfs }),
            ..self
        }
    }

    /// Whether its tables are over image height: those of a lens with rotational symmetry.
    pub fn is_symmetric(&self) -> bool {
        self.planar.is_none()
    }

    /// Bytes of its tables without those of PSF heights.
    pub fn table_bytes(&self) -> usize {
        let field_points =
            self.planar.as_ref().map_or(self.ideal_height_mm.len(), |p| p.map.ideal_x_mm.len());
        let middle = self.tail.as_ref().and_then(|tail| tail.middle.as_ref());
        3 * size_of::<f64>() * field_points + middle.map_or(0, |middle| size_of_val(&middle.samples[..]))
    }

    /// PSFs of the band: rows of its [`PsfStack`].
    pub fn psf_count(&self) -> usize {
        self.planar.as_ref().map_or(self.psf_height_mm.len(), |planar| planar.psfs.count())
    }
}

/// Linear interpolation in an ascending table, and extrapolation by its first and last step.
pub fn linear(xs: &[f64], ys: &[f64], at: f64) -> f64 {
    let i = xs.partition_point(|&x| x <= at).clamp(1, xs.len() - 1);
    ys[i - 1] + (at - xs[i - 1]) / (xs[i] - xs[i - 1]) * (ys[i] - ys[i - 1])
}
