//! Invented surfaces: what lies behind a visible edge where no hidden surface is given.
//!
//! A blurred edge shows what is behind it. Near an edge in depth each slab s gets, at its own pixels, a surface behind it whose light and vergence are
//! extrapolated (`extrapolate.rs`) from all slabs that are farther and apart from it (its donors):
//!
//! ```text
//! edge     pixels of a slab with a donor of it among the 3 × 3 pixels around (shares above 10⁻⁴)
//! amount   min(a_s, 1 − b_s) within reach_s rows and columns of an edge            half the widest window of nodes up to the slab's nearer one
//! k        slab of the extrapolated V, or the occupied one nearest to it:  a_k += amount,  c_k += amount · light,  m_k += amount · t
//! ```
//! The donors of a slab are the slabs below a first one, which grows with the slab. A result depends on the pixels around it alone, so neither on tiles nor
//! on where the film begins and ends.

use super::extrapolate::{Extrapolation, Known, levels, support};
use super::occupancy::Occupancy;
use super::planes::{Planes, SlabPlanes, copy_part, for_each_row};
use super::slabs::Slabs;
use crate::buffer::resize_exact;
use crate::geometry::Rect;

/// Extrapolated vergences below a node by less than this share of the nodes' range are those of the node: rounding.
const ROUNDING: f64 = 1e-6;

/// How the hidden surfaces of a band are invented.
#[derive(Clone, Debug)]
pub struct Hidden {
    slabs: Slabs,
    /// Per slab that it may have: the occupied slab nearest to it.
    occupied: Vec<usize>,
    /// Per slab: number of slabs from 0 on that are donors of it.
    donors: Vec<usize>,
    /// Per slab: half the widest window of nodes up to its nearer one, px.
    reach: Vec<usize>,
    /// Half the widest window, px.
    margin: usize,
}

/// Buffers of one worker.
#[derive(Debug, Default)]
pub(super) struct HiddenScratch {
    farthest: Vec<u16>,
    nearest: Vec<u16>,
    edge: Vec<bool>,
    near_edge: Vec<bool>,
    columns: Vec<usize>,
    behind: Vec<f32>,
    amount: Vec<f32>,
    known: Known,
    extrapolation: Extrapolation,
}

/// Least share of a pixel with which a surface makes an edge.
const PRESENT: f32 = 1e-4;
/// No slab at a pixel.
const NONE: u16 = u16::MAX;

impl Hidden {
    /// For `slabs`, of which the scene has those `occupied`; `windows`: window per node in px, 0 of nodes without PSFs.
    pub fn new(slabs: &Slabs, occupied: &[bool], windows: &[usize]) -> Self {
        let count = slabs.count();
        let donors = (0..count).map(|s| (0..s).take_while(|&k| slabs.apart(k, s)).count()).collect();
        let reach = (0..count)
            .map(|s| windows[..=slabs.nodes(s).1].iter().max().map_or(0, |window| window / 2))
            .collect();
        let gap = |s: usize, k: usize| {
            let (s, k) = (slabs.ends(s), slabs.ends(k));
            (k.0 - s.1).max(s.0 - k.1)
        };
        let nearest = |s: usize| {
            let all = (0..count).filter(|&k| occupied[k]);
            let first = if occupied[s] { Some(s) } else { None };
            first.or_else(|| all.min_by(|&k, &l| gap(s, k).total_cmp(&gap(s, l)))).unwrap_or(s)
        };
        let margin = windows.iter().max().map_or(0, |window| window / 2);
        Self { slabs: slabs.clone(), occupied: (0..count).map(nearest).collect(), donors, reach, margin }
    }

    /// Whether a surface of the slabs `present` may be hidden behind another one.
    fn is_possible(&self, present: &[bool]) -> bool {
        let first = present.iter().position(|is| *is);
        let last = present.iter().rposition(|is| *is);
        first.zip(last).is_some_and(|(first, last)| first < self.donors[last])
    }

    /// Whether a surface may be hidden behind another one near it in the chart pixels `rect`.
    pub fn may_be_in(&self, rect: Rect, occupancy: &Occupancy) -> bool {
        occupancy.any_neighbourhood(rect, |bins| self.is_possible(&occupancy.slabs(bins, &self.slabs)))
    }

    /// Largest reach of a slab, px.
    fn max_reach(&self) -> usize {
        self.reach.iter().max().copied().unwrap_or(0)
    }

    /// The film rectangle in which an edge matters to `tile`.
    pub fn edges(&self, tile: Rect) -> Rect {
        tile.grown(self.margin + self.max_reach() + 1)
    }

    /// The film rectangle on which the invented surfaces of `tile` depend, in part beyond the film.
    pub fn sources(&self, tile: Rect) -> Rect {
        let reach = self.max_reach();
        tile.grown(self.margin + support(levels(reach)).max(reach + 1))
    }

    /// Adds the invented surfaces of `tile` to `planes`, which reach over [`Hidden::sources`]; they then reach over the tile grown by half the widest
    /// window.
    pub(super) fn add(&self, tile: Rect, planes: &mut Planes, s: &mut HiddenScratch) {
        let (from, grown) = (planes.rect.expect("computed before"), tile.grown(self.margin));
        self.edge(from, planes, s);
        let n = from.size().pixels();
        for plane in [&mut s.known.a, &mut s.known.c, &mut s.known.v] {
            resize_exact(plane, n);
            plane.fill(0.0);
        }
        resize_exact(&mut s.behind, grown.size().pixels());
        copy_part(from, grown, &planes.uncovered, &mut s.behind);
        let (mut added, mut donors): (Vec<SlabPlanes>, usize) = (Vec::new(), 0);
        let Planes { slabs, free, .. } = planes;
        for slab in &*slabs {
            for donor in slabs[donors..].iter().take_while(|d| d.slab < self.donors[slab.slab]) {
                self.add_known(donor, &mut s.known);
                donors += 1;
            }
            let needed = if donors > 0 { self.amount(from, grown, slab, s) } else { None };
            if let Some(part) = needed {
                self.invent(slab.slab, (from, grown, part), (&mut added, free), s);
            }
            for_each_row(from, grown, |i, k, width| {
                let behind = &mut s.behind[k..k + width];
                behind.iter_mut().zip(i..).for_each(|(behind, i)| *behind += slab.at(&slab.a, i));
            });
        }
        planes.crop(grown);
        added.into_iter().for_each(|slab| planes.add(slab));
    }

    /// Marks the edges.
    fn edge(&self, from: Rect, planes: &Planes, s: &mut HiddenScratch) {
        let n = from.size().pixels();
        for plane in [&mut s.farthest, &mut s.nearest] {
            plane.clear();
            plane.resize(n, NONE);
        }
        for slab in &planes.slabs {
            for (i, _) in slab.a.iter().enumerate().filter(|(_, a)| **a > PRESENT) {
                let i = slab.first + i;
                s.farthest[i] = s.farthest[i].min(slab.slab as u16);
                s.nearest[i] = slab.slab as u16;
            }
        }
        s.edge.clear();
        s.edge.resize(n, false);
        let (height, width) = (from.height, from.width);
        for y in 0..height {
            for x in 0..width {
                let nearest = s.nearest[y * width + x];
                let donors = if nearest == NONE { 0 } else { self.donors[usize::from(nearest)] };
                if donors == 0 {
                    continue;
                }
                let rows = y.saturating_sub(1)..(y + 2).min(height);
                s.edge[y * width + x] = rows.into_iter().any(|y| {
                    let around = &s.farthest[y * width..][x.saturating_sub(1)..(x + 2).min(width)];
                    around.iter().any(|far| usize::from(*far) < donors)
                });
            }
        }
    }

    /// Adds the pixels of a donor.
    fn add_known(&self, donor: &SlabPlanes, known: &mut Known) {
        let (low, high) = self.slabs.ends(donor.slab);
        let (low, range) = (low as f32, (high - low) as f32);
        for (k, (a, m)) in std::iter::zip(&donor.a, &donor.m).enumerate() {
            let i = donor.first + k;
            known.a[i] += a;
            known.c[i] += donor.c[k];
            known.v[i] += a * low + m * range;
        }
    }

    /// Computes how much is hidden behind `slab` in `grown`; the part of it outside of which that is nothing.
    fn amount(&self, from: Rect, grown: Rect, slab: &SlabPlanes, s: &mut HiddenScratch) -> Option<Rect> {
        near(&s.edge, from, grown, self.reach[slab.slab], &mut s.near_edge, &mut s.columns);
        resize_exact(&mut s.amount, grown.size().pixels());
        let (mut rows, mut columns) = ((usize::MAX, 0), (usize::MAX, 0));
        let HiddenScratch { amount, near_edge, behind, .. } = s;
        for_each_row(from, grown, |i, k, width| {
            for x in 0..width {
                let open = 1.0 - behind[k + x].min(1.0);
                let value = if near_edge[k + x] { slab.at(&slab.a, i + x).min(open).max(0.0) } else { 0.0 };
                amount[k + x] = value;
                if value > 0.0 {
                    let y = k / width;
                    (rows, columns) = ((rows.0.min(y), y), (columns.0.min(x), columns.1.max(x)));
                }
            }
        });
        let part = |(y, last_y): (usize, usize), (x, last_x): (usize, usize)| {
            Rect::new(grown.y + y as i64, grown.x + x as i64, last_y - y + 1, last_x - x + 1)
        };
        (rows.0 != usize::MAX).then(|| part(rows, columns))
    }

    /// Extrapolates the donors of slab `of` to `part` of `grown`, where their amount is not 0, into the slabs `added`, made of `free` buffers.
    fn invent(
        &self,
        of: usize,
        (from, grown, part): (Rect, Rect, Rect),
        (added, free): (&mut Vec<SlabPlanes>, &mut Vec<SlabPlanes>),
        s: &mut HiddenScratch,
    ) {
        let vergence = self.slabs.vergence();
        let rounding = ROUNDING * (vergence[vergence.len() - 1] - vergence[0]);
        let first = (part.y - grown.y) as usize * grown.width + (part.x - grown.x) as usize;
        let HiddenScratch { known, extrapolation, amount, .. } = s;
        extrapolation.run(known, from, (part, levels(self.reach[of])), |i, (light, v, found)| {
            let i = first + i / part.width * grown.width + i % part.width;
            let share = amount[i];
            if !found || share == 0.0 {
                return;
            }
            let v = f64::from(v);
            let k = self.occupied[self.slabs.of(v + rounding)].min(of - 1);
            let to = match added.iter_mut().position(|slab| slab.slab == k) {
                Some(at) => &mut added[at],
                None => {
                    added.push(SlabPlanes::zeros(free.pop(), k, grown.size().pixels()));
                    added.last_mut().expect("pushed above")
                }
            };
            to.a[i] += share;
            to.c[i] += share * light;
            to.m[i] += share * self.slabs.position(k, v) as f32;
        });
    }
}

/// Whether each pixel of `part` lies within `reach` rows and columns of a marked one of `from`.
fn near(marked: &[bool], from: Rect, part: Rect, reach: usize, to: &mut Vec<bool>, columns: &mut Vec<usize>) {
    let (top, left) = ((part.y - from.y) as usize, (part.x - from.x) as usize);
    to.clear();
    // Marked pixels of each column among the rows in reach.
    columns.clear();
    columns.resize(from.width, 0);
    let add = |columns: &mut Vec<usize>, y: usize, by: isize| {
        for (count, marked) in std::iter::zip(columns, &marked[y * from.width..][..from.width]) {
            *count = count.wrapping_add_signed(by * isize::from(*marked));
        }
    };
    for y in top.saturating_sub(reach)..(top + reach).min(from.height) {
        add(columns, y, 1);
    }
    for y in top..top + part.height {
        if y + reach < from.height {
            add(columns, y + reach, 1);
        }
        if y > reach && y > top {
            add(columns, y - reach - 1, -1);
        }
        let count = |x: usize| usize::from(columns[x] > 0);
        let mut sum: usize = (left.saturating_sub(reach)..(left + reach).min(from.width)).map(count).sum();
        for x in left..left + part.width {
            if x + reach < from.width {
                sum += count(x + reach);
            }
            if x > reach && x > left {
                sum -= count(x - reach - 1);
            }
            to.push(sum > 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_near_a_marked_one_are_found() {
        let from = Rect::new(-3, 5, 40, 50);
        let marks = [(0, 0), (39, 49), (20, 13), (7, 30)];
        let mut marked = vec![false; 2000];
        marks.iter().for_each(|(y, x)| marked[y * 50 + x] = true);
        for (part, reach) in
            [(from, 0), (from, 4), (Rect::new(4, 9, 22, 31), 6), (Rect::new(-3, 5, 9, 9), 60)]
        {
            let mut found = Vec::new();
            near(&marked, from, part, reach, &mut found, &mut Vec::new());
            for (i, found) in found.iter().enumerate() {
                let (y, x) =
                    (part.y - from.y + (i / part.width) as i64, part.x - from.x + (i % part.width) as i64);
                let within = |(my, mx): &(usize, usize)| {
                    (*my as i64 - y).abs() <= reach as i64 && (*mx as i64 - x).abs() <= reach as i64
                };
                assert_eq!(*found, marks.iter().any(within), "row {y}, column {x}, reach {reach}");
            }
        }
    }

    #[test]
    fn donors_are_the_slabs_apart() {
        let slabs = Slabs::new(&[0.0, 0.1, 0.2, 1.0, 1.5], 0.2, 100.0);
        let hidden = Hidden::new(&slabs, &[true, false, false, true], &[5, 0, 7, 9, 3]);
        assert_eq!(hidden.donors, [0, 0, 1, 2]);
        assert_eq!(hidden.reach, [2, 3, 4, 4]);
        assert_eq!(hidden.occupied, [0, 0, 3, 3]);
        assert!(
            hidden.is_possible(&[true, false, true, false])
                && !hidden.is_possible(&[true, true, false, false])
        );
        assert!(!hidden.is_possible(&[false, false, true, true]) && !hidden.is_possible(&[false; 4]));
    }
}
