//! Sensors: descriptions in TOML (schema `lenscube/sensor/1`) with curves in CSV, from files or built in.
//!
//! A description is read whole and checked before anything else happens: unknown fields are errors with line and column, numbers out of range
//! with field, expected and found. A curve's file is in the directory of the description; a name without a file there is looked up among the built-in
//! tables. The angles of incidence are in `angle`, crosstalk in `crosstalk`. [`SensorFile::sensor`] is the sensor of the pipeline, [`SensorFile::record`] its record in a raw.

mod angle;
mod builtin;
mod check;
mod check_range;
mod crosstalk;
mod error;
mod set;
mod table;
mod text;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use pipeline::sensor::{Adc, Channel, Curve, Overflow, Pattern, Pixel, QuantumEfficiencyOf, Sensor};
use serde_json::{Map, Value, json};

pub use builtin::builtin_names;
pub use error::SensorError;

use crate::durable::{Directory, is_url, parent_of};
use crate::toml_error::located;
use angle::{AngleFile, PlateFile};
use crosstalk::CrosstalkFile;
use set::replace;
pub use set::sensor_tables;
use table::Quantity;
use text::{AreaText, CompandingText, DualGainText, FilterText, PitchText, QuantityText, SCHEMA, SensorText};

/// Largest description and table that are read, bytes.
const MAX_DESCRIPTION: u64 = 1 << 20;
const MAX_TABLE: u64 = 16 << 20;

/// A sensor description with its curves.
#[derive(Clone, Debug)]
pub struct SensorFile {
    text: SensorText,
    /// Arguments of `--set`, as typed.
    set: Vec<String>,
    channels: Vec<Channel>,
    filters: Vec<Curve>,
    angle: Option<AngleFile>,
    plates: Vec<PlateFile>,
    crosstalk: Option<CrosstalkFile>,
    pattern: Pattern,
}

/// Fields that no built-in description has.
const LATER_FIELDS: [&str; 19] = [
    "pixel.knee",
    "pixel.blooming",
    "crosstalk.file",
    "crosstalk.diffusion_length_um",
    "crosstalk.depletion_um",
    "crosstalk.absorption",
    "defects.hot_pixels",
    "defects.hot_dark_e_per_s",
    "defects.telegraph_pixels",
    "defects.telegraph_e",
    "shutter.row_time_us",
    "dual_gain.ratio",
    "dual_gain.bits",
    "dual_gain.read_noise_e",
    "dual_gain.transition_dn",
    "companding.linear_dn",
    "companding.coded_dn",
    "noise_spectrum.row_exponent",
    "noise_spectrum.column_exponent",
];

/// Fields that `--set` replaces, as `table.field`: those of the built-in descriptions and a few more.
pub fn field_names() -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for text in builtin_names().into_iter().filter_map(builtin::description) {
        let Ok(text) = toml::from_str::<SensorText>(text) else { continue };
        let text = serde_json::to_value(&text).unwrap_or_default();
        for table in ["pixel", "noise", "adc", "spectral"] {
            let fields = text[table].as_object().into_iter().flat_map(Map::keys);
            names.extend(fields.map(|field| format!("{table}.{field}")));
        }
    }
    names.extend(LATER_FIELDS.map(str::to_owned));
    names
}

/// A value with its source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    /// Field, or `*` for those without one of their own.
    pub field: String,
    /// Where it is from.
    pub text: String,
}

impl SensorFile {
    /// The built-in sensor `name`, or the description at the path `name`, with `set` (`FIELD=VALUE`) applied.
    ///
    /// # Errors
    /// [`SensorError`] if there is none, or it cannot be.
    pub fn open(name: &str, set: &[String]) -> Result<Self, SensorError> {
        if let Some(text) = builtin::description(name) {
            return Self::parse(Path::new(name), text, set, None);
        }
        let path = Path::new(name);
        let is_file = name.ends_with(".toml") || name.contains('/') || path.is_file();
        if !is_file || is_url(path) {
            let (builtin, nearest) = (builtin_names(), builtin::nearest(name));
            return Err(SensorError::Unknown { name: name.into(), builtin, nearest });
        }
        let text = read(path, MAX_DESCRIPTION)?;
        let text =
            text.ok_or_else(|| SensorError::Syntax { path: path.into(), message: "no such file".into() })?;
        Self::parse(path, &text, set, Some(parent_of(path)))
    }

    /// From the text of a description; its tables lie in `directory`.
    fn parse(
        path: &Path,
        source: &str,
        set: &[String],
        directory: Option<&Path>,
    ) -> Result<Self, SensorError> {
        let syntax = |message: String| SensorError::Syntax { path: path.into(), message };
        let mut table: toml::Table = toml::from_str(source).map_err(|e| syntax(located(&e, source)))?;
        match table.get("schema") {
            Some(toml::Value::String(s)) if s == SCHEMA => {}
            found => {
                let text = |v: &toml::Value| {
                    v.as_str().map_or("a value that is no text".into(), |s| format!("{s:?}"))
                };
                let found = found.map_or("nothing".to_owned(), text);
                return Err(syntax(format!("schema: expected \"{SCHEMA}\", found {found}")));
            }
        }
        let mut text: SensorText = toml::from_str(source).map_err(|e| syntax(located(&e, source)))?;
        for word in set {
            replace(&mut table, word).map_err(|message| SensorError::Set { set: word.clone(), message })?;
        }
        // Together: a group of fields may need several.
        if !set.is_empty() {
            text = SensorText::deserialize_from(&table).map_err(|e| SensorError::Set {
                set: set.join(" --set "),
                message: e.message().trim().to_owned(),
            })?;
        }
        Self::with(path, text, set.to_vec(), directory)
    }

    fn with(
        path: &Path,
        text: SensorText,
        set: Vec<String>,
        directory: Option<&Path>,
    ) -> Result<Self, SensorError> {
        check::fields(path, &text)?;
        check_range::fields(path, &text)?;
        let (names, pattern) = check::pattern(path, &text.cfa)?;
        let curves = Curves { path, directory, text: &text };
        let channels = curves.channels(&names)?;
        let filters = curves.filters()?;
        let names: Vec<String> = names.into_iter().map(|(name, _)| name).collect();
        let angle = text.angle.as_ref().map(|angle| AngleFile::read(&curves, angle, &names)).transpose()?;
        let plates =
            text.plate.iter().map(|plate| PlateFile::read(&curves, plate)).collect::<Result<_, _>>()?;
        let crosstalk = text.crosstalk.as_ref().map(|text| CrosstalkFile::read(&curves, text)).transpose()?;
        let file = Self { text, set, channels, filters, angle, plates, crosstalk, pattern };
        check::sensor(path, &file)?;
        Ok(file)
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.text.name
    }

    /// The sensor behind a film of this pitch.
    pub fn sensor(&self, film_pitch_um: f64) -> Sensor {
        let (p, a) = (&self.text.pixel, &self.text.adc);
        let pitch_um = self.pitch_um().unwrap_or(film_pitch_um);
        let aperture_um = p.aperture_um.unwrap_or(pitch_um);
        Sensor {
            name: self.text.name.clone(),
            description: self.text.description.clone(),
            pixel: Pixel {
                pitch_um,
                size: p.size,
                aperture_um,
                quantum_efficiency_of: match p.quantum_efficiency_of {
                    AreaText::Pixel => QuantumEfficiencyOf::Pixel,
                    AreaText::Aperture => QuantumEfficiencyOf::Aperture,
                },
                full_well_e: p.full_well_e,
                overflow: Overflow { knee: p.knee, blooming: p.blooming },
                dark_current_e_per_s: p.dark_current_e_per_s,
                dark_reference_c: p.dark_reference_c,
                dark_doubling_k: p.dark_doubling_k,
            },
            noise: self.text.noise,
            noise_spectrum: self.text.noise_spectrum.unwrap_or_default(),
            defects: self.text.defects.unwrap_or_default(),
            row_time_s: self.text.shutter.map_or(0.0, |shutter| shutter.row_time_us * 1e-6),
            adc: Adc {
                bits: a.bits,
                gain_dn_per_e: a.gain_dn_per_e,
                black_dn: a.black_dn,
                gains: a.gains.clone(),
                base_iso: a.base_iso,
                dual_gain: self.text.dual_gain.map(DualGainText::dual_gain),
                companding: self.text.companding.as_ref().map(CompandingText::companding),
            },
            channels: self.channels.clone(),
            per_energy: self.per_energy(),
            filters: self.filters.clone(),
            plates: self.plates.iter().map(PlateFile::plate).collect(),
            angle: self.angle.as_ref().map(AngleFile::response),
            crosstalk: self.crosstalk.as_ref().map(|file| file.crosstalk(pitch_um, aperture_um)),
            pattern: self.pattern.clone(),
        }
    }

    /// Whether it has a plate that may be one of the lens: a plate without `besides_lens`.
    pub fn may_repeat_plates(&self) -> bool {
        self.text.plate.iter().any(|plate| !plate.besides_lens)
    }

    /// Pixel pitch in µm; `None` if it is the film's.
    pub fn pitch_um(&self) -> Option<f64> {
        match self.text.pixel.pitch_um {
            PitchText::Um(v) => Some(v),
            PitchText::Film(_) => None,
        }
    }

    fn per_energy(&self) -> bool {
        self.text.spectral.quantity == Some(QuantityText::RelativeResponse)
    }

    /// Where its numbers are from.
    pub fn sources(&self) -> Vec<Source> {
        let one = |(field, text): (&String, &String)| Source { field: field.clone(), text: text.clone() };
        self.text.source.iter().map(one).collect()
    }

    /// All of it, for a raw: the description with what `--set` replaced, and the curves.
    pub fn record(&self) -> Value {
        let curve = |c: &Curve| json!({ "wavelength_nm": c.wavelengths_nm, "value": c.values });
        let channels: Map<String, Value> =
            self.channels.iter().map(|c| (c.name.clone(), curve(&c.curve))).collect();
        let mut record = json!({
            "description": serde_json::to_value(&self.text).expect("names and numbers are JSON"),
            "set": self.set,
            "curves": channels,
            "curves_per_energy": self.per_energy(),
            "filters": self.filters.iter().map(curve).collect::<Vec<_>>(),
        });
        if let Some(angle) = &self.angle {
            record["angle"] = serde_json::to_value(angle).expect("names and numbers are JSON");
        }
        if !self.plates.is_empty() {
            record["plates"] = serde_json::to_value(&self.plates).expect("names and numbers are JSON");
        }
        if let Some(crosstalk) = &self.crosstalk {
            record["crosstalk"] = serde_json::to_value(crosstalk).expect("names and numbers are JSON");
        }
        record
    }

    /// The sensor of a raw, from what [`SensorFile::record`] kept.
    ///
    /// # Errors
    /// [`SensorError`] if it is damaged.
    pub fn from_record(path: &Path, record: &Value) -> Result<Self, SensorError> {
        let damaged =
            |what: String| SensorError::Syntax { path: path.into(), message: format!("its sensor: {what}") };
        let text: SensorText =
            serde_json::from_value(record["description"].clone()).map_err(|e| damaged(e.to_string()))?;
        check::fields(path, &text)?;
        check_range::fields(path, &text)?;
        let (names, pattern) = check::pattern(path, &text.cfa)?;
        let numbers = |v: &Value| -> Option<Vec<f64>> { v.as_array()?.iter().map(Value::as_f64).collect() };
        let curve = |v: &Value| -> Option<Curve> {
            let (wavelengths_nm, values) = (numbers(&v["wavelength_nm"])?, numbers(&v["value"])?);
            let ascending = wavelengths_nm.is_sorted_by(|a, b| a < b);
            let fits = ascending && wavelengths_nm.len() == values.len() && values.len() >= 2;
            fits.then_some(Curve { wavelengths_nm, values })
        };
        let mut channels = Vec::new();
        for (name, filter) in names {
            let curve =
                curve(&record["curves"][&name]).ok_or_else(|| damaged(format!("the curve of {name}")))?;
            channels.push(Channel { plane: filter.plane.unwrap_or_else(|| name.clone()), name, curve });
        }
        let filters =
            record["filters"].as_array().map(|all| all.iter().map(curve).collect::<Option<Vec<_>>>());
        let filters = filters.flatten().ok_or_else(|| damaged("its filters".into()))?;
        let set = serde_json::from_value(record["set"].clone()).map_err(|e| damaged(e.to_string()))?;
        let wrong = |(field, expected, found): (String, String, String)| {
            damaged(format!("{field}: expected {expected}, found {found}"))
        };
        let angle: Option<AngleFile> =
            serde_json::from_value(record["angle"].clone()).map_err(|e| damaged(format!("angle: {e}")))?;
        angle.as_ref().map_or(Ok(()), |angle| angle.check(channels.len())).map_err(wrong)?;
        let plates: Option<Vec<PlateFile>> =
            serde_json::from_value(record["plates"].clone()).map_err(|e| damaged(format!("plates: {e}")))?;
        let plates = plates.unwrap_or_default();
        plates.iter().try_for_each(PlateFile::check).map_err(wrong)?;
        if angle.is_some() != text.angle.is_some() || plates.len() != text.plate.len() {
            return Err(damaged("its response over the angle".into()));
        }
        let crosstalk: Option<CrosstalkFile> = serde_json::from_value(record["crosstalk"].clone())
            .map_err(|e| damaged(format!("crosstalk: {e}")))?;
        crosstalk.as_ref().map_or(Ok(()), CrosstalkFile::check).map_err(wrong)?;
        if crosstalk.is_some() != text.crosstalk.is_some() {
            return Err(damaged("its crosstalk".into()));
        }
        Ok(Self { text, set, channels, filters, angle, plates, crosstalk, pattern })
    }
}

/// Where curves are looked up.
struct Curves<'a> {
    path: &'a Path,
    directory: Option<&'a Path>,
    text: &'a SensorText,
}

impl Curves<'_> {
    fn wrong(&self, field: &str, expected: &str, found: &str) -> SensorError {
        check::wrong(self.path, field, expected, found)
    }

    /// The path and the text of a table.
    fn table(&self, field: &str, file: &str) -> Result<(PathBuf, String), SensorError> {
        if let Some(directory) = self.directory {
            let path = directory.join(file);
            if let Some(text) = read(&path, MAX_TABLE)? {
                return Ok((path, text));
            }
        }
        match builtin::table(file) {
            Some(text) => Ok((file.into(), text.into())),
            None => {
                let expected = "a CSV file beside the description, or a built-in table";
                Err(self.wrong(field, expected, &format!("no file {file}")))
            }
        }
    }

    fn channels(&self, names: &[(String, FilterText)]) -> Result<Vec<Channel>, SensorError> {
        let s = &self.text.spectral;
        let missing = |field: String, expected: &str| self.wrong(&field, expected, "nothing");
        let plane =
            |(name, filter): &(String, FilterText)| filter.plane.clone().unwrap_or_else(|| name.clone());
        if let Some(constant) = s.constant {
            let curve = Curve { wavelengths_nm: vec![1.0, 1e6], values: vec![constant; 2] };
            let one = |n: &(String, FilterText)| Channel {
                name: n.0.clone(),
                plane: plane(n),
                curve: curve.clone(),
            };
            return Ok(names.iter().map(one).collect());
        }
        let file = s
            .file
            .as_ref()
            .ok_or_else(|| missing("spectral.file".into(), "a CSV file, or spectral.constant"))?;
        let relative = s.quantity == Some(QuantityText::RelativeResponse);
        let quantity = if relative { Quantity::Response } else { Quantity::Share("quantum efficiency") };
        let (path, text) = self.table("spectral.file", file)?;
        let mut channels = Vec::new();
        for named in names {
            let column = named.1.column.as_ref();
            let column = column
                .ok_or_else(|| missing(format!("cfa.{}.column", named.0), &format!("a column of {file}")))?;
            let curve = table::curve(&path, &text, column, quantity)?;
            channels.push(Channel { name: named.0.clone(), plane: plane(named), curve });
        }
        if let Some(peak) = s.peak_quantum_efficiency.filter(|_| relative) {
            // The highest quantum efficiency of all channels is the stated peak.
            let of = |c: &Channel| {
                std::iter::zip(&c.curve.values, &c.curve.wavelengths_nm)
                    .map(|(v, nm)| v / nm)
                    .fold(0.0, f64::max)
            };
            let top = channels.iter().map(of).fold(0.0, f64::max);
            for channel in &mut channels {
                channel.curve.values.iter_mut().for_each(|v| *v *= peak / top);
            }
        }
        Ok(channels)
    }

    fn filters(&self) -> Result<Vec<Curve>, SensorError> {
        let one = |file: &String| {
            let (path, text) = self.table("spectral.filters", file)?;
            table::curve(&path, &text, "transmittance", Quantity::Share("transmittance"))
        };
        self.text.spectral.filters.iter().map(one).collect()
    }
}

impl SensorText {
    fn deserialize_from(table: &toml::Table) -> Result<Self, toml::de::Error> {
        table.clone().try_into()
    }
}

/// The text of a file; `None` if there is none.
fn read(path: &Path, limit: u64) -> Result<Option<String>, SensorError> {
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let Some(bytes) = Directory::new(parent_of(path)).read_at_most(&name, limit)? else { return Ok(None) };
    match String::from_utf8(bytes) {
        Ok(text) => Ok(Some(text)),
        Err(_) => Err(SensorError::Syntax { path: path.into(), message: "expected UTF-8 text".into() }),
    }
}

/// The reflectance of a film or a surface in the CSV at `path`: columns `wavelength_nm`, ascending, and `reflectance`, 0 to 1.
///
/// # Errors
/// [`SensorError`] of a file that cannot be read or is no such table.
pub fn film_reflectance(path: &Path) -> Result<Curve, SensorError> {
    table_at(path, "reflectance", Quantity::Reflectance)
}

/// The relative power of a light in the CSV at `path`: columns `wavelength_nm`, ascending, and `power`, not negative.
///
/// # Errors
/// As [`film_reflectance`].
pub fn relative_power(path: &Path) -> Result<Curve, SensorError> {
    table_at(path, "power", Quantity::Response)
}

/// Heights on the film (mm, ascending), chief-ray angles (degrees) and F-numbers in the CSV at `path`: columns `height_mm`, `cra_deg`, `f_number`.
///
/// # Errors
/// As [`film_reflectance`].
pub fn chief_ray_angles(path: &Path) -> Result<Vec<[f64; 3]>, SensorError> {
    let rows = table::columns(path, &text_at(path)?, ["height_mm", "cra_deg", "f_number"])?;
    Ok(rows.into_iter().map(|(_, row)| row).collect())
}

/// Rows of a table of the motion of a camera; times in s, ascending.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraMotion {
    /// Time, shift of the picture on the film (µm; right, down), rotation (degrees).
    Shifts(Vec<[f64; 4]>),
    /// Time, rates of a gyroscope about x, y and z (degrees a second).
    Rates(Vec<[f64; 4]>),
}

/// The motion in the CSV at `path`: columns `time_s`, `x_um`, `y_um`, `rotation_deg`, or `time_s`, `rate_x_deg_s`, `rate_y_deg_s`, `rate_z_deg_s`.
///
/// # Errors
/// As [`film_reflectance`].
pub fn camera_motion(path: &Path) -> Result<CameraMotion, SensorError> {
    let text = text_at(path)?;
    let head = text.lines().map(str::trim).find(|line| !line.is_empty()).unwrap_or_default();
    let has_rates = table::names_of(head).iter().any(|name| name.starts_with("rate_"));
    let wanted = match has_rates {
        true => ["time_s", "rate_x_deg_s", "rate_y_deg_s", "rate_z_deg_s"],
        false => ["time_s", "x_um", "y_um", "rotation_deg"],
    };
    let rows = table::columns(path, &text, wanted)?.into_iter().map(|(_, row)| row).collect();
    Ok(if has_rates { CameraMotion::Rates(rows) } else { CameraMotion::Shifts(rows) })
}

fn table_at(path: &Path, column: &str, quantity: Quantity) -> Result<Curve, SensorError> {
    table::curve(path, &text_at(path)?, column, quantity)
}

/// The text of a table.
fn text_at(path: &Path) -> Result<String, SensorError> {
    let missing = || SensorError::Table { path: path.into(), problem: "is not there".into() };
    read(path, MAX_TABLE)?.ok_or_else(missing)
}

#[cfg(test)]
mod tests;
