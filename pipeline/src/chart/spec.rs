//! What chart to draw, in words or in types: `KIND?key=value&key=value`, as in
//! `gen:composite?size=14141&wavelengths=400:700:10&pitch_um=2&overscan=200`. Both ways end in one [`ChartSpec`]; its
//! `Display` writes every setting, so that equal charts have equal words.

use super::noise;
use crate::bounds::{BANDS, FILM_SIDE_PX, PITCH_UM, WAVELENGTH_NM};
use crate::colour::{FIRST_NM, Illuminant, LAST_NM};
use crate::geometry::Size;
use crate::wavelengths::{self, WavelengthError};
use crate::words::changes;

/// Longest side of a film.
const MAX_SIDE: usize = FILM_SIDE_PX.most as usize;
/// Most blobs or stars along a side, and most edges of a list: they are searched one by one for every rectangle.
const MAX_ALONG: usize = 128;

const COMMON_KEYS: [&str; 6] = ["size", "wavelengths", "pitch_um", "overscan", "illuminant", "noise"];

/// Every kind's name, and the keys it knows beside `size`, `wavelengths`, `pitch_um`, `overscan`, `illuminant` and `noise`.
pub const KINDS: [(&str, &[&str]); 8] = [
    ("uniform", &["value"]),
    ("points", &["count", "blob", "width_px"]),
    ("slanted-edge", &["angle_deg", "contrast", "grid", "centers", "patch_px"]),
    ("iso12233-esfr", &["angle_deg", "contrast", "grid"]),
    ("dot-grid", &["count", "width_px"]),
    ("siemens", &["spokes", "grid"]),
    ("checker", &[]),
    ("composite", &[]),
];

/// Why a chart cannot be drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ChartError {
    /// No such chart.
    #[error("no generated chart is called '{word}'; did you mean '{nearest}'? Kinds: {valid}")]
    UnknownKind {
        /// The word given.
        word: String,
        /// The kind nearest to it.
        nearest: &'static str,
        /// All kinds.
        valid: String,
    },
    /// No such setting.
    #[error("a {kind} chart has no setting '{word}'; did you mean '{nearest}'? Settings: {valid}")]
    UnknownKey {
        /// The chart's kind.
        kind: &'static str,
        /// The word given.
        word: String,
        /// The setting nearest to it.
        nearest: &'static str,
        /// All its settings.
        valid: String,
    },
    /// A piece between `&` without `=`.
    #[error("'{piece}' in the chart's settings is not key=value; write KIND?key=value&key=value")]
    NotASetting {
        /// The piece at fault.
        piece: String,
    },
    /// The same setting twice.
    #[error("the chart's setting '{key}' is given twice")]
    Twice {
        /// The setting.
        key: String,
    },
    /// A value that is not what the setting takes.
    #[error("chart setting {key}={value}: it must be {wanted}")]
    BadValue {
        /// The setting.
        key: &'static str,
        /// The value given.
        value: String,
        /// What it takes.
        wanted: String,
    },
    /// Wavelengths that cannot be read.
    #[error("chart setting wavelengths: {0}")]
    Wavelengths(#[from] WavelengthError),
    /// A wavelength without a known reflectance or light.
    #[error(
        "the chart's colours are known from {FIRST_NM} to {LAST_NM} nm, not at {wavelength_nm} nm; only a uniform chart goes beyond"
    )]
    NoColour {
        /// The wavelength asked for.
        wavelength_nm: f64,
    },
    /// Details that would touch.
    #[error(
        "{count} {what} are {spacing_px:.1} px apart and need {needed_px:.1} px: take fewer, smaller ones or a larger film"
    )]
    Crowded {
        /// What is too close.
        what: &'static str,
        /// How many, along a side or in all.
        count: usize,
        /// Their distance in pixels.
        spacing_px: f64,
        /// The distance they need.
        needed_px: f64,
    },
}

/// Shape of an isolated point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blob {
    /// Its width is the full width at half maximum.
    Gaussian,
    /// Its width is the diameter.
    Disc,
}

/// Where slanted edges stand.
#[derive(Clone, Debug, PartialEq)]
pub enum Sites {
    /// In the middle of each of n × n equal parts of the film.
    Grid(usize),
    /// At these places (row, column) in film pixels.
    Centres(Vec<(f64, f64)>),
}

/// What is drawn.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// One radiance everywhere, in every band.
    Uniform {
        /// Spectral radiance, W m⁻² sr⁻¹ nm⁻¹.
        value: f64,
    },
    /// Isolated blobs on black.
    Points {
        /// Blobs along each side.
        count: usize,
        /// Their shape.
        blob: Blob,
        /// Their width in pixels.
        width_px: f64,
    },
    /// Edges for ISO 12233 and the ESF.
    SlantedEdge {
        /// Angle from the vertical; see [`EdgeSite`](super::EdgeSite).
        angle_deg: f64,
        /// Light over dark; ISO 12233 asks for 4.
        contrast: f64,
        /// Where they stand.
        sites: Sites,
        /// Side of the square that holds an edge; by default 0.6 of their distance, and the whole chart for a lone one.
        patch_px: Option<usize>,
    },
    /// Slanted squares as on the e-SFR chart of ISO 12233: four edges each, dark on light, and a row of 20 grey steps
    /// above them. Its resolution wedges are left out.
    Esfr {
        /// Turn of the squares.
        angle_deg: f64,
        /// Light over dark.
        contrast: f64,
        /// Squares along each side.
        grid: usize,
    },
    /// Dark discs on paper, as distortion and lateral colour are measured by (ISO 17850, ISO 19084).
    DotGrid {
        /// Discs along each side.
        count: usize,
        /// Their diameter in pixels.
        width_px: f64,
    },
    /// Siemens stars.
    Siemens {
        /// Dark sectors of a star.
        spokes: usize,
        /// Stars along each side.
        grid: usize,
    },
    /// The 24 patches of a ColorChecker.
    Checker,
    /// Everything at once, for looking at.
    Composite,
}

impl Kind {
    /// The kind of this name with its defaults.
    ///
    /// # Errors
    /// If there is none; the error names the nearest.
    pub fn named(word: &str) -> Result<Self, ChartError> {
        Ok(match word {
            "uniform" => Self::Uniform { value: 1.0 },
            "points" => Self::Points { count: 9, blob: Blob::Gaussian, width_px: 3.0 },
            "slanted-edge" => {
                Self::SlantedEdge { angle_deg: 5.0, contrast: 4.0, sites: Sites::Grid(1), patch_px: None }
            }
            "iso12233-esfr" => Self::Esfr { angle_deg: 5.0, contrast: 4.0, grid: 5 },
            "dot-grid" => Self::DotGrid { count: 25, width_px: 20.0 },
            "siemens" => Self::Siemens { spokes: 72, grid: 1 },
            "checker" => Self::Checker,
            "composite" => Self::Composite,
            _ => {
                let names = KINDS.map(|(name, _)| name);
                let (nearest, valid) = (nearest(word, &names), names.join(", "));
                return Err(ChartError::UnknownKind { word: word.into(), nearest, valid });
            }
        })
    }

    /// Its name.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Uniform { .. } => "uniform",
            Self::Points { .. } => "points",
            Self::SlantedEdge { .. } => "slanted-edge",
            Self::Esfr { .. } => "iso12233-esfr",
            Self::DotGrid { .. } => "dot-grid",
            Self::Siemens { .. } => "siemens",
            Self::Checker => "checker",
            Self::Composite => "composite",
        }
    }
}

/// A chart's every setting.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartSpec {
    /// What is drawn.
    pub kind: Kind,
    /// Size of the film it is for; the chart is larger by the overscan.
    pub film: Size,
    /// Wavelength of every band in nm.
    pub wavelengths_nm: Vec<f64>,
    /// Pixel pitch in µm.
    pub pitch_um: f64,
    /// Pixels beyond the film on every side; `None`: 1 % of the longer side and 64 more, enough for 1 % of distortion at
    /// the border and a PSF of 128 px.
    pub overscan_px: Option<usize>,
    /// The light on the chart.
    pub illuminant: Illuminant,
    /// Relative standard deviation of a fixed pattern of noise, 0 to 0.28.
    pub noise: f64,
}

impl ChartSpec {
    /// The default chart of a kind: 2048 px of 2 µm, 400..700 nm step 10 nm, D65.
    pub fn new(kind: Kind) -> Self {
        Self {
            kind,
            film: Size::new(2048, 2048),
            wavelengths_nm: (0..31).map(|i| 400.0 + 10.0 * f64::from(i)).collect(),
            pitch_um: 2.0,
            overscan_px: None,
            illuminant: Illuminant::D65,
            noise: 0.0,
        }
    }

    /// Sets one setting from words.
    ///
    /// # Errors
    /// If this kind has no such setting, or it cannot take this value.
    pub fn set(&mut self, key: &str, value: &str) -> Result<(), ChartError> {
        let name = self.kind.name();
        match (key, &mut self.kind) {
            ("size", _) => self.film = size(value)?,
            ("wavelengths", _) => self.wavelengths_nm = wavelengths::parse(value)?,
            ("pitch_um", _) => self.pitch_um = number("pitch_um", value)?,
            ("overscan", _) => self.overscan_px = Some(count("overscan", value)?),
            ("illuminant", _) => {
                self.illuminant = value.parse().map_err(|_| bad("illuminant", value, "D65, A or E"))?;
            }
            ("noise", _) => self.noise = number("noise", value)?,
            ("value", Kind::Uniform { value: v }) => *v = number("value", value)?,
            ("count", Kind::Points { count: n, .. } | Kind::DotGrid { count: n, .. }) => {
                *n = count("count", value)?
            }
            ("width_px", Kind::Points { width_px, .. } | Kind::DotGrid { width_px, .. }) => {
                *width_px = number("width_px", value)?
            }
            ("blob", Kind::Points { blob, .. }) => {
                *blob = match value {
                    "gaussian" => Blob::Gaussian,
                    "disc" => Blob::Disc,
                    _ => return Err(bad("blob", value, "gaussian or disc")),
                }
            }
            ("angle_deg", Kind::SlantedEdge { angle_deg, .. } | Kind::Esfr { angle_deg, .. }) => {
                *angle_deg = number("angle_deg", value)?
            }
            ("contrast", Kind::SlantedEdge { contrast, .. } | Kind::Esfr { contrast, .. }) => {
                *contrast = number("contrast", value)?
            }
            ("grid", Kind::SlantedEdge { sites, .. }) => *sites = Sites::Grid(count("grid", value)?),
            ("centers", Kind::SlantedEdge { sites, .. }) => *sites = Sites::Centres(centres(value)?),
            ("patch_px", Kind::SlantedEdge { patch_px, .. }) => *patch_px = Some(count("patch_px", value)?),
            ("spokes", Kind::Siemens { spokes, .. }) => *spokes = count("spokes", value)?,
            ("grid", Kind::Siemens { grid, .. } | Kind::Esfr { grid, .. }) => *grid = count("grid", value)?,
            _ => {
                let own = KINDS.iter().find(|k| k.0 == name).map_or(&[][..], |k| k.1);
                let keys: Vec<_> = COMMON_KEYS.iter().chain(own).copied().collect();
                let (nearest, valid) = (nearest(key, &keys), keys.join(", "));
                return Err(ChartError::UnknownKey { kind: name, word: key.into(), nearest, valid });
            }
        }
        Ok(())
    }

    /// Overscan in pixels, the default worked out.
    pub fn overscan(&self) -> usize {
        self.overscan_px.unwrap_or_else(|| self.film.height.max(self.film.width).div_ceil(100) + 64)
    }

    /// Whether everything lies in its range: settings made of types have passed no parser.
    pub(super) fn check(&self) -> Result<(), ChartError> {
        let within = |key, v: f64, low: f64, high: f64, wanted: &str| {
            if v >= low && v <= high { Ok(()) } else { Err(bad(key, &v.to_string(), wanted)) }
        };
        let (h, w, longest) = (self.film.height, self.film.width, MAX_SIDE as f64);
        if h.min(w) == 0 || h.max(w) > MAX_SIDE {
            return Err(bad("size", &self.film.to_string(), SIZE_WANTED));
        }
        within("overscan", self.overscan() as f64, 0.0, longest, "0 to 1000000 pixels")?;
        within("noise", self.noise, 0.0, noise::MOST, "a relative standard deviation of 0 to 0.28")?;
        within("pitch_um", self.pitch_um, PITCH_UM.least, PITCH_UM.most, "a pitch of 0.001 to 1e6 µm")?;
        if BANDS.check_count(self.wavelengths_nm.len()).is_err() {
            return Err(bad(
                "wavelengths",
                &format!("{} bands", self.wavelengths_nm.len()),
                "1 to 10000 bands",
            ));
        }
        for &nm in &self.wavelengths_nm {
            let uniform = matches!(self.kind, Kind::Uniform { .. });
            if uniform && !WAVELENGTH_NM.holds(nm) {
                return Err(bad("wavelengths", &nm.to_string(), "1 to 1e6 nm"));
            }
            if !uniform && !(FIRST_NM..=LAST_NM).contains(&nm) {
                return Err(ChartError::NoColour { wavelength_nm: nm });
            }
        }
        let along = |key, n: usize| within(key, n as f64, 1.0, MAX_ALONG as f64, "1 to 128 along a side");
        match &self.kind {
            Kind::Uniform { value } => {
                let most = f64::from(f32::MAX);
                within("value", *value, -most, most, "a finite radiance that a 32-bit float holds")
            }
            Kind::Points { count, width_px, .. } => {
                along("count", *count)?;
                // Below 2.2 px a Gaussian's pixel means no longer tell its centre (aliasing above 1e-6).
                within("width_px", *width_px, 2.2, 1000.0, "2.2 to 1000 px")
            }
            Kind::SlantedEdge { angle_deg, contrast, sites, patch_px } => {
                within("angle_deg", *angle_deg, -180.0, 180.0, "-180 to 180 degrees")?;
                within("contrast", *contrast, 1.0, 1e6, "light over dark, 1 to 1e6")?;
                within("patch_px", patch_px.unwrap_or(4) as f64, 4.0, longest, "4 to 1000000 px")?;
                match sites {
                    Sites::Grid(n) => along("grid", *n),
                    Sites::Centres(list) => {
                        let on_film = |&&(y, x): &&(f64, f64)| {
                            (-0.5..=h as f64 - 0.5).contains(&y) && (-0.5..=w as f64 - 0.5).contains(&x)
                        };
                        match list.iter().find(|c| !on_film(c)) {
                            Some((y, x)) => Err(bad("centers", &format!("{x},{y}"), "X,Y on the film")),
                            None => {
                                within("centers", list.len() as f64, 1.0, 1024.0, "1 to 1024 places X,Y;X,Y")
                            }
                        }
                    }
                }
            }
            Kind::Esfr { angle_deg, contrast, grid } => {
                within("angle_deg", *angle_deg, -45.0, 45.0, "-45 to 45 degrees")?;
                within("contrast", *contrast, 1.0, 1e6, "light over dark, 1 to 1e6")?;
                along("grid", *grid)
            }
            Kind::DotGrid { count, width_px } => {
                along("count", *count)?;
                within("width_px", *width_px, 2.2, 1000.0, "2.2 to 1000 px")
            }
            Kind::Siemens { spokes, grid } => {
                within("spokes", *spokes as f64, 2.0, 720.0, "2 to 720 dark sectors")?;
                along("grid", *grid)
            }
            Kind::Checker | Kind::Composite => Ok(()),
        }
    }
}

impl std::str::FromStr for ChartSpec {
    type Err = ChartError;

    fn from_str(words: &str) -> Result<Self, ChartError> {
        let words = words.strip_prefix("gen:").unwrap_or(words);
        let (kind, settings) = words.split_once('?').unwrap_or((words, ""));
        let mut spec = Self::new(Kind::named(kind)?);
        let mut seen = Vec::new();
        for piece in settings.split('&').filter(|p| !p.is_empty()) {
            let Some((key, value)) = piece.split_once('=') else {
                return Err(ChartError::NotASetting { piece: piece.into() });
            };
            if seen.contains(&key) {
                return Err(ChartError::Twice { key: key.into() });
            }
            seen.push(key);
            spec.set(key, value)?;
        }
        spec.check()?;
        Ok(spec)
    }
}

impl std::fmt::Display for ChartSpec {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let nm = wavelengths::format(&self.wavelengths_nm);
        write!(f, "{}?size={}&wavelengths={nm}&pitch_um={}", self.kind.name(), self.film, self.pitch_um)?;
        write!(f, "&overscan={}&illuminant={}", self.overscan(), self.illuminant.name())?;
        if self.noise > 0.0 {
            write!(f, "&noise={}", self.noise)?;
        }
        match &self.kind {
            Kind::Uniform { value } => write!(f, "&value={value}"),
            Kind::Points { count, blob, width_px } => {
                let blob = if *blob == Blob::Disc { "disc" } else { "gaussian" };
                write!(f, "&count={count}&blob={blob}&width_px={width_px}")
            }
            Kind::SlantedEdge { angle_deg, contrast, sites, patch_px } => {
                write!(f, "&angle_deg={angle_deg}&contrast={contrast}")?;
                match sites {
                    Sites::Grid(n) => write!(f, "&grid={n}")?,
                    Sites::Centres(list) => {
                        let list: Vec<_> = list.iter().map(|(y, x)| format!("{x},{y}")).collect();
                        write!(f, "&centers={}", list.join(";"))?;
                    }
                }
                patch_px.map_or(Ok(()), |p| write!(f, "&patch_px={p}"))
            }
            Kind::Esfr { angle_deg, contrast, grid } => {
                write!(f, "&angle_deg={angle_deg}&contrast={contrast}&grid={grid}")
            }
            Kind::DotGrid { count, width_px } => write!(f, "&count={count}&width_px={width_px}"),
            Kind::Siemens { spokes, grid } => write!(f, "&spokes={spokes}&grid={grid}"),
            Kind::Checker | Kind::Composite => Ok(()),
        }
    }
}

const SIZE_WANTED: &str = "a film size N or HxW, each side 1 to 1000000 pixels";

fn size(value: &str) -> Result<Size, ChartError> {
    let (h, w) = value.split_once('x').unwrap_or((value, value));
    match (h.trim().parse(), w.trim().parse()) {
        (Ok(h), Ok(w)) if (1..=MAX_SIDE).contains(&h) && (1..=MAX_SIDE).contains(&w) => Ok(Size::new(h, w)),
        _ => Err(bad("size", value, SIZE_WANTED)),
    }
}

fn number(key: &'static str, value: &str) -> Result<f64, ChartError> {
    value.trim().parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| bad(key, value, "a number"))
}

fn count(key: &'static str, value: &str) -> Result<usize, ChartError> {
    let whole = value.trim().parse().ok().filter(|n| *n <= MAX_SIDE);
    whole.ok_or_else(|| bad(key, value, "a whole number, at most 1000000"))
}

/// `X,Y;X,Y` as (row, column).
fn centres(value: &str) -> Result<Vec<(f64, f64)>, ChartError> {
    let place = |pair: &str| {
        let (x, y) =
            pair.split_once(',').ok_or_else(|| bad("centers", value, "places X,Y;X,Y in film pixels"))?;
        Ok((number("centers", y)?, number("centers", x)?))
    };
    value.split(';').map(place).collect()
}

fn bad(key: &'static str, value: &str, wanted: &str) -> ChartError {
    ChartError::BadValue { key, value: value.into(), wanted: wanted.into() }
}

/// The word that takes the fewest changes to become.
fn nearest(word: &str, words: &[&'static str]) -> &'static str {
    words.iter().min_by_key(|w| changes(word, w)).copied().unwrap_or_default()
}
