//! A band at places of the film, as its film has them: ideal point, relative illumination and kernel, of lenses with and without
//! rotational symmetry.
//!
//! ```text
//! I(X)          ideal point of the film place X = (X, Y), mm, by the tables of the remap stage (head of `field`)
//! R(X)          relative illumination there
//! K(X)          Σ_node w_node(X)·P_node, the kernel of a point that is imaged to X, sum 1 (head of `psf::grid`)
//! boresight     the place X with I(X) = 0
//! ```
//! Film frame: X right, Y DOWN, mm from the lens's axis. A place of an ideal point is found by X ← X + (I − I(X))/s, s the scale on the axis: the maps of
//! lenses are close to a scale.

use crate::field::Field;
use crate::field::planar::PlanarField;
use crate::lens::planar::PsfPlaces;
use crate::lens::{LensBand, PsfSample, PsfStack};
use crate::options::PsfNodes;
use crate::psf::grid::{Node, NodeGrid};
use crate::psf::kernel::{KernelScratch, NodeKernels};
use crate::psf::polar::BlockPlace;
use crate::real;
use crate::simd::Simd;

/// Steps of the search of a place, and the distance at which it ends, mm.
const STEPS: usize = 50;
const ACCURACY_MM: f64 = 1e-10;

/// A band on a film.
#[derive(Debug)]
pub struct BandOnFilm<'a> {
    band: &'a LensBand,
    pitch_mm: f64,
    map: Map,
    grid: NodeGrid,
}

#[derive(Debug)]
enum Map {
    Radial(Field),
    Planar(PlanarField),
}

impl<'a> BandOnFilm<'a> {
    /// `band` on a film of `film_pitch_um`.
    pub fn new(band: &'a LensBand, film_pitch_um: f64) -> Self {
        let pitch_mm = 1e-3 * film_pitch_um;
        let map = match &band.planar {
            None => Map::Radial(Field::new(band, pitch_mm, true, true, 1.0)),
            Some(planar) => Map::Planar(PlanarField::new(&planar.map, pitch_mm, true, true, 1.0)),
        };
        Self { band, pitch_mm, map, grid: PsfNodes::of(band).grid(pitch_mm, None) }
    }

    /// The ideal point of a film place, mm, and the relative illumination there; beyond the tables by those of their edge.
    pub fn at(&self, place_mm: [f64; 2]) -> ([f64; 2], f64) {
        let [x, y] = place_mm.map(|mm| mm / self.pitch_mm);
        match &self.map {
            Map::Radial(field) => {
                let (ratio, illumination) = field.at(real::hypot(x, y));
                (place_mm.map(|mm| mm * ratio), illumination)
            }
            Map::Planar(field) => {
                let [down, across, illumination] = field.at(y, x);
                ([x + across, y + down].map(|px| px * self.pitch_mm), illumination)
            }
        }
    }

    /// The film place of an ideal point, mm; none if the search does not end.
    pub fn place_of(&self, ideal_mm: [f64; 2]) -> Option<[f64; 2]> {
        let scale = self.band.scale_on_axis();
        let mut place = ideal_mm.map(|mm| mm / scale);
        for _ in 0..STEPS {
            let (found, _) = self.at(place);
            let step = [0, 1].map(|i| (ideal_mm[i] - found[i]) / scale);
            place = [0, 1].map(|i| place[i] + step[i]);
            if real::hypot(step[0], step[1]) < ACCURACY_MM {
                return Some(place);
            }
        }
        None
    }

    /// Half the sides (X, Y) of the largest rectangle about the axis that the tables cover, mm; of a lens with rotational symmetry of that about the
    /// circle of its reach.
    pub fn half_sides_mm(&self) -> [f64; 2] {
        match &self.band.planar {
            None => [self.band.reach_mm(); 2],
            Some(planar) => {
                [&planar.map.x_mm, &planar.map.y_mm].map(|at| (-at[0]).min(at[at.len() - 1]).max(0.0))
            }
        }
    }

    /// Whether the tables cover a film place.
    pub fn covers(&self, [x, y]: [f64; 2]) -> bool {
        let within = |at: &[f64], mm: f64| (at[0]..=at[at.len() - 1]).contains(&mm);
        match &self.band.planar {
            None => real::hypot(x, y) <= self.band.reach_mm(),
            Some(planar) => within(&planar.map.x_mm, x) && within(&planar.map.y_mm, y),
        }
    }

    /// The kernel at a film place: side and pixels, row down, sum 1. `read`: the PSFs of a set, one after another ([`NodeGrid::psf_rows`]).
    ///
    /// # Errors
    /// Those of `read`.
    pub fn kernel<E>(
        &self,
        place_mm: [f64; 2],
        sample: PsfSample,
        mut read: impl FnMut(usize) -> Result<Vec<f32>, E>,
    ) -> Result<(usize, Vec<f32>), E> {
        let (mut size, mut sum, mut s) = (0, Vec::new(), KernelScratch::default());
        let mut kernels: Option<(usize, NodeKernels, NodeGrid)> = None;
        for (node, weight) in self.weights(place_mm) {
            let set = self.grid.psf_set(node);
            let (_, kernels, grid) = match kernels.take_if(|found| found.0 == set) {
                Some(same) => kernels.insert(same),
                None => {
                    let (of_set, grid) = self.kernels_of(node, sample, read(set)?);
                    kernels.insert((set, of_set, grid))
                }
            };
            size = kernels.size();
            sum.resize(size * size, 0.0);
            let mut kernel = vec![0.0; size * size];
            kernels.kernel(grid, self.in_set(node), &mut s, &mut kernel);
            sum.iter_mut().zip(&kernel).for_each(|(sum, v)| *sum += weight * v);
        }
        Ok((size, sum))
    }

    /// The share of all light inside the PSF windows at a film place: that of the nodes by their weights, of a node between two azimuths that of the nearer.
    pub fn energy(&self, place_mm: [f64; 2]) -> f64 {
        let energy = |node: Node| {
            let rows = self.grid.psf_rows(self.grid.psf_set(node));
            let azimuth = self.grid.azimuth_rad(node) / std::f64::consts::TAU;
            let nearest = (azimuth * rows.len() as f64).round() as usize % rows.len();
            self.band.psf_energy[rows.start + nearest]
        };
        self.weights(place_mm).iter().map(|(node, weight)| f64::from(*weight) * energy(*node)).sum()
    }

    /// The nodes of the kernel at a film place and their weights, those above 0.
    fn weights(&self, place_mm: [f64; 2]) -> Vec<(Node, f32)> {
        let mut nodes = Vec::new();
        let [dx_px, dy_px] = place_mm.map(|mm| mm / self.pitch_mm);
        let (mut r, mut theta) = ([0.0], [0.0]);
        let pixel = BlockPlace { dy_px, dx_px, rows: 1, cols: 1 };
        let extent = self.grid.coordinates(&pixel, 1, &mut r, &mut theta);
        self.grid.touching(&extent, &mut nodes);
        let weights = nodes.iter().map(|(node, weight)| (*node, weight.at(r[0], theta[0], extent.wraps)));
        weights.filter(|(_, weight)| *weight > 0.0).collect()
    }

    /// Kernels of the set of `node` alone, with the PSFs `samples`, and the grid of its nodes.
    fn kernels_of(&self, node: Node, sample: PsfSample, samples: Vec<f32>) -> (NodeKernels, NodeGrid) {
        let band = self.band;
        let n = band.psf_size;
        let (grid, samples) = match band.planar.as_ref().map(|planar| &planar.psfs) {
            Some(PsfPlaces::Cartesian { .. }) => {
                (NodeGrid::cartesian(&[0.0], &[0.0], self.pitch_mm), samples)
            }
            places => {
                let azimuth_samples = match places {
                    Some(PsfPlaces::Polar { azimuth_samples }) => azimuth_samples[node.k],
                    _ => 1,
                };
                let count = band.azimuth_count[node.k];
                // A polar grid begins on the axis: its node stands before those of the height.
                let grid = NodeGrid::polar(&[0.0, 1.0], &[1, count], &[1, azimuth_samples], self.pitch_mm);
                (grid, [&samples[..n * n], &samples].concat())
            }
        };
        let stack = PsfStack { size: n, pitch_um: band.psf_pitch_um, sample, samples };
        (NodeKernels::new(&stack, 1e3 * self.pitch_mm, None, Simd::PORTABLE), grid)
    }

    /// `node` in the grid of its set.
    fn in_set(&self, node: Node) -> Node {
        match &self.grid {
            NodeGrid::Cartesian(_) => Node { k: 0, j: 0 },
            NodeGrid::Polar(_) => Node { k: 1, j: node.j },
        }
    }
}

#[cfg(test)]
mod tests;
