//! Flags exactly as typed. What they mean together is decided in [`crate::job`].

use clap::{Args, Parser, Subcommand, ValueEnum};
use pipeline::geometry::{Rect, Size};
use std::path::PathBuf;

/// lenscube turns a multispectral chart into the image a given lens throws on the film.
#[derive(Debug, Parser)]
#[command(name = "lenscube", version, about, max_term_width = 110)]
#[command(
    after_help = "Start here:  lenscube demo\nExit codes: 0 complete, 1 failed, 2 usage, 3 the output belongs to \
another job, 4 checked and found wrong, 75 worth a retry, 130 interrupted and resumable"
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show what a real lens does to a chart: pictures in under a minute
    Demo(DemoArgs),
    /// Draw a test chart into a Zarr store
    Chart(Box<ChartArgs>),
    /// Look at lens packs
    Lens(LensArgs),
    /// Make the film of a chart
    Run(Box<RunArgs>),
    /// Make a picture of a film or a chart
    Export(ExportArgs),
}

/// `lenscube demo`
#[derive(Debug, Args)]
#[command(after_help = "Example:  lenscube demo --dir demo --size 2048")]
pub struct DemoArgs {
    /// Where the pictures and stores go
    #[arg(long, default_value = "lenscube-demo")]
    pub dir: PathBuf,
    /// Film side of the overview in pixels; it always spans the whole 28.28 mm
    #[arg(long, value_name = "PX", default_value_t = 2048, value_parser = clap::value_parser!(u32).range(64..=14141))]
    pub size: u32,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
}

/// `lenscube chart`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:  lenscube chart slanted-edge edges.zarr --size 14141 --grid 5 --angle-deg 5\n\
Without a store:  lenscube run 'gen:composite?size=14141' film.zarr"
)]
pub struct ChartArgs {
    /// uniform, points, slanted-edge, siemens, checker or composite
    #[arg(value_name = "KIND")]
    pub kind: String,
    /// The store to write
    #[arg(value_name = "OUT.zarr")]
    pub out: PathBuf,
    /// FILM size in pixels: N or HxW; the chart is larger by the overscan
    #[arg(long, value_name = "HxW")]
    pub size: Option<String>,
    /// Bands in nm: 400:700:10 (both ends) or 450,550
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// Pixel pitch in µm
    #[arg(long, value_name = "UM")]
    pub pitch_um: Option<String>,
    /// Chart pixels beyond the film on every side [default: 1 % of the longer side + 64]
    #[arg(long, value_name = "PX")]
    pub overscan: Option<String>,
    /// Light on the chart: D65, A or E
    #[arg(long, value_name = "NAME")]
    pub illuminant: Option<String>,
    /// uniform: the value of every pixel
    #[arg(long, allow_hyphen_values = true)]
    pub value: Option<String>,
    /// points: blobs per row and column
    #[arg(long)]
    pub count: Option<String>,
    /// points: gaussian or disc
    #[arg(long)]
    pub blob: Option<String>,
    /// points: width of a blob in pixels
    #[arg(long)]
    pub width_px: Option<String>,
    /// slanted-edge: angle from the vertical
    #[arg(long, allow_hyphen_values = true)]
    pub angle_deg: Option<String>,
    /// slanted-edge: Michelson contrast, 0 to 1
    #[arg(long)]
    pub contrast: Option<String>,
    /// slanted-edge, siemens: places per row and column
    #[arg(long)]
    pub grid: Option<String>,
    /// slanted-edge: places X,Y;X,Y in film pixels
    #[arg(long, value_name = "X,Y;…", allow_hyphen_values = true)]
    pub centers: Option<String>,
    /// slanted-edge: side of a patch in pixels
    #[arg(long)]
    pub patch_px: Option<String>,
    /// siemens: pairs of dark and bright spokes
    #[arg(long)]
    pub spokes: Option<String>,
    /// Compression of the store
    #[arg(long, value_enum, default_value_t = CodecArg::Zstd)]
    pub codec: CodecArg,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Replace an existing chart
    #[arg(long)]
    pub overwrite: bool,
}

/// `lenscube lens`
#[derive(Debug, Args)]
pub struct LensArgs {
    /// What to do with it.
    #[command(subcommand)]
    pub command: LensCommand,
}

/// The lens commands.
#[derive(Debug, Subcommand)]
pub enum LensCommand {
    /// Print what a lens pack holds and what its sampling implies
    #[command(after_help = "Example:  lenscube lens show double-gauss-28 --all-bands")]
    Show {
        /// A lens pack (directory or .zip) or the name of a built-in lens
        #[arg(value_name = "PACK")]
        lens: String,
        /// Every band, not just a few
        #[arg(long)]
        all_bands: bool,
        /// As JSON
        #[arg(long)]
        json: bool,
    },
    /// Make a lens pack from a prescription: heights, RI and PSFs by ray tracing
    Trace(Box<TraceArgs>),
}

/// `lenscube lens trace`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube lens trace double-gauss-28 dg.lens.zarr\n  \
lenscube lens trace my.zmx my.lens.zarr --wavelengths 450:650:50 --max-height-mm 21.6 --image-plane rms")]
pub struct TraceArgs {
    /// A sequential .zmx file, or double-gauss-28
    #[arg(value_name = "DESIGN")]
    pub design: String,
    /// The lens pack to write, a directory or a .zip
    #[arg(value_name = "OUT.lens.zarr")]
    pub out: PathBuf,
    /// Bands in nm: 400:700:10 (both ends) or 450,550
    #[arg(long, value_name = "NM", default_value = "400:700:10")]
    pub wavelengths: String,
    /// REAL image height that the tables reach: the film's corner and the PSF's margin
    #[arg(long, value_name = "MM", value_parser = positive, default_value = "20.5")]
    pub max_height_mm: f64,
    /// REAL image heights of the PSFs in mm, 0:20.5:0.5 or 0,3,7.5 [default: chosen by error]
    #[arg(long, value_name = "MM")]
    pub heights: Option<String>,
    /// Share of the light that every window must hold
    #[arg(long, value_parser = positive, default_value = "0.99")]
    pub energy: f64,
    /// Error allowed of a kernel between nodes, L1 on the film pixel
    #[arg(long, value_parser = positive, default_value = "0.01")]
    pub psf_tolerance: f64,
    /// Pitch of the PSF samples [default: finer than Nyquist]
    #[arg(long, value_name = "UM", value_parser = positive)]
    pub psf_pitch_um: Option<f64>,
    /// Pitch of the film that the pack is for
    #[arg(long, value_name = "UM", value_parser = positive, default_value = "2")]
    pub film_pitch_um: f64,
    /// Where the film lies
    #[arg(long, value_enum, default_value_t = ImagePlaneArg::Design)]
    pub image_plane: ImagePlaneArg,
    /// Wavelength of that focus [default: the design's primary]
    #[arg(long, value_name = "NM", value_parser = positive)]
    pub focus_nm: Option<f64>,
    /// Film beyond that plane, away from the lens
    #[arg(long, value_name = "MM", default_value_t = 0.0, allow_hyphen_values = true)]
    pub defocus_mm: f64,
    /// Distance of the object from the first surface [default: as in the design]
    #[arg(long, value_name = "MM", value_parser = positive)]
    pub object_distance_mm: Option<f64>,
    /// How rays are sent through the stop [default: as in the design]
    #[arg(long, value_enum)]
    pub aiming: Option<AimingArg>,
    /// Glass catalogue in AGF format, beside the built-in Schott glasses; may be repeated
    #[arg(long, value_name = "FILE.agf")]
    pub glass_catalog: Vec<PathBuf>,
}

/// Where the film lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ImagePlaneArg {
    /// As in the design
    Design,
    /// At the paraxial focus
    Paraxial,
    /// Least RMS spot on the axis
    Rms,
    /// Highest Strehl ratio on the axis
    Strehl,
}

/// How rays are sent through the stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum AimingArg {
    /// So that they fill the stop
    Real,
    /// At the paraxial entrance pupil
    Paraxial,
}

/// `lenscube run`
#[derive(Debug, Args, Clone)]
#[command(after_help = "Examples:\n  lenscube run chart.zarr film.zarr --lens double-gauss-28\n  \
lenscube run 'gen:composite?size=14141' film.zarr --memory 1GiB\n  \
lenscube run chart.zarr corner.zarr --roi 13100,13100,1024,1024 --bands 0:5\n\
The same command again resumes an interrupted run.")]
pub struct RunArgs {
    /// PATH, PATH//array or gen:KIND?size=14141&…
    #[arg(value_name = "CHART")]
    pub chart: String,
    /// The film to write, a Zarr v3 group
    #[arg(value_name = "FILM")]
    pub film: PathBuf,
    /// A lens pack (directory or .zip) or the name of a built-in lens
    #[arg(long, value_name = "NAME|PACK", default_value = "double-gauss-28")]
    pub lens: String,
    /// Wavelengths of the chart's bands where the store has none: 400:700:10 (both ends) or 450,550
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// Bands to make: indices and ranges without their end, 0,5,10:15
    #[arg(long)]
    pub bands: Option<String>,
    /// Which of ri, distortion, svpsf to apply
    #[arg(long, value_enum, value_delimiter = ',', default_value = "ri,distortion,svpsf")]
    pub stages: Vec<Stage>,
    /// Compute windows of the film only, each an array roi_N; may be repeated
    #[arg(long, value_name = "X,Y,W,H", value_parser = roi)]
    pub roi: Vec<Rect>,
    /// Azimuths per PSF height instead of the lens's own, a multiple of 4
    #[arg(long, value_name = "J", value_parser = azimuths)]
    pub azimuths: Option<usize>,
    /// Crop PSFs to N x N film pixels, odd; they are normalised again
    #[arg(long, value_name = "N", value_parser = odd)]
    pub psf_window: Option<usize>,
    /// Interpolate PSFs between the lens's wavelengths (it can be wrong by 30-100 % over 20 nm in the blue)
    #[arg(long)]
    pub interpolate_psf: bool,
    /// Film size in pixels: N or HxW [default: the chart's film_size, else its size times the scale]
    #[arg(long, value_name = "HxW", value_parser = size)]
    pub film_size: Option<Size>,
    /// Film pixel pitch in µm [default: the chart's pitch_um]
    #[arg(long, value_name = "UM", value_parser = pitch)]
    pub film_pitch_um: Option<f64>,
    /// Optical axis in film pixels [default: the middle]
    #[arg(long, value_name = "X,Y", value_parser = pair, allow_hyphen_values = true)]
    pub axis: Option<(f64, f64)>,
    /// Film pixels per chart pixel
    #[arg(long, value_name = "SX[,SY]", value_parser = scale, default_value = "1")]
    pub scale: (f64, f64),
    /// Centre of the chart in mm from the axis
    #[arg(long, value_name = "X,Y", value_parser = pair, default_value = "0,0", allow_hyphen_values = true)]
    pub center: (f64, f64),
    /// Interpolation between chart pixels (bilinear blurs)
    #[arg(long, value_enum, default_value_t = InterpArg::Bicubic)]
    pub interp: InterpArg,
    /// What lies around the chart
    #[arg(long, value_enum, default_value_t = SurroundArg::Edge)]
    pub surround: SurroundArg,
    /// Film beyond the lens's tables: refuse, or go on with the last values
    #[arg(long, value_enum, default_value_t = OutsideArg::Error)]
    pub outside: OutsideArg,
    /// NaN and infinity in the chart: refuse, or read as zero and count
    #[arg(long, value_enum, default_value_t = NanArg::Error)]
    pub nan: NanArg,
    /// relative (chart values x RI), irradiance (W m-2 nm-1 of a radiance chart) or photons (per s, nm, pixel)
    #[arg(long, value_enum, default_value_t = FilmUnits::Relative)]
    pub film_units: FilmUnits,
    /// Sample type of the film
    #[arg(long, value_enum, default_value_t = DtypeArg::F32)]
    pub dtype: DtypeArg,
    /// Shard side in pixels, a multiple of the chunk
    #[arg(long, default_value_t = 2048, value_parser = storage)]
    pub shard: usize,
    /// Inner chunk side in pixels
    #[arg(long, default_value_t = 512, value_parser = storage)]
    pub chunk: usize,
    /// Compression of the film
    #[arg(long, value_enum, default_value_t = CodecArg::Zstd)]
    pub codec: CodecArg,
    /// cpu, cuda or auto
    #[arg(long, value_enum, default_value_t = Device::Auto)]
    pub device: Device,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Memory to stay within, e.g. 1GiB [default: half of what is available, at most 4 GiB]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub memory: Option<u64>,
    /// Do not wait for the disk after each shard: faster, unsafe against power cuts
    #[arg(long)]
    pub no_fsync: bool,
    /// Start anew if the film exists
    #[arg(long)]
    pub overwrite: bool,
}

/// `lenscube export`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube export film.zarr film.png\n  \
lenscube export film.zarr//roi_0 corner.png\n  lenscube export film.zarr band.png --band 450")]
pub struct ExportArgs {
    /// A film or chart: PATH, PATH//array or gen:KIND?…
    #[arg(value_name = "FILM")]
    pub film: String,
    /// The picture to write
    #[arg(value_name = "OUT.png")]
    pub out: PathBuf,
    /// One band as 16-bit linear grey, by its wavelength in nm
    #[arg(long, value_name = "NM")]
    pub band: Option<f64>,
    /// Longest side of the picture in pixels; larger films are area-averaged
    #[arg(long, value_name = "PX", default_value_t = 2048)]
    pub max_side: usize,
    /// What is shown as white: D65, A or E
    #[arg(long, value_name = "NAME", default_value = "D65")]
    pub white: String,
    /// Factor on the values, or auto
    #[arg(long, default_value = "auto")]
    pub exposure: String,
    /// Wavelengths where the store has none
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
}

/// One of the three effects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Stage {
    /// Relative illumination
    Ri,
    /// Radial distortion
    Distortion,
    /// Spatially variant PSF
    Svpsf,
}

/// Interpolation words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum InterpArg {
    Bicubic,
    Bilinear,
}

/// Surround words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum SurroundArg {
    Edge,
    Black,
    Mirror,
}

/// Outside words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum OutsideArg {
    Error,
    Clamp,
}

/// NaN words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum NanArg {
    Error,
    Zero,
}

/// Units of the film.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FilmUnits {
    /// Chart values times relative illumination, blurred
    Relative,
    /// Spectral irradiance, W m-2 nm-1
    Irradiance,
    /// Photons per second, nm and pixel
    Photons,
}

/// Sample types of the film.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum DtypeArg {
    F32,
    F16,
}

/// Codecs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum CodecArg {
    None,
    Lz4,
    Zstd,
}

/// Devices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum Device {
    Cpu,
    Cuda,
    Auto,
}

fn number(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(v) if v.is_finite() => Ok(v),
        _ => Err(format!("`{text}` is not a number")),
    }
}

fn positive(text: &str) -> Result<f64, String> {
    number(text).and_then(|v| if v > 0.0 { Ok(v) } else { Err(format!("{v} is not above 0")) })
}

fn pair(text: &str) -> Result<(f64, f64), String> {
    let (a, b) = text.split_once(',').ok_or("expected two numbers X,Y")?;
    // Beyond this no lens sees the film, and pixels no longer count exactly.
    let place = |t: &str| match number(t)? {
        v if v.abs() <= 1e7 => Ok(v),
        v => Err(format!("{v:e} is beyond ±1e7")),
    };
    Ok((place(a)?, place(b)?))
}

fn pitch(text: &str) -> Result<f64, String> {
    match positive(text)? {
        v if (1e-3..=1e6).contains(&v) => Ok(v),
        v => Err(format!("{v:e} is not from 1e-3 to 1e6 µm")),
    }
}

fn scale(text: &str) -> Result<(f64, f64), String> {
    let (x, y) = text.split_once(',').unwrap_or((text, text));
    let (x, y) = (positive(x)?, positive(y)?);
    let sane = 1e-3..=1e3;
    match sane.contains(&x) && sane.contains(&y) {
        true => Ok((x, y)),
        false => Err("expected 0.001 to 1000 film pixels per chart pixel".into()),
    }
}

/// Film sides beyond this are a slip of the finger: 10^12 pixels a band.
const LARGEST_SIDE: usize = 1_000_000;

fn side(text: &str) -> Result<usize, String> {
    match text.trim().parse::<usize>() {
        Ok(n) if (1..=LARGEST_SIDE).contains(&n) => Ok(n),
        _ => Err(format!("`{text}` is not a number of pixels from 1 to {LARGEST_SIDE}")),
    }
}

/// Sides of shards and chunks; the film's layout checks the same.
fn storage(text: &str) -> Result<usize, String> {
    side(text)
        .ok()
        .filter(|n| *n <= 16384)
        .ok_or_else(|| format!("`{text}` is not a number of pixels from 1 to 16384"))
}

fn size(text: &str) -> Result<Size, String> {
    let (h, w) = text.split_once(['x', 'X']).unwrap_or((text, text));
    Ok(Size::new(side(h)?, side(w)?))
}

fn roi(text: &str) -> Result<Rect, String> {
    let parts: Vec<&str> = text.split(',').collect();
    let [x, y, w, h] = parts[..] else { return Err("expected X,Y,W,H in film pixels".into()) };
    let at = |t: &str| {
        t.trim().parse::<u32>().map(i64::from).map_err(|_| format!("`{t}` is not a pixel of the film"))
    };
    Ok(Rect::new(at(y)?, at(x)?, side(h)?, side(w)?))
}

fn azimuths(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(n) if n > 0 && n.is_multiple_of(4) && n <= 7200 => Ok(n),
        _ => Err("expected a multiple of 4, at most 7200 (of 8: seven of eight kernels are flips)".into()),
    }
}

fn odd(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(n) if n % 2 == 1 => Ok(n),
        _ => Err("expected an odd number of film pixels".into()),
    }
}

fn threads(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(n) if (1..=1024).contains(&n) => Ok(n),
        _ => Err("expected 1 to 1024 threads".into()),
    }
}

/// `1GiB`, `512MiB`, `2e9`, `4G`: binary units with i, decimal without.
fn bytes(text: &str) -> Result<u64, String> {
    let text = text.trim();
    let digits = text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.').len();
    let unit = match text[digits..].trim().to_ascii_lowercase().as_str() {
        "" | "b" => 1u64,
        "k" | "kb" => 1000,
        "ki" | "kib" => 1 << 10,
        "m" | "mb" => 1_000_000,
        "mi" | "mib" => 1 << 20,
        "g" | "gb" => 1_000_000_000,
        "gi" | "gib" => 1 << 30,
        "t" | "tb" => 1_000_000_000_000,
        "ti" | "tib" => 1 << 40,
        other => {
            return Err(format!("`{other}` is not a unit of bytes (KiB, MiB, GiB, TiB, or kB, MB, GB, TB)"));
        }
    };
    match text[..digits].parse::<f64>() {
        Ok(v) if v > 0.0 => Ok((v * unit as f64) as u64),
        _ => Err(format!("`{text}` is not an amount of memory such as 1GiB")),
    }
}

/// Indices and ranges without their end, as in Python: `0,5,10:15`, `:5`, `::3`; each once, ascending.
///
/// # Errors
/// A word that is none, or an index beyond `count`.
pub fn bands(text: &str, count: usize) -> Result<Vec<usize>, String> {
    let mut out = std::collections::BTreeSet::new();
    for part in text.split(',') {
        let fields: Vec<&str> = part.trim().split(':').collect();
        let index = |t: &str, default: usize| match t.trim() {
            "" => Ok(default),
            t => t.parse::<usize>().map_err(|_| format!("`{t}` is not a band index")),
        };
        let (first, end, step) = match fields[..] {
            [one] => {
                let i = one.parse::<usize>().map_err(|_| format!("`{one}` is not a band index"))?;
                if i >= count {
                    return Err(format!("band {i} is beyond the chart's last, {}", count - 1));
                }
                (i, i + 1, 1)
            }
            [a, b] => (index(a, 0)?, index(b, count)?, 1),
            [a, b, s] => (index(a, 0)?, index(b, count)?, index(s, 1)?),
            _ => return Err(format!("`{part}` is not a range of bands such as 10:15")),
        };
        if step == 0 {
            return Err(format!("`{part}` has a step of 0"));
        }
        if end > count {
            return Err(format!("range {part} ends beyond the chart's {count} bands"));
        }
        out.extend((first..end).step_by(step));
    }
    match out.is_empty() {
        true => Err(format!("`{text}` selects no band of {count}")),
        false => Ok(out.into_iter().collect()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_the_command_line() {
        assert_eq!(size("14141"), Ok(Size::new(14141, 14141)));
        assert_eq!(size("7x5"), Ok(Size::new(7, 5)));
        assert!(size("1e18").is_err() && size("0").is_err() && size("-3x4").is_err());
        assert_eq!(bytes("1GiB"), Ok(1 << 30));
        assert_eq!(bytes("1.5 MB"), Ok(1_500_000));
        assert!(bytes("one").is_err() && bytes("4QiB").is_err());
        assert_eq!(roi("3,5,10,20"), Ok(Rect::new(5, 3, 20, 10)));
        assert!(roi("1,2,3").is_err() && roi("-1,0,5,5").is_err() && roi("0,0,0,5").is_err());
        assert_eq!(bands("0,5,10:15", 31), Ok(vec![0, 5, 10, 11, 12, 13, 14]));
        assert_eq!(bands(":3", 31), Ok(vec![0, 1, 2]));
        assert_eq!(bands("::10", 31), Ok(vec![0, 10, 20, 30]));
        assert!(bands("31", 31).is_err() && bands("5:2", 31).is_err() && bands("x", 31).is_err());
        assert_eq!(scale("2"), Ok((2.0, 2.0)));
        assert_eq!(scale("2,0.5"), Ok((2.0, 0.5)));
        assert!(scale("0").is_err() && scale("nan").is_err());
    }

    #[test]
    fn clap_finds_no_fault_with_the_flags() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }
}
