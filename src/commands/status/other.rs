//! `lenscube status` of a raw.

use crate::args::StatusArgs;
use crate::failure::code;
use crate::film::reported;
use crate::progress::{json_path, plural, print, print_first};
use anyhow::Result;
use formats::pyramid::PyramidState;
use serde_json::json;

/// The exit code of `status`, if `args` name a raw.
pub fn status(args: &StatusArgs) -> Result<Option<u8>> {
    let Some(raw) =
        args.film.as_deref().filter(|_| args.plan.is_none()).map(reported::raw).transpose()?.flatten()
    else {
        return Ok(None);
    };
    let all = raw.spec().all_shards();
    let missing: Vec<String> = raw.missing(&all)?.into_iter().map(|s| raw.spec().key(s)).collect();
    let (done, complete) = (all.len() - missing.len(), missing.is_empty());
    let pyramid = raw.pyramid().state()?;
    match args.json {
        true => print(serde_json::to_string_pretty(&json!({
            "raw": json_path(raw.path()),
            "complete": complete,
            "frames": raw.spec().exposure_s.len(),
            "shards": all.len(),
            "shards_done": done,
            "pyramid": pyramid.name(),
            "missing": missing,
        }))?),
        false => {
            let state = if complete { "complete" } else { "incomplete" };
            let (frames, size) = (raw.spec().exposure_s.len(), raw.spec().sensor);
            print(format!(
                "{}: raw, {state}: {done} of {} shards; {} of {size} px",
                raw.path().display(),
                all.len(),
                plural(frames, "frame")
            ));
            if pyramid != PyramidState::None {
                print(format!("pyramid {}", pyramid.name()));
            }
            print_first(missing.iter().map(|key| format!("missing {key}")));
        }
    }
    Ok(Some(if args.check && !complete { code::WRONG } else { 0 }))
}
