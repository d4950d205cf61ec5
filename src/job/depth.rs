//! Distances of a job: the depth array, hidden surfaces and coverages, opened and checked before any pixel is computed.

mod scan;
pub mod surfaces;

use crate::args::{DepthArgs, DepthKind, DepthMiss, DepthUnit, RunArgs};
use crate::failure::usage;
use crate::open::{Chart, ChartFlags};
use anyhow::{Context, Result};
use formats::chart::{ChartError, NanPolicy};
use pipeline::depth::plan::Surfaces;
use pipeline::depth::sheet::{ConstantDepth, Distance, Sheet};
use pipeline::flow::ChartSource;
use pipeline::geometry::Frame;
use scan::{Position, Scan};
use serde_json::{Value, json};
use surfaces::SurfacePaths;

/// Surfaces of a job.
pub struct Depth {
    sheets: Vec<SheetInput>,
    /// Vergences of all surfaces.
    pub surfaces: Surfaces,
    /// Vergences of the lens's depth nodes, the farthest and the nearest, 1/m.
    pub range: (f64, f64),
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
    /// Opens and checks the surfaces `paths` of `args`, the job's chart first, for a chart on `frame` with bands at `wavelengths_nm` and a lens of
    /// distortion focal length `focal_mm`. `nodes`: vergences of its farthest and nearest depth node, 1/m; none if it is traced for the scene.
    ///
    /// # Errors
    /// An array cannot be read, has another size than the chart, or contains a distance or coverage that is not valid.
    pub fn open(
        args: &RunArgs,
        paths: &[SurfacePaths],
        frame: &Frame,
        wavelengths_nm: &[f64],
        focal_mm: f64,
        nodes: Option<(f64, f64)>,
    ) -> Result<Self> {
        let open = |paths: &SurfacePaths| SheetInput::open(args, paths, frame, wavelengths_nm, focal_mm);
        let sheets = paths.iter().map(open).collect::<Result<Vec<_>>>()?;
        for (sheet, paths) in std::iter::zip(&sheets, paths) {
            if let Some(coverage) = &sheet.coverage {
                scan::coverage(&paths.name, coverage)?;
            }
        }
        let named: Vec<(&str, &SheetInput)> =
            std::iter::zip(paths, &sheets).map(|(paths, sheet)| (&*paths.name, sheet)).collect();
        let each = |add: &mut dyn FnMut(Position, f64)| -> Result<()> {
            named.iter().try_for_each(|(name, sheet)| {
                let (source, rows) = (sheet.depth.source(), sheet.rows_at_a_time());
                scan::distances(name, source, rows, &sheet.distance, frame, &mut *add)
            })
        };
        let range = match nodes {
            Some(range) => range,
            None => {
                let mut range = (f64::INFINITY, 0f64);
                each(&mut |_, v| range = (range.0.min(v), range.1.max(v)))?;
                rounded_range(range)
            }
        };
        let mut scan = Scan::new(frame.chart, range);
        each(&mut |at, v| scan.add(at, v))?;
        let is_opaque = matches!(&sheets[..], [only] if only.coverage.is_none());
        let notes = scan.notes();
        let surfaces = scan.surfaces(is_opaque, sheets.len() == 1 && args.surfaces.hidden.is_empty());
        Ok(Self { surfaces, range, sheets, notes })
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
    fn open(
        args: &RunArgs,
        paths: &SurfacePaths,
        frame: &Frame,
        wavelengths_nm: &[f64],
        focal_mm: f64,
    ) -> Result<Self> {
        let given = &args.surfaces;
        let chart = paths.chart.as_ref().map(|spec| {
            let nm = wavelengths_nm.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
            let flags = ChartFlags { wavelengths: Some(&nm), nan: args.nan, ..ChartFlags::default() };
            let chart = Chart::open_with(spec, &flags).with_context(|| paths.name.clone())?;
            check_size(&chart, frame, spec, &paths.name).map(|()| chart)
        });
        let chart = chart.transpose()?;
        if let Ok(distance) = paths.depth.parse::<f32>() {
            if distance.is_nan() || distance <= 0.0 {
                return Err(usage(format!("{}: expected a distance above 0, or an array", paths.name)));
            }
            let depth = DepthInput::Constant(ConstantDepth { size: frame.chart, distance });
            let metres = given.depth_unit.unwrap_or(DepthUnit::Metre).metres();
            let distance = meaning(given, metres, given.depth_kind, focal_mm);
            return Ok(Self { chart, depth, coverage: None, distance });
        }
        let depth = array(&paths.depth, frame, &paths.name)?;
        let distance = declared(given, &paths.depth, &depth, focal_mm)?;
        let coverage = match (&depth, &paths.coverage) {
            (Chart::Store(_) | Chart::Generated(_), Some(spec)) => coverage(spec, frame)?,
            _ => None,
        };
        Ok(Self { chart, depth: DepthInput::Array(Box::new(depth)), coverage, distance })
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

/// `range` rounded outwards to twenty steps per power of ten of its width, so that similar scenes share the bands of a design.
fn rounded_range((first, last): (f64, f64)) -> (f64, f64) {
    if last <= first {
        return (first, last);
    }
    let step = 10f64.powi(pipeline::real::log10(last - first).floor() as i32) / 20.0;
    ((first / step).floor() * step, (last / step).ceil() * step)
}

/// Number of bands of an array.
fn array_of(chart: &Chart) -> usize {
    match chart {
        Chart::Store(store) => store.bands(),
        Chart::Raster(raster) => raster.bands(),
        Chart::Decoded(decoded) => decoded.bands(),
        Chart::Generated(generator) => generator.wavelengths_nm().len(),
    }
}

/// Whether a store has no array of the requested name.
fn is_missing(error: &anyhow::Error) -> bool {
    error.downcast_ref().is_some_and(|e| matches!(e, ChartError::NoArray { .. }))
}

/// Opens an array of one number per chart pixel.
fn array(spec: &str, frame: &Frame, name: &str) -> Result<Chart> {
    // A drawn array has one band, whose wavelength has no meaning.
    let wavelengths = spec.starts_with("gen:").then_some("550");
    let flags = ChartFlags { nan: NanPolicy::Keep, wavelengths, ..ChartFlags::default() };
    let chart = Chart::open_with(spec, &flags).with_context(|| name.to_owned())?;
    if let Chart::Decoded(_) = chart {
        return Err(usage(format!("{name}: expected a Zarr array, .npy or ENVI file")));
    }
    let bands = array_of(&chart);
    if bands != 1 {
        return Err(usage(format!("{name}: the array has {bands} bands, expected rows and columns only")));
    }
    check_size(&chart, frame, spec, name)?;
    Ok(chart)
}

fn check_size(chart: &Chart, frame: &Frame, spec: &str, name: &str) -> Result<()> {
    let (found, expected) = (chart.size(), frame.chart);
    let of = if name.ends_with(spec) { name.to_owned() } else { format!("{name}: {spec}") };
    match found == expected {
        true => Ok(()),
        false => Err(usage(format!(
            "{of}: {found} px, the chart has {expected}: arrays of surfaces are not resampled"
        ))),
    }
}

/// The coverage `spec`, if there is one.
fn coverage(spec: &str, frame: &Frame) -> Result<Option<Chart>> {
    match array(spec, frame, spec) {
        Ok(chart) => Ok(Some(chart)),
        Err(e) if is_missing(&e) => Ok(None),
        Err(e) => Err(e),
    }
}

/// What the numbers of `depth` mean: by the flags, else by its attributes.
fn declared(args: &DepthArgs, spec: &str, depth: &Chart, ray_mm: f64) -> Result<Distance> {
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

fn meaning(args: &DepthArgs, metres: f64, kind: Option<DepthKind>, ray_mm: f64) -> Distance {
    Distance {
        metres,
        ray_focal_mm: (kind == Some(DepthKind::Ray)).then_some(ray_mm),
        miss_is_far: args.depth_miss == Some(DepthMiss::Far),
    }
}

#[cfg(test)]
mod tests {
    use super::rounded_range;

    #[test]
    fn ranges_are_rounded_outwards() {
        let (first, last) = rounded_range((0.333_1, 2.511));
        assert!((first - 0.3).abs() < 1e-12 && (last - 2.55).abs() < 1e-12, "{first} {last}");
        assert_eq!(rounded_range((0.5, 0.5)), (0.5, 0.5));
        assert_eq!(rounded_range((0.0, 0.07)).0, 0.0);
    }
}
