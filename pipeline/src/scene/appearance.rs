//! What surfaces show: materials in the light of the scene, as weights of the bases.
//!
//! ```text
//! reflectance of a colour    baseColorFactor × texture × vertex colour, each of red, green and blue limited to 0…1
//! of a named spectrum        1, or the luminance of the texture
//! weight (r, l)              Σ_hits reflectance_r·w_l(hit) + emission_r·π/E_v for the illuminant
//! alpha                      factor × texture × vertex colour
//!   MASK                     a surface is where alpha ≥ cutoff
//!   BLEND                    of the samples i of N where alpha > (i + ½)/N + 0.6180339887498949·m modulo 1, m the material's number
//! ```
//! Colours are those of the mean place of the samples that hit a triangle in a pixel: the samples share a texture lookup; a triangle is convex, so that
//! the place lies in it. Light, alpha and normals are those of each sample. Left out: all that a surface does but reflect evenly in all directions and emit.

mod place;
mod request;

pub use request::{AppearanceError, AppearanceRequest, Assigned, Background, materials_named};

use super::description::{AlphaMode, Part, TextureUse};
use super::frame::Frame;
use super::light::environment::Environment;
use super::light::shadow::{Occluders, Triangles};
use super::light::{Lighting, ShadowRay, Site};
use super::shading::{SampleHit, Shader};
use super::texture::Pyramid;
use super::vector::{cross, dot, scaled, unit};
use super::weights::{Basis, COLOURS};
use place::{Owner, Place, is_in_range};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Offset of the start of shadow rays, of the distance from the camera.
const SHADOW_OFFSET: f64 = 1e-6;
/// Shift of the thresholds of alpha from one material to the next: the golden ratio's fraction, so that none of a few materials agree.
const THRESHOLD_SHIFT: f64 = 0.618_033_988_749_894_9;
/// What a material reflects.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Reflects {
    /// Its colour.
    Colour,
    /// This reflectance, 3 or more.
    Spectrum(usize),
    /// The same, times the luminance of the texture.
    SpectrumTimesTexture(usize),
}

/// A material in double precision.
struct Surface {
    colour: [f64; 3],
    alpha: f64,
    texture: Option<TextureUse>,
    alpha_mode: AlphaMode,
    emission: [f64; 3],
    emission_texture: Option<TextureUse>,
    reflects: Reflects,
}

/// Surfaces of a scene in its light.
pub struct Appearance<'a, T> {
    triangles: &'a T,
    parts: &'a [Part],
    /// Of each part: from its normals to directions in the camera frame, of any length and sign.
    normal_matrices: Vec<[[f64; 3]; 3]>,
    surfaces: Vec<Surface>,
    textures: Vec<Pyramid>,
    lighting: Lighting,
    occluders: Option<Occluders>,
    background: Background,
    frame: Frame,
    bases: Vec<Basis>,
    /// Number of reflectances.
    reflectances: usize,
    notes: Vec<String>,
    clipped: AtomicU64,
}

impl<T: Triangles> Appearance<'_, T> {
    /// The bases of the weights.
    pub fn list_of_bases(&self) -> &[Basis] {
        &self.bases
    }

    /// What is not as the file describes it, one sentence each, without a full stop.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Colours of triangles in pixels so far of which a component was limited to 0…1.
    pub fn clipped(&self) -> u64 {
        self.clipped.load(Relaxed)
    }

    /// Bytes of textures, of the map of the light around and of the hierarchy for shadows.
    pub fn bytes(&self) -> usize {
        let textures: usize = self.textures.iter().map(Pyramid::bytes).sum();
        let map = self.lighting.environment().map_or(0, Environment::bytes);
        textures + map + self.occluders.as_ref().map_or(0, Occluders::bytes)
    }

    /// The map of the light around, if there is one.
    pub fn environment(&self) -> Option<&Environment> {
        self.lighting.environment()
    }

    /// Whether there is a surface behind all triangles.
    pub fn has_background(&self) -> bool {
        self.background != Background::None
    }

    /// Adds the weights of the background, where they are the same in all directions, to `sums`, one per basis.
    pub fn add_background(&self, sums: &mut [f64]) {
        let unit = self.lighting.weight_of_luminance();
        match self.background {
            Background::None | Background::Environment => {}
            Background::Luminance(cd_per_m2) => {
                sums[..COLOURS].iter_mut().for_each(|w| *w += unit * cd_per_m2)
            }
        }
    }

    /// The light on each hit, summed over the hits: one number per spectrum of the light.
    fn light(&self, triangle: u32, owner: &Owner<'_>, hits: &[SampleHit]) -> Vec<f64> {
        let mut sums = vec![0.0; self.lighting.spectra().len()];
        let corners = self.triangles.corners(triangle);
        let along = |k: usize| std::array::from_fn(|c| corners[k][c] - corners[0][c]);
        let Some(normal) = unit(cross(along(1), along(2))) else { return sums };
        for (number, hit) in hits.iter().enumerate() {
            let away = (normal[0] * hit.x + normal[1] * hit.y) + normal[2] > 0.0;
            let geometric = if away { scaled(normal, -1.0) } else { normal };
            let point = [hit.x, hit.y, 1.0].map(|v| v / hit.vergence);
            let offset = SHADOW_OFFSET * dot(point, point).sqrt();
            let start = std::array::from_fn(|k| point[k] + geometric[k] * offset);
            let shading = self.shading_normal(owner, hit, geometric);
            let site = Site { start, geometric, shading };
            self.lighting.add(&site, (number, hits.len()), |ray| self.is_blocked(ray), &mut sums);
        }
        sums
    }

    /// The interpolated normal on the side of `geometric`, or that where the part has none.
    fn shading_normal(&self, owner: &Owner<'_>, hit: &SampleHit, geometric: [f64; 3]) -> [f64; 3] {
        let normals = &owner.part.geometry.normals;
        if normals.is_empty() {
            return geometric;
        }
        let corners = owner.vertices().map(|v| normals[v]);
        let mean =
            std::array::from_fn(|c| (0..3).map(|k| hit.barycentric[k] * f64::from(corners[k][c])).sum());
        match unit(self.normal_matrices[owner.number].map(|row| dot(row, mean))) {
            Some(n) if dot(n, geometric) < 0.0 => scaled(n, -1.0),
            Some(n) => n,
            None => geometric,
        }
    }

    fn is_blocked(&self, ray: &ShadowRay) -> bool {
        let exists = |triangle, barycentric| {
            let owner = self.owner(triangle);
            match owner.surface.alpha_mode {
                AlphaMode::Mask(cutoff) => {
                    let place = Place::at_point(&owner, barycentric);
                    self.alpha(&place) >= f64::from(cutoff)
                }
                _ => true,
            }
        };
        self.occluders.as_ref().is_some_and(|o| o.is_blocked(self.triangles, ray, exists))
    }
}

impl<T: Triangles> Shader for Appearance<'_, T> {
    fn bases(&self) -> usize {
        self.bases.len()
    }

    fn is_opaque(&self, triangle: u32) -> bool {
        self.owner(triangle).surface.alpha_mode == AlphaMode::Opaque
    }

    fn exists(&self, triangle: u32, hit: &SampleHit, samples: usize) -> bool {
        let owner = self.owner(triangle);
        let alpha = || self.alpha(&self.place(&owner, triangle, hit.x, hit.y));
        match owner.surface.alpha_mode {
            AlphaMode::Opaque => true,
            AlphaMode::Mask(cutoff) => alpha() >= f64::from(cutoff),
            AlphaMode::Blend => alpha() > blend_threshold(hit.sample, samples, owner.part.material),
        }
    }

    fn even_weights(&self, triangle: u32, weights: &mut [f64]) -> bool {
        let owner = self.owner(triangle);
        let surface = owner.surface;
        // Limited colours are counted.
        let is_limited = surface.reflects == Reflects::Colour && !is_in_range(&surface.colour);
        let is_dark = surface.emission == [0.0; 3];
        if !self.lighting.is_even() || owner.varies() || !is_dark || is_limited {
            return false;
        }
        let place = Place::at_point(&owner, [1.0 / 3.0; 3]);
        let (first, values) = self.reflectance(&place);
        let count = if first == 0 { COLOURS } else { 1 };
        weights[first..][..count].copy_from_slice(&values[..count]);
        true
    }

    fn add_background_at(&self, x: f64, y: f64, sums: &mut [f64]) {
        let map = self.lighting.environment().filter(|_| self.background == Background::Environment);
        if let Some(map) = map {
            let unit = self.lighting.weight_of_luminance();
            let light = map.luminance([x, y, 1.0]);
            sums.iter_mut().zip(light).for_each(|(sum, luminance)| *sum += unit * luminance);
        }
    }

    fn add_weights(&self, triangle: u32, hits: &[SampleHit], sums: &mut [f64]) {
        if hits.is_empty() {
            return;
        }
        let owner = self.owner(triangle);
        let surface = owner.surface;
        let count = hits.len() as f64;
        let mean = |of: fn(&SampleHit) -> f64| hits.iter().map(of).sum::<f64>() / count;
        let place = match owner.varies() {
            true => self.place(&owner, triangle, mean(|h| h.x), mean(|h| h.y)),
            false => Place::at_point(&owner, hits[0].barycentric),
        };
        let (first, values) = self.reflectance(&place);
        let mut add = |spectrum: usize, light: f64| {
            let from = spectrum * self.reflectances + first;
            let weights = sums[from..].iter_mut().zip(values);
            weights.take(if first == 0 { COLOURS } else { 1 }).for_each(|(w, v)| *w += v * light);
        };
        match self.lighting.is_even() {
            true => add(0, count),
            false => {
                self.light(triangle, &owner, hits)
                    .into_iter()
                    .enumerate()
                    .for_each(|(l, light)| add(l, light));
            }
        }
        if surface.emission != [0.0; 3] {
            let texel = surface.emission_texture.as_ref().map_or([1.0; 4], |t| self.texel(t, &place));
            let unit = self.lighting.weight_of_luminance() * count;
            for (c, weight) in sums[..COLOURS].iter_mut().enumerate() {
                *weight += surface.emission[c] * texel[c] * unit;
            }
        }
    }
}

/// The alpha up to which sample `sample` of `samples` has no surface of a blended material.
fn blend_threshold(sample: u32, samples: usize, material: usize) -> f64 {
    ((f64::from(sample) + 0.5) / samples as f64 + material as f64 * THRESHOLD_SHIFT) % 1.0
}

#[cfg(test)]
mod tests;
