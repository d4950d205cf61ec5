//! lenscube's physics and flow: what happens to the light, in order. Knows no file.
//!
//! A chart lies on the ideal image plane of a lens; the film gets what the lens makes of it, band by band:
//!
//! ```text
//! for band in job:                                            band, lens      tables at this wavelength
//!     for tile of the film grown by half the PSF window:      plan, geometry  the cut; px and mm
//!         remap = R(r) · chart at (X, Y)·h(r)/r               remap           stages 1-2, a gather
//!                                                             field             h(r, λ), R(r, λ)
//!                                                             resample          between the chart's pixels
//!         light = Σ_nodes (w_node · remap) ∗ P_node           psf             stage 3, a scatter: tile + tail
//!         film += light, in tile order                        overlap_add     stage 4
//!         shards that nothing can reach any more → encode → write
//! ```
//!
//! [`executor`] schedules this on all cores and GPUs with bounded queues and the same bits for any number of threads; [`stages`] is what
//! it calls to compute a tile. [`flow`] holds the traits of chart sources and film sinks, [`clock`] counts the time of each stage. [`cuda`] opens
//! GPUs and holds their memory; a stage's kernels lie beside it ([`remap::cuda`]). Beside the path: [`chart`] draws charts without a store ([`colour`], [`reflectance`],
//! [`wavelengths`] serve it); [`design`] makes a lens's tables and PSFs from its prescription,
//! [`figures`] sums them up for people; [`mod@bench`] is what speed is measured against; [`bounds`] limits every number from outside.
//! [`simd`] chooses the instructions, and [`real`] has the functions whose bits do not depend on the host.

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod band;
pub mod bench;
pub mod bounds;
pub mod buffer;
pub mod chart;
pub mod clock;
pub mod colour;
pub mod cuda;
pub mod design;
pub mod executor;
pub mod field;
pub mod figures;
pub mod flow;
pub mod geometry;
pub mod lens;
pub mod measure;
pub mod overlap_add;
pub mod plan;
pub mod psf;
pub mod real;
pub mod reflectance;
pub mod remap;
pub mod resample;
pub mod simd;
pub mod stages;
pub mod wavelengths;
mod words;
