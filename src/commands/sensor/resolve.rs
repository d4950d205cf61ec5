//! Flags resolved: film or kept signal, sensor, geometry, exposure, memory. What can fail early fails here, before any pixel.

use super::directions::Directions;
use super::exposure::{Times, flicker, time};
use super::film::Film;
use super::geometry::{Geometry, check_pitch, check_rois};
use super::kept::Kept;
use super::memory::{self, Memory, Needs};
use super::motion::CameraMotion;
use super::open::open_sensor;
use super::{identity, warnings};
use crate::args::ExposeArgs;
use crate::camera::frame::split_group;
use crate::camera::shading::recorded;
use crate::failure::usage;
use crate::film::plane::FilmPlane;
use crate::job::light_units;
use crate::machine::{MemoryLimit, threads};
use crate::progress::given_number;
use anyhow::Result;
use formats::film::FilmSpec;
use formats::group::Output;
use formats::raw::{RawSpec, RawStore};
use formats::sensor::SensorFile;
use pipeline::geometry::{Rect, Size};
use pipeline::sensor::pixels::Resample;
use pipeline::sensor::spectrum::illuminance_weights;
use pipeline::sensor::spread::SpreadRows;
use pipeline::sensor::stream::BandWeights;
use pipeline::sensor::{Exposure, Sensor};
use serde_json::{Map, Value};
use std::path::Path;

/// Where the signal comes from.
pub enum Source {
    /// A film, placed under the sensor.
    Film(Box<Film>, Geometry),
    /// A raw that kept it.
    Kept(Box<Kept>),
}

/// A job, ready to run.
pub struct RawJob {
    /// The signal.
    pub source: Source,
    pub(super) file: SensorFile,
    /// The sensor.
    pub sensor: Sensor,
    pub(super) times: Times,
    pub(super) frames: u32,
    /// Gain of the converter.
    pub gain: f64,
    pub(super) nominal_s: f64,
    pub(super) film_lux: Option<f64>,
    pub(super) film_scale: Option<f64>,
    /// Seed, die, noises, temperature.
    pub exposure: Exposure,
    pub(super) outputs: Vec<Output>,
    pub(super) keep_signal: bool,
    /// Directions of the film's light, where the sensor depends on them.
    directions: Option<Directions>,
    /// Motion of the camera over the film.
    pub(super) motion: Option<CameraMotion>,
    /// Crosstalk of a film's signal, where the sensor has it.
    pub(super) spread: Option<SpreadRows>,
    /// All that changes pixels.
    pub identity: Map<String, Value>,
    pub(super) signal_identity: Value,
    /// Memory and threads.
    pub memory: Memory,
    pub(super) warnings: Vec<String>,
}

impl RawJob {
    /// Resolves `args`.
    pub fn new(args: &ExposeArgs, film: &str) -> Result<Self> {
        let times = Times::parse(args.exposure.as_deref().unwrap_or_default())?;
        let auto = matches!(times, Times::Auto { .. });
        if auto && !args.roi.is_empty() {
            return Err(usage(
                "--exposure auto with --roi: the time follows from the whole sensor; run once without --roi, then give the time that was found",
            ));
        }
        if args.film_lux.is_some() && !args.roi.is_empty() {
            return Err(usage(
                "--film-lux with --roi: the scale follows from the whole sensor; run once without --roi, then give --film-scale as it was found",
            ));
        }
        let threads = threads(args.threads);
        let limit = MemoryLimit::new(args.memory, memory::DEFAULT);
        let (path, array) = split_group(film);
        if array.is_empty() && RawStore::is_one(Path::new(path)).unwrap_or(false) {
            return Self::of_kept(args, Path::new(path), times, (limit, threads));
        }
        let Some(name) = &args.sensor else {
            let names = formats::sensor::builtin_names().join(", ");
            return Err(usage(format!(
                "--sensor is required: the name of a built-in sensor or FILE.toml; built-in sensors: {names}"
            )));
        };
        let file = open_sensor(name, &args.set)?;
        let opened = Film::open(film, args, 0)?;
        let sensor = file.sensor(opened.plane.pitch_um);
        let geometry = Geometry::new(&sensor, &opened.plane, args)?;
        let mut notes = warnings::of_spectrum(&sensor, &opened.wavelengths_nm, &opened.path)?;
        notes.extend(geometry.warning());
        notes.extend(warnings::of_crosstalk(&sensor, &opened.wavelengths_nm));
        let directions = Directions::of_film(&opened, args, (&file, &sensor), &geometry)?;
        notes.extend(directions.iter().map(Directions::note));
        if directions.is_some() {
            let from_table = args.chief_ray_angles.is_some();
            notes.extend(opened.notes_on_directions(from_table, file.may_repeat_plates()));
        }
        let motion = CameraMotion::of_film(args, &times, &sensor, (&opened.plane, &geometry))?;
        notes.extend(motion.iter().map(CameraMotion::note));
        let relative = opened.relative;
        if !relative && (args.film_lux.is_some() || args.film_scale.is_some()) {
            return Err(usage(format!(
                "--film-lux and --film-scale are for relative films; the units of {film} are {}",
                opened.units
            )));
        }
        check_scale(args, relative, auto, &format!("film {film} ({})", opened.units))?;
        let size = geometry.size();
        let spread = sensor
            .crosstalk
            .as_ref()
            .map(|of| SpreadRows::new(size, of.corrections(&sensor, &opened.wavelengths_nm)));
        let needs = Needs {
            width: args.roi.iter().map(|r| r.width).max().unwrap_or(size.width),
            shard: largest_shard(args, size),
            bands: opened.wavelengths_nm.len(),
            chunk: opened.chunk,
            ratio: geometry.rows.ratio().max(1e-3),
            aligned: motion.is_none()
                && geometry.rows.is_whole()
                && geometry.columns.is_whole()
                && opened.chunk.1 as f64 % geometry.rows.ratio() == 0.0,
            planes: 1 + usize::from(args.film_lux.is_some()),
            corrections: spread.as_ref().map_or(0, SpreadRows::corrections),
            column: blooming_rows(&sensor, size),
            margin: motion.as_ref().map_or(0, |of| of.motion.margin_px()),
        };
        let memory = Memory::plan(limit, threads, &needs)?;
        let opened = Film::open(film, args, memory.cache)?;
        let mut signal_identity = identity::of_signal(&opened, &sensor, &geometry, directions.as_ref());
        if let Some(motion) = &motion {
            signal_identity["motion"] = motion.identity();
        }
        let source = Source::Film(Box::new(opened), geometry);
        let signal = (signal_identity, relative, size);
        let job = Self::with(args, source, (file, sensor), times, memory, signal, notes)?;
        Ok(Self { directions, motion, spread, ..job })
    }

    fn of_kept(
        args: &ExposeArgs,
        path: &Path,
        times: Times,
        (limit, threads): (MemoryLimit, usize),
    ) -> Result<Self> {
        let kept = Kept::open(path)?;
        let geometry_flags = args.size.is_some()
            || args.center != (0.0, 0.0)
            || args.resample != Resample::Cubic
            || args.coarse_film;
        let of_light = args.f_number.is_some() || args.lens.is_some() || args.chief_ray_angles.is_some();
        if geometry_flags || of_light || args.film_lux.is_some() || args.motion.is_some() {
            return Err(usage(format!(
                "{}: its signal is already that of a sensor: --size, --center, --resample, --coarse-film, --f-number, --lens, --chief-ray-angles, --motion and --film-lux are for films",
                path.display()
            )));
        }
        if !kept.relative && args.film_scale.is_some() {
            return Err(usage(format!(
                "--film-scale is for relative films; that of {} has absolute units",
                path.display()
            )));
        }
        let file = match &args.sensor {
            Some(name) => open_sensor(name, &args.set)?,
            None if args.set.is_empty() => kept.sensor.clone(),
            None => return Err(usage("--set changes a sensor: give --sensor as well")),
        };
        let sensor = file.sensor(kept.spec.pitch_um);
        if Some(identity::optics(&sensor).as_str()) != kept.signal_identity["optics"].as_str() {
            return Err(usage(format!(
                "{}: its signal is that of another sensor ({}): pitch, aperture, curves, filters, angles, crosstalk or pattern differ; start from the film",
                path.display(),
                kept.sensor.name()
            )));
        }
        let auto = matches!(times, Times::Auto { .. });
        check_scale(args, kept.relative, auto, &format!("the film of {}", path.display()))?;
        let size = kept.spec.sensor;
        check_rois(args, size)?;
        let needs = Needs {
            width: 1,
            shard: largest_shard(args, size),
            bands: 1,
            chunk: RawSpec::chunk_shape(),
            ratio: 1.0,
            aligned: true,
            planes: 1,
            corrections: 0,
            column: blooming_rows(&sensor, size),
            margin: 0,
        };
        let memory = Memory::plan(limit, threads, &needs)?;
        let (identity, relative) = (kept.signal_identity.clone(), kept.relative);
        Self::with(
            args,
            Source::Kept(Box::new(kept)),
            (file, sensor),
            times,
            memory,
            (identity, relative, size),
            Vec::new(),
        )
    }

    fn with(
        args: &ExposeArgs,
        source: Source,
        (file, sensor): (SensorFile, Sensor),
        times: Times,
        memory: Memory,
        (signal_identity, relative, size): (Value, bool, Size),
        mut warnings: Vec<String>,
    ) -> Result<Self> {
        let gain = gain(args, &sensor)?;
        let exposure = Exposure {
            seconds: 0.0,
            gain,
            scale: 1.0,
            seed: args.seed,
            die: args.die,
            frame: 0,
            noise: args.noise,
            temperature_c: args.temperature,
            flicker: args.flicker.as_deref().map(flicker).transpose()?,
        };
        warnings.extend(warnings::of_black(&sensor, gain, args.temperature));
        Ok(Self {
            identity: identity::of_job(args, &signal_identity, &sensor, gain, relative),
            nominal_s: time("--nominal", &args.nominal)?,
            outputs: outputs(args, size),
            frames: args.frames,
            film_lux: args.film_lux,
            film_scale: args.film_scale,
            keep_signal: args.keep_signal,
            directions: None,
            motion: None,
            spread: None,
            source,
            file,
            sensor,
            times,
            gain,
            exposure,
            signal_identity,
            memory,
            warnings,
        })
    }

    /// Size of the sensor in pixels.
    pub fn size(&self) -> Size {
        match &self.source {
            Source::Film(_, geometry) => geometry.size(),
            Source::Kept(kept) => kept.spec.sensor,
        }
    }

    /// Whether exposures follow from the whole signal.
    pub fn needs_signal_first(&self) -> bool {
        matches!(self.times, Times::Auto { .. }) || self.film_lux.is_some()
    }

    /// Weights of the planes that a pass over the film makes: the signal, and the illuminance if it is summed.
    pub fn planes(&self, film: &Film, with_lux: bool) -> Vec<BandWeights> {
        let field = |of: &Directions| of.weights(film, &self.sensor, self.memory.threads);
        let signal = BandWeights::electrons(&self.sensor, &film.wavelengths_nm, &film.factors)
            .with_field(self.directions.as_ref().map(field));
        let lux = illuminance_weights(&film.wavelengths_nm);
        let lux = BandWeights::uniform(&self.sensor, &lux);
        if with_lux { vec![signal, lux] } else { vec![signal] }
    }

    /// The response of the filters over angles of incidence, as a raw records it; null without.
    pub(super) fn response_map(&self) -> Value {
        match (&self.source, &self.directions) {
            (Source::Film(film, _), Some(directions)) => {
                recorded(&directions.response_map(film, &self.sensor, self.memory.threads), &self.sensor)
            }
            (Source::Film(..), None) => Value::Null,
            (Source::Kept(kept), _) => kept.response_map.clone(),
        }
    }

    /// Whether the film's values are relative.
    pub(super) fn relative(&self) -> bool {
        match &self.source {
            Source::Film(film, _) => film.relative,
            Source::Kept(kept) => kept.relative,
        }
    }

    /// Whether the signal of a film is made before its first shard.
    pub(super) fn needs_columns(&self) -> bool {
        self.sensor.pixel.overflow.flows() && matches!(self.source, Source::Film(..))
    }

    /// Whether illuminance is to be summed.
    pub fn sums_lux(&self) -> bool {
        self.film_lux.is_some()
    }
}

/// Fails for a sensor and an exposure that are not possible for the film at `path` that will have the layout `film`, before it is made.
///
/// # Errors
/// Usage, as [`RawJob::new`] once the film is there; the sensor cannot be read.
pub fn check_before_film(args: &ExposeArgs, path: &Path, film: &FilmSpec) -> Result<(SensorFile, Sensor)> {
    let times = Times::parse(args.exposure.as_deref().unwrap_or_default())?;
    let plane = FilmPlane::new(film, 0);
    let file = open_sensor(args.sensor.as_deref().unwrap_or_default(), &args.set)?;
    let sensor = file.sensor(plane.pitch_um);
    // `lenscube sensor` names its own flags for it.
    check_pitch(&sensor, plane.pitch_um, "give `", "")?;
    Geometry::new(&sensor, &plane, args)?;
    warnings::of_spectrum(&sensor, &film.wavelengths_nm, path)?;
    let is_relative = light_units::parse(&film.units).is_none();
    check_scale(
        args,
        is_relative,
        matches!(times, Times::Auto { .. }),
        &format!("the film ({})", film.units),
    )?;
    gain(args, &sensor)?;
    Ok((file, sensor))
}

/// Whether times and a relative film go together.
fn check_scale(args: &ExposeArgs, relative: bool, auto: bool, what: &str) -> Result<()> {
    match relative && !auto && args.film_lux.is_none() && args.film_scale.is_none() {
        false => Ok(()),
        true => Err(usage(format!(
            "{what} holds relative values, so a time alone gives no exposure; give --film-lux LX (mean illuminance over the sensor), \
             --film-scale KAPPA (W m-2 nm-1 of a unit), or --exposure auto"
        ))),
    }
}

/// Gain of the flags, as the sensor has it.
fn gain(args: &ExposeArgs, sensor: &Sensor) -> Result<f64> {
    let gain = match (args.gain, args.iso, sensor.adc.base_iso) {
        (Some(gain), _, _) => gain,
        (None, Some(iso), Some(base)) => iso / base,
        (None, Some(iso), None) => {
            return Err(usage(format!(
                "--iso {}: sensor {} has no adc.base_iso; give --gain",
                given_number(iso),
                sensor.name
            )));
        }
        (None, None, _) => 1.0,
    };
    let gains = &sensor.adc.gains;
    let allowed = if gains.is_empty() { (1.0..=64.0).contains(&gain) } else { gains.contains(&gain) };
    let list = || match gains.is_empty() {
        true => "1 to 64".to_owned(),
        false => gains.iter().map(f64::to_string).collect::<Vec<_>>().join(", "),
    };
    match allowed {
        true => Ok(gain),
        false => {
            Err(usage(format!("gain {}: sensor {} has gains {}", given_number(gain), sensor.name, list())))
        }
    }
}

fn outputs(args: &ExposeArgs, size: Size) -> Vec<Output> {
    let window = |(i, rect): (usize, &Rect)| Output { name: format!("roi_{i}"), rect: *rect };
    match args.roi.is_empty() {
        true => vec![Output { name: "raw".into(), rect: size.rect() }],
        false => args.roi.iter().enumerate().map(window).collect(),
    }
}

/// Rows that are in memory at a time for the flows along a column; 0: pixels keep to themselves.
fn blooming_rows(sensor: &Sensor, size: Size) -> usize {
    if sensor.pixel.overflow.flows() { size.height } else { 0 }
}

/// Rows and columns of the largest shard of the outputs.
fn largest_shard(args: &ExposeArgs, size: Size) -> (usize, usize) {
    let spec = RawSpec { outputs: outputs(args, size), ..empty() };
    let shapes = (0..spec.outputs.len()).map(|output| spec.shard_shape(output));
    shapes.fold((0, 0), |max, shape| (max.0.max(shape.0), max.1.max(shape.1)))
}

/// A layout without content.
pub(super) fn empty() -> RawSpec {
    RawSpec {
        outputs: Vec::new(),
        sensor: Size::new(1, 1),
        pitch_um: 1.0,
        centre_mm: (0.0, 0.0),
        exposure_s: Vec::new(),
        signal: false,
        shard: RawSpec::LAYOUT.0,
        chunk: RawSpec::LAYOUT.1,
    }
}
