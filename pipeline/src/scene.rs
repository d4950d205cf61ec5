//! Scenes: what a pinhole at the centre of the entrance pupil sees of a triangle mesh, as sheets with a chart, a distance and a coverage per
//! chart pixel.
//!
//! | step | module |
//! |---|---|
//! | what a file describes | [`description`] |
//! | spectra, weights of a surface's light | [`weights`] |
//! | chart pixel to direction, places of the samples | [`frame`], [`film_directions`] |
//! | camera | [`pose`] |
//! | triangles in the camera frame, closed components | [`mesh`] |
//! | all hits of each sample, and which are surfaces | [`visibility`] |
//! | sheets of a pixel and of a tile, reach of hidden sheets | [`sheets`] |
//! | materials, textures, light with shadows | [`appearance`], [`texture`], [`light`] |
//!
//! Camera frame: origin at the centre of the paraxial entrance pupil, x right (columns), y DOWN (rows), z along the axis into the scene, in
//! metres. A direction is d = (x, y, 1), so that the point of a ray at z is z·d and the vergence is V = 1/z in 1/m.
//! From the f32 vertices of the camera frame on all arithmetic is f64: + − × ÷ √ without fused operations or functions of the C library,
//! so bits depend neither on the engine nor on tiles nor on threads.
//!
//! The radiance of a surface in the direction of the camera is a sum over bases, L(λ) = Σ_b w_b·S_b(λ): the weights w depend on the place, the spectra S on
//! the wavelength. Without the feature `mesh` there are the descriptions and the spectra alone, which a scene needs that is made already.

#[cfg(feature = "mesh")]
pub mod appearance;
pub mod description;
#[cfg(feature = "mesh")]
pub mod film_directions;
#[cfg(feature = "mesh")]
pub mod frame;
#[cfg(feature = "mesh")]
pub mod horizon;
#[cfg(feature = "mesh")]
pub mod light;
#[cfg(feature = "mesh")]
pub mod mesh;
#[cfg(feature = "mesh")]
pub mod pose;
#[cfg(feature = "mesh")]
pub mod shading;
#[cfg(feature = "mesh")]
pub mod sheets;
#[cfg(all(test, feature = "mesh"))]
mod test_mesh;
#[cfg(feature = "mesh")]
pub mod texture;
#[cfg(feature = "mesh")]
mod vector;
#[cfg(feature = "mesh")]
pub mod visibility;
pub mod weights;
