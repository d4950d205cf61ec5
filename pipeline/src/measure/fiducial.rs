//! Corner marks of a chart in a picture: positions to a few hundredths of a pixel, and which corner each is.
//!
//! A mark is three concentric squares of 7, 5 and 3 modules (ISO/IEC 18004, finder pattern): runs of 1:1:3:1:1 modules on every line through its
//! centre. At the chart's top right, bottom right and bottom left the inner square is dark on a light surround; at the top left all is inverted, and its dark
//! surround is 3 modules wider towards the top right: without it, a mirror-reversed picture would be that of another chart. One module of
//! surround is needed on every side, in the picture too.
//!
//! | step | module |
//! |---|---|
//! | dark and light pixels, by a local threshold | `threshold.rs` |
//! | 1:1:3:1:1 along rows, then along 32 rays | `scan.rs` |
//! | order of the four about their mean; length of the dark surround towards both neighbours of the inverted one | here |
//! | centre: diagonals of the outer square, from lines through its borders | `refine.rs` |
//!
//! Needs modules of 3 px in a sharp picture, of 2 σ + 1 px in one blurred by σ, and a chart that is seen from its front with its four marks, each less than 1/4 of the
//! picture wide. Reads the picture three times; holds one byte a pixel. Accuracy for marks of 46 px (tests below): 0.01 px in sharp pictures, 0.02 px with
//! blur of σ = 2 px and 30 % of shading; with noise of 5 % of white 0.08 px, and 0.25 px with that blur too. Not modelled: distortion within a mark.

mod refine;
mod scan;
mod threshold;

use super::projective::Quad;
use crate::geometry::Size;
use crate::real;
use refine::Axes;
use scan::{Mark, crossings};
use threshold::Bitmap;

/// Ratio of the dark surround towards the top right and towards the bottom left, 8.5/5.5 modules from the centre; half-way to 1.
const MIN_SURROUND_RATIO: f64 = 1.2;

/// A picture in which the four marks are not found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FiducialError {
    /// The buffer is not a picture of this size.
    #[error("a picture of {size} has {expected} pixels, not {found}")]
    Buffer {
        /// Its size.
        size: Size,
        /// Pixels of the size.
        expected: usize,
        /// Pixels of the buffer.
        found: usize,
    },
    /// There is none.
    #[error(
        "no corner marks in the picture of {size}: the chart needs fiducials=PX, at least 21 px wide and sharp in the picture, with their light surround"
    )]
    NotFound {
        /// Size of the picture.
        size: Size,
    },
    /// Fewer than four.
    #[error(
        "{found} of 4 corner marks found ({inverted} with a light centre, which is at the top left): the others are outside the picture, covered, blurred or glossy"
    )]
    Missing {
        /// Marks found.
        found: usize,
        /// Those of them that are inverted.
        inverted: usize,
    },
    /// More than four.
    #[error("{found} corner marks found, more than 4: one chart a picture; crop the picture to it")]
    TooMany {
        /// Marks found.
        found: usize,
    },
    /// Four, but not three of a dark and one of a light centre.
    #[error("{inverted} of 4 corner marks have a light centre; of a chart it is the one at the top left")]
    NotOneChart {
        /// Those with a light centre.
        inverted: usize,
    },
    /// The marks are not the corners of a convex quadrilateral.
    #[error("the 4 corner marks are not the corners of one chart: their quadrilateral is not convex")]
    NotConvex,
    /// The surround of the top left mark does not tell its neighbours apart.
    #[error("the dark surround of the top left mark is covered or blurred: the chart's top edge is unknown")]
    UnknownTop,
    /// Mirror-reversed.
    #[error("the picture of the chart is mirror-reversed")]
    Mirrored,
}

/// Positions (row, column), in pixels from the centre of the first one, of the marks at the chart's top left, top right, bottom right and bottom left.
/// `luma` is linear in light, row by row.
///
/// # Errors
/// [`FiducialError`] if they are not found, or not those of one chart seen from its front.
pub fn find(luma: &[f32], size: Size) -> Result<Quad, FiducialError> {
    if luma.len() != size.pixels() {
        return Err(FiducialError::Buffer { size, expected: size.pixels(), found: luma.len() });
    }
    if luma.is_empty() {
        return Err(FiducialError::NotFound { size });
    }
    let map = Bitmap::new(luma, size);
    let marks = scan::marks(&map);
    let (found, inverted) = (marks.len(), marks.iter().filter(|m| m.light).count());
    let marks: [Mark; 4] = match found {
        0 => return Err(FiducialError::NotFound { size }),
        1..=3 => return Err(FiducialError::Missing { found, inverted }),
        4 if inverted == 1 => [marks[0], marks[1], marks[2], marks[3]],
        4 => return Err(FiducialError::NotOneChart { inverted }),
        _ => return Err(FiducialError::TooMany { found }),
    };
    let marks = clockwise(marks)?;
    is_from_the_front(&map, &marks)?;
    let coarse = marks.map(|m| m.centre);
    let mut centres = coarse;
    for (i, centre) in centres.iter_mut().enumerate() {
        // Along the chart's rows and columns: from the left mark to the right one, from the upper to the lower.
        let (left, right) = if i < 2 { (0, 1) } else { (3, 2) };
        let (top, bottom) = if i == 0 || i == 3 { (0, 3) } else { (1, 2) };
        let (u, v) = (unit(coarse[left], coarse[right]), unit(coarse[top], coarse[bottom]));
        let half = |along: (f64, f64)| {
            let reach = |sign: f64| {
                let along = (sign * along.0, sign * along.1);
                crossings::<3>(&map, marks[i].centre, along, marks[i].light, 3.0 * marks[i].reach_px)
            };
            let (ahead, behind) = (reach(1.0), reach(-1.0));
            match (ahead, behind) {
                (Some(a), Some(b)) => (a[2] + b[2]) / 2.0,
                _ => marks[i].reach_px,
            }
        };
        let (half_u_px, half_v_px) = (half(u), half(v));
        // A second time about the centre found: a coarse one that is off by a pixel has levels beside the middle of a ring.
        for _ in 0..2 {
            let axes = Axes { centre: *centre, u, v, half_u_px, half_v_px };
            *centre = refine::centre(luma, size, &axes).unwrap_or(*centre);
        }
    }
    Ok(centres)
}

/// The marks in clockwise order in the picture, from the inverted one.
fn clockwise(mut marks: [Mark; 4]) -> Result<[Mark; 4], FiducialError> {
    let mean = |f: fn(&Mark) -> f64| marks.iter().map(f).sum::<f64>() / 4.0;
    let (row, column) = (mean(|m| m.centre.0), mean(|m| m.centre.1));
    // Rows point down: the angle from +column towards +row is clockwise.
    let angle = |m: &Mark| real::atan2(m.centre.0 - row, m.centre.1 - column);
    marks.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    let first = marks.iter().position(|m| m.light).unwrap_or(0);
    marks.rotate_left(first);
    let convex = (0..4).all(|i| {
        let [a, b, c] = [0, 1, 2].map(|k| marks[(i + k) % 4].centre);
        (b.1 - a.1) * (c.0 - b.0) - (b.0 - a.0) * (c.1 - b.1) > 0.0
    });
    if convex { Ok(marks) } else { Err(FiducialError::NotConvex) }
}

/// Checks that the dark surround of the first mark is longer towards its clockwise neighbour.
fn is_from_the_front(map: &Bitmap, marks: &[Mark; 4]) -> Result<(), FiducialError> {
    let surround = |to: &Mark| {
        let (from, along) = (marks[0].centre, unit(marks[0].centre, to.centre));
        let crossed = crossings::<4>(map, from, along, marks[0].light, 6.0 * marks[0].reach_px);
        crossed.map(|c| c[3] / c[2]).ok_or(FiducialError::UnknownTop)
    };
    let (clockwise, counter) = (surround(&marks[1])?, surround(&marks[3])?);
    if clockwise > MIN_SURROUND_RATIO * counter {
        Ok(())
    } else if counter > MIN_SURROUND_RATIO * clockwise {
        Err(FiducialError::Mirrored)
    } else {
        Err(FiducialError::UnknownTop)
    }
}

/// The unit vector from a position to another.
fn unit(from: (f64, f64), to: (f64, f64)) -> (f64, f64) {
    let (row, column) = (to.0 - from.0, to.1 - from.1);
    let length = real::hypot(row, column);
    (row / length, column / length)
}

#[cfg(test)]
mod tests;
