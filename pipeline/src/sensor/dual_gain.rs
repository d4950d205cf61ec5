//! Dual conversion gain: a pixel read twice from one exposure, and both readings combined on the die into one linear number.
//!
//! Of the charge (e-, with what is the same in both readings: DSNU, reset noise, defects, columns and rows), two independent read noises and two of the converter, K the conversion of the high gain, ρ the ratio of the gains, b black:
//!
//! ```text
//! n_h = ⌊b + g·K·(charge + read·z) + adc·z + ½⌋                      high conversion gain,  0 … 2^bits − 1
//! n_l = ⌊b + g·K/ρ·(charge + read_low·z) + adc·z + ½⌋                low conversion gain,   0 … 2^bits − 1
//! w   = 0 where n_h ≤ first, 1 where n_h ≥ last, linear between      (first = last: a threshold)
//! x   = b + (1 − w)·(n_h − b) + w·ρ·(n_l − b)                         the linear number, DN of the high gain
//! ```
//!
//! So the dark has the noise of the high gain and the range is that of the low one, in steps of ρ DN. The choice is that of the number n_h, noise included, as a comparator on the die makes it: at a threshold the mean is lower by at most 0.4 standard deviations of the high gain's read noise.
//! Source: the principle is that of dual-gain column readouts, B. Fowler et al., Proc. SPIE 7536, 753607 (2010). Left out: a full well of the high gain below that of the low one, other offsets and gains of columns in the low gain, its lateral-overflow variants with their own exposure.

/// The low conversion gain and how both readings are combined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DualGain {
    /// ρ: high conversion gain over the low one.
    pub ratio: f64,
    /// Bits of each reading's converter.
    pub bits: u32,
    /// Read noise of the low conversion gain, e-.
    pub read_noise_e: f64,
    /// Numbers of the high gain's reading between which the linear number changes to that of the low one, DN.
    pub transition_dn: (f64, f64),
}

impl DualGain {
    /// The greatest number of a reading.
    pub fn max_dn(&self) -> f64 {
        ((1u32 << self.bits) - 1).into()
    }

    /// w: share of the low gain at a number of the high one.
    #[inline(always)]
    pub fn share(&self, high_dn: f64) -> f64 {
        share(self.transition_dn, high_dn)
    }

    /// The linear number of two readings, which are rounded and limited here.
    #[inline(always)]
    pub fn combined(&self, high_dn: f64, low_dn: f64, black_dn: f64) -> f64 {
        let max_dn = self.max_dn();
        let (high, low) = (whole(high_dn, max_dn), whole(low_dn, max_dn));
        let w = self.share(high);
        black_dn + (1.0 - w) * (high - black_dn) + w * self.ratio * (low - black_dn)
    }
}

/// w of a transition at a number of the high gain.
#[inline(always)]
pub fn share((first, last): (f64, f64), high_dn: f64) -> f64 {
    if high_dn <= first {
        0.0
    } else if high_dn >= last {
        1.0
    } else {
        (high_dn - first) / (last - first)
    }
}

/// A number rounded to a whole one of 0 to `max_dn`.
#[inline(always)]
pub(super) fn whole(dn: f64, max_dn: f64) -> f64 {
    let rounded = (dn + 0.5).floor();
    let low = if rounded > 0.0 { rounded } else { 0.0 };
    if low < max_dn { low } else { max_dn }
}

#[cfg(test)]
mod tests;
