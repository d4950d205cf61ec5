//! A raw as what is restored: for each colour plane of its mosaic the film values that its electrons stand for, and the weights of its pixels by the noise of its sensor.
//!
//! ```text
//! electrons   n = (DN − black)/(gK) − dark charge            of frame t, exposure T
//! film value  y = n/(K_c r_c)      K_c = T s Σ_b w_cb        electrons of a film of 1 in every band; s: film scale, r_c: response over angle
//! shares      a_b = Σ_c w_cb/K_c over the filters c of the plane, normalised to 1 in all: y = Σ_b a_b film_b
//! weight      σ²/var(y)            var of a pixel of the mean charge of its neighbours behind the plane's filters (EMVA 1288, [`pipeline::sensor`]); 0 where it is saturated
//! ```
//! The chart of a plane is the one of which, the same in all bands, the film has these values. Left out: crosstalk, diffusion and apertures smaller than a pixel, which blur by a fraction of
//! a pixel and remain; the resampling of a film whose pixels are not a whole fraction of the sensor's.

use super::planes::{Grid, Pixels, Plane};
use crate::args::RestoreArgs;
use crate::camera::frame::Frame;
use crate::camera::shading::response_map;
use crate::failure::usage;
use crate::progress::log_line;
use anyhow::Result;
use formats::film::FilmStore;
use pipeline::geometry::Rect;
use pipeline::restore::mosaic::Samples;
use pipeline::sensor::response_map::ResponseMap;
use serde_json::Value;

/// Bands with less than this share of a plane's electrons are left out.
const LEAST_SHARE: f64 = 1e-3;
/// Standard deviations below saturation from which a pixel is not measured.
const BELOW_SATURATION: f64 = 3.0;

/// A frame and its colour planes.
pub struct RawPlanes {
    frame: Frame,
    /// Electrons of a film value of 1 behind each filter.
    electrons: Vec<f64>,
    /// Number of the plane of each filter; none: it collects nothing of the film.
    plane_of: Vec<Option<usize>>,
    /// Dark charge, e-.
    dark_e: f64,
    /// Charge from which a pixel is not measured, e-.
    limit_e: f64,
    /// Response over the angle of incidence.
    response: Option<ResponseMap>,
}

impl RawPlanes {
    /// The frame of `args` of the raw `given`, made of `film`: its grid, and its planes by wavelength.
    ///
    /// # Errors
    /// A raw that is damaged or not complete; usage: one of another film, of regions, without light.
    pub fn open(
        args: &RestoreArgs,
        given: &str,
        film: &FilmStore,
        cache: usize,
    ) -> Result<(Self, Grid, Vec<Plane>)> {
        if args.noise.is_some() {
            return Err(usage(format!(
                "--noise is for films; the noise of the raw {given} is that of its sensor"
            )));
        }
        let frame = Frame::open(given, args.frame, cache)?;
        check_film(&frame, given, film)?;
        if frame.rect != frame.spec.sensor.rect() {
            return Err(usage(format!(
                "raw {given} is a region, whose surroundings are not known: expected a complete frame, made without --roi"
            )));
        }
        let sensor = &frame.sensor;
        if sensor.crosstalk.is_some() {
            log_line("note: the sensor's crosstalk is not undone: it remains as blur");
        }
        let bands = film_bands(&frame, film)?;
        let factors: Vec<f64> = numbers(&frame.attributes["film"]["factors"]);
        let scale = frame.attributes.get("film_scale").and_then(Value::as_f64).unwrap_or(1.0);
        let wavelengths_nm = frame.wavelengths_nm();
        let per_unit = scale * frame.exposure_s() * sensor.area_m2();
        let of_filter = |c: usize| -> Vec<f64> {
            let weights = sensor.band_weights(c, &wavelengths_nm);
            weights.iter().zip(&factors).map(|(w, factor)| w * factor * per_unit).collect()
        };
        // Electrons of a film value of 1, by filter and band.
        let per_band: Vec<Vec<f64>> = (0..sensor.channels.len()).map(of_filter).collect();
        let electrons: Vec<f64> = per_band.iter().map(|bands| bands.iter().sum()).collect();
        let dark_e = frame.dark_e();
        let dark_variance_e2 = frame.sigma_e(dark_e).powi(2);
        let names = sensor.planes();
        let mut planes: Vec<(usize, Plane)> = Vec::new();
        let plane_of = sensor.plane_of_channels();
        for (number, name) in names.iter().enumerate() {
            let filters: Vec<usize> =
                (0..plane_of.len()).filter(|c| plane_of[*c] == number && electrons[*c] > 0.0).collect();
            if filters.is_empty() {
                continue;
            }
            let share = |b: usize| -> f64 {
                filters.iter().map(|c| per_band[*c][b] / electrons[*c]).sum::<f64>() / filters.len() as f64
            };
            let shares: Vec<(usize, f64)> =
                (0..bands.len()).map(|b| (b, share(b))).filter(|(_, share)| *share >= LEAST_SHARE).collect();
            let all: f64 = shares.iter().map(|(_, share)| share).sum();
            let wavelength = |(b, share): &(usize, f64)| wavelengths_nm[*b] * share / all;
            let cells = &sensor.pattern.channels;
            let measured = cells.iter().filter(|c| filters.contains(c)).count();
            let of_plane = filters.iter().map(|c| electrons[*c]).sum::<f64>() / filters.len() as f64;
            planes.push((
                number,
                Plane {
                    name: Some((*name).to_owned()).filter(|_| names.len() > 1),
                    wavelength_nm: tenths(shares.iter().map(wavelength).sum()),
                    bands: shares.iter().map(|(b, share)| (bands[*b], share / all)).collect(),
                    density: measured as f64 / cells.len() as f64,
                    background: dark_variance_e2 / of_plane,
                },
            ));
        }
        if planes.is_empty() {
            return Err(usage(format!("raw {given}: its sensor collects no light of the film's bands")));
        }
        planes.sort_by(|a, b| a.1.wavelength_nm.total_cmp(&b.1.wavelength_nm));
        let position = |number: usize| planes.iter().position(|(n, _)| *n == number);
        let own = |c: usize| position(plane_of[c]).filter(|_| electrons[c] > 0.0);
        let saturation_e = sensor.saturation_e(frame.gain);
        let knee_e = sensor.pixel.overflow.knee * sensor.pixel.full_well_e;
        let limit_e = saturation_e.min(knee_e);
        let grid = Grid {
            size: frame.spec.sensor,
            pitch_um: frame.spec.pitch_um,
            axis_px: (
                axis_px(frame.spec.sensor.height, frame.spec.centre_mm.0, frame.spec.pitch_um),
                axis_px(frame.spec.sensor.width, frame.spec.centre_mm.1, frame.spec.pitch_um),
            ),
        };
        let own_planes = (0..plane_of.len()).map(own).collect();
        let planes = planes.into_iter().map(|(_, plane)| plane).collect();
        let raw = Self {
            limit_e: limit_e - BELOW_SATURATION * frame.sigma_e(limit_e),
            response: response_map(&frame)?,
            plane_of: own_planes,
            electrons,
            dark_e,
            frame,
        };
        Ok((raw, grid, planes))
    }

    /// Number of the frame.
    pub fn frame(&self) -> usize {
        self.frame.number()
    }

    /// The digest of its job.
    pub fn job_digest(&self) -> &str {
        self.frame.job_digest()
    }

    /// σ of a film value of `mean` of a plane, of the filters together.
    pub fn sigma(&self, plane: usize, mean: f64) -> f64 {
        let filters = (0..self.electrons.len()).filter(|c| self.plane_of[*c] == Some(plane));
        let of = |c: usize| self.sigma_e(mean * self.electrons[c]) / self.electrons[c];
        let (sum, count) = filters.fold((0.0, 0), |(sum, n), c| (sum + of(c).powi(2), n + 1));
        (sum / f64::from(count)).sqrt()
    }

    /// σ of a pixel with `light_e` electrons of light.
    fn sigma_e(&self, light_e: f64) -> f64 {
        self.frame.sigma_e(light_e.max(0.0) + self.dark_e)
    }

    /// The pixels of `rect` of a plane; `noise`: σ of the weights.
    ///
    /// # Errors
    /// A damaged shard.
    pub fn read(&self, plane: usize, rect: Rect, noise: f64) -> Result<Pixels> {
        let (frame, sensor) = (&self.frame, &self.frame.sensor);
        let pattern = &sensor.pattern;
        let period = pattern.rows.max(pattern.columns);
        // A mean charge: over two periods to each side.
        let reach = 2 * period;
        let read = rect.grown(reach).intersect(frame.rect);
        let dn_per_e = frame.gain * sensor.adc.gain_dn_per_e;
        let numbers = frame.read(read)?;
        let (mut are_of_filter, mut are_measured) = (Vec::new(), Vec::new());
        let (mut values, mut per_value) = (Vec::new(), Vec::new());
        for (i, dn) in numbers.iter().enumerate() {
            let (y, x) = (read.y as usize + i / read.width, read.x as usize + i % read.width);
            let filter = pattern.channel(y, x);
            let response = self.response.as_ref().map_or(1.0, |map| map.at(filter, (y as f32, x as f32)));
            let electrons = self.electrons[filter] * f64::from(response);
            let is_of_plane = self.plane_of[filter] == Some(plane) && electrons > 0.0;
            let charge_e = (f64::from(*dn) - sensor.adc.black_dn) / dn_per_e;
            are_of_filter.push(is_of_plane);
            are_measured.push(is_of_plane && charge_e < self.limit_e);
            values.push(if is_of_plane { ((charge_e - self.dark_e) / electrons) as f32 } else { 0.0 });
            per_value.push(electrons);
        }
        let samples = |are_of_filter| Samples { values: &values, are_of_filter, rect: read };
        let mut between = samples(&are_measured).means(rect, period - 1);
        if between.iter().any(|v| v.is_nan()) {
            // In the middle of saturated pixels: what they have.
            let all = samples(&are_of_filter).means(rect, period - 1);
            between.iter_mut().zip(all).filter(|(v, _)| v.is_nan()).for_each(|(v, all)| *v = all);
        }
        let means = samples(&are_measured).means(rect, reach);
        let mut weights = Vec::with_capacity(between.len());
        for (i, (value, mean)) in between.iter_mut().zip(means).enumerate() {
            let (y, x) =
                ((i / rect.width) as i64 + rect.y - read.y, (i % rect.width) as i64 + rect.x - read.x);
            let at = y as usize * read.width + x as usize;
            if !are_measured[at] {
                weights.push(0.0);
                continue;
            }
            *value = values[at];
            let sigma = self.sigma_e(f64::from(mean) * per_value[at]) / per_value[at];
            weights.push((noise / sigma).powi(2) as f32);
        }
        Ok(Pixels { values: between, weights: Some(weights) })
    }
}

fn tenths(nm: f64) -> f64 {
    (10.0 * nm).round() / 10.0
}

/// The optical axis on a row or column of `n` pixels whose middle is at `centre_mm`.
fn axis_px(n: usize, centre_mm: f64, pitch_um: f64) -> f64 {
    (n as f64 - 1.0) / 2.0 - centre_mm * 1e3 / pitch_um
}

/// Fails unless the raw is of `film`.
fn check_film(frame: &Frame, given: &str, film: &FilmStore) -> Result<()> {
    let found = &frame.attributes["film"]["identity"]["job_digest"];
    let expected = film.provenance().get("job_digest").cloned().unwrap_or_default();
    if found.is_null() || *found != expected {
        return Err(usage(format!(
            "raw {given} was not made of film {}: it records the job {found}, the film's is {expected}; give --film the film that `lenscube sensor` read",
            film.path().display()
        )));
    }
    Ok(())
}

/// The film's bands of the raw's, which ascend in wavelength.
fn film_bands(frame: &Frame, film: &FilmStore) -> Result<Vec<usize>> {
    let of_film = &film.spec().wavelengths_nm;
    let found: Option<Vec<usize>> =
        frame.wavelengths_nm().iter().map(|nm| of_film.iter().position(|band| band == nm)).collect();
    found.filter(|bands| bands.len() == of_film.len()).ok_or_else(|| {
        usage(format!(
            "the raw records wavelengths of film bands that film {} has not: it is damaged, or the film of another one",
            film.path().display()
        ))
    })
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
}
