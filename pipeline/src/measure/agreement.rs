//! Agreement of two curves: intersection over union, maximum difference, area between them.

/// Agreement of a measured curve with the expected one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// Intersection over union, Σ min / Σ max of non-negative values; 1 if equal.
    pub iou: f64,
    /// Largest |measured − expected|.
    pub max_difference: f64,
    /// ∫ |measured − expected|: the sum times the sample spacing.
    pub area_between: f64,
}

/// Compares curves sampled at the same positions, `step` apart.
///
/// Negative values count as 0 in the IoU, which is not defined for them, but not in the differences.
///
/// # Panics
/// For curves of different lengths.
pub fn agreement(measured: &[f64], expected: &[f64], step: f64) -> Agreement {
    assert_eq!(measured.len(), expected.len(), "curves sampled at the same positions");
    let (mut intersection, mut union, mut largest, mut area) = (0.0, 0.0, 0.0f64, 0.0);
    for (a, b) in measured.iter().zip(expected) {
        let (p, q) = (a.max(0.0), b.max(0.0));
        intersection += p.min(q);
        union += p.max(q);
        largest = largest.max((a - b).abs());
        area += (a - b).abs() * step;
    }
    let iou = if union > 0.0 { intersection / union } else { 1.0 };
    Agreement { iou, max_difference: largest, area_between: area }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_curves_have_iou_1_and_different_ones_the_ratio_of_areas() {
        let curve = [0.0, 0.5, 1.0];
        assert_eq!(agreement(&curve, &curve, 0.25).iou, 1.0);
        let a = agreement(&[0.0, 0.4, 1.0], &curve, 0.25);
        assert!((a.iou - 1.4 / 1.5).abs() < 1e-12 && (a.max_difference - 0.1).abs() < 1e-12);
        assert!((a.area_between - 0.025).abs() < 1e-12);
    }
}
