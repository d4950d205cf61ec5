//! Coordinate breaks that leave all powered surfaces on one axis: returned tilts and decentres, and fold mirrors.
//!
//! A break changes the coordinates of a surface and of all behind it, or of these alone, before the thickness of its surface:
//!
//! ```text
//! order 0:      v' = (Rx Ry Rz)ᵀ (v − δ)      δ = decentre, tilts about x, y and z, right-handed
//! else:         v' = (Rz Ry Rx)ᵀ v − δ
//! ```
//! The ray that starts along the axis is followed through the local coordinates of every surface. A plane mirror may be met at any angle: it
//! folds the axis, which changes nothing for a rotationally symmetric beam. So may a plane without change of medium. Every other surface, the
//! stop and the image must have the ray on its vertex, along its normal. Gaps are then the lengths along the ray. A file that gives the place of
//! every surface has neither breaks nor gaps: the change from place to place is followed.

use super::draft::DraftSurface;
use pipeline::design::prescription::pose::{Order, Pose, Vector};
use pipeline::real;

/// Tolerances of the position, mm, and of the direction, rad.
const OFF_AXIS_MM: f64 = 1e-6;
const OFF_AXIS_RAD: f64 = 1e-8;

/// Tilts and decentres of the surfaces behind a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Break {
    /// Along x, y and z, mm.
    pub(super) decentre_mm: Vector,
    /// About x, y and z, degrees.
    pub(super) tilt_deg: [f64; 3],
    /// Whether tilts, in the reverse order, come before decentres.
    pub(super) tilts_first: bool,
}

/// The first surface that is not on the axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct OffAxis {
    pub(super) surface: usize,
}

impl Break {
    fn is_tilt(&self) -> bool {
        self.decentre_mm != [0.0; 3] || self.tilt_deg[..2] != [0.0; 2]
    }

    /// The frame behind the break in that before it.
    pub(super) fn pose(&self) -> Pose {
        let order = if self.tilts_first { Order::TiltFirst } else { Order::DecentreFirst };
        Pose::coordinate_break(order, self.decentre_mm, self.tilt_deg.map(f64::to_radians))
    }

    /// The break that undoes this one.
    pub(super) fn undone(&self) -> Self {
        let negative = |v: Vector| v.map(|c| if c == 0.0 { 0.0 } else { -c });
        Self {
            decentre_mm: negative(self.decentre_mm),
            tilt_deg: negative(self.tilt_deg),
            tilts_first: !self.tilts_first,
        }
    }

    /// Point and direction in the coordinates behind the break.
    fn apply(&self, point: Vector, direction: Vector) -> (Vector, Vector) {
        let [dx, dy, dz] = self.decentre_mm;
        let shifted = |v: Vector| [v[0] - dx, v[1] - dy, v[2] - dz];
        match self.tilts_first {
            true => (shifted(self.rotated(point)), self.rotated(direction)),
            false => (self.rotated(shifted(point)), self.rotated(direction)),
        }
    }

    fn rotated(&self, v: Vector) -> Vector {
        let order = if self.tilts_first { [2, 1, 0] } else { [0, 1, 2] };
        order.into_iter().fold(v, |v, axis| {
            let (sin, cos) = real::sin_cos(self.tilt_deg[axis].to_radians());
            let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
            let mut out = v;
            // Transposed: the coordinates are rotated, not the vector.
            (out[a], out[b]) = (cos * v[a] + sin * v[b], cos * v[b] - sin * v[a]);
            out
        })
    }
}

/// Point and direction of frame `from` in frame `to`, both places in the lens frame.
fn from_place_to_place(from: &Pose, to: &Pose, (point, direction): (Vector, Vector)) -> (Vector, Vector) {
    let change = to.inverse().compose(from);
    let rotation = Pose { origin_mm: [0.0; 3], ..change };
    (change.point(point), rotation.point(direction))
}

/// Whether a place is tilted about x or y, or off the axis.
fn is_off_axis(place: &Pose) -> bool {
    place.origin_mm[..2] != [0.0; 2] || place.rotation[2] != [0.0, 0.0, 1.0]
}

/// Replaces coordinate breaks and places by planes and gaps along the axis; notes say which.
///
/// # Errors
/// [`OffAxis`]: a surface is tilted or decentred.
pub(super) fn straighten(
    surfaces: &mut [DraftSurface],
    stop: Option<usize>,
    notes: &mut Vec<String>,
) -> Result<(), OffAxis> {
    let breaks = |s: &DraftSurface| [s.coordinate_break, s.break_behind].into_iter().flatten();
    let is_placed_off_axis = surfaces.iter().filter_map(|s| s.place).any(|place| is_off_axis(&place));
    if !is_placed_off_axis && !surfaces.iter().flat_map(breaks).any(|b| b.is_tilt()) {
        return Ok(());
    }
    let (mut point, mut direction) = ([0.0; 3], [0.0, 0.0, 1.0]);
    // Direction of the light along z of the file, if mirrors alone changed it.
    let mut parity = 1.0;
    let mut folds = 0;
    let image = surfaces.len() - 1;
    for i in 1..=image {
        let before = surfaces[i - 1].glass.clone();
        let place_before = surfaces[i - 1].place.unwrap_or_default();
        let surface = &mut surfaces[i];
        if let Some(place) = surface.place {
            (point, direction) = from_place_to_place(&place_before, &place, (point, direction));
        }
        if let Some(coordinate_break) = surface.coordinate_break {
            (point, direction) = coordinate_break.apply(point, direction);
        }
        let travelled = -point[2] / direction[2];
        if direction[2].abs() < OFF_AXIS_RAD || !travelled.is_finite() {
            return Err(OffAxis { surface: i });
        }
        let hit = [0, 1].map(|k| point[k] + travelled * direction[k]);
        let is_on_axis = real::hypot(hit[0], hit[1]) <= OFF_AXIS_MM
            && real::hypot(direction[0], direction[1]) <= OFF_AXIS_RAD;
        let is_dummy = surface.shape.is_flat()
            && surface.glass == before
            && !surface.is_mirror
            && surface.ideal_focal_mm.is_none();
        if !is_on_axis {
            let may_tilt = (is_dummy && surface.clear_mm.is_none() && surface.obscuration_mm.is_none())
                || (surface.is_mirror && surface.shape.is_flat());
            if !may_tilt || stop == Some(i) || i == image {
                return Err(OffAxis { surface: i });
            }
            if surface.is_mirror {
                folds += 1;
                (surface.clear_mm, surface.obscuration_mm, surface.is_fixed) = (None, None, false);
            }
        }
        let sign = direction[2].signum();
        if sign != parity {
            surface.shape = surface.shape.reversed();
        }
        let gap = std::mem::take(&mut surface.thickness_mm);
        if surface.is_mirror {
            parity = -parity;
            direction[2] = -direction[2];
        }
        point = [hit[0], hit[1], 0.0];
        if let Some(behind) = surface.break_behind {
            (point, direction) = behind.apply(point, direction);
        }
        point[2] -= gap;
        if i == 1 {
            surfaces[0].thickness_mm += travelled;
        } else {
            // The light's direction before this surface, as the file has it.
            let before = if surfaces[i].is_mirror { -parity } else { parity };
            surfaces[i - 1].thickness_mm = before * travelled;
        }
    }
    notes.push(match folds {
        0 => "coordinate breaks cancel: the surfaces are on one axis".to_owned(),
        n => format!(
            "coordinate breaks fold the axis at {n} plane mirror(s): the lens is traced along the axis, the mirrors without apertures"
        ),
    });
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::design::shape::Shape;

    fn plane(thickness_mm: f64) -> DraftSurface {
        DraftSurface { thickness_mm, ..DraftSurface::default() }
    }

    fn curved(thickness_mm: f64) -> DraftSurface {
        let shape = Shape { curvature: 0.02, ..Shape::default() };
        DraftSurface { shape, is_mirror: true, ..plane(thickness_mm) }
    }

    fn tilt(x: f64, y: f64, thickness_mm: f64) -> DraftSurface {
        let tilt_deg = [x, y, 0.0];
        let coordinate_break = Some(Break { tilt_deg, ..Break::default() });
        DraftSurface { coordinate_break, ..plane(thickness_mm) }
    }

    #[test]
    fn returned_tilts_and_decentres_leave_the_gaps() {
        let there = Break { decentre_mm: [3.0, -2.0, 1.0], tilt_deg: [10.0, 20.0, 5.0], tilts_first: false };
        let back = there.undone();
        assert_eq!((back.tilt_deg, back.tilts_first), ([-10.0, -20.0, -5.0], true));
        let at = |b, t| DraftSurface { coordinate_break: Some(b), ..plane(t) };
        let mut surfaces =
            vec![plane(f64::INFINITY), plane(4.0), at(there, 0.0), at(back, 7.0), curved(-9.0), plane(0.0)];
        let mut notes = Vec::new();
        straighten(&mut surfaces, Some(1), &mut notes).unwrap();
        let gaps: f64 = surfaces[1..4].iter().map(|s| s.thickness_mm).sum();
        assert!(
            (gaps - 11.0).abs() < 1e-12 && (surfaces[4].thickness_mm + 9.0).abs() < 1e-12,
            "{surfaces:?}"
        );
        assert_eq!((surfaces[4].shape.curvature, notes.len()), (0.02, 1));
        // Without the return the mirror is off the axis.
        let mut surfaces = vec![plane(f64::INFINITY), plane(4.0), at(there, 7.0), curved(-9.0), plane(0.0)];
        let error = straighten(&mut surfaces, Some(1), &mut notes).unwrap_err();
        assert_eq!(error, OffAxis { surface: 3 });
    }

    #[test]
    fn fold_mirror_gives_the_length_along_the_axis() {
        let flat = DraftSurface { is_mirror: true, ..plane(0.0) };
        let mut surfaces = vec![
            plane(f64::INFINITY),
            plane(30.0),
            tilt(45.0, 0.0, 0.0),
            flat,
            tilt(45.0, 0.0, -20.0),
            curved(12.0),
            plane(0.0),
        ];
        straighten(&mut surfaces, Some(1), &mut Vec::new()).unwrap();
        let gaps: Vec<f64> = surfaces[1..6].iter().map(|s| s.thickness_mm).collect();
        for (found, expected) in gaps.iter().zip([30.0, 0.0, 0.0, -20.0, 12.0]) {
            assert!((found - expected).abs() < 1e-12, "{gaps:?}");
        }
        assert_eq!(surfaces[5].shape.curvature, 0.02);
    }

    #[test]
    fn places_give_the_gaps_that_breaks_give() {
        let at = |y: f64, z: f64, tilt_deg: f64, surface: DraftSurface| {
            let place = Some(Pose::new([0.0, y, z], [tilt_deg.to_radians(), 0.0, 0.0]));
            DraftSurface { place, ..surface }
        };
        let flat = DraftSurface { is_mirror: true, ..plane(0.0) };
        let lens = |tilt_deg: f64| {
            vec![
                plane(f64::INFINITY),
                at(0.0, 0.0, 0.0, plane(0.0)),
                at(0.0, 30.0, 45.0, flat.clone()),
                // The light leaves along +y, against z of frames tilted by a quarter about x.
                at(20.0, 30.0, tilt_deg, curved(0.0)),
                at(8.0, 30.0, 90.0, plane(0.0)),
            ]
        };
        let mut surfaces = lens(90.0);
        straighten(&mut surfaces, Some(1), &mut Vec::new()).unwrap();
        let gaps: Vec<f64> = surfaces[1..4].iter().map(|s| s.thickness_mm).collect();
        for (found, expected) in gaps.iter().zip([30.0, -20.0, 12.0]) {
            assert!((found - expected).abs() < 1e-12, "{gaps:?}");
        }
        let error = straighten(&mut lens(89.0), Some(1), &mut Vec::new()).unwrap_err();
        assert_eq!(error.surface, 3);
    }
}
