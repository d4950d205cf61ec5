//! Light on a surface: sun, sky, a map of all directions ([`environment`]), lights of the file, with shadows.
//!
//! ```text
//! w_l = Σ_sources (E_i/E_v)·max(0, n·l_i)·vis_i  +  1/M Σ_m (E_sky/E_v + π L_env(d_m)/E_v)·vis_m
//! ```
//! multiplied by a reflectance, w is a weight of [`super::weights`]. E_i: illuminance on a plane perpendicular to the rays, lx; of a point of I cd at r metres
//! I/r². E_v: illuminance of the scene, lx. E_sky: illuminance below an open sky of constant luminance E_sky/π in all directions; L_env: luminance of a map,
//! cd/m² of white. n: normal of the triangle on the side of the camera, n_g, or the interpolated one, n_s; light below the triangle (n_g·l ≤ 0) does not count.
//! d_m: M fixed directions of density cos/π about n, the same at every place: an error shows as bands, not as noise. Of the places where the samples of a pixel hit
//! a triangle, n of them, each has a share of the directions: hit i those with m modulo n = i, n times their light, so that a pixel has all of them once.
//! vis: 0 if a triangle blocks the ray from the place, moved by 10⁻⁶ of its distance along n_g, to the source ([`shadow`]).
//! Left out: light that a surface reflects onto another; the size of the sun. Sources of range and cone: `KHR_lights_punctual` of glTF 2.0.

mod directions;
pub mod environment;
mod request;
pub mod shadow;

pub use directions::cosine_directions;
pub use request::{LightError, LightRequest, Sun};

use super::vector::{dot, scaled};
use super::weights::LightSpectrum;
use directions::tangents;
use environment::Environment;

/// Where light falls.
#[derive(Clone, Copy, Debug)]
pub struct Site {
    /// Start of rays to the sources, camera frame, m.
    pub start: [f64; 3],
    /// Unit normal of the triangle, on the side of the camera.
    pub geometric: [f64; 3],
    /// Unit normal that determines cosines, on the same side.
    pub shading: [f64; 3],
}

/// A ray to a source.
#[derive(Clone, Copy, Debug)]
pub struct ShadowRay {
    /// Its start, camera frame, m.
    pub start: [f64; 3],
    /// Its direction, of any length.
    pub direction: [f64; 3],
    /// Where it ends, in lengths of the direction; infinite for a distant source.
    pub end: f64,
}

/// A source without size.
#[derive(Clone, Debug)]
enum Source {
    /// Parallel light.
    Distant { to_source: [f64; 3], relative: f64 },
    /// A point: cd/E_v, range in m, cone.
    Near { place: [f64; 3], relative: f64, range_m: Option<f64>, cone: Option<Cone> },
}

/// Attenuation of a spot: (cos·scale + offset)², limited to 0…1.
#[derive(Clone, Copy, Debug)]
struct Cone {
    axis: [f64; 3],
    scale: f64,
    offset: f64,
}

/// All light of a scene.
pub struct Lighting {
    illuminance_lx: f64,
    /// The first is that of the illuminant.
    spectra: Vec<LightSpectrum>,
    /// Each with the number of its spectrum.
    sources: Vec<(Source, usize)>,
    /// E_sky/E_v.
    sky: f64,
    /// The light around, and the numbers of the spectra of its red, green and blue.
    environment: Option<(Environment, [usize; 3])>,
    directions: Vec<[f64; 3]>,
    is_even: bool,
}

impl Lighting {
    /// The illuminant alone, the same everywhere and without shading or shadows; a white surface then has the luminance `illuminance_lx`/π.
    pub fn even(illuminance_lx: f64) -> Self {
        Self {
            illuminance_lx,
            spectra: vec![LightSpectrum::Illuminant],
            sources: Vec::new(),
            sky: 0.0,
            environment: None,
            directions: Vec::new(),
            is_even: true,
        }
    }

    /// Whether there is no shading.
    pub fn is_even(&self) -> bool {
        self.is_even
    }

    /// Spectra of the light: at first the illuminant.
    pub fn spectra(&self) -> &[LightSpectrum] {
        &self.spectra
    }

    /// Weight of a luminance of 1 cd/m² in the basis of the illuminant: π/E_v.
    pub fn weight_of_luminance(&self) -> f64 {
        std::f64::consts::PI / self.illuminance_lx
    }

    /// The light around, if there is a map of it.
    pub fn environment(&self) -> Option<&Environment> {
        self.environment.as_ref().map(|(map, _)| map)
    }

    /// Rays to sources from one place.
    pub fn rays_per_site(&self) -> usize {
        self.sources.len() + self.directions.len()
    }

    /// Adds w_l of a place to `sums`, one per spectrum; `hit` and `hits`: its number among the places of a triangle in a pixel, and how many these are.
    pub fn add(
        &self,
        site: &Site,
        (hit, hits): (usize, usize),
        mut is_blocked: impl FnMut(&ShadowRay) -> bool,
        sums: &mut [f64],
    ) {
        if self.is_even {
            sums[0] += 1.0;
            return;
        }
        for (source, spectrum) in &self.sources {
            let (direction, to_source, relative, end) = match source {
                Source::Distant { to_source, relative } => (*to_source, *to_source, *relative, f64::INFINITY),
                Source::Near { place, relative, range_m, cone } => {
                    let direction: [f64; 3] = std::array::from_fn(|k| place[k] - site.start[k]);
                    let squared = dot(direction, direction);
                    if squared == 0.0 {
                        continue;
                    }
                    let to_source = scaled(direction, 1.0 / squared.sqrt());
                    let limit = range_m.map_or(1.0, |range| {
                        let share = squared / (range * range);
                        (1.0 - share * share).max(0.0)
                    });
                    let of_cone = cone.map_or(1.0, |c| {
                        let share = (c.offset - c.scale * dot(c.axis, to_source)).clamp(0.0, 1.0);
                        share * share
                    });
                    (direction, to_source, relative / squared * limit * of_cone, 1.0)
                }
            };
            let cosine = dot(site.shading, to_source);
            if cosine > 0.0 && relative > 0.0 && dot(site.geometric, to_source) > 0.0 {
                let ray = ShadowRay { start: site.start, direction, end };
                if !is_blocked(&ray) {
                    sums[*spectrum] += relative * cosine;
                }
            }
        }
        if !self.directions.is_empty() {
            self.add_sky(site, (hit, hits), is_blocked, sums);
        }
    }

    fn add_sky(
        &self,
        site: &Site,
        (hit, hits): (usize, usize),
        mut is_blocked: impl FnMut(&ShadowRay) -> bool,
        sums: &mut [f64],
    ) {
        let [t, b] = tangents(site.shading);
        let of_direction = hits as f64 / self.directions.len() as f64;
        let mut open = 0usize;
        for d in self.directions.iter().skip(hit).step_by(hits) {
            let direction: [f64; 3] =
                std::array::from_fn(|k| d[0] * t[k] + d[1] * b[k] + d[2] * site.shading[k]);
            let ray = ShadowRay { start: site.start, direction, end: f64::INFINITY };
            if dot(site.geometric, direction) <= 0.0 || is_blocked(&ray) {
                continue;
            }
            open += 1;
            if let Some((map, spectra)) = &self.environment {
                let unit = self.weight_of_luminance() * of_direction;
                let light = map.mean_luminance(direction);
                spectra.iter().zip(light).for_each(|(s, luminance)| sums[*s] += luminance * unit);
            }
        }
        sums[0] += self.sky * (open as f64 * of_direction);
    }
}

#[cfg(test)]
mod tests;
