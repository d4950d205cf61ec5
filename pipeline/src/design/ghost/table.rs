//! The table of the ghost paths of a lens.

use super::apertures::Apertures;
use super::group::Group;
use super::light_tables::LightTables;
use super::options::GhostOptions;
use super::path::ghost_paths;
use super::report::{PathReport, sort};
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;

/// The ghost paths of a lens at one wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct GhostTable {
    /// The paths, the largest share on the axis first.
    pub paths: Vec<PathReport>,
    /// Width of a ring, mm.
    pub ring_mm: f64,
    /// Surfaces whose clear radius is that of image rays, from 0.
    pub radii_of_rays: Vec<usize>,
    /// Paths between whose reflections a mirror lies, which are left out.
    pub across_mirrors: usize,
}

/// The ghost paths of `system` at `nm`.
///
/// # Errors
/// As [`trace_ghosts`](super::operator::trace_ghosts).
pub fn ghost_table(system: &System, nm: f64, options: &GhostOptions) -> Result<GhostTable, DesignError> {
    let apertures = Apertures::new(system, options.corner_mm)?;
    let group = Group::new(system, nm, &[nm], options, &apertures)?;
    let ways = group.ways();
    let tables = LightTables::new(&group.lights, ways.iter().map(Vec::as_slice));
    let mut paths = group.reports(&ways, &group.windows(&ways), &tables).swap_remove(0);
    sort(&mut paths);
    Ok(GhostTable {
        paths,
        ring_mm: group.sizes.ring_mm,
        radii_of_rays: apertures.of_rays,
        across_mirrors: ghost_paths(system, !options.film_reflectance.is_zero()).1,
    })
}
