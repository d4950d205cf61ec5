//! `lenscube status` of a raw or a scene.

use crate::args::StatusArgs;
use crate::failure::code;
use crate::film::reported;
use crate::progress::{json_path, plural, print, print_first};
use anyhow::Result;
use formats::object;
use formats::pyramid::PyramidState;
use formats::raw::RawStore;
use formats::scene::{SceneShard, SceneStore};
use serde_json::{Map, Value, json};
use std::path::Path;

/// The exit code of `status`, if `args` name a raw or a scene.
pub fn status(args: &StatusArgs) -> Result<Option<u8>> {
    let Some(path) = args.film.as_deref().filter(|_| args.plan.is_none()) else { return Ok(None) };
    if let Some(raw) = reported::raw(path)? {
        return of_raw(&raw)?.print(args).map(Some);
    }
    match reported::opened_scene(path, SceneStore::open)? {
        Some(scene) => of_scene(&scene)?.print(args).map(Some),
        None => Ok(None),
    }
}

/// Status of a group.
struct Status<'a> {
    kind: &'static str,
    path: &'a Path,
    /// Its content, for people.
    content: String,
    /// Its content, as JSON.
    figures: Map<String, Value>,
    shards: usize,
    /// Keys of shards.
    missing: Vec<String>,
    /// Of a group that can have one.
    pyramid: Option<PyramidState>,
}

fn of_raw(raw: &RawStore) -> Result<Status<'_>> {
    let spec = raw.spec();
    let all = spec.all_shards();
    let frames = spec.exposure_s.len();
    Ok(Status {
        kind: "raw",
        path: raw.path(),
        content: format!("{} of {} px", plural(frames, "frame"), spec.sensor),
        figures: object! { "frames": frames },
        shards: all.len(),
        missing: raw.missing(&all)?.into_iter().map(|shard| spec.key(shard)).collect(),
        pyramid: Some(raw.pyramid().state()?),
    })
}

fn of_scene(scene: &SceneStore) -> Result<Status<'_>> {
    let spec = scene.spec();
    let all: Vec<SceneShard> = spec.all_shards().collect();
    Ok(Status {
        kind: "scene",
        path: scene.path(),
        content: format!(
            "{} of {}, {} px",
            plural(spec.sheets, "surface"),
            plural(spec.bases, "weight"),
            spec.size
        ),
        figures: object! {
            "size": [spec.size.height, spec.size.width],
            "surfaces": spec.sheets,
            "weights": spec.bases,
        },
        shards: all.len(),
        missing: scene.missing(&all)?.iter().map(SceneShard::key).collect(),
        pyramid: None,
    })
}

impl Status<'_> {
    /// Prints it; the exit code.
    fn print(&self, args: &StatusArgs) -> Result<u8> {
        let (done, is_complete) = (self.shards - self.missing.len(), self.missing.is_empty());
        match args.json {
            true => {
                let kind = self.kind;
                let mut all = object! { kind: json_path(self.path), "complete": is_complete };
                all.extend(self.figures.clone());
                all.extend(object! { "shards": self.shards, "shards_done": done });
                all.extend(self.pyramid.map(|pyramid| ("pyramid".to_owned(), json!(pyramid.name()))));
                all.insert("missing".into(), json!(self.missing));
                print(serde_json::to_string_pretty(&all)?);
            }
            false => {
                let state = if is_complete { "complete" } else { "incomplete" };
                print(format!(
                    "{}: {}, {state}: {done} of {} shards; {}",
                    self.path.display(),
                    self.kind,
                    self.shards,
                    self.content
                ));
                if let Some(pyramid) = self.pyramid.filter(|pyramid| *pyramid != PyramidState::None) {
                    print(format!("pyramid {}", pyramid.name()));
                }
                print_first(self.missing.iter().map(|key| format!("missing {key}")));
            }
        }
        Ok(if args.check && !is_complete { code::WRONG } else { 0 })
    }
}
