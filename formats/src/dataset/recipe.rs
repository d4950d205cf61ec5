//! The recipe of a data set: TOML, schema `lenscube/dataset/1`.
//!
//! Every field that varies is a value, a list, or (numbers) a range `{ from = A, to = B }`. Without `samples` the data set has every combination of the
//! lists, the pictures slowest; with it each sample is drawn at random.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::values::{Numbers, Texts};
use crate::durable::read_file_at_most;
use crate::toml_error::located;

const SCHEMA: &str = "lenscube/dataset/1";
/// Largest recipe that is read, bytes.
const MAX_BYTES: u64 = 1 << 20;
/// Samples of a data set, at most: their numbers have nine digits.
const MAX_SAMPLES: u64 = 1_000_000_000;

/// A recipe that cannot be.
#[derive(Debug, thiserror::Error)]
#[error("recipe {}: {problem}", .path.display())]
pub struct RecipeError {
    path: PathBuf,
    problem: String,
}

/// A recipe.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    schema: String,
    /// Samples to draw; none: every combination.
    pub samples: Option<u64>,
    /// Key of all random numbers.
    #[serde(default = "one")]
    pub seed: u64,
    /// Samples of each combination, which differ in the noise and in the place of the part.
    #[serde(default = "one")]
    pub repeats: u64,
    /// The pictures or cubes.
    pub pictures: PicturesTable,
    /// The lenses.
    pub lens: LensTable,
    /// The films and their places in the field.
    pub film: FilmTable,
    /// The sensors and exposures.
    pub sensor: Option<SensorTable>,
    /// The development.
    #[serde(default)]
    pub develop: DevelopTable,
    /// What is written.
    pub output: OutputTable,
}

fn one() -> u64 {
    1
}

/// `[pictures]`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PicturesTable {
    /// Files, folders and patterns; lists of files as `@LIST.txt`.
    pub files: Texts,
    /// Width and height of the part that becomes a chart; none: the whole picture.
    pub size: Option<[usize; 2]>,
    /// Wavelengths of the bands, nm; of a picture with `colours = "bands"` those of red, green and blue.
    pub wavelengths_nm: Option<Vec<f64>>,
    /// How colours become bands.
    #[serde(default)]
    pub colours: Colours,
    /// COCO annotations of the pictures.
    pub labels: Option<PathBuf>,
    /// Folder of masks, pictures in grey with the names of the pictures.
    pub masks: Option<PathBuf>,
}

/// How the colours of a picture become bands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Colours {
    /// Red, green and blue are three bands.
    #[default]
    Bands,
    /// Spectra of reflected light under D65, as of `lenscube chart image`.
    Spectra,
}

/// `[lens]`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LensTable {
    /// Lenses, as of `lenscube run --lens`.
    pub name: Texts,
    /// Object distances in focus, m.
    pub focus_m: Option<Numbers>,
    /// Other flags of `lenscube run`, without their `--`.
    #[serde(default)]
    pub flags: BTreeMap<String, Flag>,
}

/// The value of a flag.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Flag {
    /// A flag without a value, given or not.
    Switch(bool),
    /// A whole number.
    Whole(i64),
    /// A number.
    Number(f64),
    /// A text.
    Text(String),
}

/// `[film]`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilmTable {
    /// Pixel pitch of chart and film, µm.
    pub pitch_um: f64,
    /// Places of the film's centre in the field, (x, y) in mm from the axis, y down.
    pub center_mm: Option<Vec<[f64; 2]>>,
    /// The same in polar coordinates; a range is drawn uniformly over its area.
    pub radius_mm: Option<Numbers>,
    /// Azimuths, degrees from +x towards +y [0 to 360].
    pub angle_deg: Option<Numbers>,
    /// Pixels of the chart around the film on each side.
    #[serde(default)]
    pub margin_px: usize,
}

/// `[sensor]`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorTable {
    /// Sensors, as of `lenscube sensor --sensor`.
    pub name: Texts,
    /// Exposures, as of `lenscube sensor --exposure`.
    #[serde(default = "automatic")]
    pub exposure: Texts,
    /// Further exposure, a factor of 2^EV.
    pub exposure_ev: Option<Numbers>,
    /// Irradiance of a film value of 1, W m⁻² nm⁻¹, where the exposure is a time.
    pub film_scale: Option<f64>,
    /// Gains of the converter.
    pub gain: Option<Numbers>,
    /// Temperature, °C.
    pub temperature_c: Option<f64>,
    /// Noises, as of `lenscube sensor --noise`.
    pub noise: Option<String>,
}

fn automatic() -> Texts {
    Texts(vec!["auto".into()])
}

/// `[develop]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DevelopTable {
    /// Colour matrix.
    #[serde(default)]
    pub matrix: Matrix,
    /// Light that becomes neutral where the matrix is fitted.
    pub white: Option<String>,
}

/// Colour matrix of a development.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Matrix {
    /// That gives back the bands of red, green and blue; of spectra the fitted one.
    #[default]
    Bands,
    /// As of `lenscube develop --matrix fitted`.
    Fitted,
    /// None.
    None,
}

/// `[output]`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputTable {
    /// How samples are stored.
    #[serde(rename = "as", default)]
    pub layout: Layout,
    /// The film.
    pub film: Option<Format>,
    /// The chart in register with the film: distortion alone.
    pub clean: Option<Format>,
    /// The digital numbers of the sensor.
    pub raw: Option<Format>,
    /// The developed raw.
    pub picture: Option<Format>,
    /// The value that becomes white in PNG and TIFF.
    #[serde(default = "unity")]
    pub white: f64,
    /// Samples per unit: what is computed again after an interruption, and a shard [as many as 32 MiB hold, at most 256].
    pub unit: Option<u64>,
}

fn unity() -> f64 {
    1.0
}

/// How samples are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// A folder a unit, a file an item.
    #[default]
    Folders,
    /// A tar file a unit, as WebDataset reads them.
    Tar,
    /// Arrays (sample, …) of a Zarr store.
    Zarr,
}

/// The format of an item.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// 8 bits, sRGB; of a raw 16 bits, digital numbers.
    Png,
    /// 16 bits, linear.
    Tif,
    /// NumPy, linear 32-bit floats; of a raw 16-bit integers.
    Npy,
}

impl Format {
    /// Ending of its files.
    pub fn ending(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Tif => "tif",
            Self::Npy => "npy",
        }
    }
}

impl Recipe {
    /// Reads and checks the recipe at `path`; relative paths in it start at its folder.
    ///
    /// # Errors
    /// [`RecipeError`]; the file cannot be read.
    pub fn open(path: &Path) -> Result<Self, RecipeError> {
        let fail = |problem: String| RecipeError { path: path.into(), problem };
        let bytes = read_file_at_most(path, MAX_BYTES).map_err(|e| fail(e.to_string()))?;
        let bytes = bytes.ok_or_else(|| fail(format!("expected at most {MAX_BYTES} bytes, found more")))?;
        let text = String::from_utf8(bytes).map_err(|_| fail("expected text in UTF-8".into()))?;
        Self::parse(&text).map_err(fail)
    }

    /// Parses and checks a text.
    ///
    /// # Errors
    /// What is wrong, with line and column.
    pub fn parse(text: &str) -> Result<Self, String> {
        let recipe: Self = toml::from_str(text).map_err(|e| located(&e, text))?;
        recipe.check()?;
        Ok(recipe)
    }

    /// Whether samples are developed.
    pub fn develops(&self) -> bool {
        self.output.picture.is_some()
    }

    /// Items of a sample and their formats, in order.
    pub fn items(&self) -> Vec<(&'static str, Format)> {
        let output = &self.output;
        let all = [
            ("film", output.film),
            ("clean", output.clean),
            ("raw", output.raw),
            ("picture", output.picture),
        ];
        all.into_iter().filter_map(|(name, format)| Some((name, format?))).collect()
    }

    fn check(&self) -> Result<(), String> {
        if self.schema != SCHEMA {
            return Err(format!("schema: expected \"{SCHEMA}\", found {:?}", self.schema));
        }
        if let Some(samples) = self.samples
            && !(1..=MAX_SAMPLES).contains(&samples)
        {
            return Err(format!("samples: expected 1 to {MAX_SAMPLES}, found {samples}"));
        }
        if self.repeats == 0 || self.samples.is_some() && self.repeats != 1 {
            return Err("repeats: expected 1 or more, and none with `samples`".into());
        }
        for (field, texts) in [("pictures.files", &self.pictures.files), ("lens.name", &self.lens.name)] {
            if texts.0.is_empty() {
                return Err(format!("{field}: expected one or more, found none"));
            }
        }
        if self.pictures.size.is_some_and(|[width, height]| width == 0 || height == 0) {
            return Err("pictures.size: expected [width, height] in pixels, above 0".into());
        }
        let nm = self.pictures.wavelengths_nm.as_deref().unwrap_or_default();
        if nm.iter().any(|nm| !nm.is_finite() || *nm <= 0.0) {
            return Err("pictures.wavelengths_nm: expected numbers above 0".into());
        }
        self.check_numbers()?;
        self.check_output()
    }

    fn check_numbers(&self) -> Result<(), String> {
        let film = &self.film;
        if !(film.pitch_um > 0.0 && film.pitch_um.is_finite()) {
            return Err(format!("film.pitch_um: expected a number above 0, found {}", film.pitch_um));
        }
        if let Some(places) = &film.center_mm {
            if film.radius_mm.is_some() || film.angle_deg.is_some() {
                return Err("film: give center_mm, or radius_mm and angle_deg".into());
            }
            if places.is_empty() || places.iter().flatten().any(|v| !v.is_finite()) {
                return Err("film.center_mm: expected a list of [x, y] in mm".into());
            }
        }
        if film.angle_deg.is_some() && film.radius_mm.is_none() {
            return Err("film.angle_deg: needs radius_mm".into());
        }
        let sensor = self.sensor.as_ref();
        let bounded = [
            ("lens.focus_m", self.lens.focus_m.as_ref(), (1e-6, f64::INFINITY)),
            ("film.radius_mm", film.radius_mm.as_ref(), (0.0, 1e4)),
            ("film.angle_deg", film.angle_deg.as_ref(), (-360.0, 720.0)),
            ("sensor.exposure_ev", sensor.and_then(|s| s.exposure_ev.as_ref()), (-30.0, 30.0)),
            ("sensor.gain", sensor.and_then(|s| s.gain.as_ref()), (1.0, 64.0)),
        ];
        for (field, numbers, bounds) in bounded {
            if let Some(numbers) = numbers {
                numbers.check(field, bounds)?;
                if self.samples.is_none() && matches!(numbers, Numbers::Range(_)) {
                    return Err(format!(
                        "{field}: a range is drawn from; give `samples = N`, or a list of numbers"
                    ));
                }
            }
        }
        let is_polar = film.radius_mm.as_ref().is_some_and(|radii| radii != &Numbers::List(vec![0.0]));
        match is_polar && self.samples.is_none() && film.angle_deg.is_none() {
            true => {
                Err("film.angle_deg: without `samples = N` expected a list of numbers, found none".into())
            }
            false => Ok(()),
        }
    }

    fn check_output(&self) -> Result<(), String> {
        if self.items().is_empty() {
            return Err(
                "output: expected one or more of film, clean, raw, picture, e.g. film = \"png\"".into()
            );
        }
        for (name, format) in self.items() {
            if self.output.layout == Layout::Zarr && format != Format::Npy {
                return Err(format!(
                    "output.{name}: a Zarr store holds arrays; expected \"npy\" with as = \"zarr\""
                ));
            }
            if ["raw", "picture"].contains(&name) && self.sensor.is_none() {
                return Err(format!("output.{name}: needs a table [sensor]"));
            }
        }
        if !(self.output.white > 0.0 && self.output.white.is_finite()) {
            return Err(format!("output.white: expected a number above 0, found {}", self.output.white));
        }
        if self.output.unit.is_some_and(|unit| !(1..=65_536).contains(&unit)) {
            return Err("output.unit: expected 1 to 65536 samples".into());
        }
        if let Some(scale) = self.sensor.as_ref().and_then(|s| s.film_scale)
            && !(scale > 0.0 && scale.is_finite())
        {
            return Err(format!("sensor.film_scale: expected a number above 0, found {scale}"));
        }
        Ok(())
    }
}
