//! Opens charts (stores, files, generators) and lens packs by the names in the arguments.

use crate::args::{DESIGN_FILES, size_order_note};
use crate::design;
use crate::failure::{usage, without_flags};
use crate::machine::machine_memory;
use crate::progress::{counting, log_line};
use anyhow::Result;
use formats::chart::{AxisOrder, ChartError, ChartRequest, NanPolicy, holds_arrays, split_array};
pub use formats::chart::{Chart, check_has_files};
use formats::durable::is_url;
use formats::lens::{LensPack, builtin, builtin_names};
use formats::mesh_name;
use formats::raw::RawStore;
use formats::scene::SceneStore;
use std::path::Path;

/// Whether `spec` is the name of a mesh.
pub fn is_mesh(spec: &str) -> bool {
    mesh_name::is_mesh(Path::new(spec))
}

/// Fails for a URL, a directory or a Zarr group where a mesh is expected.
///
/// # Errors
/// Usage.
pub fn check_mesh_file(path: &Path) -> Result<()> {
    let refused = |what: &str| Err(usage(format!("mesh {}: {what}", path.display())));
    if is_url(path) {
        return refused("it is a URL; a mesh is read from files: download it with the files that it names");
    }
    match path.is_dir() {
        false => Ok(()),
        true if SceneStore::is_one(path).unwrap_or(false) => {
            refused("it is a scene already, of which `lenscube run` makes a film")
        }
        true if path.join("zarr.json").exists()
            || path.join(".zgroup").exists()
            || path.join(".zarray").exists() =>
        {
            refused(
                "it is a Zarr store; expected a .glb, .gltf, .obj or .ply file (charts are read by `lenscube run`)",
            )
        }
        true => refused("it is a folder; give the .glb, .gltf, .obj or .ply file in it"),
    }
}

/// How a chart is read: flags of the command line.
#[derive(Clone, Copy, Default)]
pub struct ChartFlags<'a> {
    /// `--wavelengths`.
    pub wavelengths: Option<&'a str>,
    /// `--chart-shape` and `--chart-dtype`: the file holds raw samples.
    pub raw: Option<(&'a str, &'a str)>,
    /// `--var`.
    pub var: Option<&'a str>,
    /// `--axes`.
    pub axes: Option<&'a AxisOrder>,
    /// `--chart-scale`.
    pub scale: Option<f64>,
    /// `--nan`.
    pub nan: NanPolicy,
    /// Bytes of decoded chunks that are cached.
    pub cache_bytes: usize,
}

/// Flags of a chart's format, which commands that open it by [`chart`] do not have.
const FORMAT_FLAGS: [&str; 2] = ["--axes", "--var"];

/// Opens `PATH`, `PATH//array` or `gen:KIND?…` without flags of its format.
pub fn chart(spec: &str, wavelengths: Option<&str>, nan: NanPolicy, cache_bytes: usize) -> Result<Chart> {
    chart_with(spec, &ChartFlags { wavelengths, nan, cache_bytes, ..ChartFlags::default() })
        .map_err(|e| without_chart_flags(&FORMAT_FLAGS, spec, e))
}

/// An error of the chart `spec` in a command without `flags` of charts.
pub fn without_chart_flags(flags: &[&str], spec: &str, error: anyhow::Error) -> anyhow::Error {
    without_flags(flags, error, || {
        format!("`lenscube export {spec} CHART.hdr` has it, and writes a chart for this command")
    })
}

/// Opens `PATH`, `PATH//array`, a folder or pattern of pictures, or `gen:KIND?…`.
pub fn chart_with(spec: &str, flags: &ChartFlags<'_>) -> Result<Chart> {
    if spec.is_empty() {
        return Err(usage("the name of the chart is empty; give its path, or gen:KIND?…"));
    }
    let declared = declared_nm(flags.wavelengths)?;
    let with_var;
    let spec = match flags.var {
        None => spec,
        Some(var) => {
            check_takes_var(spec, var)?;
            with_var = format!("{spec}//{var}");
            &with_var
        }
    };
    if is_mesh(spec) {
        return Err(usage(format!(
            "chart `{spec}` is a mesh: `lenscube scene` makes a scene of it, which this command reads; `lenscube run` does both"
        )));
    }
    let request = ChartRequest {
        wavelengths_nm: declared.as_deref(),
        raw: flags.raw,
        axes: flags.axes,
        scale: flags.scale,
        nan: flags.nan,
        cache_bytes: flags.cache_bytes,
    };
    Chart::open(spec, &request).map_err(|e| match e {
        ChartError::NoArray { .. } if RawStore::is_one(Path::new(split_array(spec).0)).unwrap_or(false) => {
            usage(format!(
                "`{spec}` is a raw of a sensor: `lenscube develop` makes a picture of it, `lenscube compare` measures two of them"
            ))
        }
        e => e.into(),
    })
}

/// Sorts `chart` by band into a temporary file in `directory`, if its bands would otherwise be fetched or decoded once per band; prints that.
pub fn sort_by_band(chart: &mut Chart, bands: &[usize], directory: &Path, threads: usize) -> Result<()> {
    let (bar, progress) = counting("sorting the chart by band");
    if let Some(note) = chart.sorting_note(bands) {
        log_line(note);
        chart.sort_by_band(bands, directory, threads, &progress)?;
    }
    bar.finish_and_clear();
    Ok(())
}

/// Notes on how the values of `chart` are read.
pub fn notes(chart: &Chart) -> Vec<String> {
    match chart {
        Chart::Generated(generator) => size_order_note("size", generator.spec().film).into_iter().collect(),
        _ => chart.notes(),
    }
}

/// Reads a store whose `bands` would fill the page cache past it: see `ChartStore::read_past_page_cache`.
pub fn read_past_page_cache(chart: &mut Chart, bands: &[usize], threads: usize) {
    if let (Chart::Store(store), Some(memory)) = (chart, machine_memory()) {
        store.read_past_page_cache(bands, threads, memory);
    }
}

/// Fails unless `--var` fits the chart: a store or an HDF5 file without an array in its path.
fn check_takes_var(spec: &str, var: &str) -> Result<()> {
    let (path, array) = split_array(spec);
    if !array.is_empty() {
        return Err(usage(format!("--var {var}: chart `{spec}` names its array already; give one of them")));
    }
    if holds_arrays(path) {
        return Ok(());
    }
    Err(usage(format!(
        "--var selects an array of a Zarr store or of HDF5 (NetCDF-4) or MATLAB (.mat), not of `{spec}`"
    )))
}

/// The wavelengths of `--wavelengths`.
fn declared_nm(wavelengths: Option<&str>) -> Result<Option<Vec<f64>>> {
    let declared = wavelengths.map(pipeline::wavelengths::parse).transpose();
    declared.map_err(|e| usage(format!("--wavelengths: {e}")))
}

/// Whether `name` is that of a built-in lens. Such a name never means a file; `./NAME` does.
pub fn is_builtin(name: &str) -> bool {
    design::builtin_names().chain(builtin_names()).any(|known| known == name)
}

/// Opens a lens pack, or a built-in one by its name, for a command that needs tables over image height.
///
/// # Errors
/// Usage: a lens without rotational symmetry.
pub fn symmetric_lens(name: &str) -> Result<LensPack> {
    let pack = lens(name)?;
    pack.require_symmetric("this command").map_err(|e| usage(e.to_string()))?;
    Ok(pack)
}

/// Opens a lens pack, or a built-in one by its name.
pub fn lens(name: &str) -> Result<LensPack> {
    if builtin_names().any(|known| known == name) {
        return Ok(builtin(name)?);
    }
    let path = Path::new(name);
    if !path.exists() && !name.contains(['/', '.']) {
        let known: Vec<_> = design::builtin_names().chain(builtin_names()).collect();
        return Err(usage(format!(
            "`{name}` is neither a lens pack nor a built-in lens; give the path of a *.lens.zarr, its .zip or a design ({DESIGN_FILES}); built-in lenses: {}",
            known.join(", ")
        )));
    }
    Ok(LensPack::open(path)?)
}
