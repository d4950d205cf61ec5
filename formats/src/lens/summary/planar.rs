//! Summary of a lens without rotational symmetry: maps and places of the PSFs of its bands, and the errors drawn.
//!
//! The boresight is the film place whose ideal point is the centre, by one step of Newton's rule from the nearest node of the map, and may lie beyond the
//! map.

use super::{LensBand, nyquist_pitch_um};
use crate::lens::attributes::{PackAttributes, ReferencePoint};
use pipeline::lens::Lens;
use pipeline::lens::planar::{PlanarMap, PsfPlaces};
use serde::Serialize;
use serde_json::Value;
use std::fmt;

/// Summary of a lens without rotational symmetry.
#[derive(Clone, Debug, Serialize)]
pub struct PlanarSummary {
    /// The point that the map gives: "chief ray", "centroid" or "as given".
    pub reference_point: Option<&'static str>,
    /// The errors drawn, as the pack has them.
    pub errors: Option<Value>,
    /// What compensates them, as the pack has it.
    pub compensators: Option<Value>,
    /// The listed bands.
    pub table: Vec<PlanarBandSummary>,
}

/// Summary of one band of a lens without rotational symmetry.
#[derive(Clone, Debug, Serialize)]
pub struct PlanarBandSummary {
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// First and last X of the map on the film, mm.
    pub map_x_mm: [f64; 2],
    /// First and last Y (down) of the map on the film, mm.
    pub map_y_mm: [f64; 2],
    /// Columns and rows of the map's nodes.
    pub map_nodes: [usize; 2],
    /// Film place whose ideal point is the centre, X and Y (down), µm.
    pub boresight_um: [f64; 2],
    /// Largest distance of (film point − ideal point) from the boresight, µm.
    pub largest_shift_um: f64,
    /// Least and largest relative illumination.
    pub illumination: [f64; 2],
    /// Number of PSFs.
    pub psfs: usize,
    /// Places of the PSFs.
    pub psf_field: PsfFieldSummary,
    /// Side of the PSF window, samples.
    pub psf_size: usize,
    /// Side of the PSF window, µm.
    pub psf_window_um: f64,
    /// Sample pitch, µm.
    pub psf_pitch_um: f64,
    /// λ·N/2, µm.
    pub nyquist_pitch_um: f64,
    /// Least and largest share of the energy inside the window.
    pub energy: [f64; 2],
}

/// Places of the PSFs of a band.
#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PsfFieldSummary {
    /// At heights and azimuths.
    Polar {
        /// Number of heights.
        heights: usize,
        /// Real height of the last PSF, mm.
        last_psf_height_mm: f64,
        /// Least and largest number of azimuths with PSFs off axis, A_k.
        psf_azimuths: [usize; 2],
        /// Least and largest number of azimuths of the nodes off axis, J_k.
        azimuths: [usize; 2],
        /// Number of nodes of the PSF field.
        nodes: usize,
    },
    /// At columns and rows of the film.
    Grid {
        /// Columns and rows.
        nodes: [usize; 2],
        /// First and last X, mm.
        x_mm: [f64; 2],
        /// First and last Y (down), mm.
        y_mm: [f64; 2],
    },
}

/// Summary of the bands `listed` of a lens without rotational symmetry.
pub(super) fn summary<'a>(
    listed: impl Iterator<Item = &'a LensBand>,
    lens: &Lens,
    attributes: &PackAttributes,
) -> PlanarSummary {
    PlanarSummary {
        reference_point: attributes.reference_point.map(ReferencePoint::name),
        errors: attributes.errors.clone(),
        compensators: attributes.compensators.clone(),
        table: listed.filter_map(|band| band_summary(band, lens.f_number)).collect(),
    }
}

fn band_summary(band: &LensBand, f_number: f64) -> Option<PlanarBandSummary> {
    let planar = band.planar.as_ref()?;
    let map = &planar.map;
    let (boresight_um, largest_shift_um) = shifts_um(map);
    Some(PlanarBandSummary {
        wavelength_nm: band.wavelength_nm,
        map_x_mm: ends(&map.x_mm)?,
        map_y_mm: ends(&map.y_mm)?,
        map_nodes: [map.x_mm.len(), map.y_mm.len()],
        boresight_um,
        largest_shift_um,
        illumination: range(map.relative_illumination.iter().copied()),
        psfs: planar.psfs.count(),
        psf_field: match &planar.psfs {
            PsfPlaces::Polar { azimuth_samples } => PsfFieldSummary::Polar {
                heights: band.psf_height_mm.len(),
                last_psf_height_mm: *band.psf_height_mm.last()?,
                psf_azimuths: off_axis(azimuth_samples),
                azimuths: off_axis(&band.azimuth_count),
                nodes: band.azimuth_count.iter().sum(),
            },
            PsfPlaces::Cartesian { x_mm, y_mm } => PsfFieldSummary::Grid {
                nodes: [x_mm.len(), y_mm.len()],
                x_mm: ends(x_mm)?,
                y_mm: ends(y_mm)?,
            },
        },
        psf_size: band.psf_size,
        psf_window_um: band.psf_size as f64 * band.psf_pitch_um,
        psf_pitch_um: band.psf_pitch_um,
        nyquist_pitch_um: nyquist_pitch_um(band, f_number),
        energy: range(band.psf_energy.iter().copied()),
    })
}

/// The film place whose ideal point is the centre, and the largest distance of (film − ideal) of the nodes from it, µm.
fn shifts_um(map: &PlanarMap) -> ([f64; 2], f64) {
    let columns = map.x_mm.len();
    let ideal = |i: usize| [map.ideal_x_mm[i], map.ideal_y_mm[i]];
    let film = |i: usize| [map.x_mm[i % columns], map.y_mm[i / columns]];
    let nodes = 0..map.ideal_x_mm.len();
    let distance = |i: usize| ideal(i)[0].hypot(ideal(i)[1]);
    let nearest = nodes.clone().min_by(|a, b| distance(*a).total_cmp(&distance(*b))).unwrap_or(0);
    // The change of the ideal point per mm of film along a direction, from the neighbours of the node.
    let slope = |at: usize, count: usize, stride: usize| {
        let (before, after) = (at.min(1), (count - 1 - at).min(1));
        let (a, b) = (nearest - before * stride, nearest + after * stride);
        let mm = (film(b)[0] - film(a)[0]) + (film(b)[1] - film(a)[1]);
        [0, 1].map(|axis| (ideal(b)[axis] - ideal(a)[axis]) / mm)
    };
    let [xx, yx] = slope(nearest % columns, columns, 1);
    let [xy, yy] = slope(nearest / columns, map.y_mm.len(), columns);
    let ([x, y], [film_x, film_y], det) = (ideal(nearest), film(nearest), xx * yy - xy * yx);
    let boresight = [film_x - (yy * x - xy * y) / det, film_y - (xx * y - yx * x) / det];
    let beyond = nodes.map(|i| {
        let [dx, dy] = [0, 1].map(|axis| film(i)[axis] - ideal(i)[axis] - boresight[axis]);
        dx.hypot(dy)
    });
    (boresight.map(|mm| 1e3 * mm), 1e3 * beyond.fold(0.0, f64::max))
}

fn ends(table: &[f64]) -> Option<[f64; 2]> {
    Some([*table.first()?, *table.last()?])
}

fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, largest], v| [least.min(v), largest.max(v)])
}

/// Least and largest count off the axis.
fn off_axis(counts: &[usize]) -> [usize; 2] {
    let off_axis = || counts.iter().skip(1).copied();
    [off_axis().min().unwrap_or(1), off_axis().max().unwrap_or(1)]
}

impl PlanarSummary {
    /// Lines on the lens as a whole.
    pub(super) fn write_head(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "symmetry       none: maps over the film")?;
        match self.reference_point {
            Some(point) => writeln!(f, "; reference point: {point}")?,
            None => writeln!(f)?,
        }
        if let Some(errors) = &self.errors {
            writeln!(f, "errors         {}", drawn(errors))?;
        }
        if let Some(compensators) = &self.compensators {
            writeln!(f, "compensators   {}", list(compensators))?;
        }
        Ok(())
    }

    /// The listed bands, two lines each.
    pub(super) fn write_table(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for b in &self.table {
            let ([x0, x1], [y0, y1], [columns, rows]) = (b.map_x_mm, b.map_y_mm, b.map_nodes);
            let ([left, down], [least, largest]) = (b.boresight_um, b.illumination);
            writeln!(
                f,
                "{:7.2} nm     map ({x0:.3}, {y0:.3}) to ({x1:.3}, {y1:.3}) mm, {columns} × {rows} nodes; boresight ({left:.3}, {down:.3}) µm, beyond it up to {:.3} µm; RI {least:.5} to {largest:.5}",
                b.wavelength_nm, b.largest_shift_um
            )?;
            write!(f, "               {} PSFs ", b.psfs)?;
            match &b.psf_field {
                PsfFieldSummary::Polar { heights, last_psf_height_mm, psf_azimuths, azimuths, nodes } => {
                    write!(
                        f,
                        "(polar) at {heights} heights to {last_psf_height_mm:.3} mm and {} azimuths, for {nodes} nodes at {} azimuths",
                        dots(*psf_azimuths),
                        dots(*azimuths)
                    )?
                }
                PsfFieldSummary::Grid { nodes: [columns, rows], x_mm: [x0, x1], y_mm: [y0, y1] } => write!(
                    f,
                    "(grid) at {columns} × {rows} places from ({x0:.3}, {y0:.3}) to ({x1:.3}, {y1:.3}) mm"
                )?,
            }
            writeln!(
                f,
                "; window {} px ({:.1} µm), pitch {:.3} µm (Nyquist {:.3}), energy {:.4} to {:.4}",
                b.psf_size, b.psf_window_um, b.psf_pitch_um, b.nyquist_pitch_um, b.energy[0], b.energy[1]
            )?;
        }
        Ok(())
    }
}

fn dots([least, largest]: [usize; 2]) -> String {
    if least == largest { least.to_string() } else { format!("{least}..{largest}") }
}

/// Number of drawn values, and what else `errors` has.
fn drawn(errors: &Value) -> String {
    let Value::Object(map) = errors else { return list(errors) };
    let count =
        map.get("values").and_then(Value::as_array).map(|values| format!("{} drawn values", values.len()));
    let others =
        map.iter().filter(|(name, _)| *name != "values").map(|(name, v)| format!("{name} {}", plain(v)));
    count.into_iter().chain(others).collect::<Vec<_>>().join(", ")
}

/// Names and values of an object, or any other value.
fn list(value: &Value) -> String {
    match value {
        Value::Object(map) => {
            map.iter().map(|(name, v)| format!("{name} {}", plain(v))).collect::<Vec<_>>().join(", ")
        }
        other => plain(other),
    }
}

/// A text without its quotes, or JSON.
fn plain(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}
