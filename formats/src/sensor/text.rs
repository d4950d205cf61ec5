//! The fields of a sensor description as they stand in its TOML, schema `lenscube/sensor/1`. Unknown fields are errors.

use std::collections::BTreeMap;

use pipeline::sensor::{Companding, Defects, DualGain, NoiseFigures, NoiseSpectrum};
use serde::{Deserialize, Serialize};

/// What marks a description.
pub(super) const SCHEMA: &str = "lenscube/sensor/1";

#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SensorText {
    pub schema: String,
    pub name: String,
    pub description: String,
    pub pixel: PixelText,
    #[serde(default)]
    pub noise: NoiseFigures,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise_spectrum: Option<NoiseSpectrum>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub defects: Option<Defects>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shutter: Option<ShutterText>,
    pub adc: AdcText,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dual_gain: Option<DualGainText>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub companding: Option<CompandingText>,
    pub spectral: SpectralText,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle: Option<AngleText>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub plate: Vec<PlateText>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crosstalk: Option<CrosstalkText>,
    pub cfa: BTreeMap<String, CfaText>,
    pub source: BTreeMap<String, String>,
}

#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PixelText {
    pub pitch_um: PitchText,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size: Option<(usize, usize)>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aperture_um: Option<f64>,
    #[serde(default)]
    pub quantum_efficiency_of: AreaText,
    pub full_well_e: f64,
    #[serde(default = "no_knee", skip_serializing_if = "is_no_knee")]
    pub knee: f64,
    #[serde(default, skip_serializing_if = "is_zero")]
    pub blooming: f64,
    #[serde(default)]
    pub dark_current_e_per_s: f64,
    #[serde(default = "reference_c")]
    pub dark_reference_c: f64,
    #[serde(default = "doubling_k")]
    pub dark_doubling_k: f64,
}

fn reference_c() -> f64 {
    25.0
}

fn doubling_k() -> f64 {
    7.0
}

fn no_knee() -> f64 {
    1.0
}

fn is_no_knee(knee: &f64) -> bool {
    *knee == no_knee()
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(untagged, expecting = "expected a number in µm or \"film\"")]
pub(super) enum PitchText {
    Um(f64),
    Film(FilmWord),
}

#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum FilmWord {
    Film,
}

#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum AreaText {
    #[default]
    Pixel,
    Aperture,
}

#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AdcText {
    pub bits: u32,
    pub gain_dn_per_e: f64,
    pub black_dn: f64,
    #[serde(default)]
    pub gains: Vec<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base_iso: Option<f64>,
}

#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SpectralText {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quantity: Option<QuantityText>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub peak_quantum_efficiency: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub constant: Option<f64>,
    #[serde(default)]
    pub filters: Vec<String>,
}

#[derive(Clone, Copy, Debug, Deserialize, Serialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub(super) enum QuantityText {
    QuantumEfficiency,
    RelativeResponse,
}

/// `cfa.pattern`, or a filter of it.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(
    untagged,
    expecting = "expected rows of names for `pattern`, or { column = \"…\", plane = \"…\" } for a filter"
)]
pub(super) enum CfaText {
    Pattern(Vec<Vec<String>>),
    Filter(FilterText),
}

#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FilterText {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub column: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plane: Option<String>,
}

/// Response of pixels over the angle of incidence.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AngleText {
    pub stack_index: f64,
    #[serde(default = "centred")]
    pub microlenses: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acceptance_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exponent: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub filters: BTreeMap<String, AcceptanceText>,
}

fn centred() -> String {
    CENTRED.into()
}

impl AngleText {
    /// That of filters without one of their own.
    pub(super) fn of_all(&self) -> AcceptanceText {
        AcceptanceText {
            acceptance_deg: self.acceptance_deg,
            exponent: self.exponent,
            file: self.file.clone(),
        }
    }
}

/// Words of `angle.microlenses`; else a table.
pub(super) const CENTRED: &str = "centred";
pub(super) const OF_LENS: &str = "lens";

/// Response of a filter's pixels: a half width, or a table.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AcceptanceText {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acceptance_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exponent: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
}

/// A plate in front of the sensor.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PlateText {
    pub file: String,
    pub kind: PlateWord,
    pub index: f64,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub besides_lens: bool,
}

#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum PlateWord {
    Interference,
    Absorbing,
}

/// What pixels collect of the light of their neighbours: a table, diffusion, or the one and then the other.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CrosstalkText {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diffusion_length_um: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depletion_um: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub absorption: Option<String>,
}

/// When rows are exposed.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ShutterText {
    pub row_time_us: f64,
}

/// A second reading of each exposure, of a lower conversion gain. Fields that are missing are out of range, so that `--set` gives one after the other.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct DualGainText {
    pub ratio: f64,
    pub bits: u32,
    pub read_noise_e: f64,
    pub transition_dn: (f64, f64),
}

impl DualGainText {
    pub(super) fn dual_gain(self) -> DualGain {
        let Self { ratio, bits, read_noise_e, transition_dn } = self;
        DualGain { ratio, bits, read_noise_e, transition_dn }
    }
}

/// Knee points from linear numbers to those of a raw.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct CompandingText {
    pub linear_dn: Vec<f64>,
    pub coded_dn: Vec<f64>,
}

impl CompandingText {
    pub(super) fn companding(&self) -> Companding {
        Companding { linear_dn: self.linear_dn.clone(), coded_dn: self.coded_dn.clone() }
    }
}
