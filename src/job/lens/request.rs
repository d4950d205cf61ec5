//! What a design is traced as: recorded in a film, so that a film of another lens is found before that lens is traced.
//!
//! The record is not part of the identity of a job, which has the digest of what was traced. Records of other versions of the program or of its tracer are
//! not compared.

use super::{UntracedDesign, UntracedLens};
use crate::args::{RunArgs, TracingArgs};
use pipeline::design::trace::{NODES_VERSION, TAILS_VERSION, TRACER_VERSION};
use serde_json::{Map, Value, json};

/// The flags of designs in `args`, as text.
fn flags(args: &RunArgs) -> Map<String, Value> {
    let TracingArgs { image_plane, aiming, configuration, coatings, energy, max_window_px, .. } =
        &args.tracing;
    let of = |value: Option<String>| value.unwrap_or_else(|| "nothing".into());
    let number = |value: Option<f64>| of(value.map(|v| v.to_string()));
    [
        ("--focus-m", number(args.surfaces.focus_m)),
        ("--gap", format!("{:?}", args.surfaces.gap)),
        ("--image-plane", format!("{image_plane:?}").to_lowercase()),
        ("--aiming", of(aiming.map(|aiming| format!("{aiming:?}").to_lowercase()))),
        ("--configuration", of(configuration.map(|n| n.to_string()))),
        ("--coatings", coatings.to_string()),
        ("--energy", number(*energy)),
        ("--max-window-px", of(max_window_px.map(|px| px.to_string()))),
    ]
    .map(|(flag, value)| (flag.to_owned(), value.into()))
    .into_iter()
    .collect()
}

impl UntracedLens {
    /// The record of a design of the job `args`; none of a pack.
    pub fn request(&self, args: &RunArgs) -> Option<Value> {
        let Self::Design(design) = self else { return None };
        let UntracedDesign { system, .. } = &**design;
        Some(json!({
            "program": env!("CARGO_PKG_VERSION"),
            "tracer": [TRACER_VERSION, NODES_VERSION, TAILS_VERSION],
            "prescription": blake3::hash(system.identity().as_bytes()).to_hex().to_string(),
            "energy": args.tracing.energy,
            "max_window_px": args.tracing.max_window_px,
            "flags": flags(args),
        }))
    }
}

/// Why the lens that a film records is not the one that is requested; `None` where it is, or where that is not known.
pub fn difference(recorded: &Value, requested: &Value) -> Option<String> {
    let same = |key: &str| recorded.get(key) == requested.get(key);
    if !(same("program") && same("tracer"))
        || ["prescription", "energy", "max_window_px"].into_iter().all(same)
    {
        return None;
    }
    let empty = Map::new();
    let flags = |of: &Value| of.get("flags").and_then(Value::as_object).unwrap_or(&empty).clone();
    let (film, asked) = (flags(recorded), flags(requested));
    let text = |value: Option<&Value>| value.and_then(Value::as_str).unwrap_or("nothing").to_owned();
    let differing = asked.keys().filter(|flag| film.get(*flag) != asked.get(*flag));
    let list: Vec<String> = differing
        .map(|flag| format!("{flag} (film {}, requested {})", text(film.get(flag)), text(asked.get(flag))))
        .collect();
    Some(match list.is_empty() {
        true => "--lens (another prescription)".into(),
        false => list.join(", "),
    })
}
