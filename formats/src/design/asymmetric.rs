//! The true surfaces of a design without rotational symmetry, from its coordinate breaks or from the places that a file gives.
//!
//! ```text
//! break before the surface → frame of the surface → break behind it → thickness along z → next surface
//! light along z (s = 1) or against it (−1):   s' = s·sgn(z'·z) from one frame to the next,   s' = −s behind a mirror
//! ```
//! The lens frame is that of surface 1 before its own break. Gaps of the straightened lens are the file's, and the decentres along z of
//! its breaks; between places the difference along z, or their distance where one of both is tilted.

use super::draft::DraftSurface;
use super::straight_axis::OffAxis;
use pipeline::design::prescription::asymmetry::{FreeSurface, Outline};
use pipeline::design::prescription::freeform::SkewShape;
use pipeline::design::prescription::pose::Pose;
use pipeline::design::shape::Shape;
use std::f64::consts::FRAC_PI_2;

/// How notes name an aperture that a symmetric lens cannot have.
pub(super) const CIRCLE_INSIDE: &str = "an aperture that is not a circle is replaced by the circle inside it";

/// Cosine of a tilt that counts as none.
const STRAIGHT: f64 = 1.0 - 1e-15;

/// Where a surface is.
pub(super) struct Place {
    pub(super) pose: Pose,
    /// Whether the light arrives against the z of its frame.
    pub(super) is_reversed: bool,
    /// Distance to the next surface in the straightened lens, along the light, mm.
    pub(super) gap_mm: f64,
}

/// What makes the design asymmetric, if anything: the first surface, in words. `straight`: whether its surfaces are on one axis.
pub(super) fn reason(surfaces: &[DraftSurface], straight: Result<(), OffAxis>) -> Option<String> {
    let image = surfaces.len() - 1;
    let shape = |(i, s): (usize, &DraftSurface)| {
        let free = s.free.as_ref().filter(|_| i > 0 && i < image).map(|f| format!("is {}", f.what));
        let is_decentred = |o: &Outline| i > 0 && i < image && o.centre_mm != [0.0; 2];
        let has = [s.outline, s.hidden].iter().flatten().any(is_decentred);
        free.or_else(|| has.then(|| "has a decentred aperture".to_owned())).map(|what| (i, what))
    };
    let first = surfaces.iter().enumerate().find_map(shape);
    let tilted = straight.err().map(|e| (e.surface, "is tilted or decentred".to_owned()));
    let (i, what) = [tilted, first].into_iter().flatten().min_by_key(|(i, _)| *i)?;
    Some(format!("surface {i} {what}"))
}

/// The places of the surfaces behind the object.
pub(super) fn places(surfaces: &[DraftSurface]) -> Vec<Place> {
    let mut places = Vec::<Place>::with_capacity(surfaces.len());
    let (mut frame, mut light) = (Pose::IDENTITY, 1.0);
    // The frame that `light` is given in, and the place of the surface before if the file gives it.
    let mut of_light = Pose::IDENTITY;
    for (i, surface) in surfaces.iter().enumerate().skip(1) {
        if let Some(place) = surface.place {
            if let Some(before) = places.last_mut() {
                before.gap_mm = distance(&before.pose, &place, light);
            }
            frame = place;
        }
        if let Some(b) = &surface.coordinate_break {
            if let Some(before) = places.last_mut() {
                before.gap_mm += light * b.decentre_mm[2];
            }
            frame = frame.compose(&b.pose());
        }
        light = seen_from(light, &of_light, &frame);
        let pose = frame;
        let is_reversed = light < 0.0;
        of_light = frame;
        if surface.is_mirror {
            light = -light;
        }
        let mut gap_mm = 0.0;
        if let Some(b) = &surface.break_behind {
            gap_mm += light * b.decentre_mm[2];
            frame = frame.compose(&b.pose());
            light = seen_from(light, &of_light, &frame);
            of_light = frame;
        }
        if i + 1 < surfaces.len() {
            gap_mm += light * surface.thickness_mm;
            frame = frame.compose(&Pose::at([0.0, 0.0, surface.thickness_mm]));
        }
        places.push(Place { pose, is_reversed, gap_mm });
    }
    places
}

/// Direction of the light along z of frame `to`, from that along z of frame `from`.
fn seen_from(light: f64, from: &Pose, to: &Pose) -> f64 {
    if cosine(from, to) < 0.0 { -light } else { light }
}

/// Cosine of the angle between the z axes of two frames.
fn cosine(a: &Pose, b: &Pose) -> f64 {
    (0..3).map(|i| a.rotation[i][2] * b.rotation[i][2]).sum()
}

/// Gap of the straightened lens from `a` to `b`, mm; `light`: its direction along z of `a`.
fn distance(a: &Pose, b: &Pose, light: f64) -> f64 {
    let local = a.inverse().point(b.origin_mm);
    let is_straight = |p: &Pose| cosine(&Pose::IDENTITY, p).abs() >= STRAIGHT;
    if is_straight(a) && is_straight(b) {
        return light * local[2];
    }
    let length = local.iter().map(|v| v * v).sum::<f64>().sqrt();
    if light * local[2] < 0.0 { -length } else { length }
}

/// The true surface of a draft at `place`; `fixed_mm`: the semi-diameter that clips light where it has no aperture.
pub(super) fn free_surface(
    draft: &DraftSurface,
    place: &Place,
    (is_image, is_frame): (bool, bool),
    fixed_mm: Option<f64>,
) -> FreeSurface {
    let shape = match (&draft.free, is_image) {
        (_, true) => SkewShape::from(Shape::default()),
        (Some(free), false) => free.shape.clone(),
        (None, false) => SkewShape::from(draft.shape.clone()),
    };
    let is_rotated = !is_image && draft.free.as_ref().is_some_and(|f| f.is_rotated);
    let disc = |radius: Option<f64>| radius.filter(|r| *r > 0.0 && r.is_finite()).map(Outline::disc);
    let outlines = [
        draft.outline.or_else(|| disc(draft.clear_mm)).or_else(|| disc(fixed_mm)),
        draft.hidden.or_else(|| disc(draft.obscuration_mm)),
    ];
    let [aperture, obscuration] = outlines.map(|o| {
        o.filter(|_| !is_image && !is_frame).map(|o| if is_rotated { rotated_by_a_quarter(&o) } else { o })
    });
    let quarter = Pose::new([0.0; 3], [0.0, 0.0, FRAC_PI_2]);
    FreeSurface {
        pose: if is_rotated { place.pose.compose(&quarter) } else { place.pose },
        is_reversed: place.is_reversed,
        shape: if place.is_reversed { shape.reversed() } else { shape },
        is_frame,
        aperture,
        obscuration,
    }
}

/// The outline in a frame rotated by a quarter about z: x' = y, y' = −x.
fn rotated_by_a_quarter(o: &Outline) -> Outline {
    let ([a, b], [x, y]) = (o.half_mm, o.centre_mm);
    Outline { half_mm: [b, a], centre_mm: [y, -x], ..*o }
}
