//! `lenscube scene`.

use super::choices::{Choices, one_of};
use super::design::{DESIGN_FILES, Depths, DesignArgs, depths, focus_m};
use super::run::ProcessArgs;
use super::values::{bounded, bytes, number, pitch, positive, size, threads};
use clap::{Args, Command, FromArgMatches};
use pipeline::bounds::Bound;
use pipeline::geometry::Size;
use std::path::{Path, PathBuf};

/// Heading of the flags of scenes that exist.
const EXISTING: &str = "Existing scene";
/// Difference of blur between surfaces, px.
const GAP_PX: Bound = Bound { name: "a difference of blur", unit: "px", min: 0.01, max: 1000.0 };

/// `lenscube scene`
#[derive(Clone, Debug, Args)]
#[command(
    mut_arg("overwrite", |a| a.help("Remove an existing scene and start again").help_heading(EXISTING)),
    mut_arg("force", |a| a.help("Start although the disk is too small for the scene").help_heading(EXISTING)),
    mut_arg("take_over", |a| a.help_heading(EXISTING)),
    after_help = "Example:\n  lenscube scene room.glb scene.zarr --lens phone --focus-m 1 --film-size 2000x1500 --film-pitch-um 1.5\n  \
lenscube run scene.zarr film.zarr --lens phone --focus-m 1 --film-size 2000x1500 --film-pitch-um 1.5 --wavelengths 400:700:10\n\
Surfaces are matt and lit evenly, or by sun, sky and lamps with shadows; no light bounces, nothing shines, refracts or mirrors. The camera's place is the \
centre of the lens's entrance pupil; the field of view is that of the lens and film. `lenscube help scenes` has the rules."
)]
pub struct SceneArgs {
    /// Mesh: .glb, .gltf, .obj or .ply
    #[arg(value_name = "MESH")]
    pub mesh: PathBuf,
    /// Scene to write, a Zarr v3 group, local or at s3://BUCKET/PREFIX; not with --info and --materials
    #[arg(value_name = "SCENE", required_unless_present_any = ["info", "materials"])]
    pub out: Option<PathBuf>,
    /// Design file, or name of a built-in design, as for the run
    #[arg(long, value_name = "NAME|DESIGN", help_heading = "Lens", help = format!("Design file ({DESIGN_FILES}), or name of a built-in design, as for the run"))]
    pub lens: String,
    /// Object distance in focus, m from the entrance pupil, or inf [default: the film of the design]
    #[arg(long, value_name = "M", value_parser = focus_m, conflicts_with = "object_distance_mm", help_heading = "Lens")]
    pub focus_m: Option<f64>,
    /// Size of the film in pixels, N or WxH
    #[arg(long, value_name = "WxH", value_parser = size, help_heading = "Film")]
    pub film_size: Size,
    /// Film pixel pitch in µm
    #[arg(long, value_name = "UM", value_parser = pitch, help_heading = "Film")]
    pub film_pitch_um: f64,
    /// Distances of the scene in m: the margin of the chart around the film holds their blur [default: those of the mesh's corners before the camera, from
    /// ten focal lengths on]
    #[arg(long, value_name = "NEAR:FAR", value_parser = depths, help_heading = "Film")]
    pub depths_m: Option<Depths>,
    /// Where the camera is.
    #[command(flatten)]
    pub view: ViewpointArgs,
    /// Which surfaces there are.
    #[command(flatten)]
    pub surfaces: SurfaceArgs,
    /// What they look like.
    #[command(flatten)]
    pub look: LookArgs,
    /// Print what the mesh holds, the size of the chart, and what the scene would take; write nothing
    #[arg(long, visible_alias = "dry-run")]
    pub info: bool,
    /// Print the materials: name, triangles, area, colour, spectrum; write nothing
    #[arg(long)]
    pub materials: bool,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads, help_heading = "Machine")]
    pub threads: Option<usize>,
    /// Maximum memory, e.g. 1GiB [default: half of the available memory, at most 4 GiB]
    #[arg(long, value_name = "BYTES", value_parser = bytes, help_heading = "Machine")]
    pub memory: Option<u64>,
    /// Do not wait for the disk after each file: faster, but a power failure may lose some
    #[arg(long, help_heading = "Machine")]
    pub no_fsync: bool,
    /// Flags of one process.
    #[command(flatten)]
    pub process: ProcessArgs,
    /// Parameters of the design.
    #[command(flatten)]
    pub design: DesignArgs,
}

/// Place and direction of the camera.
#[derive(Clone, Debug, PartialEq, Args)]
#[command(next_help_heading = "Mesh: view")]
pub struct ViewpointArgs {
    /// Camera of the file, by its name or number from 0 [default: the only one]
    #[arg(long, value_name = "NAME|N", conflicts_with = "eye")]
    pub camera: Option<String>,
    /// Place of the camera in coordinates of the file, m after --mesh-unit; replaces the file's cameras
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, requires = "target", allow_hyphen_values = true)]
    pub eye: Option<[f64; 3]>,
    /// Point on the optical axis, likewise
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, requires = "eye", allow_hyphen_values = true)]
    pub target: Option<[f64; 3]>,
    /// Direction that is up in the picture [default: --up-axis]
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, requires = "eye", allow_hyphen_values = true)]
    pub up: Option<[f64; 3]>,
    /// Unit of the positions in OBJ and PLY files, which name none; glTF is in metres
    #[arg(long, value_parser = one_of(MESH_UNIT))]
    pub mesh_unit: Option<MeshUnit>,
    /// Axis of the file that points up, of OBJ and PLY [default: y]
    #[arg(long, value_parser = one_of(UP_AXIS))]
    pub up_axis: Option<UpAxisArg>,
    /// Plane of the chart: the ideal image plane, or where the lens puts each direction on the film at its primary wavelength, as large as the film, for
    /// fisheyes [default: planar, an error where distortion makes it 4 times the film]
    #[arg(long, value_parser = one_of(PROJECTION))]
    pub projection: Option<ProjectionArg>,
    /// Surfaces nearer than this, m, are cut away [default: an error from 1 % of the picture on, if nearer than ten focal lengths]
    #[arg(long, allow_negative_numbers = true, value_name = "M", value_parser = positive)]
    pub near_m: Option<f64>,
}

/// Surfaces of the scene.
#[derive(Clone, Debug, PartialEq, Args)]
#[command(next_help_heading = "Mesh: surfaces")]
pub struct SurfaceArgs {
    /// Samples per pixel of the chart: 1, 4, 16 or 64
    #[arg(long, value_name = "N", value_parser = samples, default_value = "16")]
    pub samples_per_px: usize,
    /// Surfaces of a pixel that are stored, the one seen first and those hidden behind it: 1 to 8
    #[arg(long, value_name = "K", value_parser = sheets, default_value = "3")]
    pub sheets: usize,
    /// Difference of blur radii, in film pixels, from which on surfaces are told apart
    #[arg(long, value_name = "PX", value_parser = bounded(GAP_PX), default_value = "1")]
    pub gap_px: f64,
    /// Distance from edges within which hidden surfaces are stored, chart pixels, or all [default: that of the largest blur]
    #[arg(long, value_name = "N|all", value_parser = reach)]
    pub reach_px: Option<ReachArg>,
    /// Closed surfaces of opaque triangles have an inside that is never seen (auto), or every surface has two sides (none)
    #[arg(long, value_parser = one_of(SOLIDS), default_value = "auto")]
    pub solids: SolidsArg,
    /// Show the back of materials that are declared one-sided
    #[arg(long)]
    pub two_sided: bool,
    /// Store weights as 16-bit floats: half the size, relative errors up to 2^-11
    #[arg(long)]
    pub half: bool,
    /// Store the array `object` (u32): the number of the object that is seen first, the nearest in the pixel, + 1: its node in glTF, its place in OBJ; 0: none
    #[arg(long)]
    pub ids: bool,
}

/// Materials and light of the scene.
#[derive(Clone, Debug, PartialEq, Args)]
#[command(next_help_heading = "Mesh: materials and light")]
pub struct LookArgs {
    /// Reflectance of a material: CSV with the columns wavelength_nm and reflectance (0 to 1); its colour and texture are ignored, or with *texture the
    /// texture's luminance is a factor; repeatable
    #[arg(long, value_name = "NAME=FILE.csv[*texture]")]
    pub material: Vec<String>,
    /// Spectrum of white light: D65, A, E, …, or CSV with the columns wavelength_nm and power (relative)
    #[arg(long, value_name = "NAME|FILE.csv", default_value = "D65")]
    pub illuminant: String,
    /// Illuminance of the scene, lx: surfaces are lit evenly, their radiance is reflectance × irradiance/π; with --sun, --sky or --lights it is that of a sun
    /// without one
    #[arg(long, value_name = "LX", value_parser = positive, default_value = "1000")]
    pub illuminance: f64,
    /// Sun with shadows: azimuth clockwise from north (−Z where y is up, +Y where z is) as a compass bearing, and elevation, degrees;
    /// lx on a surface that faces it [default: --illuminance]
    #[arg(long, value_name = "AZIMUTH,ELEVATION[,LX]", value_parser = sun, allow_hyphen_values = true)]
    pub sun: Option<SunArg>,
    /// Even light from all directions, with shadows: lx on an open surface
    #[arg(long, allow_negative_numbers = true, value_name = "LX", value_parser = positive)]
    pub sky: Option<f64>,
    /// Directions in which the sky and the environment are sampled: 1, 4, 16 or 64 [default: 64]
    #[arg(long, value_name = "N", value_parser = samples)]
    pub sky_samples: Option<usize>,
    /// Light from all directions, with shadows: a picture of 360 x 180 degrees (OpenEXR, or PNG, JPEG, TIFF in sRGB), north in the middle; lx on an open horizontal
    /// surface [default: --illuminance]
    #[arg(long, value_name = "FILE[,LX]", value_parser = environment)]
    pub environment: Option<EnvironmentArg>,
    /// Turns the picture of --environment clockwise, seen from above, degrees
    #[arg(long, value_name = "DEG", value_parser = turn, allow_hyphen_values = true, requires = "environment")]
    pub environment_azimuth: Option<f64>,
    /// Lamps of the file (KHR_lights_punctual): file
    #[arg(long, value_parser = one_of(LIGHTS))]
    pub lights: Option<LightsArg>,
    /// What is behind all surfaces: none (black), its luminance in cd/m², or environment
    #[arg(long, allow_negative_numbers = true, value_name = "CD_PER_M2|none|environment", value_parser = background, default_value = "none")]
    pub background: BackgroundArg,
    /// Distance of the background, m [default: inf]
    #[arg(long, value_name = "M", value_parser = focus_m)]
    pub background_m: Option<f64>,
    /// Textures that are not there: an error, or grey
    #[arg(long, value_parser = one_of(MISSING), default_value = "error")]
    pub missing_textures: MissingTextures,
    /// Folder outside that of the mesh from which it may read; repeatable
    #[arg(long, value_name = "DIR")]
    pub allow_path: Vec<PathBuf>,
}

/// Suffix of a spectrum that the texture's luminance multiplies.
const TIMES_TEXTURE: &str = "*texture";

impl LookArgs {
    /// Directions in which the sky is sampled.
    #[cfg(feature = "mesh")]
    pub fn sky_directions(&self) -> usize {
        self.sky_samples.unwrap_or(64)
    }

    /// The spectra of `--material`: its text, name and file, and whether the texture's luminance multiplies it; `None` for a text without `=`.
    pub fn materials(&self) -> impl Iterator<Item = (&str, Option<(&str, &Path, bool)>)> {
        self.material.iter().map(|text| {
            let parts = text.split_once('=').map(|(name, file)| match file.strip_suffix(TIMES_TEXTURE) {
                Some(file) => (name, Path::new(file), true),
                None => (name, Path::new(file), false),
            });
            (&**text, parts)
        })
    }

    /// The file of `--illuminant`, if it is none of the known ones.
    pub fn illuminant_file(&self) -> Option<&Path> {
        self.illuminant.contains(['.', '/']).then(|| Path::new(&*self.illuminant))
    }
}

/// How `lenscube run` makes the scene of a mesh.
#[derive(Clone, Debug, PartialEq, Args)]
pub struct MeshArgs {
    /// Where the camera is.
    #[command(flatten)]
    pub view: ViewpointArgs,
    /// Which surfaces there are.
    #[command(flatten)]
    pub surfaces: SurfaceArgs,
    /// What they look like.
    #[command(flatten)]
    pub look: LookArgs,
    /// Distances of the scene in m: the margin of the chart around the film holds their blur [default: those of the mesh's corners before the camera, from
    /// ten focal lengths on]
    #[arg(long, value_name = "NEAR:FAR", value_parser = depths, help_heading = "Mesh: view")]
    pub depths_m: Option<Depths>,
    /// Keep the scene, FILM.scene, when the film is complete
    #[arg(long, help_heading = "Mesh: surfaces")]
    pub keep_scene: bool,
}

impl Default for MeshArgs {
    fn default() -> Self {
        let matches = Self::augment_args(Command::new("mesh")).get_matches_from(["mesh"]);
        Self::from_arg_matches(&matches).expect("all have defaults")
    }
}

const MESH_UNIT: Choices<MeshUnit> = &[
    ("m", "", MeshUnit::Metre),
    ("cm", "", MeshUnit::Centimetre),
    ("mm", "", MeshUnit::Millimetre),
    ("in", "", MeshUnit::Inch),
    ("ft", "", MeshUnit::Foot),
];

/// `--mesh-unit`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the variants are the values of the flag")]
pub enum MeshUnit {
    Metre,
    Centimetre,
    Millimetre,
    Inch,
    Foot,
}

#[cfg(feature = "mesh")]
impl MeshUnit {
    /// Metres per unit.
    pub fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Centimetre => 1e-2,
            Self::Millimetre => 1e-3,
            Self::Inch => 0.0254,
            Self::Foot => 0.3048,
        }
    }
}

const UP_AXIS: Choices<UpAxisArg> = &[("y", "", UpAxisArg::Y), ("z", "", UpAxisArg::Z)];

/// `--up-axis`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the variants are the values of the flag")]
pub enum UpAxisArg {
    Y,
    Z,
}

const PROJECTION: Choices<ProjectionArg> =
    &[("planar", "", ProjectionArg::Planar), ("film", "", ProjectionArg::Film)];

/// `--projection`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProjectionArg {
    /// The ideal image plane.
    Planar,
    /// The film at the primary wavelength.
    Film,
}

const SOLIDS: Choices<SolidsArg> = &[("auto", "", SolidsArg::Auto), ("none", "", SolidsArg::None)];

/// `--solids`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolidsArg {
    /// Closed components of opaque triangles.
    Auto,
    /// There are none.
    None,
}

const LIGHTS: Choices<LightsArg> = &[("file", "", LightsArg::File)];

/// `--lights`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightsArg {
    /// Those of the file.
    File,
}

const MISSING: Choices<MissingTextures> =
    &[("error", "", MissingTextures::Error), ("grey", "", MissingTextures::Grey)];

/// `--missing-textures`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MissingTextures {
    /// An error.
    Error,
    /// 0.8 of white.
    Grey,
}

/// `--reach-px`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReachArg {
    /// Everywhere.
    All,
    /// This many chart pixels.
    Pixels(usize),
}

/// `--sun`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunArg {
    /// Degrees clockwise from north.
    pub azimuth_deg: f64,
    /// Degrees above the horizon.
    pub elevation_deg: f64,
    /// Illuminance of a surface that faces it, lx.
    pub illuminance_lx: Option<f64>,
}

/// `--background`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BackgroundArg {
    /// Black, and no surface.
    None,
    /// Luminance, cd/m².
    Luminance(f64),
    /// The picture of `--environment`.
    Environment,
}

/// `--environment`.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentArg {
    /// The picture.
    pub path: PathBuf,
    /// Illuminance of an open horizontal surface, lx.
    pub illuminance_lx: Option<f64>,
}

/// Three coordinates.
fn triple(text: &str) -> Result<[f64; 3], String> {
    let parts: Vec<f64> = text.split(',').map(|part| number(part.trim())).collect::<Result<_, _>>()?;
    parts.try_into().map_err(|_| format!("`{text}`: expected three numbers, X,Y,Z"))
}

fn samples(text: &str) -> Result<usize, String> {
    let count = text.parse().ok().filter(|n| [1, 4, 16, 64].contains(n));
    count.ok_or_else(|| format!("`{text}`: expected 1, 4, 16 or 64"))
}

fn sheets(text: &str) -> Result<usize, String> {
    let count = text.parse().ok().filter(|n| (1..=8).contains(n));
    count.ok_or_else(|| format!("`{text}`: expected 1 to 8"))
}

fn reach(text: &str) -> Result<ReachArg, String> {
    match text {
        "all" => Ok(ReachArg::All),
        _ => {
            let count = text.parse().ok().filter(|n| *n <= 1_000_000);
            let count = count
                .ok_or_else(|| format!("`{text}`: expected a number of pixels up to 1000000, or all"))?;
            Ok(ReachArg::Pixels(count))
        }
    }
}

fn sun(text: &str) -> Result<SunArg, String> {
    let parts: Vec<f64> = text.split(',').map(|part| number(part.trim())).collect::<Result<_, _>>()?;
    let (azimuth_deg, elevation_deg, illuminance_lx) = match parts[..] {
        [azimuth, elevation] => (azimuth, elevation, None),
        [azimuth, elevation, lx] if lx > 0.0 => (azimuth, elevation, Some(lx)),
        _ => {
            return Err(format!(
                "`{text}`: expected AZIMUTH,ELEVATION in degrees, or with an illuminance in lx above 0"
            ));
        }
    };
    if azimuth_deg.abs() > 360.0 || elevation_deg.abs() > 90.0 {
        return Err(format!(
            "`{text}`: expected an azimuth from -360 to 360 and an elevation from -90 to 90 degrees"
        ));
    }
    Ok(SunArg { azimuth_deg, elevation_deg, illuminance_lx })
}

fn background(text: &str) -> Result<BackgroundArg, String> {
    match text {
        "none" => Ok(BackgroundArg::None),
        "environment" => Ok(BackgroundArg::Environment),
        _ => match positive(text) {
            Ok(luminance) => Ok(BackgroundArg::Luminance(luminance)),
            Err(e) => Err(format!("{e}, none or environment")),
        },
    }
}

/// `FILE`, or `FILE,LX`: what follows the last comma is an illuminance if it is a number.
fn environment(text: &str) -> Result<EnvironmentArg, String> {
    if let Some((path, lx)) = text.rsplit_once(',')
        && let Ok(lx) = number(lx)
    {
        return match lx > 0.0 && !path.is_empty() {
            true => Ok(EnvironmentArg { path: path.into(), illuminance_lx: Some(lx) }),
            false => Err(format!("`{text}`: expected a file and an illuminance in lx above 0")),
        };
    }
    Ok(EnvironmentArg { path: text.into(), illuminance_lx: None })
}

fn turn(text: &str) -> Result<f64, String> {
    let degrees: f64 = number(text)?;
    match degrees.abs() <= 360.0 {
        true => Ok(degrees),
        false => Err(format!("`{text}`: expected -360 to 360 degrees")),
    }
}
