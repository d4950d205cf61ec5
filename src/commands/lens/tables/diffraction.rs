//! Tables from PSFs with diffraction: MTF, encircled energy.

use super::request::{Request, number, places, tracers};
use super::table::Table;
use crate::args::TableName;
use crate::failure::usage;
use crate::job::lens::samples::LensData;
use anyhow::Result;
use pipeline::bounds::DEFOCUS_MM;
use pipeline::design::System;
use pipeline::design::field_psf::field_psf;
use pipeline::design::ray::Tracer;
use pipeline::design::system::ImagePlane;
use pipeline::figures::{Direction, PsfWindow, polychromatic_mtf};
use rayon::prelude::*;
use serde_json::Value;

const BOTH: [Direction; 2] = [Direction::Tangential, Direction::Sagittal];
/// Film positions of the MTF through focus.
const POSITIONS: i32 = 11;
/// Radii of the encircled energy, µm.
const RADII_UM: [f64; 14] = [0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 50.0, 100.0];
/// Shares of the light whose radii are given.
const SHARES: [f64; 3] = [0.5, 0.8, 0.9];

/// MTF or encircled energy of a design by wavelength and height.
pub fn monochromatic(name: TableName, system: &System, request: &Request<'_>) -> Result<Table> {
    let tracers = tracers(system, request)?;
    let rows: Vec<Vec<Vec<Value>>> = places(&tracers, request)
        .into_par_iter()
        .filter_map(|(nm, mm, tracer, tan)| Some(rows(name, nm, mm, &field_psf(tracer, tan).ok()?, request)))
        .collect();
    Ok(Table::new(name, columns(name), rows.concat()))
}

/// MTF or encircled energy of a pack.
pub fn of_pack(name: TableName, lens: &LensData, request: &Request<'_>) -> Result<Table> {
    let samples = lens.sample(request.nm, request.heights_mm)?;
    let of_band = |(nm, fields): (&f64, &Vec<crate::job::lens::samples::Field>)| {
        fields.iter().flat_map(|f| rows(name, *nm, f.height_mm, &f.psf, request)).collect::<Vec<_>>()
    };
    let all = request.nm.iter().zip(&samples.fields).flat_map(of_band).collect();
    Ok(Table::new(name, columns(name), all))
}

fn columns(name: TableName) -> &'static [&'static str] {
    match name {
        TableName::EncircledEnergy => &["wavelength_nm", "image_height_mm", "radius_um", "encircled_energy"],
        _ => &[
            "wavelength_nm",
            "image_height_mm",
            "frequency_lp_mm",
            "tangential",
            "sagittal",
            "light_in_window",
        ],
    }
}

fn rows(name: TableName, nm: f64, mm: f64, psf: &PsfWindow, request: &Request<'_>) -> Vec<Vec<Value>> {
    if name == TableName::EncircledEnergy {
        let radii = request.args.radii_um.as_deref().unwrap_or(&RADII_UM);
        let curve = psf.encircled();
        let known = radii.iter().filter_map(|r| Some((*r, curve.within(*r)?)));
        let by_share = SHARES.iter().filter_map(|share| Some((curve.radius_um(*share)?, *share)));
        let mut all: Vec<(f64, f64)> = known.chain(by_share).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        return all.into_iter().map(|(r, e)| [nm, mm, r, e].map(number).to_vec()).collect();
    }
    let row = |lp: &f64| {
        let [t, s] = BOTH.map(|d| psf.mtf(*lp, d));
        [nm, mm, *lp, t, s, psf.energy].map(number).to_vec()
    };
    request.args.lp_mm.iter().map(row).collect()
}

/// PSFs of all weighted wavelengths at one field point.
struct Polychromatic {
    /// Weight, height of the chief ray in mm, PSF.
    psfs: Vec<(f64, f64, PsfWindow)>,
    primary: usize,
}

impl Polychromatic {
    fn new(system: &System, tan: f64) -> Option<Self> {
        let used: Vec<usize> = (0..system.wavelengths_um.len())
            .filter(|i| system.wavelengths_um[*i].1 > 0.0 || *i == system.primary)
            .collect();
        let psf = |i: &usize| {
            let (um, weight) = system.wavelengths_um[*i];
            let tracer = Tracer::new(system, um).ok()?;
            Some((weight, tracer.chief_height_mm(tan).ok()?, field_psf(&tracer, tan).ok()?))
        };
        let psfs = used.par_iter().map(psf).collect::<Option<Vec<_>>>()?;
        Some(Self { psfs, primary: used.iter().position(|i| *i == system.primary)? })
    }

    /// Of all wavelengths by weight.
    fn mtf(&self, lp_mm: f64) -> [f64; 2] {
        let origin = self.psfs[self.primary].1;
        let all: Vec<_> = self.psfs.iter().map(|(w, mm, psf)| (*w, 1e3 * (mm - origin), psf)).collect();
        BOTH.map(|d| polychromatic_mtf(&all, lp_mm, d))
    }

    /// Of the primary wavelength.
    fn primary_mtf(&self, lp_mm: f64) -> [f64; 2] {
        BOTH.map(|d| self.psfs[self.primary].2.mtf(lp_mm, d))
    }
}

/// MTF of all wavelengths of the design by weight.
pub fn polychromatic(name: TableName, system: &System, request: &Request<'_>) -> Result<Table> {
    let primary = Tracer::new(system, system.primary_um())?;
    let mut all = Vec::new();
    for mm in request.heights_mm {
        let Some(psfs) = primary.field_of_height(*mm).ok().and_then(|tan| Polychromatic::new(system, tan))
        else {
            continue;
        };
        let row = |lp: &f64| {
            let [t, s] = psfs.mtf(*lp);
            [*mm, *lp, t, s].map(number).to_vec()
        };
        all.extend(request.args.lp_mm.iter().map(row));
    }
    Ok(Table::new(name, &["image_height_mm", "frequency_lp_mm", "tangential", "sagittal"], all))
}

/// MTF at the middle frequency against the position of the film, field points fixed.
pub fn through_focus(name: TableName, system: &System, request: &Request<'_>) -> Result<Table> {
    let primary = Tracer::new(system, system.primary_um())?;
    let lp_mm = request.args.lp_mm[request.args.lp_mm.len() / 2];
    let positions = match &request.args.focus_mm {
        Some(text) => positions(text)?,
        None => {
            // As in the figure: to twice the defocus whose geometrical blur has the diameter of a period.
            let range_mm = 2.0 * primary.primary.working_f_number() / lp_mm;
            let step = |k: i32| range_mm * (2.0 * f64::from(k) / f64::from(POSITIONS - 1) - 1.0);
            (0..POSITIONS).map(step).collect()
        }
    };
    let mut jobs = Vec::new();
    for z in positions {
        let moved = system.with_image_plane(ImagePlane::AsDesigned, z)?;
        jobs.extend(request.heights_mm.iter().map(|mm| (z, *mm, moved.clone())));
    }
    let one = |(z, mm, moved): (f64, f64, System)| {
        let psfs = Polychromatic::new(&moved, primary.field_of_height(mm).ok()?)?;
        let values = [&[z, mm, lp_mm][..], &psfs.primary_mtf(lp_mm), &psfs.mtf(lp_mm)].concat();
        Some(values.into_iter().map(number).collect())
    };
    let columns = [
        "film_position_mm",
        "image_height_mm",
        "frequency_lp_mm",
        "tangential",
        "sagittal",
        "tangential_polychromatic",
        "sagittal_polychromatic",
    ];
    Ok(Table::new(name, &columns, jobs.into_par_iter().filter_map(one).collect()))
}

/// Film positions `FIRST:LAST:STEP` or a list, mm.
fn positions(text: &str) -> Result<Vec<f64>> {
    let bad = |why: String| usage(format!("--focus-mm {text}: {why}"));
    let number = |t: &str| {
        let v = t.trim().parse::<f64>().ok().filter(|v| DEFOCUS_MM.contains(*v));
        v.ok_or_else(|| {
            bad(format!("`{t}` is not a position from {} to {} mm", DEFOCUS_MM.min, DEFOCUS_MM.max))
        })
    };
    let parts: Vec<&str> = text.split(':').collect();
    let [first, last, step] = parts[..] else { return text.split(',').map(number).collect() };
    let (first, last, step) = (number(first)?, number(last)?, number(step)?);
    if !(step > 0.0 && last > first && (last - first) / step <= 1000.0) {
        return Err(bad("expected FIRST:LAST:STEP with at most 1000 steps".into()));
    }
    Ok((0..=((last - first) / step + 1e-9) as usize).map(|i| first + i as f64 * step).collect())
}

#[cfg(test)]
mod tests {
    use super::positions;

    #[test]
    fn film_positions_are_ranges_or_lists() {
        assert_eq!(positions("-0.1:0.1:0.1").unwrap(), [-0.1, 0.0, 0.1]);
        assert_eq!(positions("0.2,-1").unwrap(), [0.2, -1.0]);
        for text in ["", "a", "0:1:0", "1:0:0.1", "0:1e4:1", "inf", "1e300", "0:1e300:1e299"] {
            let error = positions(text).unwrap_err().to_string();
            assert!(error.contains("--focus-mm"), "{error}");
        }
    }
}
