//! What is said of a scene: its materials, its size and cost, what was found while it was made.

use super::done::Done;
use super::job::SceneJob;
use super::prepared::Prepared;
use crate::failure::{Coded, code};
use crate::film::group;
use crate::machine::{free_space, peak_resident};
use crate::progress::{data_size, duration, log_line, mib, plural, print};
use anyhow::Result;
use formats::object;
use formats::scene::SceneStore;
use pipeline::projection::Projection;
use pipeline::scene::appearance::Appearance;
use pipeline::scene::description::{AlphaMode, Material};
use pipeline::scene::mesh::Mesh;
use pipeline::scene::visibility::MAX_HITS;
use std::path::Path;
use std::time::Instant;

/// Triangles per core second, those that a few pixels or less see: 2 to 11 µs each were measured beyond the time of the samples.
const TRIANGLES_PER_S: f64 = 250e3;
/// Samples per core second, all hits of a million triangles (`scripts/bench`).
const SAMPLES_PER_S: f64 = 20e6;
/// Bytes per core second of encoding and writing.
const BYTES_PER_S: f64 = 400e6;
/// Share of hidden light from backs of open surfaces from which on it is told.
const BACK_SHARE: f64 = 0.01;
/// Share of the bytes that is left by compression, at least.
const MIN_SHARE: f64 = 0.02;

/// Prints the materials of the mesh.
pub fn print_materials(prepared: &Prepared) {
    let mut triangles = vec![(0u64, 0.0); prepared.scene.materials.len()];
    for number in 0..prepared.mesh.triangles() {
        let (part, _) = prepared.mesh.part_of(number);
        let [a, b, c] = prepared.mesh.corners(number);
        let (u, v): ([f64; 3], [f64; 3]) =
            (std::array::from_fn(|k| b[k] - a[k]), std::array::from_fn(|k| c[k] - a[k]));
        let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let of = &mut triangles[prepared.scene.parts[part].material];
        *of = (of.0 + 1, of.1 + 0.5 * n.iter().map(|n| n * n).sum::<f64>().sqrt());
    }
    let name = |material: &Material| {
        if material.name.is_empty() { "(no name)".to_owned() } else { material.name.clone() }
    };
    let width = prepared.scene.materials.iter().map(|m| name(m).chars().count()).max().unwrap_or(0).max(8);
    print(format!("{:width$}  triangles     area m²  linear colour        texture, alpha", "material"));
    for (material, (count, area)) in prepared.scene.materials.iter().zip(triangles) {
        let [r, g, b] = material.colour;
        let texture = match &material.texture {
            Some(used) => {
                prepared.scene.textures.get(used.texture).map_or("missing", |texture| &texture.name)
            }
            None => "-",
        };
        let alpha = match material.alpha_mode {
            AlphaMode::Opaque => "opaque".to_owned(),
            AlphaMode::Mask(cutoff) => format!("mask from {cutoff}"),
            AlphaMode::Blend => format!("blend {}", material.alpha),
        };
        let name = name(material);
        print(format!("{name:width$}  {count:9}  {area:10.4}  {r:.3} {g:.3} {b:.3}    {texture}, {alpha}"));
    }
}

/// Prints what the mesh holds and what the scene would take.
pub fn print_info(prepared: &Prepared, job: &SceneJob) {
    let facts = prepared.mesh.facts();
    let pinhole = &prepared.pinhole;
    let samples = pinhole.size.pixels() as f64 * job.settings.samples as f64;
    let core_s =
        samples / SAMPLES_PER_S + facts.triangles as f64 / TRIANGLES_PER_S + job.bytes() as f64 / BYTES_PER_S;
    let camera = prepared.camera.as_ref().map_or("--eye, --target".to_owned(), |name| format!("`{name}`"));
    print(format!(
        "triangles               {} in {}, {} materials, {} textures\n\
         solids                  {} closed, {} of them around the camera; {} open components\n\
         nearest, farthest       {:.4} m, {:.4} m along the axis (corners before the camera)\n\
         camera                  {camera}, field of view of the chart {:.3} x {:.3} deg\n\
         covered                 {:.1} % of the chart\n\
         chart                   {} px{}, {} px beyond the film on each side; {} with spectra {}\n\
         surfaces                up to {}; told apart from {:.5} dioptres; hidden ones within {} of edges\n\
         disk                    {} before compression{}\n\
         work                    about {core_s:.0} core s, {} threads",
        facts.triangles,
        plural(prepared.scene.parts.len(), "part"),
        prepared.scene.materials.len(),
        prepared.textures,
        facts.solids,
        facts.around_camera,
        facts.open,
        facts.nearest_m,
        facts.farthest_m,
        pinhole.fov_deg(pinhole.size.width),
        pinhole.fov_deg(pinhole.size.height),
        100.0 * prepared.covered,
        pinhole.size,
        if pinhole.projection == Projection::Planar { "" } else { " in the projection of the film" },
        pinhole.overscan_px,
        plural(job.spec.bases, "weight"),
        job.bases().collect::<Vec<_>>().join(", "),
        job.spec.sheets,
        job.settings.gap_dioptre,
        job.reach_px.map_or("any distance".to_owned(), |px| format!("{px} px")),
        data_size(job.bytes()),
        match prepared.mesh.scratch().file_bytes() {
            0 => String::new(),
            bytes => format!("; a scratch file of {} beside it", data_size(bytes)),
        },
        prepared.threads,
    ));
}

/// Fails if the disk cannot hold the scene even if it compresses well.
pub fn check_space(out: &Path, job: &SceneJob, force: bool) -> Result<()> {
    let least = (job.bytes() as f64 * MIN_SHARE) as u64;
    match free_space(out)?.filter(|free| least > *free && !force) {
        None => Ok(()),
        Some(free) => Err(Coded {
            code: code::RETRY,
            message: format!(
                "{}: the disk is too small: the scene has {} before compression, {} are free; free some space, make fewer surfaces (--sheets) or a \
                 smaller film, or start anyway with --force",
                out.display(),
                data_size(job.bytes()),
                data_size(free)
            ),
        }
        .into()),
    }
}

/// What is worth telling of what was found.
pub fn print_warnings(prepared: &Prepared, appearance: &Appearance<'_, Mesh>, done: &Done) {
    let counts = &done.counts;
    let back = counts.hidden_back_samples as f64 / counts.hidden_samples.max(1) as f64;
    if back >= BACK_SHARE {
        let largest = prepared.mesh.facts().largest_open.map_or(String::new(), |(triangle, count)| {
            let part = &prepared.scene.parts[prepared.mesh.part_of(triangle).0].name;
            format!("; the largest open surface is of `{part}`, {count} triangles: is it meant to be closed?")
        });
        log_line(format!(
            "note: {:.1} % of the hidden light is that of backs of open surfaces{largest}",
            100.0 * back
        ));
    }
    if counts.merged_pixels > 0 {
        log_line(format!(
            "note: {} pixels show more surfaces than are stored; their light is in the last one (--sheets)",
            counts.merged_pixels
        ));
    }
    if counts.dropped_hits > 0 {
        log_line(format!(
            "note: {} hits beyond {MAX_HITS} behind one another were left out",
            counts.dropped_hits
        ));
    }
    if appearance.clipped() > 0 {
        log_line(format!("note: {} colours were limited to 0 to 1", appearance.clipped()));
    }
}

/// Keeps what the command did, however it ended.
pub fn write_record(store: &SceneStore, outcome: &Result<Done>, prepared: &Prepared, start: Instant) {
    let done = outcome.as_ref().ok();
    let further = object! {
        "triangles": prepared.mesh.facts().triangles,
        "shards": done.map(|d| d.shards),
        "bytes_written": done.map(|d| d.bytes),
        "samples": done.map(|d| d.counts.samples),
        "hidden_samples": done.map(|d| d.counts.hidden_samples),
        "merged_pixels": done.map(|d| d.counts.merged_pixels),
    };
    let left = outcome.as_ref().map(|done| done.left);
    group::write_record(store.group(), left, (prepared.threads, prepared.limit.bytes), start, further);
}

/// The last line.
pub fn summary(out: &Path, job: &SceneJob, done: &Done, start: Instant) -> String {
    let peak = peak_resident().map_or(String::new(), |bytes| format!(", {} at most", mib(bytes as usize)));
    format!(
        "{}: scene of {} px, {} surfaces of {}, {} in {}{peak}",
        out.display(),
        job.spec.size,
        job.spec.sheets,
        plural(job.spec.bases, "weight"),
        data_size(done.bytes),
        duration(start.elapsed().as_secs_f64())
    )
}
