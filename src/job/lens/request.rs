//! What a design is traced as: recorded in a film, so that a film of another lens is found before that lens is traced.
//!
//! The record is not part of the identity of a job, which has the digest of what was traced. Records of other versions of the program or of its tracer are
//! not compared.

use super::asymmetric::AsymmetricLens;
use super::drawn::DrawnLens;
use super::untraced::{UntracedDesign, UntracedLens};
use crate::args::{RunArgs, TracingArgs};
use pipeline::design::trace::{NODES_VERSION, TAILS_VERSION, TRACER_VERSION, TraceOptions};
use serde_json::{Map, Value, json};

/// Key of the digest of the prescription without its coatings, in the record of a lens that has coatings.
const UNCOATED: &str = "uncoated";

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
        let UntracedDesign { system, asymmetric, .. } = &**design;
        let mut flags = flags(args);
        let identity = match asymmetric {
            Some(AsymmetricLens::Design(lens)) => lens.identity(),
            Some(AsymmetricLens::Drawn(drawn)) => {
                flags.extend(drawn.flags());
                system.identity()
            }
            None => system.identity(),
        };
        let digest = |text: &str| blake3::hash(text.as_bytes()).to_hex().to_string();
        let mut request = json!({
            "program": env!("CARGO_PKG_VERSION"),
            "tracer": [TRACER_VERSION, NODES_VERSION, TAILS_VERSION],
            "prescription": digest(&identity),
            "energy": args.tracing.energy.unwrap_or(default_energy()),
            "max_window_px": args.tracing.max_window_px,
            "flags": flags,
        });
        if system.has_coatings() {
            request[UNCOATED] = digest(&system.identity_without_coatings()).into();
        }
        Some(request)
    }
}

/// Share of the light in PSF windows without `--energy`.
fn default_energy() -> f64 {
    TraceOptions::new(Vec::new(), 0.0).energy
}

/// Why the lens that a film records is not the one that is requested; `None` where it is, or where that is not known.
pub fn difference(recorded: &Value, requested: &Value) -> Option<String> {
    let same = |key: &str| recorded.get(key) == requested.get(key);
    // The largest window that is not given may be the one that is.
    let is_open = [recorded, requested].into_iter().any(|of| of["max_window_px"].is_null());
    let drawn = |of: &Value| DrawnLens::FLAGS.map(|flag| of["flags"].get(flag).cloned());
    let same_lens = same("prescription")
        && drawn(recorded) == drawn(requested)
        && same("energy")
        && (is_open || same("max_window_px"));
    if !(same("program") && same("tracer")) || same_lens {
        return None;
    }
    let empty = Map::new();
    let flags = |of: &Value| of.get("flags").and_then(Value::as_object).unwrap_or(&empty).clone();
    let (film, asked) = (flags(recorded), flags(requested));
    let text = |value: Option<&Value>| value.and_then(Value::as_str).unwrap_or("nothing").to_owned();
    let all = asked.keys().chain(film.keys().filter(|flag| !asked.contains_key(*flag)));
    let differing = all.filter(|flag| film.get(*flag) != asked.get(*flag));
    let list: Vec<String> = differing
        .map(|flag| format!("{flag} (film {}, requested {})", text(film.get(flag)), text(asked.get(flag))))
        .collect();
    let differ_in_coatings = recorded[UNCOATED].is_string() && same(UNCOATED);
    Some(match list.is_empty() {
        true if differ_in_coatings => format!(
            "--coatings {} (its file, or a table that it names, has changed since)",
            text(asked.get("--coatings"))
        ),
        true => "--lens (another prescription)".into(),
        false => list.join(", "),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_that_make_the_same_lens_are_no_difference() {
        let of = |prescription: &str, energy: f64, window: Option<usize>, focus: &str| {
            json!({
                "program": "1", "tracer": [1, 2, 3], "prescription": prescription, "energy": energy, "max_window_px": window,
                "flags": {"--focus-m": focus, "--energy": energy.to_string()},
            })
        };
        let film = of("a", default_energy(), None, "nothing");
        assert_eq!(difference(&film, &film), None);
        assert_eq!(difference(&film, &of("a", 0.99, Some(401), "inf")), None);
        let focused = difference(&film, &of("b", 0.99, None, "2"));
        assert_eq!(focused.unwrap(), "--focus-m (film nothing, requested 2)");
        assert_eq!(
            difference(&film, &of("a", 0.95, None, "nothing")).unwrap(),
            "--energy (film 0.99, requested 0.95)"
        );
        assert_eq!(
            difference(&film, &of("b", 0.99, None, "nothing")).unwrap(),
            "--lens (another prescription)"
        );
        // A file of coatings that changed, beside a design that did not.
        let coated = |prescription: &str, uncoated: &str| {
            let mut of = of(prescription, 0.99, None, "nothing");
            (of[UNCOATED], of["flags"]["--coatings"]) = (json!(uncoated), json!("lens.toml"));
            of
        };
        let changed = difference(&coated("a", "x"), &coated("b", "x")).unwrap();
        assert!(changed.starts_with("--coatings lens.toml (its file"), "{changed}");
        let redesigned = difference(&coated("a", "x"), &coated("b", "y")).unwrap();
        assert_eq!(redesigned, "--lens (another prescription)");
        // Of another version of the tracer nothing is known.
        let mut other = of("b", 0.99, None, "2");
        other["tracer"] = json!([2, 2, 3]);
        assert_eq!(difference(&film, &other), None);
    }
}
