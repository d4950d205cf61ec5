//! `lenscube sensor`.

use super::choices::{RESAMPLE, one_of};
use super::values::{bounded, bytes, figures, number, pair_mm, positive, roi, threads};
use clap::{Args, Subcommand};
use pipeline::bounds;
use pipeline::colour::Illuminant;
use pipeline::geometry::{Rect, Size};
use pipeline::sensor::figures::Over;
use pipeline::sensor::pixels::Resample;
use pipeline::sensor::{NoiseFigures, NoiseSet};
use std::path::PathBuf;

/// `lenscube sensor FILM RAW.zarr …`, or one of its subcommands.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
#[command(after_help = "Examples:\n  \
lenscube sensor film.zarr raw.zarr --sensor cmv12000-rgb --exposure auto --seed 1\n  \
lenscube sensor film.zarr bracket.zarr --sensor sony-a7r2 --exposure 1ms,4ms,16ms --frames 8\n\
A film called `show` is ./show")]
pub struct SensorArgs {
    /// list, show or validate
    #[command(subcommand)]
    pub command: Option<SensorCommand>,
    /// What to expose.
    #[command(flatten)]
    pub expose: ExposeArgs,
}

/// Subcommands.
#[derive(Debug, Subcommand)]
pub enum SensorCommand {
    /// List the built-in sensors
    #[command(after_help = "Example:\n  lenscube sensor list")]
    List,
    /// Show a sensor: figures, sources, assumptions
    Show(SensorShowArgs),
    /// Measure a sensor's frames of uniform light by EMVA 1288 and compare with its description
    Validate(SensorValidateArgs),
}

/// `lenscube sensor show`.
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  lenscube sensor show cmv12000-rgb --set pixel.pitch_um=3.45 --plot figures"
)]
pub struct SensorShowArgs {
    /// Name of a built-in sensor, or a description (.toml)
    #[arg(value_name = "NAME|FILE")]
    pub sensor: String,
    /// Replace a field of the description; repeatable
    #[arg(long, value_name = "FIELD=VALUE")]
    pub set: Vec<String>,
    /// Write figures of quantum efficiency and signal-to-noise ratio into this directory
    #[arg(long, value_name = "DIR", value_parser = figures())]
    pub plot: Option<PathBuf>,
    /// Replace existing figures
    #[arg(long, requires = "plot")]
    pub overwrite: bool,
}

/// `lenscube sensor validate`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  lenscube sensor validate cmv12000-rgb --out emva --require")]
pub struct SensorValidateArgs {
    /// Name of a built-in sensor, or a description (.toml)
    #[arg(value_name = "NAME|FILE")]
    pub sensor: String,
    /// Replace a field of the description; repeatable
    #[arg(long, value_name = "FIELD=VALUE")]
    pub set: Vec<String>,
    /// Write figures and the measured points into this directory
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace existing files there
    #[arg(long, requires = "out")]
    pub overwrite: bool,
    /// End with exit code 4 if a figure is outside its tolerance
    #[arg(long)]
    pub require: bool,
    /// Seed of the noise of each frame
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Seed of the noise that is the same in every frame
    #[arg(long, default_value_t = 1)]
    pub die: u64,
}

/// From a film to a raw. Other commands that make a raw request it by [`ExposeArgs::new`].
#[derive(Clone, Debug, PartialEq, Args)]
pub struct ExposeArgs {
    /// A film, PATH or PATH//roi_0; or a raw that kept its signal
    #[arg(value_name = "FILM", required = true)]
    pub film: Option<String>,
    /// The raw to write: a Zarr v3 group, here or at s3://BUCKET/PREFIX; or one frame as .dng, or as 16-bit grey in .tif or .png
    #[arg(value_name = "RAW", required = true)]
    pub raw: Option<PathBuf>,
    /// Write digital numbers to .tif and .png as they are [default: multiplied, so that 65535 is the largest one]
    #[arg(long)]
    pub keep_dn: bool,
    /// Light whose white is the neutral of a .dng: D65, A or E [default: the chart's light if the film records it, else D65]
    #[arg(long, value_name = "LIGHT")]
    pub white: Option<Illuminant>,
    /// Name of a built-in sensor (`lenscube sensor list`) or a description (.toml); of a raw that kept its signal, by default its own
    #[arg(long, value_name = "NAME|FILE")]
    pub sensor: Option<String>,
    /// Replace a field of the description, e.g. noise.prnu=0; repeatable
    #[arg(long, value_name = "FIELD=VALUE")]
    pub set: Vec<String>,
    /// 10ms, 1/60s, 2.5 (seconds); auto, auto:FILL or auto:FILL@PERCENTILE, by default 0.9@99.9; or a comma-separated list
    #[arg(long, value_name = "TIME", required = true, help_heading = "Exposure")]
    pub exposure: Option<String>,
    /// Frames of each exposure
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000), help_heading = "Exposure")]
    pub frames: u32,
    /// Gain of the converter
    #[arg(long, value_parser = positive, conflicts_with = "iso", help_heading = "Exposure")]
    pub gain: Option<f64>,
    /// Gain as ISO over the sensor's base ISO
    #[arg(long, value_parser = positive, help_heading = "Exposure")]
    pub iso: Option<f64>,
    /// Seed of the noise of each frame
    #[arg(long, help = format!("Seed of the noise of each frame: shot, {}", noises_over(Over::Frames)), default_value_t = 1, help_heading = "Noise")]
    pub seed: u64,
    /// Seed of the noise of the sensor itself
    #[arg(
        long,
        help = format!("Seed of the noise of the sensor itself: {}; the same in every frame", noises_over(Over::Die)),
        default_value_t = 1,
        help_heading = "Noise"
    )]
    pub die: u64,
    /// all, none, or some of shot,dark,read,reset,adc,dsnu,prnu,column,row
    #[arg(long, default_value_t = NoiseSet::ALL, help_heading = "Noise")]
    pub noise: NoiseSet,
    /// Temperature of the sensor, °C [default: that of its dark current]
    #[arg(long, value_name = "C", value_parser = temperature, allow_hyphen_values = true, help_heading = "Exposure")]
    pub temperature: Option<f64>,
    /// Flicker of the light: frequency of its power, modulation 0 to 1, and the time since a maximum at the start of the first row [default: 0]
    #[arg(long, value_name = "HZ:M[:TIME]", help_heading = "Light of the film")]
    pub flicker: Option<String>,
    /// Motion of the camera: CSV of time_s, x_um, y_um (shift of the picture, right and down), rotation_deg, or of time_s, rate_x_deg_s, rate_y_deg_s, rate_z_deg_s of a gyroscope; rows see it at their time
    #[arg(long, value_name = "FILE.csv", value_hint = clap::ValueHint::FilePath, help_heading = "Exposure")]
    pub motion: Option<PathBuf>,
    /// Time of --motion at which the exposure of the first row begins: of the later frames of a burst, a raw each [default: 0]
    #[arg(long, value_name = "TIME", requires = "motion", help_heading = "Exposure")]
    pub motion_start: Option<String>,
    /// Focal length, for the rates of a gyroscope (camera axes: x right, y down, z forward)
    #[arg(long, value_name = "MM", value_parser = positive, help_heading = "Exposure")]
    pub focal_length_mm: Option<f64>,
    /// Regions of the sensor only, each an array roi_N; repeatable
    #[arg(long, value_name = "X,Y,W,H", value_parser = roi, help_heading = "Placement")]
    pub roi: Vec<Rect>,
    /// Sensor size in pixels, N or WxH, or `native` [default: as many as fit on the film]
    #[arg(long, value_name = "WxH|native", value_parser = sensor_size, help_heading = "Placement")]
    pub size: Option<SizeArg>,
    /// Middle of the sensor in mm from the optical axis
    #[arg(long, value_name = "X,Y", value_parser = pair_mm, default_value = "0,0", allow_hyphen_values = true, help_heading = "Placement")]
    pub center: (f64, f64),
    /// Interpolation of the film between its pixel edges
    #[arg(long, value_parser = one_of(RESAMPLE), default_value = "cubic", help_heading = "Placement")]
    pub resample: Resample,
    /// Allow a film whose pixels are larger than the sensor's
    #[arg(long, help_heading = "Placement")]
    pub coarse_film: bool,
    /// F-number, for a film of radiance that has no solid angles: Ω = π/(4N²), object at infinity
    #[arg(long, value_name = "N", value_parser = bounded(bounds::F_NUMBER), help_heading = "Light of the film")]
    pub f_number: Option<f64>,
    /// Transmission of the lens, with --f-number
    #[arg(long, value_name = "TAU", value_parser = bounded(bounds::TRANSMISSION), requires = "f_number", help_heading = "Light of the film")]
    pub transmission: Option<f64>,
    /// Lens of the film, where the one that it records lies elsewhere now: for sensors whose response depends on the angle of incidence
    #[arg(
        long,
        value_name = "LENS",
        conflicts_with = "chief_ray_angles",
        help_heading = "Light of the film"
    )]
    pub lens: Option<String>,
    /// Chief-ray angles instead of the lens's, for such sensors: columns height_mm, cra_deg (in air) and f_number (of the exit pupil)
    #[arg(long, value_name = "FILE.csv", help_heading = "Light of the film")]
    pub chief_ray_angles: Option<PathBuf>,
    /// Mean illuminance over the sensor of a relative film, lx
    #[arg(long, value_name = "LX", value_parser = positive, conflicts_with = "film_scale", help_heading = "Light of the film")]
    pub film_lux: Option<f64>,
    /// W m-2 nm-1 of one unit of a relative film
    #[arg(long, value_name = "KAPPA", value_parser = positive, help_heading = "Light of the film")]
    pub film_scale: Option<f64>,
    /// Integration time of the dark current for a relative film without a given time
    #[arg(long, value_name = "TIME", default_value = DEFAULT_NOMINAL, help_heading = "Exposure")]
    pub nominal: String,
    /// Keep the signal: other exposures, seeds and noises then need no film
    #[arg(long, conflicts_with = "roi")]
    pub keep_signal: bool,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads, help_heading = "Machine")]
    pub threads: Option<usize>,
    /// Maximum memory, e.g. 1GiB [default: half of what is available, at most 1 GiB]
    #[arg(long, value_name = "BYTES", value_parser = bytes, help_heading = "Machine")]
    pub memory: Option<u64>,
    /// Do not wait for the disk after each shard: faster, unsafe against power failures
    #[arg(long, help_heading = "Machine")]
    pub no_fsync: bool,
    /// Replace an existing raw, or an existing file (the raw of an interrupted command is resumed)
    #[arg(long)]
    pub overwrite: bool,
    /// Take over a stale lock held by another host
    #[arg(long)]
    pub take_over: bool,
}

/// Default of `--nominal`.
const DEFAULT_NOMINAL: &str = "10ms";

impl ExposeArgs {
    /// The request of `lenscube sensor FILM RAW` without flags, of which `--exposure` is required.
    pub fn new(film: impl Into<String>, raw: impl Into<PathBuf>) -> Self {
        Self {
            film: Some(film.into()),
            raw: Some(raw.into()),
            keep_dn: false,
            white: None,
            sensor: None,
            set: Vec::new(),
            exposure: None,
            frames: 1,
            gain: None,
            iso: None,
            seed: 1,
            die: 1,
            noise: NoiseSet::ALL,
            temperature: None,
            flicker: None,
            motion: None,
            motion_start: None,
            focal_length_mm: None,
            roi: Vec::new(),
            size: None,
            center: (0.0, 0.0),
            resample: Resample::Cubic,
            coarse_film: false,
            f_number: None,
            transmission: None,
            lens: None,
            chief_ray_angles: None,
            film_lux: None,
            film_scale: None,
            nominal: DEFAULT_NOMINAL.into(),
            keep_signal: false,
            threads: None,
            memory: None,
            no_fsync: false,
            overwrite: false,
            take_over: false,
        }
    }
}

/// Size of the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SizeArg {
    /// The sensor's own.
    Native,
    /// Rows and columns.
    Px(Size),
}

/// The noises that differ over `over`, as texts name them.
fn noises_over(over: Over) -> String {
    let rows = NoiseFigures::TABLE.iter().filter(|row| row.over == over);
    rows.map(|row| row.label).collect::<Vec<_>>().join(", ")
}

fn sensor_size(text: &str) -> Result<SizeArg, String> {
    match text {
        "native" => Ok(SizeArg::Native),
        text => super::values::size(text).map(SizeArg::Px),
    }
}

fn temperature(text: &str) -> Result<f64, String> {
    let celsius = number(text)?;
    match (-200.0..=200.0).contains(&celsius) {
        true => Ok(celsius),
        false => Err(format!("expected -200 to 200 °C, found {celsius}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{Command, FromArgMatches};

    #[test]
    fn request_has_the_defaults_of_the_flags() {
        let words = ["sensor", "film", "raw", "--exposure", "auto"];
        let matches = ExposeArgs::augment_args(Command::new("sensor")).get_matches_from(words);
        let request = ExposeArgs { exposure: Some("auto".into()), ..ExposeArgs::new("film", "raw") };
        assert_eq!(ExposeArgs::from_arg_matches(&matches).unwrap(), request);
    }
}
