//! Parameters of a lens design, which several commands have.

use super::choices::{AIMING, one_of};
use super::values::bounded;
use clap::{Args, ValueEnum};
use formats::design::endings_read;
use pipeline::bounds;
use pipeline::design::system::RayAiming;
use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

/// Endings of design files, for help and messages.
pub const DESIGN_FILES: DesignFiles = DesignFiles;

/// Displays [`DESIGN_FILES`].
pub struct DesignFiles;

impl Display for DesignFiles {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(&endings_read())
    }
}

/// Parameters of a design: film plane, conjugate, aiming and glasses.
#[derive(Clone, Debug, Default, PartialEq, Args)]
#[command(next_help_heading = "Designs")]
pub struct DesignArgs {
    /// Position of the film
    #[arg(long, value_enum, default_value_t = ImagePlaneArg::Design)]
    pub image_plane: ImagePlaneArg,
    /// Wavelength at which --image-plane paraxial, rms or strehl is found, nm [default: primary wavelength of the design]
    #[arg(long, value_name = "NM", value_parser = bounded(bounds::WAVELENGTH_NM))]
    pub focus_nm: Option<f64>,
    /// Distance of the film from the plane of --image-plane, mm, positive away from the lens
    #[arg(long, value_name = "MM", value_parser = bounded(bounds::DEFOCUS_MM), default_value_t = 0.0, allow_hyphen_values = true)]
    pub defocus_mm: f64,
    /// Object distance from the first surface, mm [default: as in the design]
    #[arg(long, value_name = "MM", value_parser = bounded(bounds::GIVEN_DISTANCE_MM))]
    pub object_distance_mm: Option<f64>,
    /// Ray aiming [default: as in the design]
    #[arg(long, value_parser = one_of(AIMING))]
    pub aiming: Option<RayAiming>,
    /// Gap behind a surface, counted from 1, e.g. 7=3.25: focus of a lens that moves a group; repeatable
    #[arg(long, value_name = "SURFACE=MM", value_parser = gap)]
    pub gap: Vec<Gap>,
    /// Glass catalogue in AGF format, in addition to the built-in glasses; used first for designs that name it; repeatable
    #[arg(long, value_name = "FILE.agf")]
    pub glass_catalog: Vec<PathBuf>,
    /// Light lost at surfaces and in glass: ideal (none is), none (bare surfaces), mgf2 or mgf2@NM (a quarter wave at 550 nm or NM), design (as the design names
    /// them), or a file of coatings (.toml, .dat); all but ideal with the absorption of the glasses
    #[arg(long, value_name = "COATINGS|FILE", value_parser = CoatingsArg::parse, default_value = "ideal")]
    pub coatings: CoatingsArg,
    /// Make an unknown keyword of the design file, or optics that are ignored, an error instead of a note
    #[arg(long)]
    pub strict: bool,
    /// Configuration of a multi-configuration .zmx file [default: 1]
    #[arg(long, value_name = "N", value_parser = configuration)]
    pub configuration: Option<usize>,
}

/// `--coatings`.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum CoatingsArg {
    /// All light passes.
    #[default]
    Ideal,
    /// Bare surfaces.
    Bare,
    /// A quarter wave of magnesium fluoride at this wavelength in nm, else 550.
    Mgf2(Option<f64>),
    /// Those that the design names.
    Design,
    /// A file of coatings.
    File(PathBuf),
}

impl CoatingsArg {
    /// Reads the flag.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        match (text, text.split_once('@')) {
            ("ideal", _) => Ok(Self::Ideal),
            ("none", _) => Ok(Self::Bare),
            ("mgf2", _) => Ok(Self::Mgf2(None)),
            ("design", _) => Ok(Self::Design),
            (_, Some(("mgf2", nm))) => bounded(bounds::WAVELENGTH_NM)(nm).map(|nm| Self::Mgf2(Some(nm))),
            _ if text.contains(['.', '/']) => Ok(Self::File(text.into())),
            _ => Err("expected ideal, none, mgf2, mgf2@NM, design or a file (.toml, .dat)".to_owned()),
        }
    }

    /// The file of coatings.
    pub fn file(&self) -> Option<&PathBuf> {
        match self {
            Self::File(path) => Some(path),
            _ => None,
        }
    }
}

impl Display for CoatingsArg {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ideal => f.write_str("ideal"),
            Self::Bare => f.write_str("none"),
            Self::Mgf2(None) => f.write_str("mgf2"),
            Self::Mgf2(Some(nm)) => write!(f, "mgf2@{nm}"),
            Self::Design => f.write_str("design"),
            Self::File(path) => write!(f, "{}", path.display()),
        }
    }
}

/// `--image-plane`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ImagePlaneArg {
    /// As in the design
    #[default]
    Design,
    /// Paraxial focus
    Paraxial,
    /// Minimum RMS spot radius on the axis
    Rms,
    /// Maximum Strehl ratio on the axis
    Strehl,
}

/// A gap of a design: surface, counted from 1, and the distance to the next one in mm.
pub type Gap = (usize, f64);

/// A gap `SURFACE=MM`.
pub(super) fn gap(text: &str) -> Result<Gap, String> {
    let parts = text.split_once('=').and_then(|(n, mm)| Some((n.trim().parse().ok()?, mm)));
    let (surface, mm) = parts.ok_or("expected SURFACE=MM, e.g. 7=3.25")?;
    Ok((surface, bounded(bounds::DEFOCUS_MM)(mm)?))
}

/// A distance in m, `inf` allowed.
pub(super) fn focus_m(text: &str) -> Result<f64, String> {
    let metres = text.trim().parse().ok().filter(|m| bounds::FOCUS_M.contains(*m));
    metres
        .ok_or_else(|| format!("`{text}`: expected a distance in m, {} or more, or inf", bounds::FOCUS_M.min))
}

/// A range of distances as vergences (farthest, nearest), 1/m.
pub type Depths = (f64, f64);

/// A range of distances in m, `NEAR:FAR`.
pub(super) fn depths(text: &str) -> Result<Depths, String> {
    let (near, far) = text.split_once(':').ok_or("expected NEAR:FAR in m, e.g. 0.5:inf")?;
    let (near, far) = (focus_m(near)?, focus_m(far)?);
    match near <= far && near.is_finite() {
        true => Ok((1.0 / far, 1.0 / near)),
        false => Err(format!("`{text}`: expected the nearer distance first, e.g. 0.5:inf")),
    }
}

/// A configuration number.
pub(super) fn configuration(text: &str) -> Result<usize, String> {
    let number = text.parse().ok().filter(|n| (1..=10_000).contains(n));
    number.ok_or_else(|| "expected a number from 1 to 10000".to_owned())
}
