//! A coarse picture of the scene, before it is made: whether anything is seen, and whether the camera stands inside something.

use super::prepared::Prepared;
use crate::args::SceneArgs;
use crate::failure::usage;
use anyhow::Result;
use pipeline::scene::appearance::Appearance;
use pipeline::scene::frame::Frame;
use pipeline::scene::mesh::Mesh;
use pipeline::scene::sheets::{Counts, Renderer, Settings};
use pipeline::scene::visibility::Engine;

/// Pixels of the coarse picture's longer side.
const SIDE_PX: usize = 256;
/// Share of the samples that may see a surface that is too near.
const NEAR_SHARE: f64 = 0.01;

/// What the coarse picture shows.
pub struct Seen {
    /// Share of the pixels in which there is a surface.
    pub covered: f64,
}

impl Seen {
    /// Makes the picture.
    ///
    /// # Errors
    /// Nothing is seen; what is seen is too near.
    pub fn new(args: &SceneArgs, prepared: &Prepared, appearance: &Appearance<'_, Mesh>) -> Result<Self> {
        let Frame { height, width, pitch_mm, focal_mm, .. } = prepared.frame;
        let step = (height.max(width) as f64 / SIDE_PX as f64).max(1.0);
        let side = |n: usize| ((n as f64 / step) as usize).max(1);
        let frame = Frame::centred(side(height), side(width), pitch_mm * step, focal_mm);
        let settings = Settings {
            samples: 1,
            sheets: 1,
            gap_dioptre: 0.0,
            near_m: prepared.near_m,
            is_near_cut: args.view.near_m.is_some(),
            background: None,
        };
        let renderer = Renderer::new(&prepared.mesh, frame, appearance, settings, Engine::detect())
            .map_err(|e| usage(e.to_string()))?;
        let (mut worker, mut counts, mut covered) = (renderer.worker(), Counts::default(), 0);
        for tile in 0..renderer.grid().tiles() {
            let front = renderer.front(tile, &mut worker);
            counts.add(&front.counts);
            covered += front.sheet.pixels;
        }
        let mesh = args.mesh.display();
        if covered == 0 && !appearance.has_background() {
            return Err(usage(format!(
                "{mesh}: nothing is before the camera in the field of view of {:.1} x {:.1} deg; nearest and farthest corner are at {:.4} and {:.4} m along \
                 its axis: check --camera, or --eye, --target and --mesh-unit",
                prepared.pinhole.fov_deg(prepared.pinhole.size.width),
                prepared.pinhole.fov_deg(prepared.pinhole.size.height),
                prepared.mesh.facts().nearest_m,
                prepared.mesh.facts().farthest_m,
            )));
        }
        let near = counts.near_samples as f64 / counts.samples.max(1) as f64;
        if let (true, None, Some((vergence, triangle))) =
            (near > NEAR_SHARE, args.view.near_m, counts.nearest)
        {
            let part = &prepared.scene.parts[prepared.mesh.part_of(triangle).0];
            return Err(usage(format!(
                "{mesh}: the camera is inside or at `{}`: {:.1} % of the picture is nearer than {:.4} m, ten focal lengths, the nearest surface at {:.4} m; move the \
                 camera, or cut what is nearer away by --near-m",
                part.name,
                100.0 * near,
                prepared.near_m,
                1.0 / vergence
            )));
        }
        Ok(Self { covered: covered as f64 / counts.samples.max(1) as f64 })
    }
}
