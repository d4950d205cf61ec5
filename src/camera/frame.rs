//! One frame of a raw: its pixels, its sensor, and what its film records.

use super::noise::RawNoise;
use crate::failure::usage;
use anyhow::{Result, bail};
use formats::chart::{ChartOptions, ChartStore};
use formats::raw::{RawShard, RawSpec, RawStore};
use formats::sensor::SensorFile;
use pipeline::colour::Illuminant;
use pipeline::develop::defects;
use pipeline::develop::merge::Bracket;
use pipeline::geometry::Rect;
use pipeline::sensor::Sensor;
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// A frame of one array of a raw.
pub struct Frame {
    store: ChartStore,
    path: PathBuf,
    /// Number of the array.
    output: usize,
    #[cfg(feature = "view")]
    array: String,
    frame: usize,
    /// Layout of the raw.
    pub spec: RawSpec,
    /// Pixels of the array on the sensor.
    pub rect: Rect,
    /// All that the raw records.
    pub attributes: Map<String, Value>,
    /// The sensor.
    pub sensor: Sensor,
    /// Gain of the converter.
    pub gain: f64,
    /// All frames, shortest first, that are read as one.
    bracket: Option<(Bracket, Vec<usize>)>,
    /// Whether pixels that differ from their neighbours by more than noise are replaced.
    corrects_defects: bool,
    /// Linear number of every stored one, where they differ.
    linear_dn: Option<Vec<f32>>,
}

/// `PATH//array` of a group; an empty name without `//`. Unlike charts, a film or raw is always the group, also where the directory of
/// the array exists.
pub fn split_group(spec: &str) -> (&str, &str) {
    match spec.rsplit_once("//") {
        Some((path, array)) if !path.is_empty() && !array.is_empty() && !path.ends_with(':') => {
            (path, array.trim_matches('/'))
        }
        _ => (spec, ""),
    }
}

/// Index of the array `array` of the film or raw (`kind`) at `path`, which has the arrays `names`; the only one if `array` is empty.
///
/// # Errors
/// Usage: no such array; several arrays and no name.
pub fn array_index(kind: &str, path: &str, names: &[&str], array: &str) -> Result<usize> {
    let list = names.join(", ");
    match (array, names.len()) {
        ("", 1) => Ok(0),
        ("", _) => {
            Err(usage(format!("{kind} {path} has the arrays {list}; name one, e.g. {path}//{}", names[0])))
        }
        (name, _) => names
            .iter()
            .position(|n| *n == name)
            .ok_or_else(|| usage(format!("{kind} {path} has no array `{name}`; it has {list}"))),
    }
}

impl Frame {
    /// Opens frame `frame` of the raw `PATH` or `PATH//array`, with a cache of decoded chunks.
    ///
    /// # Errors
    /// No raw, no such array or frame, no sensor (2); missing shards (1).
    pub fn open(spec: &str, frame: usize, cache_bytes: usize) -> Result<Self> {
        let (name, array) = split_group(spec);
        let path = Path::new(name);
        let raw = RawStore::open(path, true).map_err(|e| match e {
            formats::group::GroupError::NotOfKind { .. } => usage(e.to_string()),
            e => e.into(),
        })?;
        let layout = raw.spec().clone();
        let names: Vec<&str> = layout.outputs.iter().map(|o| o.name.as_str()).collect();
        let output = array_index("raw", name, &names, array)?;
        let frames = layout.exposure_s.len();
        if frame >= frames {
            return Err(usage(format!(
                "--frame {frame}: raw {} has {frames} frames, 0 to {}",
                path.display(),
                frames - 1
            )));
        }
        check_complete(&raw, output, frame)?;
        let attributes = raw.attributes().clone();
        let shown = path.display();
        let sensor = SensorFile::from_record(path, &attributes.get("sensor").cloned().unwrap_or_default())
            .map_err(|e| usage(format!("raw {shown} does not describe its sensor: {e}")))?
            .sensor(layout.pitch_um);
        let linear_dn = sensor.adc.linear_table();
        let gain = attributes.get("gain").and_then(Value::as_f64).filter(|g| *g > 0.0);
        let gain = gain.ok_or_else(|| usage(format!("raw {shown} does not record its gain")))?;
        let options = ChartOptions {
            // Frames take the place of bands, which have wavelengths.
            wavelengths_nm: Some((1..=frames).map(|f| f as f64).collect()),
            cache_bytes,
            ..ChartOptions::default()
        };
        let store = ChartStore::open_at(path, names[output], options)?;
        let rect = layout.outputs[output].rect;
        #[cfg(feature = "view")]
        let array = names[output].to_owned();
        Ok(Self {
            store,
            path: path.into(),
            output,
            #[cfg(feature = "view")]
            array,
            frame,
            rect,
            attributes,
            sensor,
            gain,
            spec: layout,
            bracket: None,
            corrects_defects: false,
            linear_dn,
        })
    }

    /// With all frames of the raw as one, of the brightness of this one.
    ///
    /// # Errors
    /// A raw of one exposure time (2); missing shards of a frame (1).
    pub fn merged(self) -> Result<Self> {
        let mut order: Vec<usize> = (0..self.spec.exposure_s.len()).collect();
        order.sort_by(|a, b| self.spec.exposure_s[*a].total_cmp(&self.spec.exposure_s[*b]));
        let times_s: Vec<f64> = order.iter().map(|k| self.spec.exposure_s[*k]).collect();
        if times_s[0] == times_s[times_s.len() - 1] {
            return Err(usage(format!(
                "--merge: expected frames of several exposure times, found {} of {} s; make them by `lenscube sensor --exposure 1ms,4ms,16ms`",
                times_s.len(),
                times_s[0]
            )));
        }
        let raw = RawStore::open(&self.path, true)?;
        order.iter().try_for_each(|frame| check_complete(&raw, self.output, *frame))?;
        let (sensor, pixel) = (&self.sensor, &self.sensor.pixel);
        let bracket = Bracket {
            times_s,
            reference_s: self.exposure_s(),
            black_dn: sensor.adc.black_dn,
            dn_per_e: self.gain * sensor.adc.gain_dn_per_e,
            limit_e: sensor.saturation_e(self.gain).min(pixel.overflow.knee * pixel.full_well_e),
            dark_variance_e2: self.noise().dark_variance_e2(sensor, self.gain),
            low_gain: self.noise().low_gain(sensor, self.gain),
        };
        Ok(Self { bracket: Some((bracket, order)), ..self })
    }

    /// With pixels that differ from their neighbours by more than noise replaced.
    #[must_use]
    pub fn without_defects(self) -> Self {
        Self { corrects_defects: true, ..self }
    }

    /// Frames that are read for one.
    pub fn reads(&self) -> usize {
        self.bracket.as_ref().map_or(1, |(_, order)| order.len())
    }

    /// Ratio of the greatest value to that of saturation: above 1 where frames are read as one.
    pub fn range(&self) -> f64 {
        self.bracket.as_ref().map_or(1.0, |(bracket, _)| bracket.range())
    }

    /// Numbers of pixels of the array as they are stored: coded ones of a companded raw.
    pub fn read_stored(&self, rect: Rect) -> Result<Vec<f32>> {
        let mut pixels = vec![0.0; rect.size().pixels()];
        self.store.read_rect(self.frame, rect, &mut pixels)?;
        Ok(pixels)
    }

    /// Linear numbers in place of stored ones, or of means of them (levels of a pyramid), which are whole numbers.
    pub fn linearize(&self, numbers: &mut [f32]) {
        if let Some(table) = &self.linear_dn {
            numbers.iter_mut().for_each(|v| *v = table[(*v as usize).min(table.len() - 1)]);
        }
    }

    /// Linear digital numbers of pixels of the array; of frames that are read as one, those that this frame would have without an end.
    pub fn read(&self, rect: Rect) -> Result<Vec<f32>> {
        match &self.bracket {
            None => self.read_frame(self.frame, rect),
            Some((bracket, order)) => {
                let frames: Result<Vec<_>> = order.iter().map(|k| self.read_frame(*k, rect)).collect();
                Ok(bracket.merged(&frames?))
            }
        }
    }

    fn read_frame(&self, frame: usize, rect: Rect) -> Result<Vec<f32>> {
        let numbers = |rect: Rect| -> Result<Vec<f32>> {
            let mut pixels = vec![0.0; rect.size().pixels()];
            self.store.read_rect(frame, rect, &mut pixels)?;
            self.linearize(&mut pixels);
            Ok(pixels)
        };
        if !self.corrects_defects {
            return numbers(rect);
        }
        let (pattern, adc) = (&self.sensor.pattern, &self.sensor.adc);
        let period = (pattern.rows, pattern.columns);
        let read = defects::needs(rect, period, self.rect.size().rect());
        let dn_per_e = self.gain * adc.gain_dn_per_e;
        let sigma_e = self.noise().sigma_e(&self.sensor, self.gain, self.spec.exposure_s[frame]);
        let sigma_dn = |dn: f64| dn_per_e * sigma_e((dn - adc.black_dn) / dn_per_e);
        Ok(defects::corrected(&numbers(read)?, (rect, read), period, sigma_dn))
    }

    fn noise(&self) -> RawNoise {
        RawNoise::recorded(&self.attributes)
    }

    /// Standard deviation of a pixel of some mean charge over frames and dies, e-.
    pub fn sigma_e(&self, mean_e: f64) -> f64 {
        self.noise().sigma_e(&self.sensor, self.gain, self.exposure_s())(mean_e)
    }

    /// Mean dark charge of a pixel, e-.
    pub fn dark_e(&self) -> f64 {
        self.noise().dark_e(&self.sensor, self.exposure_s())
    }

    /// Digital numbers of no light and of saturation.
    pub fn black_white_dn(&self) -> (f64, f64) {
        (self.sensor.adc.black_dn, self.sensor.white_dn(self.gain))
    }

    /// Light of the film's chart, if it is recorded.
    pub fn light(&self) -> Option<Illuminant> {
        self.attributes.get("film")?["light"].as_str()?.parse().ok()
    }

    /// Wavelengths of the film's bands, nm.
    pub fn wavelengths_nm(&self) -> Vec<f64> {
        let all = self.attributes.get("film_wavelengths_nm").and_then(Value::as_array);
        all.into_iter().flatten().filter_map(Value::as_f64).collect()
    }

    /// Exposure time, s.
    pub fn exposure_s(&self) -> f64 {
        self.spec.exposure_s[self.frame]
    }

    /// Name of the array.
    #[cfg(feature = "view")]
    pub fn array(&self) -> &str {
        &self.array
    }

    /// Number of the frame.
    pub fn number(&self) -> usize {
        self.frame
    }

    /// Digest of the raw's job.
    pub fn job_digest(&self) -> &str {
        self.attributes.get("provenance").and_then(|p| p["job_digest"].as_str()).unwrap_or("unknown")
    }
}

/// Fails unless all shards of a frame are there.
fn check_complete(raw: &RawStore, output: usize, frame: usize) -> Result<()> {
    let own = |s: &RawShard| s.output == output && s.frame == Some(frame);
    let shards: Vec<RawShard> = raw.spec().all_shards().into_iter().filter(own).collect();
    let missing = raw.missing(&shards)?;
    if let Some(first) = missing.first() {
        bail!(
            "raw {}: {} of {} shards of frame {frame} are missing ({} is the first); finish it by the same `lenscube sensor`",
            raw.path().display(),
            missing.len(),
            shards.len(),
            raw.spec().key(*first)
        );
    }
    Ok(())
}
