//! Comparison of the films with the reference lens, band by band.

use super::distortion::{self, Point, PointFilm};
use super::edge::{self, EdgeFilm, EdgeResult};
use super::edge_places::EdgePlace;
use super::error_budget::RunPsfs;
use super::illumination::{self, Illumination, UniformFilms};
use super::setup::Setup;
use anyhow::Result;

/// Results of one band.
pub struct Band {
    pub nm: f64,
    /// Side of the film kernels, px.
    pub window_px: usize,
    pub illumination: Illumination,
    /// Points without the PSF stage.
    pub points: Vec<Point>,
    /// Points with the PSF stage.
    pub psf_points: Vec<Point>,
    pub edges: Vec<EdgeResult>,
}

/// Films of all charts.
pub struct Films {
    uniform: UniformFilms,
    points: PointFilm,
    psf_points: PointFilm,
    edges: Vec<EdgeFilm>,
}

impl Films {
    /// Simulates the films.
    pub fn new(setup: &Setup, places: &[EdgePlace]) -> Result<Self> {
        Ok(Self {
            uniform: illumination::simulate(setup)?,
            points: distortion::simulate(setup, false)?,
            psf_points: distortion::simulate(setup, true)?,
            edges: edge::simulate(setup, places)?,
        })
    }
}

/// Measures one band of the films and compares it with the reference.
pub fn compare(setup: &Setup, films: &Films, band: usize) -> Result<Band> {
    let nm = setup.wavelengths_nm[band];
    let reference = setup.reference.band(nm)?;
    let run = RunPsfs::new(setup, band)?;
    let edge = |film| edge::compare(setup, &reference, &run, band, film);
    Ok(Band {
        nm,
        window_px: setup.windows_px[band],
        illumination: illumination::compare(setup, &reference, band, &films.uniform)?,
        points: distortion::compare(setup, &reference, band, &films.points)?,
        psf_points: distortion::compare(setup, &reference, band, &films.psf_points)?,
        edges: films.edges.iter().map(edge).collect::<Result<_>>()?,
    })
}
