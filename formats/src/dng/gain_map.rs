//! Gains over a picture, one map for each pixel of a period: GainMap opcodes of DNG 1.3, in OpcodeList2.
//!
//! All numbers are big-endian. A list is the number of opcodes, then each: 9 (GainMap), 1.3.0.0, flags (1: a reader may leave it out), bytes that follow; top, left, bottom, right of
//! the pixels, plane, planes, pitch of rows and columns, points down and across; their spacing and the first one, as shares of the picture's height and width; planes of the map; the gains, in f32, row by row.
//! Source: Adobe, Digital Negative Specification 1.4.0.0 (2012), chapter 6.

use pipeline::geometry::Size;

/// Opcode of a gain map.
const GAIN_MAP: u32 = 9;
/// The version of DNG that has it.
const VERSION: u32 = 0x0103_0000;
/// A reader that does not know it may leave it out.
const OPTIONAL: u32 = 1;

/// Gains over a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct GainMaps {
    /// Rows and columns of a period.
    pub period: (usize, usize),
    /// Points down and across, evenly spaced from edge to edge of the picture; at least two each.
    pub points: (usize, usize),
    /// The gains of each pixel of the period, row by row, at the points, row by row.
    pub gains: Vec<Vec<f32>>,
}

impl GainMaps {
    /// The list of opcodes for a picture of `size`.
    pub(super) fn opcodes(&self, size: Size) -> Vec<u8> {
        let mut list = (self.gains.len() as u32).to_be_bytes().to_vec();
        for (k, gains) in self.gains.iter().enumerate() {
            let (top, left) = (k / self.period.1, k % self.period.1);
            let whole = |v: usize| (v as u32).to_be_bytes();
            let spacing = |points: usize| (1.0 / (points - 1) as f64).to_be_bytes();
            let mut map: Vec<u8> = [
                top,
                left,
                size.height,
                size.width,
                0,
                1,
                self.period.0,
                self.period.1,
                self.points.0,
                self.points.1,
            ]
            .into_iter()
            .flat_map(whole)
            .collect();
            map.extend([spacing(self.points.0), spacing(self.points.1), [0; 8], [0; 8]].as_flattened());
            map.extend(whole(1));
            map.extend(gains.iter().flat_map(|gain| gain.to_be_bytes()));
            for word in [GAIN_MAP, VERSION, OPTIONAL, map.len() as u32] {
                list.extend(word.to_be_bytes());
            }
            list.extend(map);
        }
        list
    }
}
