//! How a design is traced for a film: flags of a job, as `lens trace` has them.

use super::choices::{AIMING, SWITCH, one_of};
use super::design::{CoatingsArg, DesignArgs, Gap, ImagePlaneArg, configuration};
use super::values::{bounded, share, window_px};
use clap::{ArgAction, Args};
use pipeline::bounds::{BAND_WIDTH_NM, HEIGHT_MM};
use pipeline::design::system::RayAiming;
use pipeline::psf::blocks::Blocks;
use std::fmt;
use std::path::PathBuf;

/// Maximum of the wavelengths of a band.
const MAX_BAND_SAMPLES: usize = 16;

/// How a design is traced. Without flags as by default; they belong to the lens of a film.
#[derive(Clone, Debug, PartialEq, Args)]
#[command(next_help_heading = "Designs")]
pub struct TracingArgs {
    /// Position of the film
    #[arg(long, value_enum, default_value_t = ImagePlaneArg::Design)]
    pub image_plane: ImagePlaneArg,
    /// Ray aiming [default: as in the design]
    #[arg(long, value_parser = one_of(AIMING))]
    pub aiming: Option<RayAiming>,
    /// Configuration of a multi-configuration .zmx file [default: 1]
    #[arg(long, value_name = "N", value_parser = configuration)]
    pub configuration: Option<usize>,
    /// Glass catalogue in AGF format, in addition to the built-in glasses and to those beside the design; repeatable
    #[arg(long, value_name = "FILE.agf")]
    pub glass_catalog: Vec<PathBuf>,
    /// Light lost at surfaces and in glass: ideal (none is), none (bare surfaces), mgf2 or mgf2@NM (a quarter wave at 550 nm or NM), design (as the design names
    /// them), or a file of coatings (.toml, .dat); all but ideal with the absorption of the glasses
    #[arg(long, value_name = "COATINGS|FILE", value_parser = CoatingsArg::parse, default_value = "ideal")]
    pub coatings: CoatingsArg,
    /// Minimum share of the energy inside every PSF window [default: 0.99]
    #[arg(long, value_name = "SHARE", value_parser = share)]
    pub energy: Option<f64>,
    /// Maximum PSF window, an odd number of film pixels [default: 401, of film pixels above 2 µm fewer; 639 with distances]
    #[arg(long, value_name = "N", value_parser = |text: &str| window_px(text, Blocks::widest_window()))]
    pub max_window_px: Option<usize>,
    /// Trace at least up to this height on the film, mm, so that films at several places of the field have one lens [default: what the film needs]
    #[arg(long, value_name = "MM", value_parser = bounded(HEIGHT_MM))]
    pub reach_mm: Option<f64>,
    /// Wavelengths within the width of a band over which its PSFs, illumination and transmission are averaged, 1 to 16; bands end half-way to their
    /// neighbours, or have the width in nm [default: 1, a band is one wavelength]
    #[arg(long, value_name = "N[,width=NM]", value_parser = BandSamplesArg::parse)]
    pub band_samples: Option<BandSamplesArg>,
    /// Light of PSFs beyond their windows, of a design or of a lens pack that has it: on the film, or scaled into the windows (off)
    #[arg(long, value_parser = one_of(SWITCH), action = ArgAction::Set, default_value = "on")]
    pub tails: bool,
}

impl Default for TracingArgs {
    fn default() -> Self {
        Self {
            image_plane: ImagePlaneArg::default(),
            aiming: None,
            configuration: None,
            glass_catalog: Vec::new(),
            coatings: CoatingsArg::default(),
            energy: None,
            max_window_px: None,
            reach_mm: None,
            band_samples: None,
            tails: true,
        }
    }
}

/// `--band-samples`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BandSamplesArg {
    /// Number of wavelengths.
    pub count: usize,
    /// Width of every band, nm.
    pub width_nm: Option<f64>,
}

impl fmt::Display for BandSamplesArg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.count)?;
        self.width_nm.map_or(Ok(()), |nm| write!(f, ",width={nm}"))
    }
}

impl BandSamplesArg {
    /// Parses `N[,width=NM]`.
    pub fn parse(text: &str) -> Result<Self, String> {
        let expected = format!("expected N[,width=NM], N from 1 to {MAX_BAND_SAMPLES}");
        let (count, width) = match text.split_once(',') {
            None => (text, None),
            Some((count, width)) => {
                let (name, width) = width.split_once('=').ok_or(expected.clone())?;
                (count, Some(width).filter(|_| name.trim() == "width").ok_or(expected.clone())?.into())
            }
        };
        let count = count.trim().parse::<usize>().ok().filter(|n| (1..=MAX_BAND_SAMPLES).contains(n));
        let width_nm = width.map(|nm: &str| bounded(BAND_WIDTH_NM)(nm)).transpose()?;
        Ok(Self { count: count.ok_or(expected)?, width_nm })
    }
}

impl TracingArgs {
    /// Parameters of the design, with the gaps `gap`.
    pub fn design(&self, gap: &[Gap]) -> DesignArgs {
        DesignArgs {
            image_plane: self.image_plane,
            aiming: self.aiming,
            configuration: self.configuration,
            glass_catalog: self.glass_catalog.clone(),
            coatings: self.coatings.clone(),
            gap: gap.to_vec(),
            ..DesignArgs::default()
        }
    }

    /// The flags of this group that are for designs only.
    pub const FLAGS: [&str; 9] = [
        "--image-plane",
        "--aiming",
        "--configuration",
        "--glass-catalog",
        "--coatings",
        "--energy",
        "--max-window-px",
        "--reach-mm",
        "--band-samples",
    ];

    /// Whether a film has tails of a lens that has them: it is asked for, with the PSF stage (`has_psfs`), without surfaces at several distances (`has_depth`),
    /// and a band is one wavelength.
    pub fn admits_tails(&self, has_psfs: bool, has_depth: bool) -> bool {
        self.tails && has_psfs && !has_depth && self.integrated_bands().is_none()
    }

    /// `--band-samples` for more than one wavelength.
    pub fn integrated_bands(&self) -> Option<BandSamplesArg> {
        self.band_samples.filter(|bands| bands.count > 1)
    }

    /// Those of [`TracingArgs::FLAGS`] that are given.
    pub fn given(&self) -> Vec<&'static str> {
        let Self {
            image_plane,
            aiming,
            configuration,
            glass_catalog,
            coatings,
            energy,
            max_window_px,
            reach_mm,
            band_samples: _,
            tails: _,
        } = self;
        let is_given = [
            *image_plane != ImagePlaneArg::default(),
            aiming.is_some(),
            configuration.is_some(),
            !glass_catalog.is_empty(),
            *coatings != CoatingsArg::Ideal,
            energy.is_some(),
            max_window_px.is_some(),
            reach_mm.is_some(),
            self.integrated_bands().is_some(),
        ];
        std::iter::zip(Self::FLAGS, is_given)
            .filter(|(_, is_given)| *is_given)
            .map(|(flag, _)| flag)
            .collect()
    }
}
