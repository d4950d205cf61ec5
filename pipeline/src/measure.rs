//! Measurement of films, and the values expected from the data of a lens.
//!
//! | quantity | from the film | from the lens |
//! |---|---|---|
//! | position of a point | [`centroid`] | chief ray, centroid of its PSF |
//! | edge spread function ESF, line spread function LSF | [`edge`]: pixels by their distance from the edge | [`expected`]: the PSF summed across the edge |
//! | modulation transfer function MTF | [`sfr`]: e-SFR of ISO 12233 | the same, of the expected ESF |
//! | veiling glare, flare of a lamp | mean of a black area over that of a white one; [`flare`] | closed forms of its kernels |
//! | agreement of two curves | [`agreement`] | |
//!
//! No code is shared with the stages that compute a film: no rotation, interpolation or convolution. Distances are film pixels, angles
//! degrees or rad as named, azimuth 0 on +x and 90° down.

pub mod agreement;
pub mod centroid;
pub mod edge;
pub mod expected;
pub mod flare;
pub mod sfr;
