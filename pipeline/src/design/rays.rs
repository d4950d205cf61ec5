//! First-order optics, and real rays from a field point through the pupil to the film.

pub(super) mod aim;
pub(super) mod clip;
mod field;
pub(super) mod ideal_lens;
mod launch;
pub(super) mod losses;
pub mod paraxial;
pub mod ray;
mod ray_budget;
pub mod scalar;
pub(super) mod stop_point;
pub mod surface;
