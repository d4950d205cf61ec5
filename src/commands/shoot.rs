//! `lenscube shoot`: chart → film → raw → picture, by the commands `run`, `sensor` and `develop` one after the other. A picture as chart is
//! converted first, by `chart image`, to a store that is named by a digest of the picture, so that an interrupted command resumes.

use super::chart::image;
use super::{develop, run, sensor};
use crate::args::{
    DevelopArgs, DevelopStyle, ExposeArgs, ImageArgs, PlacementArgs, ProgressArg, RunArgs, ShootArgs,
    check_directory,
};
use crate::camera::recipe::check_white;
use crate::failure::{replacing_other_job, usage, without_flags};
use crate::job::UntracedJob;
use crate::job::lens::UntracedLens;
use crate::open;
use crate::outputs::check_absent;
use crate::progress::log_line;
use anyhow::{Context, Result};
use formats::chart::image::ImageFile;
use formats::chart::{NanPolicy, remove_chart};
use formats::film::FilmStore;
use formats::raw::RawStore;
use pipeline::geometry::Size;
use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// An error of the film, which names a flag of `lenscube run`.
fn without_force(error: anyhow::Error) -> anyhow::Error {
    without_flags(&["--force"], error, || {
        "free some space, or make the film by `lenscube run`, and then raw and picture".into()
    })
}

/// Runs the command and returns its exit code.
pub fn command(args: &ShootArgs) -> Result<u8> {
    let out = text(&args.out)?;
    let ending = args.out.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    let developed = match ending.as_deref() {
        Some("png" | "tif" | "tiff" | "exr") => true,
        Some("dng") => false,
        _ => return Err(usage(format!("{out}: expected a picture, .png, .tif or .exr, or a .dng"))),
    };
    let development = args.demosaic.is_some() || args.even_light;
    if !developed && development {
        return Err(usage(format!("{out} is not developed: --demosaic and --even-light are for pictures")));
    }
    let neutral = match &args.white {
        Some(name) if !developed => {
            Some(name.parse().map_err(|_| usage(format!("--white {name}: a .dng takes D65, A or E")))?)
        }
        _ => None,
    };
    let is_as_designed = args.surfaces.focus_m.is_none() && args.surfaces.gap.is_empty();
    if args.even_light && !(is_as_designed && args.tracing.given().is_empty()) {
        return Err(usage(
            "--even-light divides by the relative illumination of the lens as designed, not of another focus or trace: develop with `lenscube develop --shading` and a flat \
             field, or give a lens pack traced by `lenscube lens trace` with these flags",
        ));
    }
    check_absent(&args.out, args.overwrite)?;
    let directory = directory(args);
    check_directory(&directory)?;
    let [film, raw] = STORES.map(|name| text(&directory.join(name)));
    let (film, raw) = (film?, raw?);
    let picture = Picture::of(args, &directory)?;
    let steps = 3 + usize::from(picture.is_some());
    let step = |from_last: usize, what: &str| log_line(format!("{}/{steps}  {what}", steps - from_last));
    let chart = picture.as_ref().map_or(Ok(args.chart.clone()), |picture| text(&picture.chart))?;
    let job = RunArgs {
        lens: args.lens.clone(),
        var: args.var.clone(),
        axes: args.axes.clone(),
        wavelengths: args.wavelengths.clone().filter(|_| picture.is_none()),
        chart_units: args.chart_units.clone(),
        check_input: args.check_input,
        surfaces: args.surfaces.clone(),
        tracing: args.tracing.clone(),
        veil: args.veil.clone(),
        placement: PlacementArgs {
            film_size: args.film_size,
            film_pitch_um: args.film_pitch_um,
            ..PlacementArgs::default()
        },
        threads: args.threads,
        memory: args.memory,
        ..RunArgs::new(&chart, &film)
    };
    if args.exposure.contains(',') {
        return Err(usage(format!(
            "--exposure {}: expected one time; `lenscube sensor` takes several, of which `lenscube develop --merge` makes one picture",
            args.exposure
        )));
    }
    let exposure = ExposeArgs {
        sensor: Some(args.sensor.clone()),
        exposure: Some(args.exposure.clone()),
        gain: args.gain,
        iso: args.iso,
        seed: args.seed,
        threads: args.threads,
        memory: args.memory,
        ..ExposeArgs::new(&film, &raw)
    };
    // What the lens, the sensor and the picture refuse is known before the film is made: of a picture by a chart of its size and bands.
    let stand_in = picture.as_ref().map(Picture::stand_in);
    let before = RunArgs { chart: stand_in.unwrap_or(chart), ..job.clone() };
    let (file, sensor) =
        sensor::check_before_film(&exposure, Path::new(&film), &UntracedJob::new(&before)?.film)?;
    let lens = UntracedLens::open_focused(&before.lens, &before.surfaces, &before.tracing)?;
    sensor::check_lens((&file, &sensor), &lens, &before.lens)?;
    if developed {
        check_white(args.white.as_deref(), &sensor)?;
    }
    formats::durable::create_directories(&directory, true)?;
    if let Some(picture) = &picture {
        step(3, "chart");
        picture.convert(args)?;
    }
    step(2, "film");
    let code = replacing_other_job(
        args.overwrite,
        || run::run_job(&job, None, ProgressArg::Auto).map_err(without_force),
        || crate::film::remove(Path::new(&film), false),
    )?;
    if code != 0 {
        return Ok(code);
    }
    step(1, "raw");
    let code = match developed {
        true => replacing_other_job(
            args.overwrite,
            || sensor::expose(&exposure),
            || sensor::remove(Path::new(&raw), false),
        )?,
        false => sensor::expose(&ExposeArgs {
            raw: Some(args.out.clone()),
            overwrite: args.overwrite,
            white: neutral,
            ..exposure
        })?,
    };
    if code != 0 {
        return Ok(code);
    }
    step(0, "picture");
    if developed {
        let shading = args.even_light.then(|| args.lens.clone());
        let standard = DevelopStyle::default();
        let style = DevelopStyle {
            white: args.white.clone(),
            demosaic: args.demosaic,
            shading: shading.unwrap_or(standard.shading),
            ..standard
        };
        let code = develop::command(&DevelopArgs {
            style,
            threads: args.threads,
            memory: args.memory,
            overwrite: args.overwrite,
            ..DevelopArgs::new(&raw, &args.out)
        })?;
        if code != 0 {
            return Ok(code);
        }
    }
    if args.keep.is_none() {
        RawStore::remove(Path::new(&raw))?;
        FilmStore::remove(Path::new(&film))?;
        if let Some(picture) = &picture {
            remove_chart(&picture.chart)?;
        }
        match std::fs::remove_dir(&directory) {
            Err(e) if e.kind() == ErrorKind::DirectoryNotEmpty => {
                log_line(format!("note: {} contains files of yours and was not removed", directory.display()))
            }
            removed => removed.with_context(|| format!("removing {}", directory.display()))?,
        }
    }
    Ok(0)
}

/// Endings of pictures that are converted to a chart, unless they are charts themselves: spectral OpenEXR, TIFF of bands.
const PICTURES: [&str; 7] = ["png", "jpg", "jpeg", "webp", "tif", "tiff", "exr"];
/// Digits of the digest in the name of a converted picture.
const DIGEST_DIGITS: usize = 12;

/// A picture as chart.
struct Picture {
    size: Size,
    pitch_um: f64,
    wavelengths: String,
    /// The chart that it becomes.
    chart: PathBuf,
}

impl Picture {
    /// The picture of `args`, converted in `directory`; `None` for a chart.
    fn of(args: &ShootArgs, directory: &Path) -> Result<Option<Self>> {
        let path = Path::new(&args.chart);
        let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        let is_array = args.var.is_some() || args.axes.is_some();
        if !PICTURES.contains(&&*ending) || is_array || !path.is_file() {
            return Ok(None);
        }
        let is_chart = open::chart(&args.chart, args.wavelengths.as_deref(), NanPolicy::Keep, 0).is_ok();
        let file = match ImageFile::open(path) {
            _ if is_chart => return Ok(None),
            Ok(file) if file.spectral().is_none() => file,
            // The error of the chart says more.
            _ => return Ok(None),
        };
        if let Some(units) = &args.chart_units {
            return Err(usage(format!(
                "--chart-units {units}: {} is a picture, whose light is relative",
                args.chart
            )));
        }
        let pitch_um = args.film_pitch_um.ok_or_else(|| {
            usage(format!(
                "{} is a picture, whose pixels have no size on the film; give --film-pitch-um",
                args.chart
            ))
        })?;
        image::check_colours(&file, args.wavelengths.as_deref(), args.max_colour_error)?;
        let wavelengths = args.wavelengths.clone().unwrap_or(image::DEFAULT_BANDS.into());
        let mut hasher = blake3::Hasher::new();
        let reading = || format!("reading {}", args.chart);
        hasher.update_reader(File::open(path).with_context(reading)?).with_context(reading)?;
        hasher.update(format!("{wavelengths} {pitch_um} {:?}", args.max_colour_error).as_bytes());
        let digest = &hasher.finalize().to_hex()[..DIGEST_DIGITS];
        let chart = directory.join(format!("chart-{digest}.zarr"));
        Ok(Some(Self { size: file.size(), pitch_um, wavelengths, chart }))
    }

    /// A chart of its size, pitch and bands.
    fn stand_in(&self) -> String {
        let Self { size, pitch_um, wavelengths, .. } = self;
        let (width, height) = (size.width, size.height);
        format!("gen:uniform?size={width}x{height}&pitch_um={pitch_um}&overscan=0&wavelengths={wavelengths}")
    }

    /// Converts it, unless an interrupted command has.
    fn convert(&self, args: &ShootArgs) -> Result<()> {
        if self.chart.exists() {
            return Ok(());
        }
        let conversion = ImageArgs {
            threads: args.threads,
            memory: args.memory,
            pitch_um: Some(self.pitch_um),
            max_colour_error: args.max_colour_error,
            wavelengths: Some(self.wavelengths.clone()),
            ..ImageArgs::new(&args.chart, &self.chart)
        };
        image::convert(&conversion).map(|_| ())
    }
}

/// Whether `out` is a digital negative, which is not developed.
pub fn is_negative(out: &Path) -> bool {
    out.extension().is_some_and(|e| e.eq_ignore_ascii_case("dng"))
}

/// Names of film and raw in [`directory`].
pub const STORES: [&str; 2] = ["film.zarr", "raw.zarr"];

/// Where film and raw lie.
pub fn directory(args: &ShootArgs) -> PathBuf {
    args.keep.clone().unwrap_or_else(|| {
        let mut name = args.out.as_os_str().to_owned();
        name.push(".shot");
        name.into()
    })
}

fn text(path: &Path) -> Result<String> {
    path.to_str()
        .map(str::to_owned)
        .ok_or_else(|| usage(format!("{}: the name must be UTF-8", path.display())))
}
