//! Slope of a surface: how much the blur radius changes from one film pixel to the next.
//!
//! ```text
//! ∇ρ = blur per dioptre·∇V,  |∇ρ| ≤ 4;   V = vergence of the slab's pixel, of its neighbours that of the slab nearest to it that is not apart from it
//! ```
//! Central differences; to one side where the other pixel is of another surface; 0 where both are.

use crate::depth::planes::Planes;
use crate::depth::slabs::Slabs;
use crate::geometry::Rect;

/// Steeper surfaces count as this steep, px per px: at the silhouette of a ball the slope has no bound.
const STEEPEST: f32 = 4.0;
/// Slopes below this are 0.
const LEAST: f32 = 1e-4;

/// ∂ρ/∂y and ∂ρ/∂x of the pixels of a rectangle.
#[derive(Debug, Default)]
pub(super) struct Slope {
    pub(super) y: Vec<f32>,
    pub(super) x: Vec<f32>,
}

/// Slopes of the slab at `plane` of `planes` on `area`; whether any is not 0. Beyond the planes they are those at their border.
pub(super) fn slopes(slabs: &Slabs, planes: &Planes, plane: usize, area: Rect, to: &mut Slope) -> bool {
    let (from, slab) = (planes.rect.expect("computed before"), &planes.slabs[plane]);
    // The slabs of one surface, that of `plane` first.
    let mut surface: Vec<usize> = (0..planes.slabs.len())
        .filter(|&k| {
            let (a, b) = (planes.slabs[k].slab, slab.slab);
            !slabs.apart(a.min(b), a.max(b))
        })
        .collect();
    surface.sort_by_key(|&k| {
        (planes.slabs[k].slab.abs_diff(slab.slab), std::cmp::Reverse(planes.slabs[k].slab))
    });
    // Blur radius of the pixel (y, x) of the planes, from the first of `of` that has it.
    let blur = |y: i64, x: i64, of: &[usize]| {
        if !(0..from.height as i64).contains(&y) || !(0..from.width as i64).contains(&x) {
            return None;
        }
        let i = y as usize * from.width + x as usize;
        of.iter().map(|&k| &planes.slabs[k]).find_map(|slab| {
            let (low, high) = slabs.ends(slab.slab);
            let is_there = slab.at(&slab.a, i) > 0.0;
            is_there.then(|| slabs.blur_at(low + f64::from(slab.position(i)) * (high - low)))
        })
    };
    let along = |here: f64, before: Option<f64>, after: Option<f64>| match (before, after) {
        (Some(before), Some(after)) => (after - before) / 2.0,
        (Some(before), None) => here - before,
        (None, Some(after)) => after - here,
        (None, None) => 0.0,
    };
    to.y.clear();
    to.x.clear();
    let mut any = false;
    for y in area.y..area.bottom() {
        for x in area.x..area.right() {
            let (y, x) =
                (y.clamp(from.y, from.bottom() - 1) - from.y, x.clamp(from.x, from.right() - 1) - from.x);
            let (mut dy, mut dx) = (0.0, 0.0);
            if let Some(here) = blur(y, x, &surface[..1]) {
                dy = along(here, blur(y - 1, x, &surface), blur(y + 1, x, &surface)) as f32;
                dx = along(here, blur(y, x - 1, &surface), blur(y, x + 1, &surface)) as f32;
                let steep = (dy * dy + dx * dx).sqrt();
                let limit = if steep < LEAST { 0.0 } else { (STEEPEST / steep).min(1.0) };
                (dy, dx) = (dy * limit, dx * limit);
                any |= limit > 0.0;
            }
            to.y.push(dy);
            to.x.push(dx);
        }
    }
    any
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::planes::SlabPlanes;

    /// Slabs 1/m wide, 10 px of blur each; a plane of 0.05 slabs per column, a step of 3 slabs up at column 30.
    fn planes(rect: Rect) -> (Slabs, Planes) {
        let slabs = Slabs::new(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 0.0, 10.0);
        let n = rect.size().pixels();
        let mut all: Vec<SlabPlanes> = (0..6).map(|s| SlabPlanes::zeros(None, s, n)).collect();
        for i in 0..n {
            let column = (i % rect.width) as f32;
            let v = 0.5 + 0.05 * column + if column >= 30.0 { 3.0 } else { 0.0 };
            let s = v as usize;
            (all[s].a[i], all[s].m[i]) = (1.0, v - s as f32);
        }
        let trimmed = all.iter().filter_map(|slab| slab.trimmed(rect.width)).collect();
        (slabs, Planes { rect: Some(rect), slabs: trimmed, uncovered: vec![0.0; n], free: Vec::new() })
    }

    #[test]
    fn slopes_run_through_slabs_and_end_at_edges() {
        let rect = Rect::new(-3, 5, 8, 40);
        let (slabs, planes) = planes(rect);
        for plane in 0..planes.slabs.len() {
            let mut found = Slope::default();
            assert!(slopes(&slabs, &planes, plane, rect, &mut found));
            for (i, (dy, dx)) in std::iter::zip(&found.y, &found.x).enumerate() {
                let is_of = planes.slabs[plane].at(&planes.slabs[plane].a, i) > 0.0;
                let expected = if is_of { 0.5 } else { 0.0 };
                assert!(*dy == 0.0 && (dx - expected).abs() < 1e-4, "slab {plane}, column {}: {dx}", i % 40);
            }
        }
    }

    #[test]
    fn a_parallel_surface_has_no_slope() {
        let rect = Rect::new(0, 0, 5, 7);
        let mut slab = SlabPlanes::zeros(None, 2, 35);
        slab.a.fill(0.5);
        slab.m.fill(0.2);
        let planes =
            Planes { rect: Some(rect), slabs: vec![slab], uncovered: vec![0.5; 35], free: Vec::new() };
        let slabs = Slabs::new(&[0.0, 1.0, 2.0, 3.0], 0.0, 10.0);
        assert!(!slopes(&slabs, &planes, 0, rect.grown(2), &mut Slope::default()));
    }
}
