//! Chart specifications: kind, size, wavelengths and all other settings of a generated chart.
//!
//! As text `KIND?key=value&key=value` (`parse.rs`), e.g. `gen:composite?size=14141&wavelengths=400:700:10&pitch_um=2&overscan=200`. The
//! `Display` of a [`ChartSpec`] writes every setting, so that equal charts have equal texts.

use super::depth_scene::ScenePart;
use super::error::{ChartError, bad_value};
use super::fiducials;
use super::noise;
use super::sine_star::StarProfile;
use super::targets::{EdgePlaces, PointShape};
use crate::bounds::{self, BANDS, FILM_SIDE_PX, PITCH_UM, WAVELENGTH_NM};
use crate::colour::{FIRST_NM, Illuminant, LAST_NM};
use crate::geometry::Size;
use crate::wavelengths;

/// Longest side of a film.
pub(super) const MAX_SIDE: usize = FILM_SIDE_PX.max as usize;
pub(super) const SIZE_EXPECTED: &str = "a film size N or WxH, each side 1 to 1000000 pixels";
/// Largest number of points or stars along a side: they are searched one by one for every rectangle.
const MAX_ALONG: usize = 128;

/// Name of every kind, and its settings beside `size`, `wavelengths`, `pitch_um`, `overscan`, `illuminant`, `noise` and `fiducials`.
pub const KINDS: [(&str, &[&str]); 13] = [
    ("uniform", &["value"]),
    ("points", &["count", "blob", "width_px"]),
    ("slanted-edge", &["angle_deg", "contrast", "grid", "centers", "patch_px"]),
    ("iso12233-esfr", &["angle_deg", "contrast", "grid"]),
    ("dot-grid", &["count", "width_px"]),
    ("black-spots", &["spots", "diameter"]),
    ("lamp", &["radius", "x", "y"]),
    ("siemens", &["spokes", "grid", "profile"]),
    ("dead-leaves", &["seed", "r_min_px", "r_max_px", "contrast"]),
    ("oecf", &["patches", "density"]),
    ("checker", &[]),
    ("composite", &[]),
    ("depth-scene", &["near_m", "far_m", "part"]),
];

/// Content of a chart.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// One radiance everywhere, in every band.
    Uniform {
        /// Spectral radiance, W m⁻² sr⁻¹ nm⁻¹.
        value: f64,
    },
    /// Isolated points on black.
    Points {
        /// Points along each side.
        count: usize,
        /// Their shape.
        shape: PointShape,
        /// Their width in pixels.
        width_px: f64,
    },
    /// Edges for ISO 12233 and the ESF.
    SlantedEdge {
        /// Angle from the vertical; see [`EdgeSite`](super::EdgeSite).
        angle_deg: f64,
        /// Light over dark; 4 in ISO 12233.
        contrast: f64,
        /// Their places.
        places: EdgePlaces,
        /// Side of the square around an edge; by default 0.6 of the distance of the edges, and the complete chart for a single one.
        patch_px: Option<usize>,
    },
    /// Slanted squares as on the e-SFR chart of ISO 12233: four edges each, dark on light, and a row of 20 grey steps
    /// above them. Its resolution wedges are left out.
    Esfr {
        /// Rotation of the squares.
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
    /// Black discs on white paper, by which veiling glare is measured (ISO 9358): their light is 0.
    BlackSpots {
        /// Discs along each side, in the middle of equal parts of the film.
        along: usize,
        /// Their diameter over the height of the film.
        diameter: f64,
    },
    /// A bright disc, 10⁶ times the radiance of the paper around it.
    Lamp {
        /// Its radius in pixels.
        radius_px: f64,
        /// Its centre (column, row) in film pixels; `None`: the middle of the film.
        column: Option<f64>,
        /// See `column`.
        row: Option<f64>,
    },
    /// Siemens stars.
    Siemens {
        /// Dark sectors of a star.
        spokes: usize,
        /// Stars along each side.
        grid: usize,
        /// Reflectance over the angle.
        profile: StarProfile,
    },
    /// Discs of random radius, place and grey that hide each other, in a frame of their mean grey.
    DeadLeaves {
        /// Seed of all random numbers.
        seed: u64,
        /// Smallest radius, px.
        r_min_px: f64,
        /// Largest radius, px.
        r_max_px: f64,
        /// Lightest over darkest reflectance.
        contrast: f64,
    },
    /// Grey patches on a circle, equal steps in density, on a background of 18 % (ISO 14524).
    Oecf {
        /// Their number.
        patches: usize,
        /// Density of the darkest above that of the lightest.
        density: f64,
    },
    /// The 24 patches of a ColorChecker.
    Checker,
    /// Several targets in one picture, for visual inspection.
    Composite,
    /// Wall, floor, disc and ball at several distances, with their distances and the surfaces hidden behind disc and ball.
    DepthScene {
        /// Distance of the disc and of the nearest floor from the entrance pupil, m.
        near_m: f64,
        /// Distance of the wall, m; infinity is allowed.
        far_m: f64,
        /// The array.
        part: ScenePart,
    },
}

impl Kind {
    /// Name of the kind.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Uniform { .. } => "uniform",
            Self::Points { .. } => "points",
            Self::SlantedEdge { .. } => "slanted-edge",
            Self::Esfr { .. } => "iso12233-esfr",
            Self::DotGrid { .. } => "dot-grid",
            Self::BlackSpots { .. } => "black-spots",
            Self::Lamp { .. } => "lamp",
            Self::Siemens { .. } => "siemens",
            Self::DeadLeaves { .. } => "dead-leaves",
            Self::Oecf { .. } => "oecf",
            Self::Checker => "checker",
            Self::Composite => "composite",
            Self::DepthScene { .. } => "depth-scene",
        }
    }
}

/// All settings of a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartSpec {
    /// Its content.
    pub kind: Kind,
    /// Size of the film; the chart is larger by the overscan.
    pub film: Size,
    /// Wavelength of every band in nm.
    pub wavelengths_nm: Vec<f64>,
    /// Pixel pitch in µm.
    pub pitch_um: f64,
    /// Pixels beyond the film on every side; `None`: 1 % of the longer side and 64 more, enough for 1 % of distortion at
    /// the border and a PSF of 128 px.
    pub overscan_px: Option<usize>,
    /// The illuminant.
    pub illuminant: Illuminant,
    /// Relative standard deviation of a fixed pattern of noise, 0 to 0.28.
    pub noise: f64,
    /// Side of the marks in the film's corners, px; 0: without.
    pub fiducials_px: f64,
}

impl ChartSpec {
    /// Colour of a white: the illuminant where there are spectra of reflectance, else equal energy in every band.
    pub const fn light(&self) -> Illuminant {
        match self.kind {
            Kind::Checker | Kind::Composite | Kind::DepthScene { .. } => self.illuminant,
            _ => Illuminant::E,
        }
    }

    /// Whether it is the picture of a depth scene, whose other arrays [`ChartSpec::scene_part`] gives.
    pub const fn has_depth(&self) -> bool {
        matches!(self.kind, Kind::DepthScene { part: ScenePart::Chart, .. })
    }

    /// The same scene's array `part`, if it is a depth scene: all bands of a radiance, else one.
    pub fn scene_part(&self, part: ScenePart) -> Option<Self> {
        let Kind::DepthScene { near_m, far_m, .. } = self.kind else { return None };
        let mut spec = Self { kind: Kind::DepthScene { near_m, far_m, part }, ..self.clone() };
        if !part.is_radiance() {
            spec.wavelengths_nm.truncate(1);
        }
        Some(spec)
    }

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
            fiducials_px: 0.0,
        }
    }

    /// Overscan in pixels, given or by default.
    pub fn overscan(&self) -> usize {
        self.overscan_px.unwrap_or_else(|| self.film.height.max(self.film.width).div_ceil(100) + 64)
    }

    /// Checks the range of every setting, parsed or not.
    pub(super) fn check(&self) -> Result<(), ChartError> {
        let within = |key, v: f64, low: f64, high: f64, expected: &str| {
            if v >= low && v <= high { Ok(()) } else { Err(bad_value(key, &v.to_string(), expected)) }
        };
        let (h, w, longest) = (self.film.height, self.film.width, MAX_SIDE as f64);
        if h.min(w) == 0 || h.max(w) > MAX_SIDE {
            return Err(bad_value("size", &self.film.to_string(), SIZE_EXPECTED));
        }
        within("overscan", self.overscan() as f64, 0.0, longest, "0 to 1000000 pixels")?;
        within("noise", self.noise, 0.0, noise::MAX_SIGMA, "a relative standard deviation of 0 to 0.28")?;
        if self.fiducials_px != 0.0 {
            let (low, high) = fiducials::SIDE_PX;
            within(
                "fiducials",
                self.fiducials_px,
                low,
                high,
                "0 (no corner marks) or a side of 21 to 100000 px",
            )?;
            if matches!(self.kind, Kind::Uniform { value } if value <= 0.0) {
                return Err(bad_value(
                    "fiducials",
                    &self.fiducials_px.to_string(),
                    "0 for a uniform chart without light",
                ));
            }
        }
        within("pitch_um", self.pitch_um, PITCH_UM.min, PITCH_UM.max, "a pitch of 0.001 to 1e6 µm")?;
        if BANDS.check_count(self.wavelengths_nm.len()).is_err() {
            return Err(bad_value(
                "wavelengths",
                &format!("{} bands", self.wavelengths_nm.len()),
                "1 to 10000 bands",
            ));
        }
        for &nm in &self.wavelengths_nm {
            let uniform = matches!(self.kind, Kind::Uniform { .. });
            if uniform && !WAVELENGTH_NM.contains(nm) {
                return Err(bad_value("wavelengths", &nm.to_string(), "1 to 1e6 nm"));
            }
            if !uniform && !(FIRST_NM..=LAST_NM).contains(&nm) {
                return Err(ChartError::NoColour { wavelength_nm: nm });
            }
        }
        let along = |key, n: usize| within(key, n as f64, 1.0, MAX_ALONG as f64, "1 to 128 along a side");
        match &self.kind {
            Kind::Uniform { value } => {
                let max = f64::from(f32::MAX);
                within("value", *value, -max, max, "a finite radiance that a 32-bit float holds")
            }
            Kind::Points { count, width_px, .. } => {
                along("count", *count)?;
                // Below 2.2 px a Gaussian's pixel means no longer determine its centre (aliasing above 1e-6).
                within("width_px", *width_px, 2.2, 1000.0, "2.2 to 1000 px")
            }
            Kind::SlantedEdge { angle_deg, contrast, places, patch_px } => {
                within("angle_deg", *angle_deg, -180.0, 180.0, "-180 to 180 degrees")?;
                within("contrast", *contrast, 1.0, 1e6, "light over dark, 1 to 1e6")?;
                within("patch_px", patch_px.unwrap_or(4) as f64, 4.0, longest, "4 to 1000000 px")?;
                match places {
                    EdgePlaces::Grid(n) => along("grid", *n),
                    EdgePlaces::Centres(list) => {
                        let on_film = |&&(y, x): &&(f64, f64)| {
                            (-0.5..=h as f64 - 0.5).contains(&y) && (-0.5..=w as f64 - 0.5).contains(&x)
                        };
                        match list.iter().find(|c| !on_film(c)) {
                            Some((y, x)) => Err(bad_value("centers", &format!("{x},{y}"), "X,Y on the film")),
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
            Kind::BlackSpots { along: n, diameter } => {
                along("spots", *n)?;
                within("diameter", *diameter, 1e-4, 0.5, "0.01% to 50% of the film's height")
            }
            Kind::Lamp { radius_px, column, row } => {
                within("radius", *radius_px, 0.5, longest, "0.5 to 1000000 px")?;
                within("x", column.unwrap_or(0.0), -longest, longest, "a column of the film, px")?;
                within("y", row.unwrap_or(0.0), -longest, longest, "a row of the film, px")
            }
            Kind::Siemens { spokes, grid, .. } => {
                within("spokes", *spokes as f64, 2.0, 720.0, "2 to 720 dark sectors")?;
                along("grid", *grid)
            }
            Kind::DeadLeaves { r_min_px, r_max_px, contrast, .. } => {
                within("r_min_px", *r_min_px, 1.0, 1e4, "1 to 10000 px")?;
                within("r_max_px", *r_max_px, *r_min_px, 1e5, "r_min_px to 100000 px")?;
                within("contrast", *contrast, 1.0, 1e6, "light over dark, 1 to 1e6")
            }
            Kind::Oecf { patches, density } => {
                within("patches", *patches as f64, 2.0, 64.0, "2 to 64 patches")?;
                within("density", *density, 0.1, 5.0, "a range of density of 0.1 to 5")
            }
            Kind::Checker | Kind::Composite => Ok(()),
            Kind::DepthScene { near_m, far_m, .. } => {
                within("near_m", *near_m, bounds::FOCUS_M.min, 1e5, "0.0001 to 100000 m")?;
                let farther = "more than near_m, or inf";
                within("far_m", *far_m, near_m * (1.0 + 1e-6), f64::INFINITY, farther)
            }
        }
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
        if self.fiducials_px != 0.0 {
            write!(f, "&fiducials={}", self.fiducials_px)?;
        }
        match &self.kind {
            Kind::Uniform { value } => write!(f, "&value={value}"),
            Kind::Points { count, shape, width_px } => {
                let shape = if *shape == PointShape::Disc { "disc" } else { "gaussian" };
                write!(f, "&count={count}&blob={shape}&width_px={width_px}")
            }
            Kind::SlantedEdge { angle_deg, contrast, places, patch_px } => {
                write!(f, "&angle_deg={angle_deg}&contrast={contrast}")?;
                match places {
                    EdgePlaces::Grid(n) => write!(f, "&grid={n}")?,
                    EdgePlaces::Centres(list) => {
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
            Kind::BlackSpots { along, diameter } => {
                write!(f, "&spots={}&diameter={diameter}", along * along)
            }
            Kind::Lamp { radius_px, column, row } => {
                write!(f, "&radius={radius_px}")?;
                column.map_or(Ok(()), |x| write!(f, "&x={x}"))?;
                row.map_or(Ok(()), |y| write!(f, "&y={y}"))
            }
            Kind::Siemens { spokes, grid, profile } => {
                write!(f, "&spokes={spokes}&grid={grid}")?;
                if *profile == StarProfile::Sine { write!(f, "&profile=sine") } else { Ok(()) }
            }
            Kind::DeadLeaves { seed, r_min_px, r_max_px, contrast } => {
                write!(f, "&seed={seed}&r_min_px={r_min_px}&r_max_px={r_max_px}&contrast={contrast}")
            }
            Kind::Oecf { patches, density } => write!(f, "&patches={patches}&density={density}"),
            Kind::Checker | Kind::Composite => Ok(()),
            Kind::DepthScene { near_m, far_m, part } => {
                write!(f, "&near_m={near_m}&far_m={far_m}&part={}", part.name())
            }
        }
    }
}
