//! The pupil function of a field as polynomials of the direction cosines, and integrals over overlaps of its pupil with itself.
//!
//! ```text
//! W(L, M), A(L, M) = Σ_{i+j≤D} c_ij T_i(u) T_j(v),    u, v in −1..1 over the extent of the bundle,    A = √(Φ/(J N))
//! ```
//! Least squares over the rays of the open pupil and on its rim; T Chebyshev polynomials. Both functions are smooth over the whole
//! pupil, whatever clips it. The rims are the cubic curves through their rays.
//! Integrals: rows across the shift, at Gauss-Legendre nodes of φ for v = v̄ + (v_max − v_min)/2 · sin φ, v_min and v_max of the
//! pupil, which removes the roots of a round pupil's chords, and φ over the extent of the overlap; where an obscuration begins and
//! ends its chords have such roots as well, and φ is divided there in the same manner. In each row Gauss-Legendre over each interval
//! of the overlap. Assumption: an interval is bounded by crossings of the rims in pairs.
//! Source: Davis & Rabinowitz, Methods of Numerical Integration, 2.7 and 5.6.

use std::f64::consts::PI;

use super::fields::{FilmBundle, FilmRay, Rim};
use crate::design::pupil::quadrature::unit_interval;
use crate::real;

/// Degree of the polynomials.
pub(super) const DEGREE: usize = 12;
/// Points of a rim between two of its rays.
const BETWEEN: usize = 8;
/// Rows that are tried for the extent of an overlap, and bisections of its ends.
const SCAN: usize = 16;
const BISECTIONS: usize = 30;

/// A pupil function as polynomials.
pub(super) struct PupilFit {
    middle: [f64; 2],
    half: [f64; 2],
    /// c_ij of W, mm, and of A, j outer.
    terms: Vec<[f64; 2]>,
    /// Rims as closed polygons of direction cosines.
    rims: Vec<Vec<[f64; 2]>>,
}

impl PupilFit {
    /// The polynomials through the rays of `bundle`.
    pub(super) fn new(bundle: &FilmBundle) -> Self {
        let all: Vec<&FilmRay> = bundle.rays.iter().chain(bundle.rims.iter().flatten().flatten()).collect();
        let extent = [0, 1].map(|i| {
            let values = all.iter().map(|r| r.cosines[i]);
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)))
        });
        let mut fit = Self {
            middle: extent.map(|(a, b)| 0.5 * (a + b)),
            half: extent.map(|(a, b)| 0.5 * (b - a)),
            terms: Vec::new(),
            rims: bundle.rims.iter().map(polygon).collect(),
        };
        let count = (DEGREE + 1) * (DEGREE + 2) / 2;
        let (mut matrix, mut right) = (vec![0.0; count * count], vec![[0.0; 2]; count]);
        let mut row = vec![0.0; count];
        for ray in all {
            fit.products(ray.cosines, |k, product| row[k] = product);
            for i in 0..count {
                right[i][0] += row[i] * ray.wavefront_mm;
                right[i][1] += row[i] * ray.amplitude;
                let part = row[i];
                for (m, v) in matrix[i * count..][..=i].iter_mut().zip(&row) {
                    *m += part * v;
                }
            }
        }
        fit.terms = solved(&mut matrix, right);
        fit
    }

    /// `each` of the number and value of T_i(u) T_j(v).
    fn products(&self, cosines: [f64; 2], mut each: impl FnMut(usize, f64)) {
        let [tu, tv] = [0, 1].map(|i| chebyshev((cosines[i] - self.middle[i]) / self.half[i]));
        let mut k = 0;
        for (j, b) in tv.iter().enumerate() {
            for a in &tu[..=DEGREE - j] {
                each(k, a * b);
                k += 1;
            }
        }
    }

    /// W, mm, and A at direction cosines.
    pub(super) fn at(&self, cosines: [f64; 2]) -> [f64; 2] {
        let mut sum = [0.0; 2];
        self.products(cosines, |k, product| {
            sum[0] += self.terms[k][0] * product;
            sum[1] += self.terms[k][1] * product;
        });
        sum
    }

    /// Nodes and weights over the points whose places `shift`/2 before and behind along `direction` are both in the pupil: their
    /// direction cosines, with about `rows` × `columns` of them.
    pub(super) fn overlap(
        &self,
        direction: [f64; 2],
        shift: f64,
        [rows, columns]: [usize; 2],
    ) -> Vec<([f64; 2], f64)> {
        let [c, s] = direction;
        let turned: Vec<Vec<[f64; 2]>> = self
            .rims
            .iter()
            .map(|rim| rim.iter().map(|[l, m]| [l * c + m * s, m * c - l * s]).collect())
            .collect();
        let mut crossings = Vec::new();
        let extents: Vec<[f64; 2]> = turned.iter().map(|rim| rows_of(rim)).collect();
        let Some(&[low, high]) = extents.first() else { return Vec::new() };
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        let Some(extent) = extent_of_rows(&turned, [low, high], shift, &mut crossings) else {
            return Vec::new();
        };
        let angle = |v: f64| real::asin(((v - middle) / half).clamp(-1.0, 1.0));
        let holes: Vec<f64> = extents[1..].iter().flatten().map(|v| angle(*v)).collect();
        let mut nodes = Vec::with_capacity(rows * columns);
        for (phi, wphi) in rows_between(extent.map(angle), &holes, rows) {
            let (sin, cos) = real::sin_cos(phi);
            let (v, wv) = (middle + half * sin, wphi * half * cos);
            for [from, to] in intervals(&turned, v, shift, &mut crossings) {
                for (y, wu) in unit_interval(columns).iter() {
                    let u = from + (to - from) * y;
                    nodes.push(([u * c - v * s, u * s + v * c], wv * wu * (to - from)));
                }
            }
        }
        nodes
    }
}

/// First and last row of a rim.
fn rows_of(rim: &[[f64; 2]]) -> [f64; 2] {
    let ends = |(low, high): (f64, f64), p: &[f64; 2]| (low.min(p[1]), high.max(p[1]));
    let (low, high) = rim.iter().fold((f64::INFINITY, f64::NEG_INFINITY), ends);
    [low, high]
}

/// Nodes of φ and weights from `first` to `last`: `rows` of them, or as many in each part between the ends of `holes`, φ = φ̄ + (φ_b −
/// φ_a)/2 · sin ψ there.
fn rows_between([first, last]: [f64; 2], holes: &[f64], rows: usize) -> Vec<(f64, f64)> {
    if holes.is_empty() {
        return unit_interval(rows)
            .iter()
            .map(|(x, w)| (first + (last - first) * x, w * (last - first)))
            .collect();
    }
    let mut ends: Vec<f64> = holes.iter().map(|phi| phi.clamp(first, last)).chain([first, last]).collect();
    ends.sort_by(f64::total_cmp);
    let part = |ends: &[f64]| {
        let (middle, half) = (0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0]));
        let node = move |(x, w): &(f64, f64)| {
            let (sin, cos) = real::sin_cos(PI * (x - 0.5));
            (middle + half * sin, PI * w * half * cos)
        };
        unit_interval(rows).iter().map(node).collect::<Vec<_>>()
    };
    ends.windows(2).filter(|ends| ends[1] > ends[0]).flat_map(part).collect()
}

/// First and last row of an overlap of a pupil with rows from `low` to `high`; none if it is empty.
fn extent_of_rows(
    rims: &[Vec<[f64; 2]>],
    [low, high]: [f64; 2],
    shift: f64,
    crossings: &mut Vec<f64>,
) -> Option<[f64; 2]> {
    let mut is_in = |v: f64| intervals(rims, v, shift, crossings).next().is_some();
    let row = |i: usize| low + (high - low) * (i as f64 + 0.5) / SCAN as f64;
    let inner = [(0..SCAN).find(|i| is_in(row(*i)))?, (0..SCAN).rfind(|i| is_in(row(*i)))?];
    let outer = [
        inner[0].checked_sub(1).map_or(low, row),
        if inner[1] + 1 < SCAN { row(inner[1] + 1) } else { high },
    ];
    Some([0, 1].map(|end| {
        let (mut inside, mut outside) = (row(inner[end]), outer[end]);
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (inside + outside);
            *(if is_in(middle) { &mut inside } else { &mut outside }) = middle;
        }
        inside
    }))
}

/// The intervals of the row `v` that are common to the pupil moved by half the shift forwards and backwards.
fn intervals<'a>(
    rims: &[Vec<[f64; 2]>],
    v: f64,
    shift: f64,
    crossings: &'a mut Vec<f64>,
) -> impl Iterator<Item = [f64; 2]> + 'a {
    crossings.clear();
    rims.iter().for_each(|rim| cross(rim, v, crossings));
    crossings.sort_by(f64::total_cmp);
    let crossings = &*crossings;
    let half = shift / 2.0;
    crossings.chunks_exact(2).flat_map(move |a| {
        let common = move |b: &[f64]| [(a[0] + half).max(b[0] - half), (a[1] + half).min(b[1] - half)];
        crossings.chunks_exact(2).map(common).filter(|[from, to]| to > from)
    })
}

/// T_0 … T_D.
fn chebyshev(u: f64) -> [f64; DEGREE + 1] {
    let mut t = [1.0; DEGREE + 1];
    t[1] = u;
    for i in 2..=DEGREE {
        t[i] = 2.0 * u * t[i - 1] - t[i - 2];
    }
    t
}

/// The places u where a closed polygon crosses the row `v`.
fn cross(polygon: &[[f64; 2]], v: f64, places: &mut Vec<f64>) {
    let mut before = polygon[polygon.len() - 1];
    for &now in polygon {
        // A vertex on the row belongs to one of its two edges.
        if (before[1] <= v) != (now[1] <= v) {
            places.push(before[0] + (v - before[1]) / (now[1] - before[1]) * (now[0] - before[0]));
        }
        before = now;
    }
}

/// Points of the cubic curves through the rays of a rim: in each interval the polynomial through the four rays around it.
fn polygon(rim: &Rim) -> Vec<[f64; 2]> {
    let mut points = Vec::new();
    for part in rim {
        for i in 0..part.len() - 1 {
            let first = i.saturating_sub(1).min(part.len() - 4);
            let near = &part[first..first + 4];
            points.extend((0..BETWEEN).map(|k| {
                let x = (i - first) as f64 + k as f64 / BETWEEN as f64;
                let weights = [
                    -(x - 1.0) * (x - 2.0) * (x - 3.0) / 6.0,
                    x * (x - 2.0) * (x - 3.0) / 2.0,
                    -x * (x - 1.0) * (x - 3.0) / 2.0,
                    x * (x - 1.0) * (x - 2.0) / 6.0,
                ];
                [0, 1].map(|axis| (0..4).map(|j| weights[j] * near[j].cosines[axis]).sum())
            }));
        }
        points.push(part[part.len() - 1].cosines);
    }
    points
}

/// The solution of the equations with a symmetric positive matrix (lower half, by rows) by Cholesky's method.
fn solved(matrix: &mut [f64], mut right: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let n = right.len();
    for i in 0..n {
        for j in 0..=i {
            let (before, row) = matrix.split_at_mut(i * n);
            let product = |other: &[f64]| -> f64 { row[..j].iter().zip(other).map(|(a, b)| a * b).sum() };
            if i == j {
                let rest = row[i] - row[..i].iter().map(|a| a * a).sum::<f64>();
                // Fewer rays than terms, or rays on a curve: the term is left out.
                row[i] = if rest > 1e-13 * row[i] { rest.sqrt() } else { f64::INFINITY };
            } else {
                row[j] = (row[j] - product(&before[j * n..][..j])) / before[j * n + j];
            }
        }
    }
    for i in 0..n {
        for j in 0..i {
            let part = matrix[i * n + j];
            right[i] = [right[i][0] - part * right[j][0], right[i][1] - part * right[j][1]];
        }
        right[i] = right[i].map(|v| v / matrix[i * n + i]);
    }
    for i in (0..n).rev() {
        for j in i + 1..n {
            let part = matrix[j * n + i];
            right[i] = [right[i][0] - part * right[j][0], right[i][1] - part * right[j][1]];
        }
        right[i] = right[i].map(|v| v / matrix[i * n + i]);
    }
    right
}
