//! Widths of the bands of a chart, over which `--band-samples` integrates.
//!
//! A band ends half-way to its neighbours among all bands of the chart, whichever of them are computed; the first and the last one are as wide on their
//! outer side as on their inner one. A width that is given holds for every band, half of it on either side of its wavelength.

use crate::args::BandSamplesArg;
use crate::failure::usage;
use crate::progress::{number, plural};
use anyhow::{Context, Result};
use pipeline::design::trace::BandRange;

/// Difference up to which two bands have the same wavelength, nm: that to which wavelengths are rounded before they are traced.
const SAME_NM: f64 = 1e-6;

/// Widths of the bands of a chart.
#[derive(Clone, Debug)]
pub struct BandWidths {
    asked: BandSamplesArg,
    /// Wavelengths of the chart, ascending, each once.
    chart_nm: Vec<f64>,
}

impl BandWidths {
    /// Those of a chart with bands at `chart_nm`, integrated as `asked`.
    ///
    /// # Errors
    /// Usage: a chart of one wavelength and no width; surfaces at several distances.
    pub fn new(asked: BandSamplesArg, chart_nm: &[f64], has_depth: bool) -> Result<Self> {
        if has_depth {
            return Err(usage(format!(
                "--band-samples {asked} is for flat charts: with surfaces at several distances a band is one wavelength; leave it out, or compute a flat film (--depth none)"
            )));
        }
        let mut nm = chart_nm.to_vec();
        nm.sort_by(f64::total_cmp);
        nm.dedup_by(|a, b| (*a - *b).abs() <= SAME_NM);
        if nm.len() < 2 && asked.width_nm.is_none() {
            let count = asked.count;
            return Err(usage(format!(
                "--band-samples {asked}: the chart has bands at one wavelength only, so their width is not known (they end half-way to their neighbours); \
                 give it, e.g. `--band-samples {count},width=10` in nm"
            )));
        }
        Ok(Self { asked, chart_nm: nm })
    }

    /// The width of the band at `nm`.
    ///
    /// # Errors
    /// The chart has no such band; a band that begins at 0 nm or below.
    pub fn of(&self, nm: f64) -> Result<BandRange> {
        let (from_nm, to_nm) = match self.asked.width_nm {
            Some(width) => (nm - 0.5 * width, nm + 0.5 * width),
            None => {
                let all = &self.chart_nm;
                let at = all.iter().position(|v| (v - nm).abs() <= SAME_NM);
                let at = at.with_context(|| format!("the chart has no band at {nm} nm"))?;
                let half = |other: usize| 0.5 * (all[other] - nm).abs();
                let below = at.checked_sub(1).map(half);
                let above = Some(at + 1).filter(|next| *next < all.len()).map(half);
                let [Some(below), Some(above)] = [below.or(above), above.or(below)] else {
                    anyhow::bail!("the band at {nm} nm has no neighbour");
                };
                (nm - below, nm + above)
            }
        };
        match from_nm > 0.0 {
            true => Ok(BandRange { from_nm, to_nm, samples: self.asked.count }),
            false => Err(usage(format!(
                "--band-samples {}: the band at {} nm would begin at {} nm; give a narrower width=NM",
                self.asked,
                number(nm),
                number(from_nm)
            ))),
        }
    }

    /// What was integrated, of bands at ascending `nm`.
    ///
    /// # Errors
    /// As [`BandWidths::of`].
    pub fn described(&self, nm: &[f64]) -> Result<String> {
        let ranges: Vec<BandRange> = nm.iter().map(|nm| self.of(*nm)).collect::<Result<_>>()?;
        let ends = ranges.first().zip(ranges.last());
        let ends = ends.map_or(String::new(), |(first, last)| {
            format!(", {} to {} nm", number(first.from_nm), number(last.to_nm))
        });
        Ok(format!(
            "PSFs and tables are means over {} within the width of each band{ends}",
            plural(self.asked.count, "wavelength")
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range(text: &str, chart_nm: &[f64], nm: f64) -> (f64, f64) {
        let widths = BandWidths::new(BandSamplesArg::parse(text).unwrap(), chart_nm, false).unwrap();
        let BandRange { from_nm, to_nm, .. } = widths.of(nm).unwrap();
        (from_nm, to_nm)
    }

    #[test]
    fn bands_end_half_way_to_their_neighbours() {
        let chart = [700.0, 400.0, 410.0, 410.0, 430.0];
        assert_eq!(range("8", &chart, 410.0), (405.0, 420.0));
        assert_eq!(range("8", &chart, 400.0), (395.0, 405.0));
        assert_eq!(range("8", &chart, 700.0), (565.0, 835.0));
        assert_eq!(range("8,width=4", &chart, 410.0), (408.0, 412.0));
        assert_eq!(range("3,width=4", &[500.0], 500.0), (498.0, 502.0));
    }

    #[test]
    fn bands_without_a_width_or_at_several_distances_are_usage_errors() {
        let asked = BandSamplesArg::parse("4").unwrap();
        let error =
            |chart: &[f64], has_depth| BandWidths::new(asked, chart, has_depth).unwrap_err().to_string();
        assert!(error(&[500.0, 500.0], false).contains("`--band-samples 4,width=10`"));
        assert!(error(&[500.0, 600.0], true).contains("--depth none"));
        let wide = BandSamplesArg::parse("4,width=900").unwrap();
        let found = BandWidths::new(wide, &[400.0], false).unwrap().of(400.0).unwrap_err();
        assert!(found.to_string().contains("narrower width=NM"), "{found}");
    }
}
