//! Interpolation between bins: the weights of four coefficients.

use crate::spline;

/// An interpolation with four taps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taps {
    /// Cubic B-spline: the layer's values are its coefficients, not its samples. Nothing becomes negative or rings, the weights of a pixel sum to
    /// 1 and those of a bin to b², and the light of a bin keeps its centre; it is blurred by a standard deviation of b/√3 along each axis.
    BSpline,
    /// Cubic Lagrange polynomial through the four values: exact for cubics, continuous.
    Lagrange,
}

impl Taps {
    /// Weights of the coefficients −1, 0, 1, 2 at fraction `f` between 0 and 1.
    pub fn weights(self, f: f64) -> [f64; 4] {
        match self {
            Self::BSpline => spline::weights(f),
            Self::Lagrange => spline::lagrange_weights(f),
        }
    }

    /// Weights of each tap at the pixels of a bin of `bin_px`: in its first half the coefficients from two bins before on, in its second half
    /// from one bin before on.
    pub(super) fn of_bin(self, bin_px: usize) -> [Vec<f32>; 4] {
        let fraction = |pixel: usize| {
            let place = (pixel as f64 + 0.5) / bin_px as f64 - 0.5;
            place - place.floor()
        };
        let at: Vec<[f64; 4]> = (0..bin_px).map(|pixel| self.weights(fraction(pixel))).collect();
        std::array::from_fn(|tap| at.iter().map(|weights| weights[tap] as f32).collect())
    }
}
