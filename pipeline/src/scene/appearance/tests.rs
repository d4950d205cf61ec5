//! Weights of pixels of small meshes against closed forms.

mod illumination;
mod spectra;
mod textures;

use super::*;
use crate::scene::description::{Geometry, Material, Texture, Wrap};
use crate::scene::horizon::{Horizon, UpAxis};
use crate::scene::light::{LightRequest, Sun};
use crate::scene::test_mesh::{POSE, TestMesh, material, quad, wall};
use crate::scene::weights::Spectrum;

/// 1 mrad a pixel.
const FRAME: Frame = Frame::centred(100, 100, 0.001, 1.0);

fn request<'a>(
    mesh: &'a TestMesh,
    materials: &'a [Material],
    lighting: Lighting,
) -> AppearanceRequest<'a, TestMesh> {
    AppearanceRequest {
        triangles: mesh,
        parts: &mesh.parts,
        materials,
        textures: Vec::new(),
        assigned: &[],
        pose: POSE,
        frame: FRAME,
        lighting,
        background: Background::None,
    }
}

fn appearance<'a>(
    mesh: &'a TestMesh,
    materials: &'a [Material],
    lighting: Lighting,
) -> Appearance<'a, TestMesh> {
    Appearance::new(request(mesh, materials, lighting)).unwrap()
}

fn light(sun: Option<Sun>, sky_lx: Option<f64>) -> LightRequest<'static> {
    LightRequest {
        illuminance_lx: 1000.0,
        sun,
        sky_lx,
        lights: &[],
        unit_m: 1.0,
        environment: None,
        sky_samples: 64,
    }
}

fn lighting(request: LightRequest<'_>) -> Lighting {
    Lighting::new(request, &POSE, &Horizon::new(&POSE, UpAxis::Y)).unwrap()
}

/// The nearest hit of a ray: the triangle and the place on it.
fn hit(mesh: &TestMesh, sample: u32, x: f64, y: f64) -> Option<(u32, SampleHit)> {
    let of = |triangle| {
        let v = mesh.corners(triangle);
        let edges = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| {
            let n = cross(v[i], v[j]);
            (n[0] * x + n[1] * y) + n[2]
        });
        let n = cross(std::array::from_fn(|k| v[1][k] - v[0][k]), std::array::from_fn(|k| v[2][k] - v[0][k]));
        let vergence = dot(n, [x, y, 1.0]) / dot(n, v[0]);
        let is_hit = (edges.iter().all(|e| *e >= 0.0) || edges.iter().all(|e| *e <= 0.0)) && vergence > 0.0;
        let sum: f64 = edges.iter().sum();
        is_hit.then(|| (triangle, SampleHit { sample, x, y, vergence, barycentric: edges.map(|e| e / sum) }))
    };
    (0..mesh.triangles()).filter_map(of).reduce(|a, b| if b.1.vergence > a.1.vergence { b } else { a })
}

fn weights(appearance: &Appearance<'_, TestMesh>, triangle: u32, hits: &[SampleHit]) -> Vec<f64> {
    let mut sums = vec![0.0; appearance.bases()];
    appearance.add_weights(triangle, hits, &mut sums);
    sums
}

/// The weights of one ray.
fn seen(appearance: &Appearance<'_, TestMesh>, mesh: &TestMesh, x: f64, y: f64) -> Vec<f64> {
    let (triangle, hit) = hit(mesh, 0, x, y).unwrap();
    weights(appearance, triangle, &[hit])
}

fn picture(width: usize, height: usize, texel: impl Fn(usize, usize) -> [u8; 4]) -> Pyramid {
    let texels = (0..width * height).map(|i| texel(i % width, i / width)).collect();
    Pyramid::new(Texture { name: "picture".into(), width, height, texels }).unwrap()
}

fn textured(mut material: Material) -> Material {
    let transform = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let wrap = [Wrap::Repeat; 2];
    material.texture = Some(TextureUse { texture: 0, set: 0, wrap, nearest: true, transform });
    material
}
