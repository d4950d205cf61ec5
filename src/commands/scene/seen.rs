//! A coarse picture of the scene, before it is made: whether anything is seen, how near, and whether the camera stands inside something. Surfaces count as
//! opaque.

use super::chart_frame::frame;
use super::scratch::no_renderer;
use crate::args::SceneArgs;
use crate::failure::usage;
use anyhow::Result;
use pipeline::design::pinhole::Pinhole;
use pipeline::scene::description::Part;
use pipeline::scene::mesh::Mesh;
use pipeline::scene::shading::{SampleHit, Shader};
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
    /// Vergence of the nearest surface, 1/m; 0 without any.
    pub nearest_vergence: f64,
}

/// Surfaces without light.
pub struct Unlit;

impl Shader for Unlit {
    fn bases(&self) -> usize {
        0
    }

    fn is_opaque(&self, _: u32) -> bool {
        true
    }

    fn exists(&self, _: u32, _: &SampleHit, _: usize) -> bool {
        true
    }

    fn add_weights(&self, _: u32, _: &[SampleHit], _: &mut [f64]) {}
}

impl Seen {
    /// Makes the picture of `mesh`, of the parts `parts`, in the field of view of `pinhole`; `near_m`: what is too near or cut away.
    ///
    /// # Errors
    /// Nothing is seen; what is seen is too near.
    pub fn new(
        args: &SceneArgs,
        mesh: &Mesh,
        parts: &[Part],
        pinhole: &Pinhole,
        near_m: f64,
    ) -> Result<Self> {
        let step = (pinhole.size.height.max(pinhole.size.width) as f64 / SIDE_PX as f64).max(1.0);
        let frame = frame(args, pinhole, step)?;
        let settings = Settings {
            samples: 1,
            sheets: 1,
            gap_dioptre: 0.0,
            near_m,
            is_near_cut: args.view.near_m.is_some(),
            background: None,
        };
        let renderer = Renderer::new(mesh, frame, &Unlit, settings, Engine::detect()).map_err(no_renderer)?;
        let (mut worker, mut counts, mut covered) = (renderer.worker(), Counts::default(), 0);
        for tile in 0..renderer.grid().tiles() {
            let front = renderer.front(tile, &mut worker);
            counts.add(&front.counts);
            covered += front.sheet.pixels;
        }
        let name = args.mesh.display();
        if covered == 0 {
            return Err(usage(format!(
                "{name}: nothing is before the camera in the field of view of {:.1} x {:.1} deg; nearest and farthest corner are at {:.4} and {:.4} m along \
                 its axis: check --camera, or --eye, --target, --mesh-unit and --near-m",
                pinhole.fov_deg(pinhole.size.width),
                pinhole.fov_deg(pinhole.size.height),
                mesh.facts().nearest_m,
                mesh.facts().farthest_m,
            )));
        }
        let near = counts.near_samples as f64 / counts.samples.max(1) as f64;
        if let (true, None, Some((vergence, triangle))) =
            (near > NEAR_SHARE, args.view.near_m, counts.nearest)
        {
            let part = &parts[mesh.part_of(triangle).0].name;
            return Err(usage(format!(
                "{name}: `{part}` is {:.4} m from the camera, and {:.1} % of the picture is nearer than {near_m:.4} m, ten focal lengths: move the camera if it \
                 stands inside or at it; else give --near-m, from which on surfaces are kept",
                1.0 / vergence,
                100.0 * near,
            )));
        }
        Ok(Self {
            covered: covered as f64 / counts.samples.max(1) as f64,
            nearest_vergence: counts.nearest.map_or(0.0, |(vergence, _)| vergence),
        })
    }
}
