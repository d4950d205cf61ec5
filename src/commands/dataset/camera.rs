//! Sensor and development of a sample, in memory: the equations of [`pipeline::sensor`] and [`pipeline::develop`].
//!
//! With the matrix `bands` the linear red, green and blue of a picture are those of the film's bands: M is the inverse of the planes' shares of the bands,
//!
//! ```text
//! R_pb = Σ_{filters c of plane p} w_cb / Σ_b Σ_c w_cb        M = R⁻¹        w: electrons of a film value of 1 in a band, in a picture of one colour
//! ```

use super::bands::Bands;
use crate::args::ExposeArgs;
use crate::camera::recipe::least_one;
use crate::commands::sensor::{Geometry, Times, of_spectrum, open_sensor, time};
use crate::failure::usage;
use crate::film::plane::FilmPlane;
use anyhow::{Context, Result, anyhow};
use formats::chart::{ArrayChart, NanPolicy};
use formats::dataset::draw::Draw;
use formats::dataset::recipe::{Matrix, Recipe, SensorTable};
use pipeline::colour::{Illuminant, inverse};
use pipeline::develop::{ColourMatrix, Demosaic, Development, PlanePattern, Recipe as Develop, Shading};
use pipeline::geometry::Size;
use pipeline::sensor::crosstalk::Corrections;
use pipeline::sensor::noise::Exposer;
use pipeline::sensor::overflow::received;
use pipeline::sensor::spread::{self, SpreadRows};
use pipeline::sensor::stream::{BandWeights, Pass};
use pipeline::sensor::{Exposure, NoiseSet, Sensor, SignalHistogram};
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

/// Developments that are kept.
const MAX_DEVELOPMENTS: usize = 32;

/// A development by sensor, gain and size of the raw.
type Known = ((usize, u64, Size), Arc<Development>);

/// The sensors of a data set, their exposures and the development.
pub struct Camera<'a> {
    recipe: &'a Recipe,
    table: &'a SensorTable,
    sensors: Vec<Sensor>,
    /// Electrons per second of film values of 1, by sensor and channel.
    weights: Vec<Vec<Vec<f64>>>,
    /// Crosstalk of each sensor that has it.
    corrections: Vec<Option<Corrections>>,
    times: Vec<Times>,
    noise: NoiseSet,
    nominal_s: f64,
    nm: Vec<f64>,
    /// The last developments.
    known: Mutex<Vec<Known>>,
}

/// A raw, and what it was taken with.
pub struct Raw {
    /// Size of the sensor.
    pub size: Size,
    /// Digital numbers.
    pub numbers: Vec<u16>,
    /// What it was taken with.
    pub exposure: Exposure,
}

impl<'a> Camera<'a> {
    /// The camera of `recipe`, if it has one.
    ///
    /// # Errors
    /// Usage: a sensor that cannot be, exposures that are none.
    pub fn new(recipe: &'a Recipe, folder: &Path, bands: &Bands) -> Result<Option<Self>> {
        let Some(table) = &recipe.sensor else { return Ok(None) };
        let nm = bands.wavelengths_nm().to_vec();
        let mut sensors = Vec::new();
        for name in &table.name.0 {
            let path = folder.join(name);
            let name = if path.exists() { path.display().to_string() } else { name.clone() };
            let sensor = open_sensor(&name, &[])?.sensor(recipe.film.pitch_um);
            of_spectrum(&sensor, &nm, Path::new("of the data set"))?;
            if sensor.depends_on_angles() {
                return Err(usage(format!(
                    "sensor.name: the response of {} depends on the angle of incidence, which data sets do not have; leave `angle` and `plate` out, or make raws by `lenscube sensor`",
                    sensor.name
                )));
            }
            sensors.push(sensor);
        }
        let weights_of = |sensor: &Sensor| {
            let sensor = sensor.in_uniform_light();
            let of = |c: usize| sensor.band_weights(c, &nm).iter().map(|w| w * sensor.area_m2()).collect();
            (0..sensor.channels.len()).map(of).collect::<Vec<Vec<f64>>>()
        };
        let times = table.exposure.0.iter().map(|text| Times::parse(text)).collect::<Result<Vec<_>>>();
        let times = times.context("sensor.exposure")?;
        let needs_scale = times.iter().any(|t| matches!(t, Times::Given(_)));
        if times.iter().any(|t| matches!(t, Times::Given(times) if times.len() != 1)) {
            return Err(usage("sensor.exposure: expected one time or auto in each text of the list"));
        }
        if needs_scale && table.film_scale.is_none() {
            return Err(usage(
                "sensor.exposure: films of pictures are relative, so a time alone gives no exposure; give sensor.film_scale (W m-2 nm-1 of a value of 1), or \"auto\"",
            ));
        }
        let noise = match &table.noise {
            None => NoiseSet::ALL,
            Some(text) => text.parse().map_err(|e| usage(format!("sensor.noise: {e}")))?,
        };
        let nominal_s = time("--nominal", &ExposeArgs::new("", "").nominal)?;
        let camera = Self {
            recipe,
            table,
            weights: sensors.iter().map(weights_of).collect(),
            corrections: sensors
                .iter()
                .map(|s| s.crosstalk.as_ref().map(|of| of.corrections(s, &nm)))
                .collect(),
            sensors,
            times,
            noise,
            nominal_s,
            nm,
            known: Mutex::default(),
        };
        if recipe.develops() {
            for sensor in 0..camera.sensors.len() {
                camera.colours(sensor, bands)?;
            }
        }
        Ok(Some(camera))
    }

    /// Size of the raw behind a film of `film` px.
    ///
    /// # Errors
    /// Usage: pixels smaller than those of the film.
    pub fn size(&self, sensor: usize, film: Size) -> Result<Size> {
        Ok(self.geometry(sensor, film)?.size())
    }

    /// The sensor in the middle of the film.
    fn geometry(&self, sensor: usize, film: Size) -> Result<Geometry> {
        let plane = FilmPlane { size: film, pitch_um: self.recipe.film.pitch_um, axis_um: (0.0, 0.0) };
        Geometry::new(&self.sensors[sensor], &plane, &ExposeArgs::new("", ""))
            .with_context(|| format!("sensor {}: film.pitch_um", self.sensors[sensor].name))
    }

    /// The raw of a film.
    ///
    /// # Errors
    /// A film that is dark under an automatic exposure.
    pub fn expose(&self, film: &[f32], size: Size, draw: &Draw) -> Result<Raw> {
        let sensor = &self.sensors[draw.sensor];
        let geometry = self.geometry(draw.sensor, size)?;
        let raw_size = geometry.size();
        let (rows, columns) = geometry.taps(raw_size.rect())?;
        let planes = [BandWeights::electrons(sensor, &self.nm, &vec![1.0; self.nm.len()])];
        let spread = self.corrections[draw.sensor].as_ref().map(|of| SpreadRows::new(raw_size, of.clone()));
        let corrections = spread.as_ref().map(SpreadRows::factors).unwrap_or_default();
        let bands = ArrayChart::new(size, self.nm.clone(), NanPolicy::Keep);
        let mut signal = Vec::with_capacity(raw_size.pixels());
        let pass = Pass {
            film: &bands.with_pixels(film),
            bands: self.nm.len(),
            sensor,
            rows: &rows,
            columns: &columns,
            window: raw_size.rect(),
            planes: &planes,
            corrections: &corrections,
            block: (64, size.width),
            bands_at_once: 1,
            threads: 1,
            cancel: &AtomicBool::new(false),
        };
        let mut deliver = |_: usize, planes: &[Vec<f32>]| {
            signal.extend_from_slice(&planes[0]);
            Ok(())
        };
        let (window, all) = (raw_size.rect(), 0..raw_size.height);
        match &spread {
            None => pass.run(all, &mut deliver),
            Some(of) => spread::run(&pass, of, window, all, &mut deliver),
        }
        .map_err(anyhow::Error::from_boxed)?;
        let exposure = self.exposure(&signal, draw)?;
        let mut numbers = vec![0; signal.len()];
        let exposer = Exposer::new(sensor, &exposure);
        let received_e =
            if sensor.pixel.overflow.flows() { received(&exposer, &signal, window) } else { Vec::new() };
        exposer.expose_with(&signal, &received_e, window, &mut numbers);
        Ok(Raw { size: raw_size, numbers, exposure })
    }

    /// What a sample is taken with.
    fn exposure(&self, signal: &[f32], draw: &Draw) -> Result<Exposure> {
        let sensor = &self.sensors[draw.sensor];
        let factor = pipeline::real::pow(2.0, draw.exposure_ev);
        let (seconds, scale) = match &self.times[draw.exposure] {
            Times::Given(times) => (times[0] * factor, self.table.film_scale.unwrap_or(1.0)),
            Times::Auto { fill, percentile } => {
                let mut histogram = SignalHistogram::default();
                histogram.add(signal);
                let found = histogram.seconds(sensor, draw.gain, 1.0, *fill, *percentile);
                let found = found.ok_or_else(|| {
                    anyhow!("exposure auto: the film is dark at the {percentile}th percentile")
                })?;
                // Only the product of scale and time is known.
                (self.nominal_s, found * factor / self.nominal_s)
            }
        };
        Ok(Exposure {
            seconds,
            gain: draw.gain,
            scale,
            seed: draw.noise_seed,
            die: 1,
            frame: 0,
            noise: self.noise,
            temperature_c: self.table.temperature_c,
            flicker: None,
        })
    }

    /// Linear red, green and blue (or grey) of a raw, pixel by pixel, and the number of channels.
    ///
    /// # Errors
    /// A raw that is too small for its pattern.
    pub fn develop(&self, raw: &Raw, draw: &Draw, bands: &Bands) -> Result<(Vec<f32>, usize)> {
        let development = self.development(raw.size, draw, bands)?;
        let size = development.size();
        let values: Vec<f32> = match self.sensors[draw.sensor].adc.linear_table() {
            None => raw.numbers.iter().map(|v| f32::from(*v)).collect(),
            Some(table) => raw.numbers.iter().map(|v| table[usize::from(*v)]).collect(),
        };
        Ok((development.develop(&values, Shading::None, size.rect()), development.channels()))
    }

    fn development(&self, size: Size, draw: &Draw, bands: &Bands) -> Result<Arc<Development>> {
        let key = (draw.sensor, draw.gain.to_bits(), size);
        let mut known = self.known.lock().expect("no panic while held");
        if let Some((_, development)) = known.iter().find(|(k, _)| *k == key) {
            return Ok(Arc::clone(development));
        }
        let sensor = &self.sensors[draw.sensor];
        let (gains, matrix) = self.colours(draw.sensor, bands)?;
        let plane_of = sensor.plane_of_channels();
        let p = &sensor.pattern;
        let pattern = PlanePattern {
            rows: p.rows,
            columns: p.columns,
            planes: p.channels.iter().map(|c| plane_of[*c]).collect(),
            count: sensor.planes().len(),
        };
        let recipe = Develop {
            size,
            pattern: p.clone(),
            plane_of,
            black_white_dn: (sensor.adc.black_dn, sensor.white_dn(draw.gain)),
            limit: 1.0,
            gains,
            bin: false,
            demosaic: if pattern.is_bayer() { Demosaic::Malvar } else { Demosaic::Bilinear },
            matrix,
            exposure: 1.0,
        };
        let development =
            Development::new(recipe, (0, 0)).map_err(|e| usage(format!("sensor {}: {e}", sensor.name)))?;
        let development = Arc::new(development);
        if known.len() == MAX_DEVELOPMENTS {
            known.remove(0);
        }
        known.push((key, Arc::clone(&development)));
        Ok(development)
    }

    /// White gains of the filters, and the colour matrix.
    fn colours(&self, sensor: usize, bands: &Bands) -> Result<(Vec<f64>, Vec<Vec<f64>>)> {
        let (of, weights) = (&self.sensors[sensor], &self.weights[sensor]);
        let planes = of.planes().len();
        let asked = self.recipe.develop.matrix;
        let is_bands = asked == Matrix::Bands && bands.are_colours();
        let fail = |problem: &str| usage(format!("develop.matrix: sensor {}: {problem}", of.name));
        if planes == 1 {
            return Ok((vec![1.0; of.channels.len()], vec![vec![1.0]]));
        }
        if planes != 3 && (is_bands || asked == Matrix::None) {
            return Err(fail(&format!(
                "{planes} planes are not red, green and blue; give matrix = \"fitted\""
            )));
        }
        let light: Illuminant = match &self.recipe.develop.white {
            None => Illuminant::D65,
            Some(name) => name
                .parse()
                .map_err(|_| usage(format!("develop.white: expected D65, A or E, found {name}")))?,
        };
        let gains = match is_bands {
            true => least_one(weights.iter().map(|w| 1.0 / w.iter().sum::<f64>()).collect()),
            false => least_one(of.white_gains(light)),
        };
        if gains.iter().any(|g| !g.is_finite()) {
            return Err(fail("a filter does not respond to the light"));
        }
        let unit = |i: usize| (0..3).map(|j| if i == j { 1.0 } else { 0.0 }).collect::<Vec<f64>>();
        let matrix = match asked {
            Matrix::None => (0..3).map(unit).collect(),
            Matrix::Bands if is_bands => {
                let plane_of = of.plane_of_channels();
                let share = |p: usize, colour: usize| {
                    let own = (0..weights.len()).filter(|c| plane_of[*c] == p);
                    let of_band: f64 = own.clone().map(|c| weights[c][bands.of_colour(colour)]).sum();
                    of_band / own.map(|c| weights[c].iter().sum::<f64>()).sum::<f64>()
                };
                let inverse =
                    inverse(&std::array::from_fn(|p| std::array::from_fn(|colour| share(p, colour))));
                if inverse.iter().flatten().any(|v| !v.is_finite()) {
                    return Err(fail("its planes do not tell the three bands apart; give matrix = \"none\""));
                }
                inverse.iter().map(|row| row.to_vec()).collect()
            }
            Matrix::Bands | Matrix::Fitted => {
                ColourMatrix::fitted(of, light).map_err(|e| usage(format!("develop.matrix: {e}")))?.rows
            }
        };
        Ok((gains, matrix))
    }

    /// All that the sensors are, for the data set's digest.
    pub fn identity(&self) -> String {
        blake3::hash(format!("{:?}", self.sensors).as_bytes()).to_hex().to_string()
    }

    /// Name of a sensor.
    pub fn name(&self, sensor: usize) -> &str {
        &self.sensors[sensor].name
    }
}
