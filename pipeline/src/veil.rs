//! Scatter, veiling glare and ghosts: light that spreads far over the film, as a smooth layer per band. Ghosts are added to the sum below ([`ghosts`]): what they have, reflections took from the image.
//!
//! ```text
//! film = (1 − Σ a_k) · (image ∗ PSF) + Σ a_k K_k ∗ I          shares a_k of the light, kernels K_k with integral 1
//! glare    K = 1 / area of the film:   the mean of I over the film
//! scatter  K(r) = (1 + (r/r₀)²)^(−s/2) / M(r_max) for r ≤ r_max, else 0
//!          M(r) = π r₀² ((1 + r²/r₀²)^(1 − s/2) − 1)/(1 − s/2);   for s = 2: π r₀² ln(1 + r²/r₀²)
//! ```
//! I is the light of the image on the film before the PSF: gain · R(r) · chart((X, Y) h(r)/r), as the remap has it; r, r₀, r_max in mm on the film, s
//! the slope of the scattered radiance per decade of angle (ABg or Harvey model: r₀ = shoulder angle × distance to the film). Light is conserved
//! and a uniform field stays uniform within r_max of its edge. A black disc of radius ρ in white has the index a (1 − M(ρ)/M(r_max)) of scatter;
//! of glare g, with the share f of the film's area, g (1 − f)/(1 − g f).
//!
//! On a grid of bins ([`crate::layer`]): I of a bin is the mean over 4 × 4 places of the reduced chart ([`crate::extended_chart`], bilinear) times gain
//! and R ([`light`]); beyond the chart its surround, beyond the lens's tables their last values. K holds the integrals over bins, scaled to sum 1
//! ([`kernel`]); the convolution is one of the padded grid in f64 ([`fft`]), glare the mean over the film, of bins that reach beyond it over their part. The layer has two bins around
//! those of the film, the light as many more as r_max covers.
//!
//! Left out: the change of scatter with field height and azimuth, and spectra other than that of roughness; scattering of scattered light. Light
//! that is scattered by less than a bin stays within about one bin: near scatter belongs to the PSF.
//! Source: J. E. Harvey, Understanding Surface Scatter (SPIE 2019), chapters 2 and 5; ISO 9358 (veiling glare index); Fest, Stray Light Analysis and
//! Control (SPIE 2013), 2.3.

pub mod fft;
pub mod ghosts;
mod index;
pub mod kernel;
pub mod light;
mod plan;

pub use index::ExpectedIndex;
pub use kernel::ScatterKernel;
pub use plan::{VEIL_MARGIN_BINS, VeilError, VeilMaker, VeilPlan, VeilShares};
