//! Nodes that the needs of kernels at probing heights ask for, and by how much errors grow where a budget does not allow them.
//!
//! Between probing heights needs are linear; heights divide the integral of cells per mm into equal parts. Errors in r and in θ have half the tolerance each times a
//! factor ([`Relaxation`]). Where further nodes are allowed above [`TraceOptions::excess`], edges keep their tolerance up to it; else they yield before the L1 does.

use super::options::{Azimuths, PsfHeights, TraceOptions};
use super::probing::{Needs, between};
use super::refine::{Budget, round_azimuths};
use super::relaxation::{Relaxation, relaxed_esf};

/// The needs of kernels, and what is given.
pub(super) struct Placement<'o> {
    pub(super) options: &'o TraceOptions,
    pub(super) last_mm: f64,
    /// Probing heights, mm.
    pub(super) probes: Vec<f64>,
    /// Azimuths there.
    pub(super) azimuths: Needs,
    /// Spacings of heights there, if heights are chosen.
    pub(super) spacing: Option<Needs>,
}

/// By how much the errors of nodes exceed their tolerance within a budget.
#[derive(Clone, Copy)]
pub(super) struct Relaxed {
    pub(super) by: Relaxation,
    pub(super) budget: Budget,
    /// Up to which factor of the L1 edges keep their tolerance.
    kept_up_to: f64,
}

impl Relaxed {
    /// Largest L1 over its tolerance where the largest ESF is its own ([`super::difference::Difference::error`]).
    pub(super) fn l1_over_esf(&self) -> f64 {
        let of_esf = [self.by.radial, self.by.angular].map(|factor| relaxed_esf(factor, self.kept_up_to));
        self.by.mean() / (0.5 * (of_esf[0] + of_esf[1]))
    }
}

impl Placement<'_> {
    /// Whether heights are chosen.
    pub(super) fn has_free_heights(&self) -> bool {
        self.spacing.is_some()
    }

    /// Whether azimuths are chosen.
    pub(super) fn has_free_azimuths(&self) -> bool {
        self.options.azimuths == Azimuths::ByError
    }

    /// What at most `heights` PSFs allow.
    pub(super) fn within(&self, heights: usize) -> Relaxed {
        let options = self.options;
        let has_further = options.base_nodes() < options.max_nodes;
        let least = |from: f64, nodes: usize, kept_up_to: f64| {
            let budget = Budget { nodes, heights };
            let by = Relaxation::least(from, |radial, angular| {
                let heights = self.heights_at(radial, kept_up_to);
                let count = self.count_at(angular, kept_up_to);
                let azimuths: Vec<usize> = heights.iter().map(|h| count(*h)).collect();
                budget.fits(&heights, &azimuths, self.has_free_heights())
            });
            Relaxed { by, budget, kept_up_to }
        };
        let mut of_base = least(1.0, options.base_nodes(), if has_further { options.excess } else { 1.0 });
        if !has_further && of_base.by.mean() > 1.0 {
            of_base = least(1.0, options.base_nodes(), 0.0);
        }
        match of_base.by.mean() <= options.excess || !has_further {
            true => of_base,
            false => least(options.excess, options.max_nodes, of_base.kept_up_to),
        }
    }

    /// Heights, mm.
    pub(super) fn heights(&self, relaxed: &Relaxed) -> Vec<f64> {
        self.heights_at(relaxed.by.radial, relaxed.kept_up_to)
    }

    /// The number of azimuths at a height in mm.
    pub(super) fn count(&self, relaxed: &Relaxed) -> impl Fn(f64) -> usize {
        self.count_at(relaxed.by.angular, relaxed.kept_up_to)
    }

    fn heights_at(&self, radial: f64, kept_up_to: f64) -> Vec<f64> {
        match (&self.options.heights, &self.spacing) {
            (PsfHeights::ByError, Some([l1, esf])) => {
                let factors = [radial, relaxed_esf(radial, kept_up_to)].map(f64::sqrt);
                let spacing = l1.iter().zip(esf).map(|(l1, esf)| (factors[0] * l1).min(factors[1] * esf));
                place(&self.probes, &spacing.collect::<Vec<f64>>(), self.last_mm)
            }
            (PsfHeights::Given(heights), _) => heights.clone(),
            (PsfHeights::ByError, None) => Vec::new(),
        }
    }

    fn count_at(&self, angular: f64, kept_up_to: f64) -> impl Fn(f64) -> usize {
        let factors = match self.has_free_azimuths() {
            true => [angular, relaxed_esf(angular, kept_up_to)].map(f64::sqrt),
            false => [1.0; 2],
        };
        let [l1, esf] = &self.azimuths;
        let need: Vec<f64> =
            l1.iter().zip(esf).map(|(l1, esf)| (l1 / factors[0]).max(esf / factors[1])).collect();
        let probes = &self.probes;
        move |h: f64| round_azimuths(between(probes, &need, h))
    }
}

/// Heights from 0 to `last` whose spacing follows `spacing` at `probes`.
fn place(probes: &[f64], spacing: &[f64], last: f64) -> Vec<f64> {
    // Integral of cells per mm; then the heights that divide it into equal parts.
    let fine = 4000;
    let step = last / f64::from(fine);
    let mut sums = vec![0.0];
    for i in 0..fine {
        let r = (f64::from(i) + 0.5) * step;
        sums.push(sums[i as usize] + step / between(probes, spacing, r));
    }
    let total = sums[fine as usize];
    let cells = (total * 1.02).ceil().max(2.0);
    let mut heights = vec![0.0];
    let mut at = 0;
    for k in 1..cells as usize {
        let target = total * k as f64 / cells;
        while sums[at + 1] < target {
            at += 1;
        }
        heights.push(step * (at as f64 + (target - sums[at]) / (sums[at + 1] - sums[at])));
    }
    heights.push(last);
    heights
}
