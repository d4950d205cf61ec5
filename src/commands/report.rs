//! `lenscube report`: a camera measured from pictures of charts, or two side by side, as a page with plots, JSON and SVG.
//!
//! | chart | measured | section |
//! |---|---|---|
//! | iso12233-esfr, slanted-edge | e-SFR | [`sfr`] |
//! | siemens | s-SFR | [`star`] |
//! | dead-leaves | texture MTF | [`texture`] |
//! | oecf, iso12233-esfr | OECF, noise, SNR, dynamic range, visual noise | [`tones`] |
//! | dot-grid | distortion, lateral colour | [`distortion`] |
//! | uniform | shading of light and colour | [`shading`] |
//! | black-spots | veiling glare | [`glare`] |
//! | checker | colour errors, metamerism index | [`colour`] |
//!
//! A chart is found by its fiducials, by corners that are given, or fills the picture ([`place`]). The estimators are those of [`pipeline::measure`].

mod colour;
mod distortion;
mod glare;
mod page;
mod picture;
mod place;
mod section;
mod sfr;
mod shading;
mod star;
mod texture;
mod tones;

use crate::args::{ReportArgs, check_directory};
use crate::failure::usage;
use crate::machine::threads;
use crate::outputs::{check_absent_in, remove_earlier};
use crate::progress::{log_line, print};
use anyhow::{Context, Result};
use formats::durable::{AtomicFile, create_directories, finish_together};
use page::Camera;
use picture::Picture;
use pipeline::chart::{ChartSpec, Kind};
use place::Placed;
use section::Section;
use serde_json::{Value, json};

/// Measures a chart in a picture.
type Measure = fn(&Placed<'_>, &ReportArgs) -> Result<Section>;
/// The page, and the values for programs.
const FILES: [&str; 2] = ["report.html", "report.json"];
/// Plots of a section, at most.
const MAX_PLOTS: usize = 3;
/// Remarks of a section that are printed.
const MAX_REMARKS: usize = 4;

/// What is measured of a kind of chart: the name of its files, and how.
fn measures(kind: &Kind) -> &'static [(&'static str, Measure)] {
    match kind {
        Kind::Esfr { .. } => &[("e-sfr", sfr::measure), ("noise", tones::measure)],
        Kind::SlantedEdge { .. } => &[("e-sfr", sfr::measure)],
        Kind::Siemens { .. } => &[("s-sfr", star::measure)],
        Kind::DeadLeaves { .. } => &[("texture", texture::measure)],
        Kind::Oecf { .. } => &[("noise", tones::measure)],
        Kind::DotGrid { .. } => &[("distortion", distortion::measure)],
        Kind::Uniform { .. } => &[("shading", shading::measure)],
        Kind::BlackSpots { .. } => &[("glare", glare::measure)],
        Kind::Checker => &[("colour", colour::measure)],
        Kind::Points { .. } | Kind::Lamp { .. } | Kind::Composite | Kind::DepthScene { .. } => &[],
    }
}

/// The chart of each picture, as text.
fn charts(args: &ReportArgs) -> Result<Vec<&str>> {
    let texts: Vec<&str> = match &args.chart[..] {
        [one] => vec![one; args.pictures.len()],
        all => all.iter().map(String::as_str).collect(),
    };
    if texts.len() != args.pictures.len() {
        return Err(usage(format!(
            "--chart: expected one for all pictures, or one for each of {}, found {}",
            args.pictures.len(),
            texts.len()
        )));
    }
    Ok(texts)
}

/// Names of the files that the command may write in its directory.
///
/// # Errors
/// Usage: an unknown chart, or one of which nothing is measured; another number of charts than of pictures.
pub fn files(args: &ReportArgs) -> Result<Vec<String>> {
    let mut all: Vec<String> = FILES.map(str::to_owned).to_vec();
    let sides = if args.against.is_empty() { 1 } else { 2 };
    let mut section = 0;
    for text in charts(args)? {
        let spec: ChartSpec = text.parse().map_err(|e| usage(format!("--chart {text}: {e}")))?;
        let kind = &spec.kind;
        if measures(kind).is_empty() {
            return Err(usage(format!(
                "--chart {text}: nothing is measured of a chart `{}`; `lenscube report --help` lists those that are",
                kind.name()
            )));
        }
        for (slug, _) in measures(kind) {
            all.extend((0..sides * MAX_PLOTS).map(|k| svg_name(k % sides, section, slug, k / sides)));
            section += 1;
        }
    }
    Ok(all)
}

/// Name of a plot: of camera a or b, section and plot by number.
fn svg_name(side: usize, section: usize, slug: &str, plot: usize) -> String {
    format!("{}{}-{slug}-{}.svg", if side == 0 { "a" } else { "b" }, section + 1, plot + 1)
}

/// What is measured ([`measures`]), in names of plots.
const SLUGS: [&str; 8] = ["e-sfr", "noise", "s-sfr", "texture", "distortion", "shading", "glare", "colour"];

/// Whether a file has the name of a plot ([`svg_name`]).
fn is_plot(name: &str) -> bool {
    let number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    let parts = name.strip_suffix(".svg").and_then(|name| name.split_once('-'));
    let Some((first, (slug, last))) = parts.and_then(|(first, rest)| Some((first, rest.rsplit_once('-')?)))
    else {
        return false;
    };
    let section = first.strip_prefix(['a', 'b']).unwrap_or_default();
    number(section) && number(last) && SLUGS.contains(&slug)
}

/// Runs the command.
///
/// # Errors
/// A chart that is not found, or whose figures would not be meaningful; a picture that cannot be read.
pub fn command(args: &ReportArgs) -> Result<()> {
    check_directory(&args.out)?;
    check_absent_in(&args.out, files(args)?, args.overwrite)?;
    check_counts(args)?;
    let texts = charts(args)?;
    let threads = threads(args.threads);
    let sides = [&args.pictures, &args.against].into_iter().filter(|s| !s.is_empty());
    let mut cameras: Vec<Camera> = Vec::new();
    for (side, pictures) in sides.enumerate() {
        let mut sections = Vec::new();
        for (k, (name, text)) in std::iter::zip(pictures, &texts).enumerate() {
            let picture = Picture::open(name, args, threads)?;
            let corners = match &args.corners[..] {
                [] => None,
                [one] => Some(one),
                all => Some(&all[side * pictures.len() + k]),
            };
            let placed = Placed::find(&picture, text, corners)?;
            for (_, measure) in measures(&placed.chart.spec().kind) {
                let mut section =
                    measure(&placed, args).with_context(|| format!("chart {text} in {name}"))?;
                section.camera = picture.camera().map(str::to_owned);
                sections.push(section);
            }
        }
        let name = args.name.get(side).cloned().unwrap_or_else(|| pictures.join(", "));
        cameras.push(Camera { name, sections });
    }
    write(args, &cameras)
}

/// Fails unless the numbers of pictures, corners and names agree.
fn check_counts(args: &ReportArgs) -> Result<()> {
    let (first, second) = (args.pictures.len(), args.against.len());
    if second != 0 && second != first {
        return Err(usage(format!(
            "--against: expected as many pictures as of the first camera, {first}, found {second}"
        )));
    }
    let sides = if second == 0 { 1 } else { 2 };
    let corners = args.corners.len();
    if corners > 1 && corners != first * sides {
        return Err(usage(format!(
            "--corners: expected one for all pictures, or one for each of {}, found {corners}",
            first * sides
        )));
    }
    if args.name.len() > sides {
        return Err(usage(format!(
            "--name: expected at most {sides} of {sides} cameras, found {}",
            args.name.len()
        )));
    }
    Ok(())
}

fn write(args: &ReportArgs, cameras: &[Camera]) -> Result<()> {
    create_directories(&args.out, true)?;
    let mut names: Vec<String> = FILES.map(str::to_owned).to_vec();
    let section = |s: &Section| json!({ "section": s.slug, "picture": s.picture, "camera": s.camera, "standard": s.standard, "remarks": s.remarks, "values": s.json });
    let camera = |c: &Camera| json!({ "name": c.name, "sections": c.sections.iter().map(section).collect::<Vec<Value>>() });
    let all = json!({ "program": format!("lenscube {}", env!("CARGO_PKG_VERSION")), "cameras": cameras.iter().map(camera).collect::<Vec<Value>>() });
    let mut out = vec![
        AtomicFile::with_text(&args.out.join(FILES[1]), &(serde_json::to_string_pretty(&all)? + "\n"))?,
        AtomicFile::with_text(&args.out.join(FILES[0]), &page::html(cameras, args.style))?,
    ];
    for (side, camera) in cameras.iter().enumerate() {
        for (number, section) in camera.sections.iter().enumerate() {
            for (k, plot) in section.plots.iter().enumerate() {
                names.push(svg_name(side, number, section.slug, k));
                out.push(plot.file(&args.out.join(&names[names.len() - 1]))?);
            }
        }
    }
    finish_together(out)?;
    // Plots of an earlier report that this one does not have, also of other charts.
    let entries =
        std::fs::read_dir(&args.out)?.flatten().map(|e| e.file_name().to_string_lossy().into_owned());
    let earlier = entries.filter(|name| args.overwrite && is_plot(name) && !names.contains(name));
    earlier.into_iter().try_for_each(|name| remove_earlier(&args.out.join(name)))?;
    for camera in cameras {
        for section in &camera.sections {
            for (name, value) in &section.figures {
                print(format!("{}: {name}: {value}", camera.name));
            }
            for remark in section.remarks.iter().take(MAX_REMARKS) {
                log_line(format!("DOUBTFUL: {}: {remark}", section.picture));
            }
            if let Some(more) = section.remarks.len().checked_sub(MAX_REMARKS).filter(|n| *n > 0) {
                log_line(format!("{more} more remarks on {} are in the report", section.picture));
            }
        }
    }
    log_line(format!("report: {}", args.out.join(FILES[0]).display()));
    Ok(())
}
