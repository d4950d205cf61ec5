//! MTF of an edge in both raws: of every plane from its own pixels, without demosaicing, and of developed luminance. Doubtful figures
//! have remarks, meaningless ones are errors, by the rules of `lenscube measure`.

use super::Pair;
use crate::camera::Developer;
use crate::commands::measure::edge_mtf::EdgeMtf;
use crate::commands::measure::{edge_region, quality};
use crate::failure::{line as message, usage};
use anyhow::{Context, Result};
use pipeline::geometry::Rect;
use pipeline::measure::edge::{EdgeLine, fit};
use pipeline::measure::shading::LUMINANCE;
use serde_json::{Value, json};
use std::fmt::Write;

/// An edge.
pub struct Edge {
    /// The line that was given: X0, Y0, X1, Y1.
    pub line: [f64; 4],
    /// Luminance and planes.
    pub curves: Vec<EdgeCurve>,
}

/// One plane, or luminance.
pub struct EdgeCurve {
    /// Its name.
    pub name: String,
    /// Measurement in both raws, or why there is none.
    pub measured: [Result<EdgeMtf, String>; 2],
}

impl EdgeCurve {
    /// Frequency of modulation 1/2 (cycles per pixel) in a raw, or why there is none.
    pub fn mtf50(&self, raw: usize) -> String {
        match self.measured[raw].as_ref().map(|m| m.mtf.mtf50_cy_px()) {
            Err(why) => format!("none ({why})"),
            Ok(None) => "above 1".into(),
            Ok(Some(f)) => format!("{f:.4}"),
        }
    }

    /// Remarks on a raw's figures.
    pub fn remarks(&self, raw: usize) -> impl Iterator<Item = &str> {
        self.measured[raw].iter().flat_map(|m| &m.remarks).map(|remark| remark.text.as_str())
    }
}

impl Edge {
    pub fn json(&self) -> Value {
        let one = |m: &Result<EdgeMtf, String>| match m {
            Ok(EdgeMtf { mtf, remarks }) => json!({
                "frequency_cy_px": mtf.frequency_cy_px,
                "modulation": mtf.modulation,
                "mtf50_cy_px": mtf.mtf50_cy_px(),
                "remarks": quality::names(remarks),
            }),
            Err(e) => json!({ "error": e }),
        };
        let curve =
            |c: &EdgeCurve| json!({ "name": c.name, "a": one(&c.measured[0]), "b": one(&c.measured[1]) });
        json!({ "line": self.line, "curves": self.curves.iter().map(curve).collect::<Vec<_>>() })
    }
}

/// The table of all MTFs.
pub fn csv(edges: &[Edge]) -> String {
    let mut text = String::from("edge,plane,raw,frequency_cy_px,modulation\n");
    for (k, edge) in edges.iter().enumerate() {
        for curve in &edge.curves {
            for (raw, measured) in ["a", "b"].iter().zip(&curve.measured) {
                let points =
                    measured.iter().flat_map(|m| std::iter::zip(&m.mtf.frequency_cy_px, &m.mtf.modulation));
                for (f, m) in points {
                    // Writing to a String cannot fail.
                    let _ = writeln!(text, "{k},{},{raw},{f},{m:.6}", curve.name);
                }
            }
        }
    }
    text
}

/// Measures the edge near a line.
///
/// # Errors
/// Usage: a line outside the raws or too short; no curve of either raw can be measured.
pub fn measure(pair: &Pair, developers: &[Developer; 2], line: [f64; 4], half: usize) -> Result<Edge> {
    let [x0, y0, x1, y1] = line;
    let (guess, rect, length) = edge_region((y0, x0), (y1, x1), half);
    let size = pair.frames[0].rect.size();
    if !size.rect().contains(rect) {
        return Err(usage(format!(
            "--edge {x0},{y0},{x1},{y1} needs {rect}, which is not inside the raw of {size} pixels; give other positions or a smaller --half-px"
        )));
    }
    quality::check_length(length).with_context(|| format!("--edge {x0},{y0},{x1},{y1}"))?;
    let middle = ((y0 + y1) / 2.0, (x0 + x1) / 2.0);
    let located = |luminance: &[f32]| -> Result<EdgeLine> {
        let found = fit(luminance, rect, guess, half)
            .context("no edge found between these positions; give positions on the edge, farther apart")?;
        quality::check_place(guess, found, half)?;
        Ok(found)
    };
    let sensor = &pair.frames[0].sensor;
    let planes: Vec<String> = sensor.planes().iter().map(|p| (*p).to_owned()).collect();
    let of = sensor.plane_of_channels();
    let mut curves: Vec<[Option<Result<EdgeMtf, String>>; 2]> =
        (0..=planes.len()).map(|_| Default::default()).collect();
    for raw in 0..2 {
        let luminance = luminance(&developers[raw], rect)?;
        let found = located(&luminance).map_err(|e| message(&e));
        let curve_of = |pixels: &[f32], own: &dyn Fn(i64, i64) -> bool| {
            let mtf = |line| EdgeMtf::new((pixels, rect), line, (middle, length), half, own);
            found.clone().and_then(|line| mtf(line).map_err(|e| message(&e)))
        };
        curves[0][raw] = Some(curve_of(&luminance, &|_, _| true));
        let pixels = pair.frames[raw].read(rect)?;
        let origin = pair.frames[raw].rect;
        for (plane, curve) in curves[1..].iter_mut().enumerate() {
            let own = |y: i64, x: i64| {
                of[sensor.pattern.channel((origin.y + y) as usize, (origin.x + x) as usize)] == plane
            };
            curve[raw] = Some(curve_of(&pixels, &own));
        }
    }
    let names = ["luminance".to_owned()].into_iter().chain(planes);
    let curves: Vec<EdgeCurve> = std::iter::zip(names, curves)
        .map(|(name, [a, b])| EdgeCurve {
            name,
            measured: [a, b].map(|m| m.expect("both raws are measured")),
        })
        .collect();
    let mut all = curves.iter().flat_map(|c| &c.measured);
    match (all.clone().all(Result::is_err), all.next()) {
        (true, Some(Err(why))) => Err(usage(format!("--edge {x0},{y0},{x1},{y1}: {why}"))),
        _ => Ok(Edge { line, curves }),
    }
}

fn luminance(developer: &Developer, rect: Rect) -> Result<Vec<f32>> {
    let linear = developer.linear(rect)?;
    Ok(match developer.channels() {
        1 => linear,
        _ => {
            let of = |c: &[f32; 3]| (0..3).map(|i| LUMINANCE[i] as f32 * c[i]).sum();
            linear.as_chunks::<3>().0.iter().map(of).collect()
        }
    })
}
