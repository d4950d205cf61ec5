//! Weights of the film's bands that differ over the sensor, by the directions of the light ([`super::angle`]).
//!
//! ```text
//! W_cb(x, y) = Σ_i q_i S_c(p_i) w_cb(s_i)          p_i, q_i: directions of the cone at (x, y) in the band's wavelength and their shares; s_i = |p_i|
//! ```
//! A response that depends on wavelength is Σ_j L_cj(λ) S_cj(p), L_cj linear in λ: each S_cj has its own w, with L_cj under the integral.
//! w_cb(s) at 65 squares of the sine, cubic polynomials between. W at the nodes of a grid over the whole sensor, 48 cells along its longer side, and at a pixel's middle cubic polynomials of W less its value for
//! perpendicular light along both axes: so a response that is 1 everywhere leaves the weights bit for bit. A pixel's weight depends on its place on the sensor, not on windows, blocks and threads.

use super::Sensor;
use super::angle::disc;
use super::field_sums::Columns;
use crate::geometry::Size;
use crate::lens::cone_field::ConeField;
use crate::parts::for_each_part;
use crate::spline::lagrange_around;
use std::convert::Infallible;
use std::ops::Range;

/// Cells along the longer side of a sensor, and along the other one at least.
const CELLS: (usize, usize) = (48, 4);
/// Squares of the sine at which weights behind plates are computed.
const SINES: usize = 65;

/// Weights of the bands behind each filter over the sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldWeights {
    size: Size,
    /// Cells along rows and columns.
    cells: (usize, usize),
    /// By channel and band, at the nodes row by row: W − w.
    differences: Vec<Vec<Vec<f64>>>,
}

/// Where the sensor is in the field of the lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Its pixels.
    pub size: Size,
    /// Pitch, mm.
    pub pitch_mm: f64,
    /// Its middle (down, right) from the axis, mm.
    pub centre_mm: (f64, f64),
}

impl Placement {
    /// Its first and its last place (X, Y), mm.
    pub fn corners_mm(&self) -> [[f64; 2]; 2] {
        let Self { size, pitch_mm, centre_mm: (y, x) } = self;
        let half = [0.5 * size.width as f64 * pitch_mm, 0.5 * size.height as f64 * pitch_mm];
        [[x - half[0], y - half[1]], [x + half[0], y + half[1]]]
    }

    /// Distance from the axis of the farthest corner, mm.
    pub fn reach_mm(&self) -> f64 {
        let far = |centre: f64, n: usize| centre.abs() + 0.5 * n as f64 * self.pitch_mm;
        let (y, x) = (far(self.centre_mm.0, self.size.height), far(self.centre_mm.1, self.size.width));
        (y * y + x * x).sqrt()
    }
}

impl FieldWeights {
    /// Those of `sensor` at `placement` for the bands `bands_nm`, of which the light has the directions `cones`, one field a band; `scales`, by band, multiply them. On `threads` threads.
    pub fn new(
        sensor: &Sensor,
        (bands_nm, scales): (&[f64], &[f64]),
        cones: &[ConeField],
        placement: &Placement,
        threads: usize,
    ) -> Self {
        let Placement { size, .. } = *placement;
        let longer = size.height.max(size.width);
        let along = |n: usize| (CELLS.0 * n).div_ceil(longer).max(CELLS.1);
        let cells = (along(size.height), along(size.width));
        let weights = SineWeights::new(sensor, (bands_nm, scales), cones, placement);
        let (rows, columns, bands) = (cells.0 + 1, cells.1 + 1, bands_nm.len());
        let (channels, nodes) = (sensor.channels.len(), disc());
        // Node by node: all channels and bands.
        let mut found = vec![0.0; rows * columns * channels * bands];
        let done: Result<(), Infallible> = for_each_part(
            threads,
            found.chunks_exact_mut(columns * channels * bands).enumerate(),
            || Directions {
                in_frame: Vec::new(),
                slopes: Vec::new(),
                taps: Vec::new(),
                responses: vec![vec![vec![1.0; nodes.len()]]; channels],
            },
            |directions, (row, out)| {
                for (column, out) in out.chunks_exact_mut(channels * bands).enumerate() {
                    let mm = |node: usize, cells: usize, n: usize, centre: f64| {
                        (node as f64 / cells as f64 - 0.5) * n as f64 * placement.pitch_mm + centre
                    };
                    let y = mm(row, cells.0, size.height, placement.centre_mm.0);
                    let x = mm(column, cells.1, size.width, placement.centre_mm.1);
                    for (band, cones) in cones.iter().enumerate() {
                        weights.at_node(sensor, (band, cones), (x, y), &nodes, directions, out);
                    }
                }
                Ok(())
            },
        );
        let Ok(()) = done;
        let of = |channel: usize, band: usize| {
            found.iter().skip(channel * bands + band).step_by(channels * bands).copied().collect()
        };
        let differences = (0..channels).map(|c| (0..bands).map(|b| of(c, b)).collect()).collect();
        Self { size, cells, differences }
    }

    /// `columns` of a sensor between the nodes.
    pub(super) fn columns(&self, columns: Range<usize>) -> Columns {
        Columns::new(columns.map(|column| taps(middle(column), self.size.width, self.cells.1)))
    }

    /// Along the row `row` of the sensor at the nodes `nodes` of its columns: what `channel` and `band` have beside their weights for perpendicular light.
    pub(super) fn line(&self, of: (usize, usize), row: usize, nodes: Range<usize>, out: &mut Vec<f64>) {
        self.line_at(of, middle(row), nodes, out);
    }

    fn line_at(&self, (channel, band): (usize, usize), y: f64, nodes: Range<usize>, out: &mut Vec<f64>) {
        let (first, weights) = taps(y, self.size.height, self.cells.0);
        let columns = self.cells.1 + 1;
        let rows = &self.differences[channel][band];
        let [a, b, c, d]: [&[f64]; 4] =
            std::array::from_fn(|k| &rows[(first + k) * columns..][..columns][nodes.clone()]);
        let [e, f, g, h] = weights;
        out.clear();
        let pairs = a.iter().zip(b).zip(c.iter().zip(d));
        out.extend(pairs.map(|((a, b), (c, d))| (e * a + f * b) + (g * c + h * d)));
    }

    /// W − w of channel and band `of` at a place of the sensor in pixels from its first edges, down and right.
    pub fn difference_at(&self, of: (usize, usize), y: f64, x: f64) -> f64 {
        let mut line = Vec::new();
        self.line_at(of, y, 0..self.cells.1 + 1, &mut line);
        interpolated(&line, &taps(x, self.size.width, self.cells.1))
    }
}

/// The value between nodes of a line.
#[inline]
fn interpolated(line: &[f64], (first, weights): &(usize, [f64; 4])) -> f64 {
    let v = &line[*first..][..4];
    (weights[0] * v[0] + weights[1] * v[1]) + (weights[2] * v[2] + weights[3] * v[3])
}

/// The middle of a pixel, pixels from the first edge.
fn middle(pixel: usize) -> f64 {
    pixel as f64 + 0.5
}

/// First of the four nodes around a place, pixels from the first edge of `pixels`, and their weights.
fn taps(place: f64, pixels: usize, cells: usize) -> (usize, [f64; 4]) {
    lagrange_around(place * cells as f64 / pixels as f64, cells)
}

/// Weights of a channel's light by one of its responses.
struct ResponseWeights {
    /// Its number.
    response: usize,
    /// At the squares of the sine; one value without plates.
    values: Vec<f64>,
}

/// Weights by the square of the sine.
struct SineWeights {
    /// The largest square.
    last: f64,
    /// By channel and band: those of the responses that have a share there.
    weights: Vec<Vec<Vec<ResponseWeights>>>,
    /// The first channel with the response of each.
    alike: Vec<usize>,
}

impl SineWeights {
    fn new(
        sensor: &Sensor,
        (bands_nm, scales): (&[f64], &[f64]),
        cones: &[ConeField],
        placement: &Placement,
    ) -> Self {
        let (corners, reach_mm) = (placement.corners_mm(), placement.reach_mm());
        let sines = cones.iter().flat_map(|cones| cones.sines(corners, reach_mm, SINES));
        let sine = sines.map(|(_, sine)| sine).fold(0.0, f64::max);
        // A little more, for the places between.
        let last = (sine * sine * 1.01).clamp(1e-6, 1.0);
        let count = if sensor.plates.is_empty() { 1 } else { SINES };
        let bands = (bands_nm, scales);
        let of_channel = |channel: usize| {
            let acceptance = sensor.angle.as_ref().map(|angle| &angle.channels[channel]);
            let square = |k: usize| if count == 1 { 0.0 } else { last * k as f64 / (count - 1) as f64 };
            let nodes_nm = acceptance.map_or(&[][..], |of| &of.wavelengths_nm);
            let at = |response: usize, k: usize| {
                let share = |nm: f64| acceptance.map_or(1.0, |of| of.share(response, nm));
                sensor.electron_weights_times(channel, bands, square(k), (nodes_nm, share))
            };
            let responses = acceptance.map_or(1, |of| of.responses.len());
            let all: Vec<Vec<Vec<f64>>> =
                (0..responses).map(|of| (0..count).map(|k| at(of, k)).collect()).collect();
            let of_band = |band: usize| {
                let of = all.iter().enumerate().map(|(response, of)| ResponseWeights {
                    response,
                    values: of.iter().map(|of| of[band]).collect(),
                });
                of.filter(|of| responses == 1 || of.values.iter().any(|v| *v != 0.0)).collect()
            };
            (0..bands_nm.len()).map(of_band).collect()
        };
        Self {
            last,
            weights: (0..sensor.channels.len()).map(of_channel).collect(),
            alike: match &sensor.angle {
                Some(angle) => angle.first_alike(),
                None => vec![0; sensor.channels.len()],
            },
        }
    }

    /// First of the values around a square, and their weights.
    fn taps(&self, square: f64) -> (usize, [f64; 4]) {
        lagrange_around((square / self.last).min(1.0) * (SINES - 1) as f64, SINES - 1)
    }

    /// W − w of `band` at (x, y) mm from the axis, of each channel into `out`, channel by channel of all bands.
    fn at_node(
        &self,
        sensor: &Sensor,
        (band, cones): (usize, &ConeField),
        (x, y): (f64, f64),
        nodes: &[([f64; 2], f64)],
        directions: &mut Directions,
        out: &mut [f64],
    ) {
        let height_mm = (x * x + y * y).sqrt();
        let away = if height_mm > 0.0 { [x / height_mm, y / height_mm] } else { [1.0, 0.0] };
        let cone = cones.at([x, y], (height_mm, away));
        let bands = out.len() / self.alike.len();
        let Directions { in_frame, slopes, taps, responses } = directions;
        in_frame.clear();
        in_frame.extend(nodes.iter().map(|(at, _)| cone.direction(*at)));
        if !sensor.plates.is_empty() {
            taps.clear();
            taps.extend(in_frame.iter().map(|[l, m]| self.taps(l * l + m * m)));
        }
        if let Some(angle) = &sensor.angle {
            let shift = angle.shift((height_mm, away), &cone);
            slopes.clear();
            slopes.extend(in_frame.iter().map(|at| angle.slope_of(cone.on_film(*at), shift)));
            for (c, own) in responses.iter_mut().enumerate().filter(|(c, _)| self.alike[*c] == *c) {
                let of = &angle.channels[c].responses;
                own.resize_with(of.len(), || vec![0.0; nodes.len()]);
                of.iter().zip(own).for_each(|(response, own)| response.at_all(slopes, own));
            }
        }
        for (channel, alike) in self.alike.iter().enumerate() {
            let (responses, to) = (&responses[*alike], &mut out[channel * bands + band]);
            for (i, (_, share)) in nodes.iter().enumerate() {
                for ResponseWeights { response, values } in &self.weights[channel][band] {
                    let weight = taps.get(i).map_or(values[0], |taps| interpolated(values, taps));
                    *to += share * (responses[*response][i] * weight - values[0]);
                }
            }
        }
    }
}

/// The directions of a cone.
struct Directions {
    /// Their direction cosines in its frame.
    in_frame: Vec<[f64; 2]>,
    /// Their slopes (right, down) in the layers.
    slopes: Vec<[f64; 2]>,
    /// The weights behind plates around them; empty without plates.
    taps: Vec<(usize, [f64; 4])>,
    /// By channel and response, where no channel before is alike; 1 without responses.
    responses: Vec<Vec<Vec<f64>>>,
}

#[cfg(test)]
mod tests;
