//! Measuring films, and what a lens's own data say a film must show.
//!
//! | quantity | from the film | from the lens |
//! |---|---|---|
//! | place of a point | [`centroid`] | chief ray, centroid of its PSF |
//! | edge spread function ESF, line spread function LSF | [`edge`]: pixels by their distance from the edge | [`expected`]: the PSF summed across the edge |
//! | modulation transfer function MTF | [`sfr`]: e-SFR of ISO 12233 | the same, of the expected ESF |
//! | agreement of two curves | [`agreement`] | |
//!
//! Nothing here is shared with the stages that make a film: no rotation, no interpolation, no convolution code. Distances are
//! film pixels, angles degrees or rad as named, azimuth 0 on +x and 90° down, as everywhere.

pub mod agreement;
pub mod centroid;
pub mod edge;
pub mod expected;
pub mod sfr;
