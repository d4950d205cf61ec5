//! Distances of a job: the depth array, hidden surfaces and coverages, opened and checked before any pixel is computed.

mod arrays;
mod clean;
mod scan;
pub mod surfaces;

use super::arguments::threads;
use crate::args::{DepthArgs, DepthEdges, DepthKind, DepthMiss, DepthUnit, RunArgs};
use crate::failure::usage;
use crate::open::{Chart, ChartFlags};
use anyhow::{Context, Result};
use arrays::{array, check_size, coverage, temporary_directory};
use clean::{CleanDepth, Edges};
use pipeline::depth::plan::Surfaces;
use pipeline::depth::sheet::{ConstantDepth, Distance, Sheet};
use pipeline::flow::ChartSource;
use pipeline::geometry::Frame;
use scan::{Position, Scan};
use serde_json::{Value, json};
use surfaces::SurfacePaths;

/// What of a lens matters to distances.
#[derive(Clone, Copy)]
pub struct LensFacts {
    /// Distortion focal length, mm.
    pub focal_mm: f64,
    /// Blur radius per dioptre, film px.
    pub blur_px: f64,
    /// Vergences of its farthest and nearest depth node, 1/m; none if it is traced for the scene.
    pub nodes: Option<(f64, f64)>,
}

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

/// Rounding of a 16-bit float, relative.
const F16_HALF_STEP: f64 = 1.0 / 4096.0;
/// Largest change of blur by rounding of distances that is not reported, px.
const MAX_STEP_PX: f64 = 0.25;

/// One surface.
struct SheetInput {
    /// Its chart; none for the surface of the job's chart.
    chart: Option<Chart>,
    depth: DepthInput,
    coverage: Option<Chart>,
    distance: Distance,
}

enum DepthInput {
    Array(Box<CleanDepth>),
    Constant(ConstantDepth),
}

impl DepthInput {
    fn source(&self) -> &dyn ChartSource {
        match self {
            Self::Array(depth) => depth.as_ref(),
            Self::Constant(depth) => depth,
        }
    }
}

impl Depth {
    /// Opens and checks the surfaces `paths` of `args`, the job's chart first, for a chart on `frame` with bands at `wavelengths_nm`.
    ///
    /// # Errors
    /// An array cannot be read, has another size than the chart, or contains a distance or coverage that is not valid.
    pub fn open(
        args: &RunArgs,
        paths: &[SurfacePaths],
        frame: &Frame,
        wavelengths_nm: &[f64],
        lens: LensFacts,
    ) -> Result<Self> {
        let open = |paths: &SurfacePaths| SheetInput::open(args, paths, frame, wavelengths_nm, lens.focal_mm);
        let mut sheets = paths.iter().map(open).collect::<Result<Vec<_>>>()?;
        let mut notes = Vec::new();
        for (sheet, paths) in std::iter::zip(&mut sheets, paths) {
            notes.extend(sheet.edges(&paths.name, args.surfaces.depth_edges, frame, lens.blur_px)?);
        }
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
        let range = match lens.nodes {
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
        notes.extend(scan.notes());
        let nearest = scan.nearest();
        for (name, sheet) in &named {
            notes.extend(sheet.step_note(name, nearest * lens.blur_px));
        }
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
                "snapped": matches!(&sheet.depth, DepthInput::Array(depth) if depth.is_snapped()),
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
                DepthInput::Array(depth) => Some(&mut depth.chart),
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
        let raw = given.depth_dtype.as_deref().filter(|_| paths.chart.is_none());
        let depth = array(&paths.depth, frame, &paths.name, raw)?;
        if let Chart::Decoded(decoded) = &depth {
            decoded.copy_bands(&[0], &temporary_directory(args), threads(args.threads), &|_, _| ())?;
        }
        let distance = declared(given, &paths.depth, &depth, focal_mm)?;
        let coverage = match (&depth, &paths.coverage) {
            (Chart::Store(_) | Chart::Generated(_), Some(spec)) => coverage(spec, frame)?,
            _ => None,
        };
        Ok(Self { chart, depth: DepthInput::Array(Box::new(CleanDepth::new(depth))), coverage, distance })
    }

    /// Looks for interpolated distances, which are replaced if asked for; a note on them.
    fn edges(
        &mut self,
        name: &str,
        edges: Option<DepthEdges>,
        frame: &Frame,
        blur_px: f64,
    ) -> Result<Option<String>> {
        let (rows, distance) = (self.rows_at_a_time(), self.distance);
        let DepthInput::Array(depth) = &mut self.depth else { return Ok(None) };
        let found = Edges { distance, frame: *frame, blur_px };
        if edges == Some(DepthEdges::Snap) {
            depth.snap(found);
            return Ok(None);
        }
        Ok(found.find(depth, rows)?.note(name))
    }

    /// A note if a step of 16-bit distances is visible: `blur_px` is the blur radius of the nearest surface.
    fn step_note(&self, name: &str, blur_px: f64) -> Option<String> {
        let step_px = blur_px * F16_HALF_STEP;
        let is_f16 = matches!(&self.depth, DepthInput::Array(depth) if depth.is_f16());
        (is_f16 && step_px > MAX_STEP_PX).then(|| {
            format!(
                "{name}: the distances are 16-bit floats, whose rounding changes the blur of the nearest surface by up to {step_px:.2} px; save \
                 them as 32-bit floats"
            )
        })
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
            DepthInput::Array(depth) => Some(&depth.chart),
            DepthInput::Constant(_) => None,
        };
        self.chart.iter().chain(depth).chain(&self.coverage)
    }

    /// Rows of the depth array that are read together while it is checked.
    fn rows_at_a_time(&self) -> usize {
        match &self.depth {
            DepthInput::Array(depth) => scan::rows_at_a_time(&depth.chart),
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
