//! `lenscube compare`: two raws of the same sensor pixels, or two films ([`films`], of other pixels at [`common_pixels`]), difference by difference; raws of different sensors side by side ([`sensors`]).
//!
//! All figures of raws are electrons, e = (DN − black)/(g·K), so that gains and black levels do not matter:
//!
//! ```text
//! difference    d = e_B − e_A of each pixel; its mean and standard deviation per region and plane       regions
//! SNR           mean/σ of a pixel, σ from the noises of the sensor that are on, at the region's mean    regions
//! noise-equivalent difference   √(σ_A² + σ_B²), the difference of two pixels of independent noise with SNR 1
//! MTF           e-SFR of an edge, per plane from its own pixels, and of developed luminance             edges
//! ΔE2000        of patches of the developed raws                                                        patches
//! ```
//! Under one seed and die both raws draw the same random numbers, so the standard deviation of d is far below the noise-equivalent
//! difference, and what remains is the difference of the two films.

mod common_pixels;
mod edges;
mod film_report;
mod films;
mod patches;
mod regions;
mod report;
mod sensors;

use crate::args::{CompareArgs, DevelopStyle, check_directory};
use crate::camera::Developer;
use crate::camera::frame::{Frame, split_group};
use crate::failure::usage;
use crate::machine::threads;
use crate::outputs::{check_absent_in, remove_earlier};
use crate::progress::log_line;
use anyhow::Result;
use formats::durable::{AtomicFile, create_directories, finish_together};
use formats::raw::{RawSpec, RawStore};
use serde_json::{Value, json};
use std::path::Path;

/// Files of a comparison.
pub const FILES: [&str; 7] =
    ["report.html", "difference.png", "compare.json", "regions.csv", "mtf.csv", "patches.csv", "figures.png"];

/// Parts of a raw's job that determine its noise, and their names for people.
const NOISES: [(&str, &str); 6] = [
    ("seed", "seed"),
    ("die", "die"),
    ("noise", "noises"),
    ("electronics", "sensor electronics"),
    ("gain", "gain"),
    ("temperature_c", "temperature"),
];

/// Two frames of the same pixels.
pub struct Pair {
    /// The frames.
    pub frames: [Frame; 2],
    /// Names for people.
    pub names: [String; 2],
    /// What differs in the noises, in words for people; nothing: both raws have the same noise.
    pub noise_differs: Vec<&'static str>,
}

/// Runs the command and returns its exit code.
pub fn command(args: &CompareArgs) -> Result<u8> {
    check_directory(&args.out)?;
    check_absent_in(&args.out, FILES, args.overwrite)?;
    if !of_raws(args)? {
        let found = films::compare(args)?;
        let files = film_report::files(&args.out, &found)?;
        film_report::print_summary(&found);
        let missing: &[&str] =
            if args.edge.is_empty() { &["mtf.csv", "patches.csv"] } else { &["patches.csv"] };
        return finish(args, files, missing);
    }
    let threads = threads(args.threads);
    let frames = Pair::frames(args)?;
    if Pair::are_of_different_sensors(&frames) {
        log_line(
            "note: the raws are of different sensors: each is measured by itself, in the same places of the film plane",
        );
        let files = sensors::compare(args, [&args.first, &args.second], &frames)?;
        return finish(args, files, &["difference.png", "mtf.csv", "patches.csv"]);
    }
    let pair = Pair::new(args, frames)?;
    log_line(pair.noise_note());
    let style = DevelopStyle::default();
    let developers = match args.edge.is_empty() && args.patch.is_empty() {
        true => None,
        false => Some([0, 1].map(|k| {
            Frame::open([&args.first, &args.second][k], args.frame, 64 << 20)
                .and_then(|frame| Developer::new(frame, &style, threads, 0))
        })),
    };
    let developers = match developers {
        None => None,
        Some([a, b]) => Some([a?, b?]),
    };
    let (mut edges, mut patches) = (Vec::new(), Vec::new());
    if let Some(developers) = &developers {
        for line in &args.edge {
            edges.push(edges::measure(&pair, developers, *line, args.half_px as usize)?);
        }
        patches = patches::measure(developers, &args.patch)?;
    }
    let (regions, difference) = regions::measure(&pair, args.grid as usize, threads)?;
    create_directories(&args.out, true)?;
    let figures = report::figures(&pair, &regions, &edges);
    let mut files = vec![
        difference.image.png_file(&args.out.join("difference.png"), &difference.caption(&pair))?,
        figures.file(&args.out.join("figures.png"))?,
        AtomicFile::with_text(&args.out.join("regions.csv"), &regions::csv(&regions))?,
    ];
    if !edges.is_empty() {
        files.push(AtomicFile::with_text(&args.out.join("mtf.csv"), &edges::csv(&edges))?);
    }
    if !patches.is_empty() {
        files.push(AtomicFile::with_text(&args.out.join("patches.csv"), &patches::csv(&patches))?);
    }
    let all = json!({
        "raws": pair.names,
        "common_noise": pair.noise_differs.is_empty(),
        "regions": regions.iter().map(regions::Region::json).collect::<Vec<_>>(),
        "edges": edges.iter().map(edges::Edge::json).collect::<Vec<_>>(),
        "patches": patches.iter().map(patches::Patch::json).collect::<Vec<_>>(),
    });
    files.push(AtomicFile::with_text(
        &args.out.join("compare.json"),
        &(serde_json::to_string_pretty(&all)? + "\n"),
    )?);
    let html = report::html(&pair, &difference, &figures, &regions, &edges, &patches);
    files.push(AtomicFile::with_text(&args.out.join("report.html"), &html)?);
    report::print_summary(&regions, &edges, &patches);
    let missing = [("mtf.csv", edges.is_empty()), ("patches.csv", patches.is_empty())];
    let missing: Vec<&str> = missing.iter().filter(|(_, is)| *is).map(|(name, _)| *name).collect();
    finish(args, files, &missing)
}

/// Whether both are raws; films if neither is.
fn of_raws(args: &CompareArgs) -> Result<bool> {
    let is_raw = |name: &str| {
        !name.starts_with("gen:") && RawStore::is_one(Path::new(split_group(name).0)).unwrap_or(false)
    };
    match (is_raw(&args.first), is_raw(&args.second)) {
        (true, true) => Ok(true),
        (false, false) => Ok(false),
        (first, _) => {
            let (raw, other) = if first { (&args.first, &args.second) } else { (&args.second, &args.first) };
            Err(usage(format!("{raw} is a raw, {other} is none: expected two raws, or two films")))
        }
    }
}

/// Makes the files visible, removes those of an earlier comparison that this one lacks, and returns the exit code.
fn finish(args: &CompareArgs, files: Vec<AtomicFile>, missing: &[&str]) -> Result<u8> {
    finish_together(files)?;
    missing.iter().try_for_each(|f| remove_earlier(&args.out.join(f)))?;
    log_line(format!("wrote {}", args.out.join("report.html").display()));
    Ok(0)
}

impl Pair {
    /// The frames that are compared.
    fn frames(args: &CompareArgs) -> Result<[Frame; 2]> {
        let chunk = RawSpec::chunk_shape();
        let open = |name: &str| -> Result<Frame> {
            let width = Frame::open(name, args.frame, 0)?.rect.width;
            Frame::open(name, args.frame, 2 * 4 * chunk.0 * (width.div_ceil(chunk.1) * chunk.1))
        };
        Ok([open(&args.first)?, open(&args.second)?])
    }

    /// Whether pitch or filters of the sensors differ.
    fn are_of_different_sensors([a, b]: &[Frame; 2]) -> bool {
        a.spec.pitch_um != b.spec.pitch_um || pattern(a) != pattern(b)
    }

    /// The pair of `frames` of one sensor.
    fn new(args: &CompareArgs, frames: [Frame; 2]) -> Result<Self> {
        let [a, b] = &frames;
        let differs = [
            ("pixels", a.rect.to_string(), b.rect.to_string()),
            ("sensor sizes", a.spec.sensor.to_string(), b.spec.sensor.to_string()),
            (
                "middles in mm (down, right)",
                format!("{:?}", a.spec.centre_mm),
                format!("{:?}", b.spec.centre_mm),
            ),
        ];
        if let Some((what, first, second)) = differs.iter().find(|(_, a, b)| a != b) {
            return Err(usage(format!(
                "{} and {}: expected raws of the same pixels and filters, their {what} differ: {first} and {second}",
                args.first, args.second
            )));
        }
        let job = |f: &Frame| f.attributes.get("provenance").map(|p| p["job"].clone()).unwrap_or_default();
        let jobs = [job(a), job(b)];
        let differs = |key: &str| jobs[0][key] != jobs[1][key] || !jobs.iter().all(Value::is_object);
        let noise_differs = NOISES.iter().filter(|n| differs(n.0)).map(|n| n.1).collect();
        Ok(Self { noise_differs, names: [args.first.clone(), args.second.clone()], frames })
    }

    fn noise_note(&self) -> String {
        match self.noise_differs.is_empty() {
            true => "both raws have the same seed, die and noises: their difference is that of the films and exposures alone".into(),
            false => {
                let differ = self.noise_differs.join(", ");
                format!("note: the raws differ in {differ}: their difference contains the noise of both; expose them with the same {differ}")
            }
        }
    }
}

fn pattern(frame: &Frame) -> String {
    let p = &frame.sensor.pattern;
    let names: Vec<&str> = p.channels.iter().map(|c| frame.sensor.channels[*c].plane.as_str()).collect();
    names.chunks(p.columns).map(|row| row.join(" ")).collect::<Vec<_>>().join(" / ")
}
