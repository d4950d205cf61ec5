//! Distances of a job: the depth array, hidden surfaces and coverages, opened and checked before any pixel is computed.

pub mod arrays;
mod clean;
mod hidden_chart;
pub mod scan;
pub mod surfaces;

use crate::args::{CoverageLight, DepthArgs, DepthEdges, DepthKind, DepthMiss, DepthUnit, RunArgs};
use crate::failure::usage;
use crate::machine::threads;
use crate::open::{Chart, ChartFlags};
use anyhow::Result;
use arrays::{array, check_opaque, check_size, coverage, decode, temporary_directory};
use clean::{CleanDepth, Edges};
use pipeline::depth::plan::Surfaces;
use pipeline::depth::sheet::{ConstantDepth, Distance, Sheet};
use pipeline::flow::ChartSource;
use pipeline::geometry::Frame;
use scan::{Findings, Scan, Scanned};
use serde_json::{Value, json};
use std::path::PathBuf;
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

/// What surfaces are opened with.
#[derive(Clone)]
pub struct DepthRequest<'a> {
    /// Flags of distances.
    pub given: &'a DepthArgs,
    /// Chart of the first surface, as given.
    pub chart: &'a str,
    /// Flags of the job's chart, which hold for those of hidden surfaces too; none if only distances are read.
    pub flags: Option<ChartFlags<'a>>,
    /// Where arrays are decoded to.
    pub directory: PathBuf,
    /// Threads that decode.
    pub threads: usize,
}

/// What mends premultiplied colours without a coverage.
const NO_COVERAGE: &str = "and there is no coverage: write colours divided by alpha, distances and alpha as the arrays chart, depth and coverage of a \
                           Zarr group, or render opaque pixels";
/// What mends premultiplied colours beside a coverage.
const COVERAGE_LIGHT: &str = "and there is a coverage: add `--coverage-light premultiplied`, which divides them by it, or `--coverage-light straight` if \
                              they are the colours of the surface";

impl<'a> DepthRequest<'a> {
    /// That of a run.
    pub fn new(args: &'a RunArgs) -> Self {
        let directory = temporary_directory(&args.film);
        let threads = threads(args.threads);
        let flags = ChartFlags {
            wavelengths: args.wavelengths.as_deref(),
            axes: args.axes.as_ref(),
            scale: args.chart_scale,
            nan: args.nan,
            ..ChartFlags::default()
        };
        Self { given: &args.surfaces, chart: &args.chart, flags: Some(flags), directory, threads }
    }

    /// Fails if the chart of the surface `paths` has premultiplied colours, which `way_out` mends.
    fn check_opaque(&self, paths: &SurfacePaths, way_out: &str) -> Result<()> {
        let spec = paths.chart.as_deref().unwrap_or(self.chart);
        check_opaque(spec, way_out, &self.directory, self.threads)
    }
}

/// Surfaces of a job.
pub struct Depth {
    sheets: Vec<SheetInput>,
    /// What was found in the depth array of each.
    pub findings: Vec<Findings>,
    /// Largest change of blur by the rounding of 16-bit distances, px; none without such.
    pub f16_step_px: Option<f64>,
    /// Vergences of all surfaces.
    pub surfaces: Surfaces,
    /// Vergences of the lens's depth nodes, the farthest and the nearest, 1/m.
    pub range: (f64, f64),
    /// Notes to print.
    pub notes: Vec<String>,
}

/// Whether `coverage` is known to stand beside light of the surface alone: it is drawn, or says so.
fn is_straight(coverage: &Chart) -> bool {
    matches!(coverage, Chart::Generated(_)) || coverage.text_attribute("light") == Some("straight")
}

/// Rounding of a 16-bit float, relative.
const F16_HALF_STEP: f64 = 1.0 / 2048.0;
/// Largest change of blur by rounding of distances that is not reported, px.
pub const MAX_STEP_PX: f64 = 0.25;

/// One surface.
struct SheetInput {
    /// Its chart; none for the surface of the job's chart.
    chart: Option<Chart>,
    depth: DepthInput,
    distance: Distance,
    /// Whether the light of its chart is multiplied by its coverage.
    is_premultiplied: bool,
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

    fn coverage(&self) -> Option<&Chart> {
        match self {
            Self::Array(depth) => depth.coverage.as_ref(),
            Self::Constant(_) => None,
        }
    }
}

impl Depth {
    /// Opens and checks the surfaces `paths` of `request`, the job's chart first, for a chart on `frame` with bands at `wavelengths_nm`. `on_row` receives
    /// the vergences of each row of the first surface.
    ///
    /// # Errors
    /// An array cannot be read, has another size than the chart, or contains a distance or coverage that is not valid; a chart with premultiplied colours.
    pub fn open(
        request: &DepthRequest<'_>,
        paths: &[SurfacePaths],
        frame: &Frame,
        wavelengths_nm: &[f64],
        lens: LensFacts,
        on_row: &mut dyn FnMut(usize, &[f64]),
    ) -> Result<Self> {
        let open =
            |paths: &SurfacePaths| SheetInput::open(request, paths, frame, wavelengths_nm, lens.focal_mm);
        let mut sheets = paths.iter().map(open).collect::<Result<Vec<_>>>()?;
        let is_snapped = request.given.depth_edges == Some(DepthEdges::Snap);
        let (mut notes, mut findings, mut scan) = (Vec::new(), Vec::new(), Scan::new(frame.chart));
        for (i, (sheet, paths)) in std::iter::zip(&mut sheets, paths).enumerate() {
            let edges = Edges { distance: sheet.distance, frame: *frame, blur_px: lens.blur_px };
            if let (true, DepthInput::Array(depth)) = (is_snapped, &mut sheet.depth) {
                depth.snap(edges);
            }
            let (name, source) = (&*paths.name, sheet.depth.source());
            let coverage = sheet.depth.coverage().map(Chart::source);
            let of =
                Scanned { name, source, coverage, rows: sheet.rows_at_a_time(), edges, nodes: lens.nodes };
            let found = match i {
                0 => scan.add(&of, on_row)?,
                _ => scan.add(&of, &mut |_, _| ())?,
            };
            notes.extend(found.edge_note(name).filter(|_| !is_snapped));
            notes.extend(found.infinity_note(name));
            let is_known =
                sheet.depth.coverage().is_some_and(is_straight) || request.given.coverage_light.is_some();
            notes.extend(found.coverage_note(name).filter(|_| !is_known));
            findings.push(found);
        }
        if scan.range().0 > scan.range().1 {
            return Err(usage(format!(
                "{}: the coverage of all pixels is 0, expected a surface somewhere",
                paths.iter().map(|paths| &*paths.name).collect::<Vec<_>>().join(", ")
            )));
        }
        let missed: u64 = findings.iter().map(Findings::missed).sum();
        if missed > 0 {
            notes.push(format!(
                "{missed} pixels of the depth arrays are NaN, 0 or negative and are taken for infinity (--depth-miss far)"
            ));
        }
        let step_px = scan.range().1 * lens.blur_px * F16_HALF_STEP;
        for (sheet, paths) in std::iter::zip(&sheets, paths) {
            notes.extend(sheet.step_note(&paths.name, step_px));
        }
        let has_f16 = sheets.iter().any(SheetInput::is_f16);
        let range = lens.nodes.unwrap_or_else(|| rounded_range(scan.range()));
        let is_opaque = matches!(&sheets[..], [only] if only.depth.coverage().is_none());
        let surfaces = scan.surfaces(is_opaque, sheets.len() == 1 && request.given.hidden.is_empty());
        let f16_step_px = has_f16.then_some(step_px);
        Ok(Self { surfaces, range, sheets, findings, f16_step_px, notes })
    }

    /// The surfaces, as the depth stage reads them.
    pub fn sheets(&self) -> Vec<Sheet<'_>> {
        self.sheets.iter().map(SheetInput::sheet).collect()
    }

    /// Charts of hidden surfaces, arrays of distances and coverages.
    pub fn charts(&self) -> impl Iterator<Item = &Chart> {
        self.sheets.iter().flat_map(SheetInput::charts)
    }

    /// Rejects pixels of the charts of hidden surfaces beyond `max`.
    ///
    /// # Errors
    /// The values of a chart cannot be limited.
    pub fn limit_values(&mut self, max: f32) -> Result<()> {
        self.sheets
            .iter_mut()
            .filter_map(|sheet| sheet.chart.as_mut())
            .try_for_each(|chart| Ok(chart.limit_values(max)?))
    }

    /// Whether the job's chart is all that is seen.
    pub fn is_opaque(&self) -> bool {
        matches!(&self.sheets[..], [only] if only.depth.coverage().is_none())
    }

    /// Number of surfaces.
    pub fn count(&self) -> usize {
        self.sheets.len()
    }

    /// Digests of the bytes of its files.
    ///
    /// # Errors
    /// As [`Chart::content_digest`].
    pub fn content_digests(&self) -> Result<Value> {
        self.charts().map(|chart| Ok(chart.content_digest()?)).collect()
    }

    /// Digests of samples of the bytes of its files, chart by chart.
    ///
    /// # Errors
    /// As [`Chart::content_sample`].
    pub fn content_samples(&self) -> Result<Vec<Value>> {
        self.charts().map(|chart| Ok(chart.content_sample()?)).collect()
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
            let mut of_sheet = json!({
                "arrays": arrays,
                "has_coverage": sheet.depth.coverage().is_some(),
                "constant": constant,
                "metres_per_unit": sheet.distance.metres,
                "ray": sheet.distance.ray_focal_mm,
                "miss_is_far": sheet.distance.miss_is_far,
                "snapped": matches!(&sheet.depth, DepthInput::Array(depth) if depth.is_snapped()),
            });
            // Absent for straight light: the identity is then that of programs without this option.
            if sheet.is_premultiplied {
                of_sheet["premultiplied"] = true.into();
            }
            content.push(of_sheet);
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
            let (depth, coverage) = match &mut sheet.depth {
                DepthInput::Array(depth) => (Some(&mut depth.chart), depth.coverage.as_mut()),
                DepthInput::Constant(_) => (None, None),
            };
            for chart in sheet.chart.iter_mut().chain(depth).chain(coverage) {
                chart.set_cache_bytes(chart.cache_for_rows(rows));
            }
        }
    }
}

impl SheetInput {
    fn open(
        request: &DepthRequest<'_>,
        paths: &SurfacePaths,
        frame: &Frame,
        wavelengths_nm: &[f64],
        focal_mm: f64,
    ) -> Result<Self> {
        let given = request.given;
        let chart = match (&paths.chart, &request.flags) {
            (Some(spec), Some(flags)) => {
                let chart = hidden_chart::open(spec, &paths.name, flags, wavelengths_nm)?;
                check_size(&chart, frame, spec, &paths.name)?;
                Some(chart)
            }
            _ => None,
        };
        if let Ok(distance) = paths.depth.parse::<f32>() {
            if distance.is_nan() || distance <= 0.0 {
                return Err(usage(format!("{}: expected a distance above 0, or an array", paths.name)));
            }
            let depth = DepthInput::Constant(ConstantDepth { size: frame.chart, distance });
            let metres = given.depth_unit.unwrap_or(DepthUnit::Metre).metres();
            let distance = meaning(given, metres, given.depth_kind, focal_mm);
            request.check_opaque(paths, NO_COVERAGE)?;
            return Ok(Self { chart, depth, distance, is_premultiplied: false });
        }
        let raw = given.depth_dtype.as_deref().filter(|_| paths.chart.is_none());
        let depth = array(&paths.depth, frame, &paths.name, raw)?;
        decode(&depth, &request.directory, request.threads)?;
        let distance = declared(given, &paths.depth, &depth, focal_mm)?;
        let is_in_group =
            matches!(depth, Chart::Store(_) | Chart::Generated(_)) || depth.hdf5_array().is_some();
        let coverage = match &paths.coverage {
            Some(spec) if is_in_group => coverage(spec, frame)?,
            _ => None,
        };
        if let Some(coverage) = &coverage {
            decode(coverage, &request.directory, request.threads)?;
        }
        match (&coverage, given.coverage_light) {
            (None, _) => request.check_opaque(paths, NO_COVERAGE)?,
            (Some(coverage), None) if !is_straight(coverage) => {
                request.check_opaque(paths, COVERAGE_LIGHT)?
            }
            (Some(_), _) => {}
        }
        let is_premultiplied =
            coverage.is_some() && given.coverage_light == Some(CoverageLight::Premultiplied);
        let depth = DepthInput::Array(Box::new(CleanDepth::new(depth, coverage)));
        Ok(Self { chart, depth, distance, is_premultiplied })
    }

    fn is_f16(&self) -> bool {
        matches!(&self.depth, DepthInput::Array(depth) if depth.is_f16())
    }

    /// A note if a step of 16-bit distances changes the blur of the nearest surface by `step_px` that is visible.
    fn step_note(&self, name: &str, step_px: f64) -> Option<String> {
        (self.is_f16() && step_px > MAX_STEP_PX).then(|| {
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
            coverage: self.depth.coverage().map(Chart::source),
            is_premultiplied: self.is_premultiplied,
            distance: self.distance,
        }
    }

    fn charts(&self) -> impl Iterator<Item = &Chart> {
        let depth = match &self.depth {
            DepthInput::Array(depth) => Some(&depth.chart),
            DepthInput::Constant(_) => None,
        };
        self.chart.iter().chain(depth).chain(self.depth.coverage())
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
    let attribute = |key: &str| depth.text_attribute(key);
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
