//! Numbers of the objects that are seen first (`--ids`): of a pixel the node of its nearest surface, which the first sheet shows; of surfaces at one distance that of
//! the first triangle.

use formats::scene::object_bits;
use pipeline::scene::description::Part;
use pipeline::scene::mesh::Mesh;
use pipeline::scene::sheets::{Renderer, Worker};

/// The objects of a mesh.
pub struct Objects<'a> {
    /// Its triangles.
    pub mesh: &'a Mesh,
    /// Its parts.
    pub parts: &'a [Part],
}

impl Objects<'_> {
    /// The number of each pixel of a tile, as the float of its bits.
    pub fn of_tile(&self, renderer: &Renderer<'_>, tile: usize, worker: &mut Worker) -> Vec<f32> {
        let (top, left, height, width) = renderer.grid().rect(tile);
        let mut nearest: Vec<Option<(f64, u32)>> = vec![None; height * width];
        renderer.surfaces(tile, worker, |row, column, _, surfaces| {
            let pixel = &mut nearest[(row - top) * width + column - left];
            let Some(&(vergence, triangle)) = surfaces.first() else { return };
            let is_nearer = pixel.is_none_or(|(v, t)| vergence > v || (vergence == v && triangle < t));
            if is_nearer {
                *pixel = Some((vergence, triangle));
            }
        });
        let node = |triangle: u32| self.parts[self.mesh.part_of(triangle).0].node;
        nearest.into_iter().map(|found| object_bits(found.map(|(_, triangle)| node(triangle)))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::scene::seen::Unlit;
    use pipeline::scene::description::{Geometry, Material, Positions};
    use pipeline::scene::frame::Frame;
    use pipeline::scene::mesh::MeshOptions;
    use pipeline::scene::pose::Pose;
    use pipeline::scene::sheets::Settings;
    use pipeline::scene::visibility::Engine;
    use std::sync::Arc;

    /// A rectangle from `left` to `right` at distance `z` before the camera.
    fn part(node: u32, z: f64, left: f64, right: f64) -> Part {
        let positions = vec![[left, -9.0, -z], [right, -9.0, -z], [right, 9.0, -z], [left, 9.0, -z]];
        let geometry = Geometry {
            positions: Positions::F64(positions.into()),
            triangles: vec![[0, 1, 2], [0, 2, 3]].into(),
            ..Geometry::default()
        };
        let unit = |i: usize| std::array::from_fn(|k| if i == k { 1.0 } else { 0.0 });
        Part {
            name: String::new(),
            node,
            to_world: std::array::from_fn(unit),
            geometry: Arc::new(geometry),
            material: 0,
        }
    }

    /// A wall from the axis to the right behind a strip, of nodes 7 and 2: to the left of the axis nothing is seen.
    #[test]
    fn each_pixel_has_the_node_of_its_nearest_surface() {
        let parts = [part(7, 2.0, 0.0, 9.0), part(2, 1.0, 0.5, 0.75)];
        let material = Material::matt(String::new(), [0.5; 3]);
        let pose =
            Pose { eye: [0.0; 3], right: [1.0, 0.0, 0.0], down: [0.0, -1.0, 0.0], forward: [0.0, 0.0, -1.0] };
        let options = MeshOptions { unit_m: 1.0, solids: true, two_sided: false };
        let mesh = Mesh::new(&parts, &[material], &pose, options).unwrap();
        // 16 x 4 px of 1 mm at 8 mm: column c is at x/z = (c − 7.5)/8.
        let frame = Frame::centred(4, 16, 1.0, 8.0);
        let settings = Settings {
            samples: 4,
            sheets: 2,
            gap_dioptre: 0.01,
            near_m: 0.0,
            is_near_cut: false,
            background: None,
        };
        let renderer = Renderer::new(&mesh, frame, &Unlit, settings, Engine::detect()).unwrap();
        let found = Objects { mesh: &mesh, parts: &parts }.of_tile(&renderer, 0, &mut renderer.worker());
        let numbers: Vec<u32> = found[16..32].iter().map(|v| v.to_bits()).collect();
        // The strip covers x/z from 0.5 to 0.75, the columns 12 and 13.
        assert_eq!(numbers, [0, 0, 0, 0, 0, 0, 0, 0, 8, 8, 8, 8, 3, 3, 8, 8]);
    }
}
