//! Heights and azimuths of the PSF nodes of a built lens: those of the nominal lens, or finer ones.
//!
//! Errors of a lens hardly change how fast its PSF changes over the film, so the nodes of the nominal lens are taken where the errors at
//! the centres of a few cells, at eight azimuths in turn, are within the tolerance or little above it. Errors fall with the square of the
//! spacing: else spacing and azimuth steps are divided by the square root of the excess, and the errors are measured again.
//! The film's kernel at a cell's centre is the mean of those of its four nodes, each rotated to its azimuth.

use std::f64::consts::{PI, TAU};

use rayon::prelude::*;

use super::super::error::SkewError;
use super::functions::Functions;
use super::kernels::{View, Views};
use super::nominal::Nominal;
use crate::design::tables::difference::{Difference, ESF_SHARE};
use crate::design::tables::refine::{NodeError, round_azimuths};
use crate::design::tables::trace::{Azimuths, PsfHeights, TraceOptions};

/// Cells that are measured, and azimuths: every second one of each cell, in turn.
const CELLS: usize = 4;
const AZIMUTHS: usize = 8;
/// Largest error over the tolerance, or over the error of the nominal lens where its budget did not allow the tolerance.
const EXCESS: f64 = 1.15;
/// Times that nodes are made finer.
const ROUNDS: usize = 3;

/// Heights (mm) and azimuth counts of nodes.
#[derive(Clone, Debug)]
pub(super) struct Nodes {
    pub(super) heights: Vec<f64>,
    pub(super) azimuths: Vec<usize>,
    pub(super) error: Option<NodeError>,
}

/// The nodes of a built lens.
pub(super) fn choose(
    views: &mut Views<'_>,
    functions: &mut Functions<'_>,
    options: &TraceOptions,
    nominal: &Nominal,
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<Nodes, SkewError> {
    let chosen = &nominal.chosen;
    let mut nodes =
        Nodes { heights: chosen.heights.clone(), azimuths: chosen.azimuths.clone(), error: chosen.error };
    let Some(there) = chosen.error else { return Ok(nodes) };
    let tolerance = options.psf_tolerance;
    let allowed = (tolerance.max(there.worst), (ESF_SHARE * tolerance).max(there.edge));
    for round in 0..=ROUNDS {
        let error = measured(views, functions, &nodes, report)?;
        nodes.error = Some(error);
        let excess = error.over(allowed.0, allowed.1);
        if excess <= EXCESS {
            break;
        }
        let finer = finer(&nodes, options, excess.sqrt());
        let count: usize = finer.azimuths.iter().sum();
        let is_more = finer.heights != nodes.heights || finer.azimuths != nodes.azimuths;
        if round == ROUNDS || count > options.base_nodes() || !is_more {
            nodes.error = Some(NodeError { limited: true, ..error });
            break;
        }
        nodes = finer;
    }
    Ok(nodes)
}

/// `nodes` with spacing and azimuth steps divided by `factor`, where they are not given.
fn finer(nodes: &Nodes, options: &TraceOptions, factor: f64) -> Nodes {
    let cells = nodes.heights.len() - 1;
    let count = match options.heights {
        PsfHeights::ByError => (cells as f64 * factor).ceil() as usize,
        PsfHeights::Given(_) => cells,
    };
    let (mut heights, mut azimuths) = (Vec::with_capacity(count + 1), Vec::with_capacity(count + 1));
    for i in 0..=count {
        let at = (i * cells) as f64 / count as f64;
        let k = (at as usize).min(cells - 1);
        let mix = |a: f64, b: f64| a + (at - k as f64) * (b - a);
        let height =
            if i == count { nodes.heights[cells] } else { mix(nodes.heights[k], nodes.heights[k + 1]) };
        let between = mix(nodes.azimuths[k] as f64, nodes.azimuths[k + 1] as f64);
        heights.push(height);
        azimuths.push(match options.azimuths {
            _ if i == 0 => 1,
            Azimuths::ByError => round_azimuths(factor * between.max(nodes.azimuths[1].min(8) as f64)),
            Azimuths::Given(count) => count,
        });
    }
    Nodes { heights, azimuths, error: None }
}

/// The errors at the centres of cells over the whole field.
fn measured(
    views: &mut Views<'_>,
    functions: &mut Functions<'_>,
    nodes: &Nodes,
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<NodeError, SkewError> {
    let Nodes { heights, azimuths, .. } = nodes;
    let cells = heights.len() - 1;
    let mut measured: Vec<usize> = (0..CELLS).map(|i| 1 + i * (cells - 1) / (CELLS - 1)).collect();
    measured.dedup();
    let centre = |k: usize, azimuth: f64| View::own((0.5 * (heights[k - 1] + heights[k]), azimuth));
    // The nodes of height k on either side of the azimuth, in the frame that is turned by it.
    let sides = |k: usize, azimuth: f64| {
        let step = if k == 0 { azimuth } else { PI / azimuths[k] as f64 };
        let node = |rotation_rad: f64| View {
            place: (heights[k], (azimuth + rotation_rad).rem_euclid(TAU)),
            rotation_rad,
        };
        match k {
            0 => [View { place: (0.0, 0.0), rotation_rad: -azimuth }; 2],
            _ => [node(step), node(-step)],
        }
    };
    let cases: Vec<(usize, f64)> = measured
        .iter()
        .enumerate()
        .flat_map(|(c, k)| (c % 2..AZIMUTHS).step_by(2).map(move |i| (*k, TAU * i as f64 / AZIMUTHS as f64)))
        .collect();
    let requested: Vec<View> = cases
        .iter()
        .flat_map(|(k, azimuth)| {
            [sides(*k - 1, *azimuth), sides(*k, *azimuth)].concat().into_iter().chain([centre(*k, *azimuth)])
        })
        .collect();
    report("checking", views.fill(functions, &requested)?);
    let views = &*views;
    let errors: Vec<(Difference, f64)> = cases
        .par_iter()
        .map(|(k, azimuth)| {
            let truth = views.at(&centre(*k, *azimuth));
            let four = [sides(*k - 1, *azimuth), sides(*k, *azimuth)].concat();
            let kernels: Vec<&[f32]> = four.iter().map(|view| views.at(view)).collect();
            let mean: Vec<f32> = (0..truth.len())
                .map(|i| 0.25 * kernels.iter().map(|kernel| kernel[i]).sum::<f32>())
                .collect();
            (Difference::of(&mean, truth), centre(*k, *azimuth).place.0)
        })
        .collect();
    Ok(NodeError::of(errors, false))
}
