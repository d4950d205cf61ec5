//! `lenscube compare`: two raws of the same sensor pixels, difference by difference.
//!
//! All figures are electrons, e = (DN − black)/(g·K), so that gains and black levels do not matter:
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

mod edges;
mod patches;
mod regions;
mod report;

use crate::args::{CompareArgs, check_directory};
use crate::develop::frame::Frame;
use crate::develop::{Developer, plain_style};
use crate::failure::usage;
use crate::job::threads;
use crate::outputs::check_absent_in;
use crate::progress::log_line;
use anyhow::Result;
use formats::durable::{AtomicFile, create_directories, finish_together};
use formats::raw::RawSpec;
use serde_json::{Value, json};

/// Files of a comparison.
const FILES: [&str; 7] =
    ["report.html", "difference.png", "compare.json", "regions.csv", "mtf.csv", "patches.csv", "figures.png"];

/// Two frames of the same pixels.
pub struct Pair {
    /// The frames.
    pub frames: [Frame; 2],
    /// Names for people.
    pub names: [String; 2],
    /// Whether both draw the same random numbers.
    pub common_noise: bool,
}

/// Runs the command and returns its exit code.
pub fn command(args: &CompareArgs) -> Result<u8> {
    check_directory(&args.out)?;
    check_absent_in(&args.out, FILES, args.overwrite)?;
    let threads = threads(args.threads);
    let pair = Pair::open(args)?;
    log_line(pair.noise_note());
    let style = plain_style();
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
        "common_noise": pair.common_noise,
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
    finish_together(files)?;
    report::print_summary(&regions, &edges, &patches);
    log_line(format!("wrote {}", args.out.join("report.html").display()));
    Ok(0)
}

impl Pair {
    fn open(args: &CompareArgs) -> Result<Self> {
        let chunk = RawSpec::chunk_shape();
        let open = |name: &str| -> Result<Frame> {
            let width = Frame::open(name, args.frame, 0)?.rect.width;
            Frame::open(name, args.frame, 2 * 4 * chunk.0 * (width.div_ceil(chunk.1) * chunk.1))
        };
        let frames = [open(&args.first)?, open(&args.second)?];
        let [a, b] = &frames;
        let differs = [
            ("pixels", a.rect.to_string(), b.rect.to_string()),
            ("pitch in µm", a.spec.pitch_um.to_string(), b.spec.pitch_um.to_string()),
            ("pattern", pattern(a), pattern(b)),
        ];
        if let Some((what, first, second)) = differs.iter().find(|(_, a, b)| a != b) {
            return Err(usage(format!(
                "{} and {}: expected raws of the same pixels and filters, their {what} differ: {first} and {second}",
                args.first, args.second
            )));
        }
        let noise = |f: &Frame| -> Vec<Value> {
            let job = f.attributes.get("provenance").map(|p| p["job"].clone()).unwrap_or_default();
            ["seed", "die", "noise"].iter().map(|key| job[*key].clone()).collect()
        };
        let common_noise = noise(a) == noise(b) && !noise(a).contains(&Value::Null);
        Ok(Self { common_noise, names: [args.first.clone(), args.second.clone()], frames })
    }

    fn noise_note(&self) -> String {
        match self.common_noise {
            true => "both raws have the same seed, die and noises: their difference is that of the films and exposures alone".into(),
            false => "note: the raws differ in seed, die or noises: their difference contains the noise of both; expose them with the same \
                      --seed and --die"
                .into(),
        }
    }
}

fn pattern(frame: &Frame) -> String {
    let p = &frame.sensor.pattern;
    let names: Vec<&str> = p.channels.iter().map(|c| frame.sensor.channels[*c].plane.as_str()).collect();
    names.chunks(p.columns).map(|row| row.join(" ")).collect::<Vec<_>>().join(" / ")
}
