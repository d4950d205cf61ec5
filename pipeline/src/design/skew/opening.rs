//! The open part of the pupil of a field of a built lens, over the full circle, and its quadrature.
//!
//! ```text
//! ∫∫ f(p, q) dp dq = ∫ dθ ∫₀¹ f · ρ B(θ)² dρ        (p, q) = c + ρ B(θ) (cos θ, sin θ),   θ in (−π, π]
//! ```
//! c is the centroid of the open points of a scan of the unit disc, the origin where nothing is clipped. B(θ) is the rim: the
//! unit circle, or the first aperture that clips; the circle is divided into segments at the corners between rims, and at θ = π.
//! Quadrature: Gauss-Legendre in ρ; in θ the midpoint rule on a circle without corners, Gauss-Legendre on segments. The part that
//! obscurations hide is a second domain about its own centre, with the sign −1. Assumption: both are star-shaped about their
//! centres. As [`crate::design::pupil`], whose pupils are symmetric about the meridian.
//! Source: Davis & Rabinowitz, Methods of Numerical Integration, 2.7 and 2.9.

use std::f64::consts::{PI, TAU};

use super::trace::SkewTracer;
use crate::design::prescription::error::DesignError;
use crate::design::pupil::PupilNode;
use crate::design::pupil::openings::zero;
use crate::design::pupil::quadrature::unit_interval;
use crate::design::rays::aim::lagrange;
use crate::real;

/// Angles at which the rim is determined.
const ANGLES: usize = 96;
/// Points of a side of the scan for the centre; finer if no point is open. Any centre from which all of the domain is seen has the same
/// integrals.
const SCANS: [usize; 4] = [9, 17, 65, 257];
/// Minimum open area of the pupil, of π.
const MIN_AREA: f64 = 1e-6;
/// Maximum of corners between two angles: more are numerical noise where two apertures coincide.
const MAX_CORNERS: usize = 4;
/// Bisections of the angle of a corner between two rims: to 3e-5 rad; the error of an integral is of second order in it.
const CORNER_STEPS: usize = 11;
/// Accuracy of a rim, in its overshoot and in pupil coordinates: in general, and to find only the surface that limits it, between two angles of
/// the scan and at a corner.
const RIM: f64 = 1e-9;
const RIM_IN_SCAN: f64 = 1e-4;
const RIM_AT_CORNER: f64 = 1e-6;
/// Rims before one that it is extrapolated from.
const FOLLOWED: usize = 3;

/// An interval of θ with one rim.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpenSegment {
    /// First angle, rad.
    pub from: f64,
    /// Last angle, rad.
    pub to: f64,
    /// The surface whose aperture is the rim, counted on from the number of surfaces for an obscuration; `None` = the unit
    /// circle.
    pub limit: Option<usize>,
    /// Centre of its domain.
    pub centre: [f64; 2],
    /// 1, or −1 for a part that an obscuration hides.
    pub sign: f64,
}

/// The open part of a pupil: of the part within the apertures, then of that behind obscurations.
#[derive(Clone, Debug, PartialEq)]
pub struct Opening {
    /// Segments from −π to π, of each domain.
    pub segments: Vec<OpenSegment>,
}

impl OpenSegment {
    /// The unit circle.
    pub const OPEN: Self = Self { from: -PI, to: PI, limit: None, centre: [0.0; 2], sign: 1.0 };

    /// Whether it is the whole circle: functions on it are periodic.
    pub fn is_whole(&self) -> bool {
        self.from == -PI && self.to == PI
    }

    /// B(θ) at ascending angles, to 1e-9.
    pub fn radii(&self, tracer: &SkewTracer<'_>, t: [f64; 2], angles: &[f64]) -> Vec<f64> {
        if *self == Self::OPEN {
            return vec![1.0; angles.len()];
        }
        let domain = Domain { tracer, t, is_hidden: self.sign < 0.0, centre: self.centre };
        let mut followed = Followed::default();
        let radius = |theta: &f64| match self.limit {
            None => domain.rim(*theta, None, RIM).0,
            Some(_) => domain.followed_rim(*theta, &mut followed, RIM).0,
        };
        angles.iter().map(radius).collect()
    }
}

impl Opening {
    /// The open pupil of the field of slopes `t`.
    ///
    /// # Errors
    /// [`DesignError::Ray`] if all rays are blocked.
    pub fn new(tracer: &SkewTracer<'_>, t: [f64; 2]) -> Result<Self, DesignError> {
        let blocked = || tracer.ray_error(t, 0.0, 0.0, "and all others are blocked by apertures");
        let mut opening = Self { segments: vec![OpenSegment::OPEN] };
        if tracer.has_apertures() {
            let domain = Domain { tracer, t, is_hidden: false, centre: [0.0; 2] };
            let on_rim = |i: usize| real::sin_cos(TAU * i as f64 / ANGLES as f64);
            let is_open = (0..ANGLES).all(|i| domain.over(on_rim(i).1, on_rim(i).0).0 <= RIM)
                && domain.over(0.0, 0.0).0 <= 0.0;
            if !is_open {
                opening.segments = domain.centred().ok_or_else(blocked)?.segments();
            }
        }
        if tracer.has_obscurations() {
            let domain = Domain { tracer, t, is_hidden: true, centre: [0.0; 2] };
            opening.segments.extend(domain.centred().iter().flat_map(Domain::segments));
            let area: f64 = opening.nodes(tracer, t, 4, 16).iter().map(|n| n.weight).sum();
            if area <= MIN_AREA * PI {
                return Err(blocked());
            }
        }
        Ok(opening)
    }

    /// Whether no aperture clips it.
    pub fn is_open(&self) -> bool {
        self.segments == [OpenSegment::OPEN]
    }

    /// The surfaces that limit it, ascending, each once.
    pub fn limits(&self) -> Vec<usize> {
        let mut limits: Vec<usize> = self.segments.iter().filter_map(|s| s.limit).collect();
        limits.sort_unstable();
        limits.dedup();
        limits
    }

    /// Quadrature nodes: `rings` in ρ, about `spokes` in θ over the full circle.
    pub fn nodes(&self, tracer: &SkewTracer<'_>, t: [f64; 2], rings: usize, spokes: usize) -> Vec<PupilNode> {
        let radial = unit_interval(rings);
        let mut nodes = Vec::with_capacity(rings * (spokes + 8));
        for segment in &self.segments {
            let angles = segment_angles(segment, spokes);
            let rims = segment.radii(tracer, t, &angles.iter().map(|a| a.0).collect::<Vec<_>>());
            for ((theta, wt), b) in angles.into_iter().zip(rims) {
                let (s, c) = real::sin_cos(theta);
                nodes.extend(radial.iter().map(|(rho, wr)| PupilNode {
                    p: segment.centre[0] + rho * b * c,
                    q: segment.centre[1] + rho * b * s,
                    weight: segment.sign * wt * wr * rho * b * b,
                }));
            }
        }
        nodes
    }
}

/// Angles of a segment with their weights.
fn segment_angles(segment: &OpenSegment, spokes: usize) -> Vec<(f64, f64)> {
    let span = segment.to - segment.from;
    if segment.is_whole() {
        // A rim that is no circle about its centre needs more.
        let n = if segment.limit.is_none() { spokes } else { 2 * spokes };
        let step = span / n as f64;
        return (0..n).map(|i| (segment.from + (i as f64 + 0.5) * step, step)).collect();
    }
    // Gauss-Legendre needs π/2 times the midpoint rule's density.
    let n = ((spokes as f64 * span / TAU * 1.6).ceil() as usize + 4).next_multiple_of(2);
    unit_interval(n).iter().map(|(x, w)| (segment.from + span * x, span * w)).collect()
}

/// Rims at the angles before, where a surface limits them.
#[derive(Default)]
struct Followed {
    /// Angle and radius.
    rims: Vec<(f64, f64)>,
    /// Change of the overshoot with the radius at the last one.
    slope: Option<f64>,
}

impl Followed {
    /// The rim at `theta` as the polynomial through those before.
    fn next(&self, theta: f64) -> Option<f64> {
        let first = self.rims.len().saturating_sub(FOLLOWED);
        (!self.rims.is_empty()).then(|| lagrange(&self.rims[first..], theta))
    }
}

/// A domain of the pupil: the points where the overshoot is not positive.
#[derive(Clone, Copy)]
struct Domain<'a> {
    tracer: &'a SkewTracer<'a>,
    t: [f64; 2],
    is_hidden: bool,
    centre: [f64; 2],
}

impl Domain<'_> {
    fn over(&self, p: f64, q: f64) -> (f64, usize) {
        match self.is_hidden {
            true => self.tracer.overshoot_of_hidden(self.t, p, q),
            false => self.tracer.overshoot(self.t, p, q),
        }
    }

    /// This domain about the centroid of its points on a grid; none if it is empty.
    fn centred(&self) -> Option<Self> {
        let centroid = |side: usize| {
            let at = |i: usize| 2.0 * i as f64 / (side - 1) as f64 - 1.0;
            let (mut sum, mut count) = ([0.0; 2], 0.0);
            for (p, q) in (0..side * side).map(|k| (at(k % side), at(k / side))) {
                if p * p + q * q <= 1.0 && self.over(p, q).0 <= 0.0 {
                    sum = [sum[0] + p, sum[1] + q];
                    count += 1.0;
                }
            }
            (count > 0.0).then(|| sum.map(|v| v / count))
        };
        SCANS.into_iter().find_map(centroid).map(|centre| Self { centre, ..*self })
    }

    /// The segments between the corners of the rim.
    fn segments(&self) -> Vec<OpenSegment> {
        let angle = |i: usize| TAU * i as f64 / ANGLES as f64 - PI;
        let mut followed = Followed::default();
        let rims: Vec<(f64, Option<usize>)> = (0..=ANGLES)
            .map(|i| {
                if followed.rims.is_empty() {
                    let rim = self.rim(angle(i), None, RIM_IN_SCAN);
                    followed.rims.extend(rim.1.map(|_| (angle(i), rim.0)));
                    return rim;
                }
                let (r, surface) = self.followed_rim(angle(i), &mut followed, RIM_IN_SCAN);
                if r < self.unit_circle(angle(i)) * (1.0 - RIM_IN_SCAN) {
                    return (r, Some(surface));
                }
                followed = Followed::default();
                self.rim(angle(i), None, RIM_IN_SCAN)
            })
            .collect();
        let (mut segments, mut from) = (Vec::new(), -PI);
        let sign = if self.is_hidden { -1.0 } else { 1.0 };
        let mut close = |to: f64, limit: Option<usize>| {
            if to > from {
                segments.push(OpenSegment { from, to, limit, centre: self.centre, sign });
            }
            from = to;
        };
        for i in 1..=ANGLES {
            let (mut a, mut limit) = (angle(i - 1), rims[i - 1].1);
            let mut near = rims[i].0;
            // Other surfaces may limit the rim in between.
            for _ in 0..MAX_CORNERS {
                if limit == rims[i].1 {
                    break;
                }
                let (mut b, mut next) = (angle(i), rims[i].1);
                for _ in 0..CORNER_STEPS {
                    let mid = 0.5 * (a + b);
                    let rim = self.rim(mid, Some(near), RIM_AT_CORNER);
                    near = rim.0;
                    if rim.1 == limit { a = mid } else { (b, next) = (mid, rim.1) }
                }
                close(b, limit);
                (a, limit) = (b, next);
            }
            if limit != rims[i].1 {
                close(angle(i), limit);
            }
        }
        close(PI, rims[ANGLES].1);
        segments
    }

    /// Radius of the unit circle about the centre.
    fn unit_circle(&self, theta: f64) -> f64 {
        let [p, q] = self.centre;
        let (s, c) = real::sin_cos(theta);
        let along = p * c + q * s;
        -along + (along * along + 1.0 - p * p - q * q).max(0.0).sqrt()
    }

    /// B(θ) and the surface that limits it, none for the unit circle. `near` is the rim at a neighbouring angle.
    fn rim(&self, theta: f64, near: Option<f64>, tolerance: f64) -> (f64, Option<usize>) {
        let (s, c) = real::sin_cos(theta);
        let edge = self.unit_circle(theta);
        let outer = self.over(self.centre[0] + edge * c, self.centre[1] + edge * s);
        // An aperture that touches the unit circle is not a rim of its own.
        if outer.0 <= RIM {
            return (edge, None);
        }
        let near = near.filter(|r| *r > 0.0 && *r < edge).unwrap_or(edge / (1.0 + outer.0).sqrt());
        let (r, surface) = self.clipped_rim(theta, near, tolerance);
        (r, Some(surface))
    }

    /// [`Domain::clipped_rim`] from those of the angles before: by two steps of the secant method where they are good enough.
    fn followed_rim(&self, theta: f64, followed: &mut Followed, tolerance: f64) -> (f64, usize) {
        let (s, c) = real::sin_cos(theta);
        let along = |r: f64| self.over(self.centre[0] + r * c, self.centre[1] + r * s);
        let edge = self.unit_circle(theta);
        let inside = |r: f64| r > 0.0 && r < edge;
        let guess = followed.next(theta).filter(|r| inside(*r)).unwrap_or(edge / 2.0_f64.sqrt());
        let (over, surface) = along(guess);
        // About as r²/B² − 1.
        let slope = followed.slope.unwrap_or(2.0 * (1.0 + over) / guess);
        let step = -over / slope;
        let secant = |next: f64| {
            let (over_next, limit) = along(next);
            let slope = (over_next - over) / step;
            let last = -over_next / slope;
            // The error of the secant method is about the product of the two steps before.
            let is_found = limit == surface && slope > 0.0 && (step * last).abs() < tolerance;
            Some((next + last, slope)).filter(|(r, _)| is_found && inside(*r))
        };
        let found = match over.abs() < tolerance {
            true => Some((guess, slope)),
            false => Some(guess + step).filter(|next| inside(*next)).and_then(secant),
        };
        let (rim, slope) = match found {
            Some((r, slope)) => ((r, surface), Some(slope)),
            None => (zero(&along, (0.0, edge), guess, None, tolerance), None),
        };
        followed.slope = slope;
        followed.rims.push((theta, rim.0));
        rim
    }

    /// B(θ) where a surface limits it, and that surface, from `near`.
    fn clipped_rim(&self, theta: f64, near: f64, tolerance: f64) -> (f64, usize) {
        let (s, c) = real::sin_cos(theta);
        let along = |r: f64| self.over(self.centre[0] + r * c, self.centre[1] + r * s);
        let edge = self.unit_circle(theta);
        zero(&along, (0.0, edge), near.min(edge), None, tolerance)
    }
}
