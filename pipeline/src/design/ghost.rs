//! Ghosts: light that reaches the film after two reflections at surfaces that refract, or at the film and one of them.
//!
//! A path (i, j), j < i, is reflected at surface i, then at j: 0 … i … j … film. All pairs of the surfaces that reflect are paths; the film is one of them if
//! it reflects. Mirrors are part of every path as they are of the image's; both ghost reflections lie between two successive mirrors. The path is unfolded:
//! z counts along the light everywhere, surfaces that are met from behind are seen reversed ([`path`]).
//!
//! ```text
//! Γ_p(h) = cos⁴θ ∫∫ w dx dy / ∫∫_axis w_image dx dy          object at infinity;     ∫∫ w dL dM / ∫∫_axis w_image dL dM   at a finite distance
//! ```
//! is the power that path p brings to the film from an element dA of the ideal plane at the height h, over E₀ dA, E₀ the irradiance of the image on the axis of the
//! same radiance. It is defined where the image is vignetted or beyond the film, too. w: reflectances, transmittances and absorption along the ray
//! ([`light`]), unpolarised light. Rays are launched over the first surface (light that both reflections send back before the stop is no part of the image's
//! bundle) and clipped at every crossing ([`apertures`]).
//!
//! Sources: paths and first order: Rogers, Proc. SPIE 3780 (1999); Lee & Eisemann, Comput. Graph. Forum 32 (2013). Left out: four reflections and more (0.4 % of the
//! image in an uncoated lens of ten surfaces, 2·10⁻⁶ with quarter waves), reflections at mounts and edges, diffraction and interference of ghosts.

pub mod apertures;
mod cell;
pub mod estimate;
pub mod first_order;
mod grid;
mod group;
mod heights;
pub mod light;
mod light_tables;
pub mod operator;
pub mod options;
pub mod path;
pub mod report;
pub mod rings;
pub mod share;
pub mod small;
mod sums;
pub mod table;
#[cfg(test)]
mod test_lenses;
pub mod trace;
mod window;

pub use group::geometry_nm;
pub use path::{GhostLens, GhostPath};
