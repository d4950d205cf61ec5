//! `lenscube demo`: pictures of a chart and of the films that a real lens makes of it.
//!
//! One film of the complete 28.28 mm at a coarse pitch, which shows distortion and colour; and three regions of the film at its full
//! 14,141² px of 2 µm, which show the PSF. Both are made by the code of `lenscube run`. Last, what a camera records of the corner.

mod camera;
mod depth;
mod directory;

use crate::args::{DemoArgs, DesignArgs, ProcessArgs, ProgressArg, RunArgs, TracingArgs, check_directory};
use crate::commands::chart::write;
use crate::commands::run;
use crate::failure::usage;
use crate::job::lens::samples::LensData;
use crate::machine::threads;
use crate::open::{self, Chart};
use crate::progress::{log_line, print};
use anyhow::Result;
use directory::DemoDirectory;
use formats::chart::{Codec, NanPolicy};
use formats::picture::contact_sheet::{Crop, contact_sheet};
use formats::picture::curve::lens_curves;
use formats::picture::exposure::Exposure;
use formats::picture::image::Image;
use formats::picture::preview::{PreviewOptions, preview};
use formats::picture::{View, nearest_band};
use pipeline::chart::Generator;
use pipeline::colour::srgb_encode;
use pipeline::geometry::Rect;
use std::path::Path;

/// Side of the paper's film, mm and px.
const FILM_MM: f64 = 28.282;
const FULL_PX: usize = 14_141;
/// Pixel pitch of the full film, mm.
const FULL_PITCH_MM: f64 = 0.002;
/// Side of a region of the full film, px.
const REGION_PX: usize = 640;
/// Test patterns of the chart, which has 30 x 30 cells: name and distance from the centre in cells.
const STATIONS: [(&str, f64); 3] = [("centre", 0.0), ("mid-field", 7.0), ("corner", 13.0)];
/// The lens, traced at the 31 wavelengths of the chart unless they are in the cache.
const LENS: &str = "double-gauss-28";
/// Wavelengths of the lens's curves, nm, and their maximum REAL image height, mm: that of the film's corner.
const CURVES_NM: [f64; 7] = [400.0, 450.0, 500.0, 550.0, 600.0, 650.0, 700.0];
const CURVES_MM: f64 = 20.0;

/// Runs the command and returns its exit code.
pub fn command(args: &DemoArgs) -> Result<u8> {
    let dir = &args.dir;
    check_directory(dir)?;
    let mut demo = DemoDirectory::open(dir)?;
    if args.depth {
        return depth::command(args, &mut demo);
    }
    let threads = threads(args.threads);

    log_line("1/5  chart: grid lines, test patterns, a ColorChecker, a spectrum; 31 bands, 400-700 nm");
    let pitch_um = FILM_MM * 1e3 / f64::from(args.size);
    let spec = format!("composite?size={}&pitch_um={pitch_um}", args.size);
    let chart: Generator = spec.parse().map_err(|e| usage(format!("{e}")))?;
    demo.create("chart.zarr", |path| write(&chart, path, Codec::default(), threads, true))?;

    log_line(
        "2/5  film (sensor-plane image): the complete 28.28 mm, with the built-in lens double-gauss-28, traced once",
    );
    let chart = text(&dir.join("chart.zarr"));
    let code = demo.create("film.zarr", |path| film(&chart, path, &[], threads))?;
    if code != 0 {
        return Ok(code);
    }
    log_line("3/5  three regions of the film at its full 14141 x 14141 px of 2 µm");
    let full = format!("gen:composite?size={FULL_PX}");
    let regions = STATIONS.map(|(_, cells)| region(cells));
    let code = demo.create("regions.zarr", |path| film(&full, path, &regions, threads))?;
    if code != 0 {
        return Ok(code);
    }
    log_line("4/5  raw of the corner by the sensor example-2um, one sensor pixel per film pixel");
    let corner = format!("{}//roi_{}", text(&dir.join("regions.zarr")), STATIONS.len() - 1);
    let centre_mm = |first: i64| {
        ((first as f64 + (REGION_PX as f64 - FULL_PX as f64) / 2.0) * FULL_PITCH_MM * 1e6).round() / 1e6
    };
    let middle = regions.last().map_or((0.0, 0.0), |r| (centre_mm(r.x), centre_mm(r.y)));
    let code = demo.create("corner.raw.zarr", |path| camera::expose(&corner, path, middle, threads))?;
    if code != 0 {
        return Ok(code);
    }
    log_line("5/5  pictures");
    let size = args.size as usize;
    let exposure = demo.create("chart.png", |path| chart_picture(dir, path, size, threads))?;
    demo.create("film.png", |path| film_picture(dir, path, exposure, threads))?;
    demo.create("regions.png", |_| region_pictures(dir, &full, &regions, threads))?;
    demo.create("camera.png", |path| camera_picture(dir, path, (&full, &regions), threads))?;
    demo.create("lens.png", |path| {
        let lens = LensData::open(LENS, &DesignArgs::default())?.sample(&CURVES_NM, &[0.0, CURVES_MM])?.lens;
        Ok(lens_curves(&lens, args.style)?.write(path)?)
    })?;
    print_summary(dir);
    Ok(0)
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// Makes the film of `chart` by the lens of the demo, complete or `regions` of it; the exit code.
fn film(chart: &str, film: &Path, regions: &[Rect], threads: usize) -> Result<u8> {
    // Tails need the whole chart of 31 × 200 Mpx before the first region.
    let tracing = TracingArgs { tails: false, ..TracingArgs::default() };
    let job = RunArgs { lens: LENS.into(), roi: regions.to_vec(), tracing, ..request(chart, film, threads) };
    run::run_job(&job, None, ProgressArg::Auto)
}

/// A film that replaces the one of an earlier demo.
fn request(chart: &str, film: &Path, threads: usize) -> RunArgs {
    let process = ProcessArgs { overwrite: true, ..ProcessArgs::default() };
    RunArgs { threads: Some(threads), process, ..RunArgs::new(chart, film) }
}

/// Region of the full film around the test patterns `cells` from the centre: stars, lines, dots and a zone plate.
fn region(cells: f64) -> Rect {
    let cell = FULL_PX as f64 / 30.0;
    let first = |offset: f64| {
        let centre = (FULL_PX as f64 - 1.0) / 2.0 + (cells + offset) * cell;
        (centre - REGION_PX as f64 / 2.0).round() as i64
    };
    Rect::new(first(-0.5), first(0.5), REGION_PX, REGION_PX)
}

fn picture(source: &str, region: Option<Rect>, exposure: Exposure, threads: usize) -> Result<(Image, f64)> {
    let chart = open::chart(source, None, NanPolicy::Keep, 256 << 20)?;
    let view = View { region, max_side: Some(2048), threads };
    let options = PreviewOptions { view, exposure, ..PreviewOptions::default() };
    let (image, shown) = preview(chart.source(), &chart.wavelengths_nm()?, &options, &|_, _| ())?;
    Ok((image, shown.exposure))
}

/// Writes chart.png and returns its exposure for film.png.
fn chart_picture(dir: &Path, out: &Path, size: usize, threads: usize) -> Result<f64> {
    let source = text(&dir.join("chart.zarr"));
    let chart = open::chart(&source, None, NanPolicy::Keep, 0)?;
    let edge = (chart.size().height - size) / 2;
    let middle = Rect::new(edge as i64, edge as i64, size, size);
    let (image, exposure) = picture(&source, Some(middle), Exposure::Auto, threads)?;
    image.write_png(out, "lenscube demo: the chart")?;
    Ok(exposure)
}

/// Writes film.png.
fn film_picture(dir: &Path, out: &Path, exposure: f64, threads: usize) -> Result<()> {
    let (image, _) = picture(&text(&dir.join("film.zarr")), None, Exposure::Factor(exposure), threads)?;
    Ok(image.write_png(out, "lenscube demo: the film")?)
}

/// Writes regions.png: chart and film side by side at 100 %.
fn region_pictures(dir: &Path, full: &str, regions: &[Rect], threads: usize) -> Result<()> {
    let chart = open::chart(full, None, NanPolicy::Keep, 0)?;
    let edge = ((chart.size().height - FULL_PX) / 2) as i64;
    let mut pairs = Vec::new();
    for (i, (region, (name, cells))) in regions.iter().zip(STATIONS).enumerate() {
        let chart_region = Rect { y: region.y + edge, x: region.x + edge, ..*region };
        let (chart, exposure) = picture(full, Some(chart_region), Exposure::Auto, threads)?;
        let source = format!("{}//roi_{i}", text(&dir.join("regions.zarr")));
        let (film, _) = picture(&source, None, Exposure::Factor(exposure), threads)?;
        let r_mm = cells * std::f64::consts::SQRT_2 * FILM_MM / 30.0;
        pairs.push([
            Crop { image: chart, caption: format!("chart, {name}") },
            Crop { image: film, caption: format!("film, {name}, r = {r_mm:.1} mm, at 100 %") },
        ]);
    }
    let (last, (name, _)) = (STATIONS.len() - 1, STATIONS[STATIONS.len() - 1]);
    let corner =
        open::chart(&format!("{}//roi_{last}", text(&dir.join("regions.zarr"))), None, NanPolicy::Keep, 0)?;
    let one_band = |nm: f64| -> Result<Crop> {
        Ok(Crop { image: grey(&corner, nm)?, caption: format!("film, {name}, {nm:.0} nm only") })
    };
    pairs.push([one_band(550.0)?, one_band(400.0)?]);
    let picture = contact_sheet("Double Gauss 28°, 2 µm film: chart and film", &pairs, 1)?;
    Ok(picture.write_png(&dir.join("regions.png"), "lenscube demo: chart and film at 100 %")?)
}

/// Writes camera.png: the corner of the film as the observer sees it, beside the camera's picture.
fn camera_picture(dir: &Path, out: &Path, (full, regions): (&str, &[Rect]), threads: usize) -> Result<()> {
    let chart = open::chart(full, None, NanPolicy::Keep, 0)?;
    let edge = ((chart.size().height - FULL_PX) / 2) as i64;
    let last = regions.len() - 1;
    let region = regions[last];
    let chart_region = Rect { y: region.y + edge, x: region.x + edge, ..region };
    let (_, exposure) = picture(full, Some(chart_region), Exposure::Auto, threads)?;
    let film = format!("{}//roi_{last}", text(&dir.join("regions.zarr")));
    let (seen, _) = picture(&film, None, Exposure::Factor(exposure), threads)?;
    let recorded = camera::picture(&dir.join("corner.raw.zarr"), &seen, threads)?;
    let pair = [
        Crop { image: seen, caption: "film, as the observer sees it, at 100 %".into() },
        Crop { image: recorded, caption: format!("as the camera {} records it, at 100 %", camera::SENSOR) },
    ];
    let picture = contact_sheet("Corner of the film behind a Double Gauss 28°, 2 µm", &[pair], 1)?;
    Ok(picture.write_png(out, "lenscube demo: film and camera at 100 %")?)
}

/// One band in grey; the brightest pixel is white.
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

fn print_summary(dir: &Path) {
    let d = dir.display();
    print(format!(
        "
Results
  {d}/chart.png    the chart, input of the simulation
  {d}/film.png     the film: barrel distortion of 0.6 % in the corner, relative illumination of 0.94 there
  {d}/regions.png  regions of the full film at 100 %: at the centre a round PSF with a violet halo; in the corner points
                   become small crosses, red towards the centre and blue away from it (lateral colour, 13 µm from 400 to
                   700 nm); the last pair is the corner at 550 nm and at 400 nm, where this lens is far out of focus
  {d}/camera.png   the corner as the observer sees the film, beside what a camera records of it (sensor example-2um: Bayer
                   pattern, noise, auto exposure), from {d}/corner.raw.zarr
  {d}/lens.png     relative illumination and distortion over image height, by wavelength

Next commands
  lenscube export {d}/film.zarr blue.png --band 400         one band, where the PSF is largest
  lenscube lens show double-gauss-28                        data of the lens
  lenscube develop {d}/corner.raw.zarr corner.png --exposure 1
  lenscube run {d}/chart.zarr no-psf.zarr --stages ri,distortion
  lenscube run 'gen:composite?size=14141' full.zarr         the full job: 31 bands of 200 Mpx, out of core
  python -c \"import xarray; print(xarray.open_zarr('{d}/film.zarr'))\""
    ));
}
