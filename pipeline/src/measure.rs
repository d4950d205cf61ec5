//! Measurement of films, and the values expected from the data of a lens.
//!
//! | quantity | from the film | from the lens |
//! |---|---|---|
//! | position of a point | [`centroid`] | chief ray, centroid of its PSF |
//! | edge spread function ESF, line spread function LSF | [`edge`]: pixels by their distance from the edge | [`expected`]: the PSF summed across the edge |
//! | modulation transfer function MTF | [`sfr`]: e-SFR of ISO 12233 | the same, of the expected ESF |
//! | modulation of a Siemens star | [`star`]: s-SFR | |
//! | texture MTF of dead leaves | [`texture`]: cross-correlation with the chart | |
//! | tones, noise, dynamic range of grey patches | [`tones`]; [`mod@visual_noise`] as an observer sees it | |
//! | gain of a camera in DN | [`mod@photon_transfer`]: variance over mean of grey patches | |
//! | distortion, lateral colour of dots | [`dots`] | |
//! | shading of light and colour | [`shading`] | |
//! | veiling glare, flare of a lamp | mean of a black area over that of a white one; [`flare`] | closed forms of its kernels |
//! | position of a chart in a picture | [`fiducial`]: its four corner marks; [`projective`]: the map through them | |
//! | agreement of two curves | [`agreement`] | |
//!
//! No code is shared with the stages that compute a film: no rotation, interpolation or convolution. Distances are film pixels, angles
//! degrees or rad as named, azimuth 0 on +x and 90° down.

pub mod agreement;
pub mod centroid;
pub mod dots;
pub mod edge;
pub mod expected;
pub mod fiducial;
pub mod flare;
pub mod photon_transfer;
pub mod projective;
pub mod sfr;
pub mod shading;
pub mod star;
pub mod texture;
pub mod tones;
pub mod visual_noise;
