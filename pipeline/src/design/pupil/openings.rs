//! The open part of the pupil for a field point, and its quadrature.
//!
//! ```text
//! ∫∫ f(p, q) dp dq = ∫ dθ ∫₀¹ f · ρ B(θ)² dρ        (p, q) = (c, 0) + ρ B(θ) (cos θ, sin θ)
//! ```
//! Pupil coordinates as in [`crate::design::ray`]; the pupil is symmetric about the meridian q = 0, so θ is in [0, π]. B(θ) is the rim: the unit
//! circle, or the first aperture that clips. The half circle is divided into segments at the corners between rims, so B is smooth on each
//! and quadrature converges fast: Gauss-Legendre in ρ; in θ the midpoint rule on an unclipped half circle (spectral convergence for a
//! function that is even and periodic), Gauss-Legendre on segments.
//! Assumption: the open part is star-shaped about its centre c on the meridian (true for overlapping discs).
//! *Central obscuration*: the part of the pupil that obscurations hide is a second domain of the same kind, about its own centre, whose
//! integral is subtracted (sign −1): f is smooth through the obscuration, as rays are traced there, too.
//! Source: Davis & Rabinowitz, Methods of Numerical Integration, 2.7 and 2.9.

use crate::real;
use std::f64::consts::PI;

use super::quadrature::{oscillating, rounded, unit_interval};
use crate::design::prescription::error::DesignError;
use crate::design::rays::aim::LastAim;
use crate::design::rays::ray::Tracer;

/// Overshoot at pupil coordinates (p, q), and its surface; negative inside.
pub(super) type Overshoot<'a> = dyn Fn(f64, f64) -> (f64, usize) + 'a;

/// Where the light of a field point passes its pupil.
#[derive(Clone, Copy)]
pub(super) struct Openings<'a> {
    /// Maximum overshoot of the apertures, if there are any.
    pub(super) over: Option<&'a Overshoot<'a>>,
    /// Overshoot of the part that central obscurations hide, if there are any.
    pub(super) hidden: Option<&'a Overshoot<'a>>,
}

/// Calls `with` with the openings of the field point at `tan`, determined by rays.
pub(super) fn with_openings<T>(tracer: &Tracer<'_>, tan: f64, with: impl FnOnce(Openings<'_>) -> T) -> T {
    let last = LastAim::default();
    let over = |p: f64, q: f64| tracer.overshoot(&last, tan, p, q);
    let hidden = |p: f64, q: f64| tracer.overshoot_of_hidden(&last, tan, p, q);
    with(Openings {
        over: tracer.has_apertures().then_some(&over),
        hidden: tracer.has_obscurations().then_some(&hidden),
    })
}

/// An interval of θ with one rim.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// First angle, rad.
    pub from: f64,
    /// Last angle, rad.
    pub to: f64,
    /// The surface whose aperture is the rim; `None` = the unit circle.
    pub limit: Option<usize>,
    /// Centre of its domain, along the meridian.
    pub centre: f64,
    /// Centre of its domain across the meridian: 0 where the pupil is symmetric about it.
    pub across: f64,
    /// 1, or −1 for a part that an obscuration hides.
    pub sign: f64,
}

impl Segment {
    /// The upper half of the unit circle.
    pub(super) const OPEN: Self =
        Self { from: 0.0, to: PI, limit: None, centre: 0.0, across: 0.0, sign: 1.0 };
    /// The whole unit circle.
    pub(in crate::design) const WHOLE: Self = Self { from: -PI, ..Self::OPEN };

    fn is_open(&self) -> bool {
        *self == Self::OPEN || *self == Self::WHOLE
    }

    /// Angles with their weights for an integrand whose phase changes by at most `change` per radian.
    pub(in crate::design) fn angles(&self, change: f64) -> Vec<(f64, f64)> {
        if self.is_open() {
            // The midpoint rule converges from one angle per period on; the additional ones reduce the error from O(1) to 1e-8.
            return self.midpoints(rounded((change / 2.0 + 2.0 * real::cbrt(change)) as usize + 10));
        }
        let span = self.to - self.from;
        oscillating(change * span).iter().map(|(t, w)| (self.from + span * t, span * w)).collect()
    }

    /// The midpoint rule of `spokes` angles on the half circle.
    fn midpoints(&self, spokes: usize) -> Vec<(f64, f64)> {
        let step = PI / spokes as f64;
        let count = if *self == Self::WHOLE { 2 * spokes } else { spokes };
        (0..count).map(|i| (self.from + (i as f64 + 0.5) * step, step)).collect()
    }

    /// B(θ) of a pupil that is symmetric about the meridian at ascending angles, to 1e-9.
    pub(super) fn radii(&self, openings: Openings<'_>, angles: impl Iterator<Item = f64>) -> Vec<f64> {
        let over = if self.sign > 0.0 { openings.over } else { openings.hidden };
        let Some(over) = over.filter(|_| !self.is_open()) else { return angles.map(|_| 1.0).collect() };
        let domain = Domain { over, centre: self.centre };
        let mut near = None;
        angles
            .map(|theta| {
                let r = match (self.limit, near) {
                    (Some(_), Some(near)) => domain.clipped_rim(theta, near, RIM).0,
                    _ => domain.rim(theta, near, RIM).0,
                };
                near = Some(r);
                r
            })
            .collect()
    }
}

/// The open part of the pupil: its upper half where it is symmetric about the meridian, else the whole
/// ([`crate::design::skew::opening`]).
#[derive(Clone, Debug, PartialEq)]
pub struct Pupil {
    /// Segments of θ from 0 or −π to π: of the part within the apertures, then of that behind obscurations.
    pub segments: Vec<Segment>,
}

/// A domain of the pupil: the points where `over` is not positive.
struct Domain<'a> {
    over: &'a Overshoot<'a>,
    centre: f64,
}

/// A sample of the pupil.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PupilNode {
    /// Pupil coordinate along the meridian.
    pub p: f64,
    /// Pupil coordinate across it.
    pub q: f64,
    /// Quadrature weight, in dp dq; negative in a part that an obscuration hides.
    pub weight: f64,
}

/// Number of angles at which the rim is determined.
const SCAN: usize = 49;
/// Minimum open area of the pupil, of π/2.
const MIN_AREA: f64 = 1e-6;
/// Maximum of corners between two of these angles: more are numerical noise where two apertures coincide.
const MAX_CORNERS: usize = 4;
/// Bisections of the angle of a corner between two rims.
const CORNER_STEPS: usize = 14;
/// Accuracy of a rim, in its overshoot and in pupil coordinates: in general, and to find only the surface that limits it.
const RIM: f64 = 1e-9;
const RIM_IN_SCAN: f64 = 1e-4;

impl Pupil {
    /// The open pupil of the field point at tan(field angle) `tan`.
    ///
    /// # Errors
    /// [`DesignError::Ray`] if all rays are blocked.
    pub fn new(tracer: &Tracer<'_>, tan: f64) -> Result<Self, DesignError> {
        with_openings(tracer, tan, Self::within).ok_or_else(|| {
            tracer.ray_error(tan, 0.0, 0.0, "and all others are blocked by apertures".to_owned())
        })
    }

    /// The open pupil within `openings`; none if all is blocked.
    pub(super) fn within(openings: Openings<'_>) -> Option<Self> {
        let mut pupil = Self { segments: vec![Segment::OPEN] };
        if let Some(over) = openings.over {
            let is_open = scan().iter().all(|a| over(real::cos(*a), real::sin(*a)).0 <= RIM);
            if !(is_open && over(0.0, 0.0).0 <= 0.0) {
                pupil.segments = Domain { over, centre: find_centre(over)? }.segments(1.0);
            }
        }
        if let Some(over) = openings.hidden {
            if let Some(centre) = find_centre(over) {
                pupil.segments.extend(Domain { over, centre }.segments(-1.0));
            }
            let area: f64 = pupil.nodes_within(openings, 4, 8).iter().map(|n| n.weight).sum();
            if area <= MIN_AREA {
                return None;
            }
        }
        Some(pupil)
    }

    /// Whether the same surfaces limit it in the same order.
    pub fn has_rims_of(&self, other: &Self) -> bool {
        let limits =
            |pupil: &Self| pupil.segments.iter().map(|s| (s.limit, s.sign > 0.0)).collect::<Vec<_>>();
        limits(self) == limits(other)
    }

    /// Quadrature nodes: `rings` in ρ, about `spokes` in θ over the half circle.
    pub fn nodes(&self, tracer: &Tracer<'_>, tan: f64, rings: usize, spokes: usize) -> Vec<PupilNode> {
        with_openings(tracer, tan, |openings| self.nodes_within(openings, rings, spokes))
    }

    fn nodes_within(&self, openings: Openings<'_>, rings: usize, spokes: usize) -> Vec<PupilNode> {
        let radial = unit_interval(rings);
        let mut nodes = Vec::with_capacity(rings * (spokes + 8));
        for segment in &self.segments {
            let angles = self.angles(segment, spokes);
            let rims = segment.radii(openings, angles.iter().map(|a| a.0));
            for ((theta, wt), b) in angles.into_iter().zip(rims) {
                let (s, c) = real::sin_cos(theta);
                nodes.extend(radial.iter().map(|(rho, wr)| PupilNode {
                    p: segment.centre + rho * b * c,
                    q: rho * b * s,
                    weight: segment.sign * wt * wr * rho * b * b,
                }));
            }
        }
        nodes
    }

    /// Angles of a segment with their weights; `spokes` is the number on the half circle.
    pub fn angles(&self, segment: &Segment, spokes: usize) -> Vec<(f64, f64)> {
        if segment.is_open() {
            return segment.midpoints(spokes);
        }
        let span = segment.to - segment.from;
        // Gauss-Legendre needs π/2 times the midpoint rule's density.
        let n = rounded((spokes as f64 * span / PI * 1.6).ceil() as usize + 6);
        unit_interval(n).iter().map(|(t, w)| (segment.from + span * t, span * w)).collect()
    }
}

fn scan() -> Vec<f64> {
    (0..SCAN).map(|i| PI * i as f64 / (SCAN - 1) as f64).collect()
}

/// Middle of the part of the meridian where `over` is not positive, to [`RIM`]: a smooth function of the field angle.
fn find_centre(over: &Overshoot<'_>) -> Option<f64> {
    // Towards `side` = ±1.
    let edge = |side: f64, open: f64, closed: (f64, f64)| {
        let along = |p: f64| over(side * p, 0.0);
        side * zero(
            &along,
            (side * open, side * closed.0),
            0.5 * side * (open + closed.0),
            Some((side * closed.0, closed.1)),
            RIM,
        )
        .0
    };
    let open = |steps: i32| {
        let at: Vec<(f64, f64)> = (0..=steps)
            .map(|i| 2.0 * f64::from(i) / f64::from(steps) - 1.0)
            .map(|p| (p, over(p, 0.0).0))
            .collect();
        let first = at.iter().position(|(_, over)| *over <= RIM)?;
        let last = at.iter().rposition(|(_, over)| *over <= RIM)?;
        let from = if first == 0 { -1.0 } else { edge(-1.0, at[first].0, at[first - 1]) };
        let to = at.get(last + 1).map_or(1.0, |closed| edge(1.0, at[last].0, *closed));
        Some(0.5 * (from + to))
    };
    // Finer if the open part is narrow.
    [16, 128, 1024].into_iter().find_map(open)
}

/// Where the overshoot `over` becomes 0 between `low`, where it is not positive, and `high`, and the surface that limits it there: the secant
/// method within the bracket, to `tolerance` in either. It begins at `r`, and with `other`, a place with its overshoot; if not given, from a growth
/// about as r²/B² − 1.
pub(in crate::design) fn zero(
    over: &dyn Fn(f64) -> (f64, usize),
    (mut low, mut high): (f64, f64),
    mut r: f64,
    mut other: Option<(f64, f64)>,
    tolerance: f64,
) -> (f64, usize) {
    let mut poor = 0;
    let mut surface = 0;
    for _ in 0..100 {
        let width = high - low;
        let f = over(r);
        if f.0 > 0.0 {
            high = r
        } else {
            low = r
        }
        surface = f.1;
        if f.0.abs() < tolerance || high - low < tolerance {
            break;
        }
        poor = if high - low > 0.5 * width { poor + 1 } else { 0 };
        let next = match other {
            None => r / (1.0 + f.0).max(1e-4).sqrt(),
            Some((at, value)) => r - f.0 * (r - at) / (f.0 - value),
        };
        other = Some((r, f.0));
        let inside = next > low && next < high;
        // Rays that end inside the lens have a constant overshoot, which stops the secant method.
        r = if inside && poor < 4 { next } else { 0.5 * (low + high) };
        if poor >= 4 {
            poor = 0;
        }
    }
    (r.clamp(low, high), surface)
}

impl Domain<'_> {
    /// The segments between the corners of the rim.
    fn segments(&self, sign: f64) -> Vec<Segment> {
        let angles = scan();
        let mut segments = Vec::new();
        let mut near = None;
        let rims: Vec<(f64, Option<usize>)> = angles
            .iter()
            .map(|a| {
                let rim = self.rim(*a, near, RIM_IN_SCAN);
                near = Some(rim.0);
                rim
            })
            .collect();
        let mut from = 0.0;
        let mut close = |to: f64, limit: Option<usize>| {
            // Of a surface that limits the rim at π alone there is nothing.
            if to > from {
                segments.push(Segment { from, to, limit, centre: self.centre, across: 0.0, sign });
            }
            from = to;
        };
        for i in 1..SCAN {
            let (mut a, mut limit) = (angles[i - 1], rims[i - 1].1);
            let mut near = rims[i].0;
            // Other surfaces may limit the rim in between.
            for _ in 0..MAX_CORNERS {
                if limit == rims[i].1 {
                    break;
                }
                let (mut b, mut next) = (angles[i], rims[i].1);
                // To 4e-6 rad: the error of an integral is of second order in that of a corner.
                for _ in 0..CORNER_STEPS {
                    let mid = 0.5 * (a + b);
                    let rim = self.rim(mid, Some(near), RIM);
                    near = rim.0;
                    if rim.1 == limit { a = mid } else { (b, next) = (mid, rim.1) }
                }
                close(b, limit);
                (a, limit) = (b, next);
            }
            if limit != rims[i].1 {
                close(angles[i], limit);
            }
        }
        close(PI, rims[SCAN - 1].1);
        segments
    }

    /// Radius of the unit circle about the centre.
    fn unit_circle(&self, theta: f64) -> f64 {
        let along = self.centre * real::cos(theta);
        -along + (along * along + 1.0 - self.centre * self.centre).max(0.0).sqrt()
    }

    /// B(θ) and the surface that limits it, none for the unit circle. `near` is the rim at a neighbouring angle.
    fn rim(&self, theta: f64, near: Option<f64>, tolerance: f64) -> (f64, Option<usize>) {
        let (s, c) = real::sin_cos(theta);
        let edge = self.unit_circle(theta);
        let outer = (self.over)(self.centre + edge * c, edge * s);
        // An aperture that touches the unit circle is not a rim of its own.
        if outer.0 <= RIM {
            return (edge, None);
        }
        let near = near.filter(|r| *r > 0.0 && *r < edge).unwrap_or(edge / (1.0 + outer.0).sqrt());
        let (r, surface) = self.clipped_rim(theta, near, tolerance);
        (r, Some(surface))
    }

    /// B(θ) where a surface limits it, and that surface, from `near`.
    fn clipped_rim(&self, theta: f64, near: f64, tolerance: f64) -> (f64, usize) {
        let (s, c) = real::sin_cos(theta);
        let along = |r: f64| (self.over)(self.centre + r * c, r * s);
        let edge = self.unit_circle(theta);
        zero(&along, (0.0, edge), near.min(edge), None, tolerance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rim_that_ends_at_the_meridian_has_no_segment() {
        // Surface 2 limits next to π alone, nearer than corners are found.
        for width in [1e-7, 1e-2] {
            let over = |p: f64, q: f64| (p * p + q * q - 0.81, if p < 0.0 && q < width { 2 } else { 1 });
            let pupil = Pupil::within(Openings { over: Some(&over), hidden: None }).unwrap();
            let found: Vec<(Option<usize>, f64)> = pupil.segments.iter().map(|s| (s.limit, s.to)).collect();
            match width < 1e-6 {
                true => assert_eq!(found, [(Some(1), PI)]),
                false => assert!(found.len() == 2 && found[1] == (Some(2), PI), "{found:?}"),
            }
            assert!(pupil.segments.iter().all(|s| s.from < s.to));
        }
    }
}
