//! Distances of a job: the depth array, hidden surfaces and coverages, opened and checked before any pixel is computed.

mod scan;

use crate::args::{DepthKind, DepthMiss, DepthUnit, RunArgs};
use crate::failure::usage;
use crate::open::{Chart, ChartFlags};
use anyhow::{Context, Result};
use formats::chart::{ChartError, NanPolicy};
use pipeline::depth::plan::Surfaces;
use pipeline::depth::sheet::{ConstantDepth, Distance, Sheet};
use pipeline::flow::ChartSource;
use pipeline::geometry::Frame;
use pipeline::lens::Lens;
use scan::Scan;
use serde_json::{Value, json};

/// Surfaces of a job.
pub struct Depth {
    sheets: Vec<SheetInput>,
    /// Vergences of all surfaces.
    pub surfaces: Surfaces,
    /// Notes to print.
    pub notes: Vec<String>,
}

/// One surface.
struct SheetInput {
    /// Its chart; none for the surface of the job's chart.
    chart: Option<Chart>,
    depth: DepthInput,
    coverage: Option<Chart>,
    distance: Distance,
}

enum DepthInput {
    Array(Box<Chart>),
    Constant(ConstantDepth),
}

impl DepthInput {
    fn source(&self) -> &dyn ChartSource {
        match self {
            Self::Array(chart) => chart.source(),
            Self::Constant(depth) => depth,
        }
    }
}

impl Depth {
    /// Opens and checks the surfaces of `args` for a chart on `frame` with bands at `wavelengths_nm` and `lens`; `None` without `--depth`.
    ///
    /// # Errors
    /// An array cannot be read, has another size than the chart, or contains a distance or coverage that is not valid.
    pub fn open(args: &RunArgs, frame: &Frame, wavelengths_nm: &[f64], lens: &Lens) -> Result<Option<Self>> {
        let Some(spec) = &args.depth else { return Ok(None) };
        let ray_mm = lens.distortion_focal_length_mm;
        let mut sheets = vec![SheetInput::first(spec, args, frame, ray_mm)?];
        let given = args.given_hidden()?;
        for group in given {
            sheets.push(SheetInput::hidden(group, args, frame, wavelengths_nm, ray_mm)?);
        }
        let mut scan = Scan::new(frame.chart, node_range(lens));
        for (sheet, name) in std::iter::zip(&sheets, std::iter::once(spec).chain(given)) {
            if let Some(coverage) = &sheet.coverage {
                scan::coverage(name, coverage)?;
            }
            scan.distances(name, sheet.depth.source(), sheet.rows_at_a_time(), &sheet.distance, frame)?;
        }
        let is_opaque = matches!(&sheets[..], [only] if only.coverage.is_none());
        let notes = scan.notes();
        let surfaces = scan.surfaces(is_opaque, args.hidden.is_empty());
        Ok(Some(Self { sheets, surfaces, notes }))
    }

    /// The surfaces, as the depth stage reads them.
    pub fn sheets(&self) -> Vec<Sheet<'_>> {
        self.sheets.iter().map(SheetInput::sheet).collect()
    }

    fn charts(&self) -> impl Iterator<Item = &Chart> {
        self.sheets.iter().flat_map(SheetInput::charts)
    }

    /// Number of surfaces.
    pub fn count(&self) -> usize {
        self.sheets.len()
    }

    /// What determines pixels, and the modification times of the files.
    ///
    /// # Errors
    /// The chunks cannot be listed.
    pub fn identity(&self) -> Result<(Value, Value)> {
        let (mut content, mut mtimes) = (Vec::new(), Vec::new());
        for sheet in &self.sheets {
            let mut arrays = Vec::new();
            for chart in sheet.charts() {
                let (of_array, times) = chart.identity()?;
                arrays.push(of_array);
                mtimes.push(times);
            }
            let constant = match sheet.depth {
                DepthInput::Constant(depth) => json!(depth.distance),
                DepthInput::Array(_) => Value::Null,
            };
            content.push(json!({
                "arrays": arrays,
                "has_coverage": sheet.coverage.is_some(),
                "constant": constant,
                "metres_per_unit": sheet.distance.metres,
                "ray": sheet.distance.ray_focal_mm,
                "miss_is_far": sheet.distance.miss_is_far,
            }));
        }
        let content = json!({ "sheets": content, "is_invented": self.surfaces.is_invented });
        Ok((content, Value::Array(mtimes)))
    }

    /// Bytes of caches of decoded chunks with which tiles of `rows` rows decode no chunk twice.
    pub fn cache_bytes(&self, rows: usize) -> usize {
        self.charts().map(|chart| chart.cache_for_rows(rows)).sum()
    }

    /// Sets the caches to hold tiles of `rows` rows.
    pub fn set_cache_for_rows(&mut self, rows: usize) {
        for sheet in &mut self.sheets {
            let depth = match &mut sheet.depth {
                DepthInput::Array(chart) => Some(chart.as_mut()),
                DepthInput::Constant(_) => None,
            };
            for chart in sheet.chart.iter_mut().chain(depth).chain(&mut sheet.coverage) {
                chart.set_cache_bytes(chart.cache_for_rows(rows));
            }
        }
    }
}

impl SheetInput {
    /// The surface of the job's chart.
    fn first(spec: &str, args: &RunArgs, frame: &Frame, ray_mm: f64) -> Result<Self> {
        if let Ok(distance) = spec.parse::<f32>() {
            let unit = args.depth_unit.unwrap_or(DepthUnit::Metre);
            if distance.is_nan() || distance <= 0.0 {
                return Err(usage(format!("--depth {spec}: expected a distance above 0, or an array")));
            }
            let depth = ConstantDepth { size: frame.chart, distance };
            let distance = meaning(args, unit.metres(), args.depth_kind, ray_mm);
            return Ok(Self { chart: None, depth: DepthInput::Constant(depth), coverage: None, distance });
        }
        let depth = array(spec, frame, "--depth")?;
        let distance = declared(args, spec, &depth, ray_mm)?;
        let coverage = match (&depth, group_of(spec)) {
            (Chart::Store(_), Some(group)) => coverage(group, frame)?,
            _ => None,
        };
        Ok(Self { chart: None, depth: DepthInput::Array(Box::new(depth)), coverage, distance })
    }

    /// A surface in a Zarr group.
    fn hidden(
        spec: &str,
        args: &RunArgs,
        frame: &Frame,
        wavelengths_nm: &[f64],
        ray_mm: f64,
    ) -> Result<Self> {
        let member = |name: &str| member(spec, name);
        let nm = wavelengths_nm.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
        let flags = ChartFlags { wavelengths: Some(&nm), nan: args.nan, ..ChartFlags::default() };
        let chart = Chart::open_with(&member("chart"), &flags).with_context(|| format!("--hidden {spec}"))?;
        check_size(&chart, frame, &member("chart"), "--hidden")?;
        let depth = array(&member("depth"), frame, "--hidden")?;
        let distance = declared(args, spec, &depth, ray_mm)?;
        let coverage = coverage(spec, frame)?;
        Ok(Self { chart: Some(chart), depth: DepthInput::Array(Box::new(depth)), coverage, distance })
    }

    fn sheet(&self) -> Sheet<'_> {
        Sheet {
            chart: self.chart.as_ref().map(Chart::source),
            depth: self.depth.source(),
            coverage: self.coverage.as_ref().map(Chart::source),
            distance: self.distance,
        }
    }

    fn charts(&self) -> impl Iterator<Item = &Chart> {
        let depth = match &self.depth {
            DepthInput::Array(chart) => Some(chart.as_ref()),
            DepthInput::Constant(_) => None,
        };
        self.chart.iter().chain(depth).chain(&self.coverage)
    }

    /// Rows of the depth array that are read together while it is checked.
    fn rows_at_a_time(&self) -> usize {
        match &self.depth {
            DepthInput::Array(chart) => scan::rows_at_a_time(chart),
            DepthInput::Constant(_) => scan::MIN_ROWS,
        }
    }
}

/// Vergences of the farthest and the nearest depth node of any band, 1/m.
fn node_range(lens: &Lens) -> (f64, f64) {
    let nodes = lens.depth.iter().flat_map(|depth| &depth.bands).flat_map(|band| &band.vergence);
    let range = nodes.fold((f64::INFINITY, 0.0), |(a, z): (f64, f64), v| (a.min(*v), z.max(*v)));
    if range.0 <= range.1 { range } else { (0.0, 0.0) }
}

/// Opens an array of one number per chart pixel.
fn array(spec: &str, frame: &Frame, flag: &str) -> Result<Chart> {
    let flags = ChartFlags { nan: NanPolicy::Keep, ..ChartFlags::default() };
    let chart = Chart::open_with(spec, &flags).with_context(|| format!("{flag} {spec}"))?;
    let bands = match &chart {
        Chart::Store(store) => store.bands(),
        Chart::Raster(raster) => raster.bands(),
        Chart::Decoded(_) | Chart::Generated(_) => {
            return Err(usage(format!("{flag} {spec}: expected a Zarr array, .npy or ENVI file")));
        }
    };
    if bands != 1 {
        return Err(usage(format!(
            "{flag} {spec}: the array has {bands} bands, expected rows and columns only"
        )));
    }
    check_size(&chart, frame, spec, flag)?;
    Ok(chart)
}

fn check_size(chart: &Chart, frame: &Frame, spec: &str, flag: &str) -> Result<()> {
    let (found, expected) = (chart.size(), frame.chart);
    match found == expected {
        true => Ok(()),
        false => Err(usage(format!(
            "{flag} {spec}: {found} px, the chart has {expected}: arrays of surfaces are not resampled"
        ))),
    }
}

/// The group of the array `PATH//depth`; none for an array that is a store of its own.
fn group_of(spec: &str) -> Option<&str> {
    let (scheme, path) = spec.split_once("://").map_or((0, spec), |(scheme, path)| (scheme.len() + 3, path));
    let at = scheme + path.rfind("//").map(|_| path.rfind('/'))??;
    Some(spec[..at].trim_end_matches('/'))
}

/// The array `name` of a group `PATH` or `PATH//GROUP`.
fn member(group: &str, name: &str) -> String {
    let has_array = group.split_once("://").map_or(group, |(_, path)| path).contains("//");
    format!("{group}{}{name}", if has_array { "/" } else { "//" })
}

/// The array `coverage` of a group, if there is one.
fn coverage(group: &str, frame: &Frame) -> Result<Option<Chart>> {
    let spec = member(group, "coverage");
    match array(&spec, frame, "coverage") {
        Ok(chart) => Ok(Some(chart)),
        Err(e) if e.downcast_ref().is_some_and(|e| matches!(e, ChartError::NoArray { .. })) => Ok(None),
        Err(e) => Err(e),
    }
}

/// What the numbers of `depth` mean: by the flags, else by its attributes.
fn declared(args: &RunArgs, spec: &str, depth: &Chart, ray_mm: f64) -> Result<Distance> {
    let attribute = |key: &str| match depth {
        Chart::Store(store) => store.text_attribute(key),
        _ => None,
    };
    let unit = match (args.depth_unit, attribute("unit").or_else(|| attribute("units"))) {
        (Some(unit), _) => unit,
        (None, None) => DepthUnit::Metre,
        (None, Some(text)) => DepthUnit::from_symbol(text).ok_or_else(|| {
            usage(format!(
                "{spec}: the attribute unit is `{text}`, expected m, cm or mm; give it by --depth-unit"
            ))
        })?,
    };
    let kind = match (args.depth_kind, attribute("kind")) {
        (Some(kind), _) => Some(kind),
        (None, None) => None,
        (None, Some("planar")) => Some(DepthKind::Planar),
        (None, Some("ray")) => Some(DepthKind::Ray),
        (None, Some(text)) => {
            return Err(usage(format!(
                "{spec}: the attribute kind is `{text}`, expected planar or ray; give it by --depth-kind"
            )));
        }
    };
    Ok(meaning(args, unit.metres(), kind, ray_mm))
}

fn meaning(args: &RunArgs, metres: f64, kind: Option<DepthKind>, ray_mm: f64) -> Distance {
    Distance {
        metres,
        ray_focal_mm: (kind == Some(DepthKind::Ray)).then_some(ray_mm),
        miss_is_far: args.depth_miss == DepthMiss::Far,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_of_a_group_are_found_beside_each_other() {
        for (spec, group, coverage) in [
            ("a/c.zarr//depth", Some("a/c.zarr"), "a/c.zarr//coverage"),
            ("c.zarr//hidden/1/depth", Some("c.zarr//hidden/1"), "c.zarr//hidden/1/coverage"),
            ("s3://b/c.zarr//depth", Some("s3://b/c.zarr"), "s3://b/c.zarr//coverage"),
        ] {
            assert_eq!(group_of(spec), group);
            assert_eq!(member(group.unwrap(), "coverage"), coverage);
        }
        assert_eq!([group_of("a/depth.npy"), group_of("s3://b/depth.zarr")], [None, None]);
    }
}
