//! MTF of an edge in both raws: of every plane from its own pixels, without demosaicing, and of developed luminance.

use super::Pair;
use crate::develop::Developer;
use crate::failure::usage;
use crate::measure::edge_region;
use anyhow::{Context, Result};
use pipeline::geometry::Rect;
use pipeline::measure::edge::{EdgeLine, Esf, fit};
use pipeline::measure::sfr::Mtf;
use serde_json::{Value, json};
use std::fmt::Write;

/// Start of the plateaus, as a share of the half width.
const PLATEAU: f64 = 0.75;
/// Luminance of linear sRGB.
const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

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
    /// MTF in both raws, or why there is none.
    pub mtf: [Result<Mtf, String>; 2],
}

impl EdgeCurve {
    /// Frequency of modulation 1/2, cycles per pixel.
    pub fn mtf50(&self, raw: usize) -> Option<f64> {
        self.mtf[raw].as_ref().ok()?.mtf50_cy_px()
    }
}

impl Edge {
    pub fn json(&self) -> Value {
        let one = |m: &Result<Mtf, String>| match m {
            Ok(m) => {
                json!({ "frequency_cy_px": m.frequency_cy_px, "modulation": m.modulation, "mtf50_cy_px": m.mtf50_cy_px() })
            }
            Err(e) => json!({ "error": e }),
        };
        let curve = |c: &EdgeCurve| json!({ "name": c.name, "a": one(&c.mtf[0]), "b": one(&c.mtf[1]) });
        json!({ "line": self.line, "curves": self.curves.iter().map(curve).collect::<Vec<_>>() })
    }
}

/// The table of all MTFs.
pub fn csv(edges: &[Edge]) -> String {
    let mut text = String::from("edge,plane,raw,frequency_cy_px,modulation\n");
    for (k, edge) in edges.iter().enumerate() {
        for curve in &edge.curves {
            for (raw, mtf) in ["a", "b"].iter().zip(&curve.mtf) {
                let points = mtf.iter().flat_map(|m| std::iter::zip(&m.frequency_cy_px, &m.modulation));
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
pub fn measure(pair: &Pair, developers: &[Developer; 2], line: [f64; 4], half: usize) -> Result<Edge> {
    let [x0, y0, x1, y1] = line;
    let (guess, rect, length) = edge_region((y0, x0), (y1, x1), half);
    let size = pair.frames[0].rect.size();
    if !size.rect().contains(rect) {
        return Err(usage(format!(
            "--edge {x0},{y0},{x1},{y1} needs {rect}, which is not inside the raw of {size} pixels; give other positions or a smaller --half-px"
        )));
    }
    let middle = ((y0 + y1) / 2.0, (x0 + x1) / 2.0);
    let mtf = |pixels: &[f32], line: EdgeLine, own: &dyn Fn(i64, i64) -> bool| {
        let (sin, cos) = line.normal_rad.sin_cos();
        let distance = |y: i64, x: i64| {
            let at = (y as f64, x as f64);
            let along = (at.0 - middle.0) * cos - (at.1 - middle.1) * sin;
            (along.abs() <= length / 2.0 && own(y, x)).then(|| line.distance(at))
        };
        let reach = half as f64 - 1.0;
        let esf = Esf::new(pixels, rect, reach, distance).and_then(|e| e.normalised(PLATEAU * reach));
        esf.map(|e| Mtf::from_esf(&e)).map_err(|e| e.to_string())
    };
    let sensor = &pair.frames[0].sensor;
    let planes: Vec<String> = sensor.planes().iter().map(|p| (*p).to_owned()).collect();
    let of = sensor.plane_of_channels();
    let mut curves: Vec<[Option<Result<Mtf, String>>; 2]> =
        (0..=planes.len()).map(|_| Default::default()).collect();
    for raw in 0..2 {
        let luminance = luminance(&developers[raw], rect)?;
        let found = fit(&luminance, rect, guess, half).with_context(|| {
            format!(
                "--edge {x0},{y0},{x1},{y1}: no edge in {}; give positions on the edge, farther apart",
                pair.names[raw]
            )
        })?;
        curves[0][raw] = Some(mtf(&luminance, found, &|_, _| true));
        let pixels = pair.frames[raw].read(rect)?;
        let origin = pair.frames[raw].rect;
        for (plane, curve) in curves[1..].iter_mut().enumerate() {
            let own = |y: i64, x: i64| {
                of[sensor.pattern.channel((origin.y + y) as usize, (origin.x + x) as usize)] == plane
            };
            curve[raw] = Some(mtf(&pixels, found, &own));
        }
    }
    let names = ["luminance".to_owned()].into_iter().chain(planes);
    let curves = std::iter::zip(names, curves)
        .map(|(name, [a, b])| EdgeCurve { name, mtf: [a, b].map(|m| m.expect("both raws are measured")) })
        .collect();
    Ok(Edge { line, curves })
}

fn luminance(developer: &Developer, rect: Rect) -> Result<Vec<f32>> {
    let linear = developer.linear(rect)?;
    Ok(match developer.channels() {
        1 => linear,
        _ => linear.as_chunks::<3>().0.iter().map(|c| (0..3).map(|i| LUMINANCE[i] * c[i]).sum()).collect(),
    })
}
