//! Ghost paths and the surfaces that their light crosses.

use super::apertures::Apertures;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::shape::Shape;
use crate::design::prescription::system::System;
use crate::design::rays::ideal_lens::IdealLens;
use crate::design::rays::ray::Tracer;

/// A path of two reflections: at surface `first`, then at `second` before it; indices from 0, the film is the last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct GhostPath {
    /// The surface of the first reflection.
    pub first: usize,
    /// The surface of the second reflection, before the first one.
    pub second: usize,
}

/// What a surface does to the light of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Act {
    /// Refracts.
    Refracts,
    /// Reflects a share: one of the two reflections of a ghost.
    Reflects,
    /// A mirror.
    Mirrors,
    /// An ideal thin lens.
    Ideal,
}

/// A surface on a path, as its light meets it.
#[derive(Clone, Debug)]
pub struct Crossing<'a> {
    /// Index of the surface.
    pub surface: usize,
    /// What it does.
    pub act: Act,
    /// Whether the light runs against the order of the surfaces.
    pub is_backward: bool,
    /// Its shape seen along the light.
    pub(super) shape: &'a Shape,
    /// Distance along the light to the next surface of the path, mm.
    pub(super) gap_mm: f64,
    /// The medium in which the light arrives, and the one on the other side, by the surface before which they lie.
    pub(super) media: (usize, usize),
    /// Indices of these media.
    pub(super) indices: (f64, f64),
    /// Whether light is bent there, so that it cannot arrive from behind.
    pub(super) is_boundary: bool,
    pub(super) ideal: Option<IdealLens>,
    pub(super) ideal_focal_mm: Option<f64>,
}

/// A lens at one wavelength, for ghosts.
#[derive(Debug)]
pub struct GhostLens<'a> {
    pub(super) tracer: Tracer<'a>,
    pub(super) system: &'a System,
    pub(super) indices: Vec<f64>,
    pub(super) apertures: Apertures,
    reversed: Vec<Shape>,
}

impl<'a> GhostLens<'a> {
    /// The lens at `um`, with the apertures that clip its ghosts.
    ///
    /// # Errors
    /// A wavelength outside the range of a glass; no first-order properties.
    pub fn new(system: &'a System, um: f64, apertures: &Apertures) -> Result<Self, DesignError> {
        let tracer = Tracer::new(system, um)?;
        let mut indices = vec![1.0];
        for s in &system.surfaces {
            indices.push(s.medium.index(um)?);
        }
        let reversed = system.surfaces.iter().map(|s| s.shape.reversed()).collect();
        Ok(Self { tracer, system, indices, apertures: apertures.clone(), reversed })
    }

    /// Wavelength, µm.
    pub fn wavelength_um(&self) -> f64 {
        self.tracer.wavelength_um
    }

    /// The lens.
    pub fn system(&self) -> &'a System {
        self.system
    }

    /// The tracer of the image's rays.
    pub fn tracer(&self) -> &Tracer<'a> {
        &self.tracer
    }

    /// The surfaces along `path`, or along the image's way (`None`), the film included.
    pub fn crossings(&self, path: Option<GhostPath>) -> Vec<Crossing<'_>> {
        let film = self.system.image();
        let Some(GhostPath { first, second }) = path else {
            return (0..=film).map(|k| self.crossing(k, false, false)).collect();
        };
        let forward = (0..first).map(|k| self.crossing(k, false, false));
        let turn = std::iter::once(self.crossing(first, false, true));
        let back = (second + 1..first).rev().map(|k| self.crossing(k, true, false));
        let again = std::iter::once(self.crossing(second, true, true));
        let rest = (second + 1..=film).map(|k| self.crossing(k, false, false));
        forward.chain(turn).chain(back).chain(again).chain(rest).collect()
    }

    fn crossing(&self, k: usize, is_backward: bool, reflects: bool) -> Crossing<'_> {
        let s = &self.system.surfaces[k];
        let media = if is_backward { (k + 1, k) } else { (k, k + 1) };
        let act = match () {
            () if reflects => Act::Reflects,
            () if s.is_mirror => Act::Mirrors,
            () if s.ideal_focal_mm.is_some() => Act::Ideal,
            () => Act::Refracts,
        };
        let is_film = k == self.system.image();
        // Light that leaves backwards crosses the gap before the surface next.
        let leaves_backward = is_backward != reflects;
        let gap_mm = match leaves_backward {
            true => k.checked_sub(1).map_or(0.0, |before| self.system.surfaces[before].thickness_mm),
            false => s.thickness_mm,
        };
        Crossing {
            surface: k,
            act,
            is_backward,
            shape: if is_backward { &self.reversed[k] } else { &s.shape },
            gap_mm,
            media,
            indices: (self.indices[media.0], self.indices[media.1]),
            is_boundary: is_film || act != Act::Refracts || self.system.is_boundary(k).0,
            ideal_focal_mm: s.ideal_focal_mm,
            ideal: s.ideal_focal_mm.map(IdealLens::without_path),
        }
    }
}

/// The ghost paths of `system`, and how many are left out since a mirror lies between their reflections. The film is a reflecting surface if
/// `film_reflects`; surfaces without a coating (ideal ones) are none.
pub fn ghost_paths(system: &System, film_reflects: bool) -> (Vec<GhostPath>, usize) {
    let film = system.image();
    let reflects = |k: &usize| system.is_boundary(*k).0 && system.surfaces[*k].coating.is_some();
    let mut there: Vec<usize> = (0..film).filter(reflects).collect();
    if film_reflects {
        there.push(film);
    }
    let mirror_between = |i: usize, j: usize| system.surfaces[j..i].iter().any(|s| s.is_mirror);
    let all = there.iter().flat_map(|i| there.iter().take_while(move |j| *j < i).map(move |j| (*i, *j)));
    let (split, kept): (Vec<_>, Vec<_>) = all.partition(|(i, j)| mirror_between(*i, *j));
    let paths = kept.into_iter().map(|(first, second)| GhostPath { first, second }).collect();
    (paths, split.len())
}
