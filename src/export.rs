//! `lenscube export`: a picture of a film, a chart or a region of interest.

use crate::args::ExportArgs;
use crate::failure::usage;
use crate::job::threads;
use crate::open::Chart;
use crate::progress::{counting, say};
use anyhow::Result;
use formats::chart::NanPolicy;
use formats::picture::exposure::Exposure;
use formats::picture::grey::{GreyOptions, write_grey};
use formats::picture::preview::{PreviewOptions, write_preview};
use formats::picture::{Shown, View};

/// Decoded chunks kept while a picture is made: a row of them, for the widest films.
const CACHE_BYTES: usize = 512 << 20;

/// Runs the command.
pub fn command(args: &ExportArgs) -> Result<()> {
    // Shards not yet made read as NaN: they are shown as missing, not refused.
    let chart = Chart::open(&args.film, args.wavelengths.as_deref(), NanPolicy::Keep, CACHE_BYTES)?;
    let nm = chart.wavelengths_nm()?;
    let exposure = match args.exposure.as_str() {
        "auto" => Exposure::Auto,
        factor => match factor.parse::<f64>() {
            Ok(f) if f.is_finite() && f > 0.0 => Exposure::Factor(f),
            _ => return Err(usage(format!("--exposure {factor}: expected `auto` or a factor above 0"))),
        },
    };
    let view = View { window: None, max_side: Some(args.max_side), threads: threads(args.threads) };
    let (bar, progress) = counting("reading");
    let shown = match args.band {
        Some(wanted) => {
            let options = GreyOptions { view, exposure };
            write_grey(&args.out, chart.source(), &nm, wanted, &options, &progress)?
        }
        None => {
            let white = args.white.parse().map_err(|e| usage(format!("--white {}: {e}", args.white)))?;
            let options = PreviewOptions { view, white, exposure };
            write_preview(&args.out, chart.source(), &nm, &options, &progress)?
        }
    };
    bar.finish_and_clear();
    tell(args, &shown);
    Ok(())
}

fn tell(args: &ExportArgs, shown: &Shown) {
    say(format!(
        "{}: {}x{} px, exposure {:.6} (give `--exposure {:.6}` to make another picture comparable)",
        args.out.display(),
        shown.size.width,
        shown.size.height,
        shown.exposure,
        shown.exposure
    ));
    if shown.missing_samples > 0 {
        say(format!(
            "note: {} samples are missing (shards not yet made) and show as a grey chequer",
            shown.missing_samples
        ));
    }
}
