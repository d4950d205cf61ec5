//! `lenscube demo`: what a real lens does to a chart, in pictures.
//!
//! One film of the whole 28.28 mm at a coarse pitch, where distortion and colour show; and three windows of the film at
//! its full 14,141² px of 2 µm, where the PSF shows. Both run the same code as `lenscube run`.

mod directory;

use crate::args::{Cli, Command, DemoArgs, check_directory};
use crate::chart::write;
use crate::failure::usage;
use crate::job::threads;
use crate::open::{self, Chart};
use crate::progress::{print, say};
use crate::run;
use anyhow::Result;
use clap::Parser;
use directory::DemoDirectory;
use formats::chart::{Codec, NanPolicy};
use formats::picture::curve::lens_curves;
use formats::picture::exposure::Exposure;
use formats::picture::image::Image;
use formats::picture::preview::{PreviewOptions, preview};
use formats::picture::sheet::{Crop, contact_sheet};
use formats::picture::{View, nearest_band};
use pipeline::chart::Generator;
use pipeline::colour::srgb_encode;
use pipeline::geometry::Rect;
use std::path::Path;

/// Side of the paper's film, mm, and its pixels.
const FILM_MM: f64 = 28.282;
const FULL_PX: usize = 14_141;
/// Side of a window of the full film, px.
const WINDOW_PX: usize = 640;
/// The chart's stations lie on a grid of 30 cells a side: middle, half-way, outermost; in cells from the middle.
const STATIONS: [(&str, f64); 3] = [("centre", 0.0), ("mid-field", 7.0), ("corner", 13.0)];
/// Ready-made tables: tracing the prescription's 31 bands would take longer than all the rest.
const LENS: &str = "double-gauss-28-npz";

/// Runs the command; the exit code.
pub fn command(args: &DemoArgs) -> Result<u8> {
    let dir = &args.dir;
    check_directory(dir)?;
    let mut own = DemoDirectory::open(dir)?;
    let threads = threads(args.threads);

    say(
        "1/4  the chart: a ruled sheet with stations of detail, a ColorChecker, a spectrum; 31 bands, 400-700 nm",
    );
    let pitch_um = FILM_MM * 1e3 / f64::from(args.size);
    let spec = format!("composite?size={}&pitch_um={pitch_um}", args.size);
    let chart: Generator = spec.parse().map_err(|e| usage(format!("{e}")))?;
    own.make("chart.zarr", |path| write(&chart, path, Codec::Zstd, threads, true))?;

    say(
        "2/4  the film: the whole 28.28 mm behind the lens (ready-made tables, double-gauss-28-npz; `run` traces its own)",
    );
    let chart = text(&dir.join("chart.zarr"));
    let code = own.make("film.zarr", |path| film(&chart, path, &[], threads))?;
    if code != 0 {
        return Ok(code);
    }
    say("3/4  three windows of the film at its full 14141 x 14141 px of 2 µm");
    let full = format!("gen:composite?size={FULL_PX}");
    let windows = STATIONS.map(|(_, cells)| window(cells));
    let code = own.make("windows.zarr", |path| film(&full, path, &windows, threads))?;
    if code != 0 {
        return Ok(code);
    }
    say("4/4  pictures");
    let size = args.size as usize;
    let exposure = own.make("chart.png", |path| chart_picture(dir, path, size, threads))?;
    own.make("film.png", |path| film_picture(dir, path, exposure, threads))?;
    own.make("windows.png", |_| sheet(dir, &full, &windows, threads))?;
    let curves = |path: &Path| Ok(lens_curves(open::lens(LENS)?.lens(), args.style.into())?.write(path)?);
    own.make("lens.png", curves)?;
    words(dir);
    Ok(0)
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// Runs `lenscube run chart film` with the demo's lens, as typed.
fn film(chart: &str, film: &Path, windows: &[Rect], threads: usize) -> Result<u8> {
    let mut words = ["lenscube", "run", "--lens", LENS, "--overwrite"].map(String::from).to_vec();
    for w in windows {
        words.extend(["--roi".into(), format!("{},{},{},{}", w.x, w.y, w.width, w.height)]);
    }
    words.extend(["--threads".into(), threads.to_string(), "--".into(), chart.into(), text(film)]);
    let Command::Run(args) = Cli::try_parse_from(words)?.command else {
        unreachable!("`run` is typed above")
    };
    run::command(&args)
}

/// A window of the full film about a station's stars, lines, dots and zone plate.
fn window(cells: f64) -> Rect {
    let cell = FULL_PX as f64 / 30.0;
    let place = |offset: f64| {
        let middle = (FULL_PX as f64 - 1.0) / 2.0 + (cells + offset) * cell;
        (middle - WINDOW_PX as f64 / 2.0).round() as i64
    };
    Rect::new(place(-0.5), place(0.5), WINDOW_PX, WINDOW_PX)
}

fn picture(source: &str, window: Option<Rect>, exposure: Exposure, threads: usize) -> Result<(Image, f64)> {
    let chart = Chart::open(source, None, NanPolicy::Keep, 256 << 20)?;
    let view = View { window, max_side: Some(2048), threads };
    let options = PreviewOptions { view, exposure, ..PreviewOptions::default() };
    let (image, shown) = preview(chart.source(), &chart.wavelengths_nm()?, &options, &|_, _| ())?;
    Ok((image, shown.exposure))
}

/// chart.png; its exposure, for film.png as well.
fn chart_picture(dir: &Path, out: &Path, size: usize, threads: usize) -> Result<f64> {
    let source = text(&dir.join("chart.zarr"));
    let chart = Chart::open(&source, None, NanPolicy::Keep, 0)?;
    let edge = (chart.size().height - size) / 2;
    let middle = Rect::new(edge as i64, edge as i64, size, size);
    let (image, exposure) = picture(&source, Some(middle), Exposure::Auto, threads)?;
    image.write_png(out, "lenscube demo: the chart")?;
    Ok(exposure)
}

/// film.png.
fn film_picture(dir: &Path, out: &Path, exposure: f64, threads: usize) -> Result<()> {
    let (image, _) = picture(&text(&dir.join("film.zarr")), None, Exposure::Factor(exposure), threads)?;
    Ok(image.write_png(out, "lenscube demo: the film")?)
}

/// windows.png: chart against film at 100 %.
fn sheet(dir: &Path, full: &str, windows: &[Rect], threads: usize) -> Result<()> {
    let chart = Chart::open(full, None, NanPolicy::Keep, 0)?;
    let edge = ((chart.size().height - FULL_PX) / 2) as i64;
    let mut pairs = Vec::new();
    for (i, (w, (name, cells))) in windows.iter().zip(STATIONS).enumerate() {
        let place = Rect { y: w.y + edge, x: w.x + edge, ..*w };
        let (before, exposure) = picture(full, Some(place), Exposure::Auto, threads)?;
        let source = format!("{}//roi_{i}", text(&dir.join("windows.zarr")));
        let (after, _) = picture(&source, None, Exposure::Factor(exposure), threads)?;
        let r_mm = cells * std::f64::consts::SQRT_2 * FILM_MM / 30.0;
        pairs.push([
            Crop { image: before, caption: format!("chart, {name}") },
            Crop { image: after, caption: format!("film, {name}, r = {r_mm:.1} mm, at 100 %") },
        ]);
    }
    let (last, (name, _)) = (STATIONS.len() - 1, STATIONS[STATIONS.len() - 1]);
    let corner =
        Chart::open(&format!("{}//roi_{last}", text(&dir.join("windows.zarr"))), None, NanPolicy::Keep, 0)?;
    let alone = |nm: f64| -> Result<Crop> {
        Ok(Crop { image: grey(&corner, nm)?, caption: format!("film, {name}, {nm:.0} nm alone") })
    };
    pairs.push([alone(550.0)?, alone(400.0)?]);
    let sheet = contact_sheet("Double Gauss 28°, 2 µm film: chart against film", &pairs, 1)?;
    Ok(sheet.write_png(&dir.join("windows.png"), "lenscube demo: chart against film at 100 %")?)
}

/// One band in grey, its brightest pixel white.
fn grey(chart: &Chart, wavelength_nm: f64) -> Result<Image> {
    let (size, band) = (chart.size(), nearest_band(&chart.wavelengths_nm()?, wavelength_nm)?);
    let mut pixels = vec![0f32; size.pixels()];
    chart.source().read(band, size.rect(), &mut pixels).map_err(anyhow::Error::from_boxed)?;
    let white = pixels.iter().fold(f32::MIN_POSITIVE, |m, v| m.max(*v));
    let mut image = Image::new(size, [0; 3]);
    for (y, line) in pixels.chunks_exact(size.width).enumerate() {
        for (to, v) in image.row_mut(y).iter_mut().zip(line) {
            *to = [(255.0 * srgb_encode(f64::from(v / white).max(0.0))).round() as u8; 3];
        }
    }
    Ok(image)
}

fn words(dir: &Path) {
    let d = dir.display();
    print(format!(
        "
Look at
  {d}/chart.png    what lies before the lens
  {d}/film.png     what it throws on the film: drawn inwards (barrel distortion, 0.6 % in the corner) and a little darker
                   there (RI 0.94)
  {d}/windows.png  the full film at 100 %: round blur with a violet halo in the centre; in the corner points become small
                   crosses, red towards the centre and blue away from it (lateral colour, 13 µm from 400 to 700 nm); the
                   last pair is the corner at 550 nm and at 400 nm, where this lens is far out of focus
  {d}/lens.png     relative illumination and distortion over image height, by wavelength

What to type next
  lenscube export {d}/film.zarr blue.png --band 400         one band, where the blur is largest
  lenscube lens show double-gauss-28                        the lens in numbers
  lenscube run {d}/chart.zarr no-psf.zarr --stages ri,distortion
  lenscube run 'gen:composite?size=14141' full.zarr         the whole job: 31 bands of 200 Mpx, out of core
  python -c \"import xarray; print(xarray.open_zarr('{d}/film.zarr'))\""
    ));
}
