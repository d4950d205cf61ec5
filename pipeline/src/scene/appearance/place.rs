//! Colours and alpha of a place on a triangle.

use super::{Appearance, Reflects, Surface};
use crate::scene::description::{Part, TextureUse};
use crate::scene::light::shadow::Triangles;
use crate::scene::texture::{Footprint, Projection, level_of};
use crate::scene::vector::dot;
use crate::scene::weights::COLOURS;
use std::sync::atomic::Ordering::Relaxed;

/// A component that is outside 0…1 by less is not counted as clipped: rounding of colours in f32 and of their interpolation.
const CLIPPED: f64 = 1e-6;
/// Luminance of linear red, green and blue of sRGB.
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Whether no component of a colour is limited to 0…1.
pub(super) fn is_in_range(colour: &[f64; COLOURS]) -> bool {
    colour.iter().all(|c| (-CLIPPED..=1.0 + CLIPPED).contains(c))
}

/// What a triangle belongs to.
pub(super) struct Owner<'a> {
    pub part: &'a Part,
    /// Number of the part.
    pub number: usize,
    pub surface: &'a Surface,
    /// Number in the part's geometry.
    triangle: usize,
}

/// A place on a triangle.
pub(super) struct Place<'a> {
    pub owner: &'a Owner<'a>,
    pub footprint: Footprint,
    /// The direction (x, y, 1) in which it is seen; none where its surroundings are not looked at.
    direction: Option<(f64, f64)>,
}

impl<'a> Place<'a> {
    /// One whose surroundings are not looked at.
    pub fn at_point(owner: &'a Owner<'a>, barycentric: [f64; 3]) -> Self {
        Self { owner, footprint: Footprint::at_point(barycentric), direction: None }
    }
}

impl Owner<'_> {
    pub fn vertices(&self) -> [usize; 3] {
        self.part.geometry.triangles[self.triangle].map(|v| v as usize)
    }

    /// Whether colours depend on the place.
    pub fn varies(&self) -> bool {
        let is_textured = self.surface.texture.is_some() || self.surface.emission_texture.is_some();
        is_textured || !self.part.geometry.colours.is_empty()
    }
}

impl<T: Triangles> Appearance<'_, T> {
    pub(super) fn owner(&self, triangle: u32) -> Owner<'_> {
        let (number, triangle) = self.triangles.part_of(triangle);
        let part = &self.parts[number];
        Owner { part, number, surface: &self.surfaces[part.material], triangle }
    }

    /// The place on `triangle` that direction (x, y, 1) meets.
    pub(super) fn place<'p>(&self, owner: &'p Owner<'p>, triangle: u32, x: f64, y: f64) -> Place<'p> {
        let footprint = Projection::new(&self.triangles.corners(triangle)).at(x, y);
        Place { owner, footprint, direction: Some((x, y)) }
    }

    /// Linear red, green, blue and alpha of a texture; 1 where the part has no coordinates for it.
    pub(super) fn texel(&self, texture: &TextureUse, place: &Place<'_>) -> [f64; 4] {
        let sets = &place.owner.part.geometry.texcoords;
        let Some(set) = sets.get(texture.set).filter(|set| !set.is_empty()) else {
            return [1.0; 4];
        };
        let corners = place.owner.vertices().map(|v| {
            let [u, v] = set[v].map(f64::from);
            texture.transform.map(|row| (row[0] * u + row[1] * v) + row[2])
        });
        let pyramid = &self.textures[texture.texture];
        let steps = place.direction.map_or([[0.0; 2]; 2], |(x, y)| self.frame.steps(x, y));
        let level = level_of(place.footprint.slopes(&corners), pyramid.size(0), steps);
        pyramid.sample(place.footprint.value(&corners), level, texture.wrap, texture.nearest)
    }

    /// Factor, texture and colour of the vertices.
    pub(super) fn alpha(&self, place: &Place<'_>) -> f64 {
        let surface = place.owner.surface;
        let texture = surface.texture.as_ref().map_or(1.0, |t| self.texel(t, place)[3]);
        surface.alpha * texture * vertex_colour(place).map_or(1.0, |c| c[3])
    }

    /// The number of the first reflectance, and values of it and, of a colour, the next two.
    pub(super) fn reflectance(&self, place: &Place<'_>) -> (usize, [f64; COLOURS]) {
        let surface = place.owner.surface;
        let texel = || surface.texture.as_ref().map(|t| self.texel(t, place));
        match surface.reflects {
            Reflects::Spectrum(r) => (r, [1.0, 0.0, 0.0]),
            Reflects::SpectrumTimesTexture(r) => {
                let texel = texel().unwrap_or([1.0; 4]);
                (r, [dot(LUMINANCE, [texel[0], texel[1], texel[2]]), 0.0, 0.0])
            }
            Reflects::Colour => {
                let mut colour = surface.colour;
                for factor in [texel(), vertex_colour(place)].into_iter().flatten() {
                    colour.iter_mut().zip(factor).for_each(|(c, f)| *c *= f);
                }
                if !is_in_range(&colour) {
                    self.clipped.fetch_add(1, Relaxed);
                }
                (0, colour.map(|c| c.clamp(0.0, 1.0)))
            }
        }
    }
}

/// The interpolated colour of the vertices.
fn vertex_colour(place: &Place<'_>) -> Option<[f64; 4]> {
    let colours = &place.owner.part.geometry.colours;
    let corners = || place.owner.vertices().map(|v| colours[v].map(f64::from));
    (!colours.is_empty()).then(|| place.footprint.value(&corners()))
}
