//! How well two curves agree, in the words of the published evaluation.

/// Agreement of a measured curve with the expected one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// Intersection over union, Σ min / Σ max of non-negative values: 1 is equal.
    pub iou: f64,
    /// Largest |measured − expected|.
    pub max_difference: f64,
    /// ∫ |measured − expected|: the sum times the step of the samples.
    pub area_between: f64,
}

/// Compares curves sampled at the same places, `step` apart.
///
/// Values below zero count as zero in the IoU, which has no meaning for them; not in the differences.
///
/// # Panics
/// For curves of different lengths.
pub fn agreement(measured: &[f64], expected: &[f64], step: f64) -> Agreement {
    assert_eq!(measured.len(), expected.len(), "curves sampled at the same places");
    let (mut least, mut most, mut largest, mut area) = (0.0, 0.0, 0.0f64, 0.0);
    for (a, b) in measured.iter().zip(expected) {
        let (p, q) = (a.max(0.0), b.max(0.0));
        least += p.min(q);
        most += p.max(q);
        largest = largest.max((a - b).abs());
        area += (a - b).abs() * step;
    }
    let iou = if most > 0.0 { least / most } else { 1.0 };
    Agreement { iou, max_difference: largest, area_between: area }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_curves_agree_and_others_by_as_much_as_they_do() {
        let curve = [0.0, 0.5, 1.0];
        assert_eq!(agreement(&curve, &curve, 0.25).iou, 1.0);
        let a = agreement(&[0.0, 0.4, 1.0], &curve, 0.25);
        assert!((a.iou - 1.4 / 1.5).abs() < 1e-12 && (a.max_difference - 0.1).abs() < 1e-12);
        assert!((a.area_between - 0.025).abs() < 1e-12);
    }
}
