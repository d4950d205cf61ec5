//! Black, the two readings of dual conversion gain, and the knee points of companding: what fits the numbers of a converter.

use std::path::Path;

use super::SensorError;
use super::check::wrong;
use super::text::{CompandingText, DualGainText, SensorText};

/// Greatest linear number: that of 24 bits, which f32 holds exactly.
const MAX_LINEAR_DN: f64 = 16_777_215.0;
/// Knee points, at most.
const MAX_KNEES: usize = 64;
/// Greatest ratio of two conversion gains.
const MAX_RATIO: f64 = 1e4;

/// All numbers within their ranges.
pub(super) fn fields(path: &Path, t: &SensorText) -> Result<(), SensorError> {
    let a = &t.adc;
    let mut max_dn = f64::from((1u32 << a.bits) - 1);
    if let Some(curve) = &t.companding {
        companding(path, curve, max_dn)?;
        max_dn = curve.linear_dn.last().copied().unwrap_or(max_dn);
    }
    if let Some(dual) = &t.dual_gain {
        dual_gain(path, dual)?;
        max_dn = max_dn.min(f64::from((1u32 << dual.bits) - 1));
    }
    if !(0.0..=max_dn - 1.0).contains(&a.black_dn) {
        return Err(wrong(path, "adc.black_dn", format!("0 to {}", max_dn - 1.0), a.black_dn));
    }
    match &t.dual_gain {
        Some(dual) if dual.transition_dn.0 <= a.black_dn => {
            let expected = format!("numbers above the black of {} DN", a.black_dn);
            Err(wrong(path, "dual_gain.transition_dn", expected, dual.transition_dn.0))
        }
        _ => Ok(()),
    }
}

fn dual_gain(path: &Path, of: &DualGainText) -> Result<(), SensorError> {
    let fail = |field: &str, expected: String, found: f64| {
        Err(wrong(path, &format!("dual_gain.{field}"), expected, found))
    };
    if !(1.0..=MAX_RATIO).contains(&of.ratio) {
        return fail(
            "ratio",
            format!("the high conversion gain over the low one, 1 to {MAX_RATIO}"),
            of.ratio,
        );
    }
    if !(1..=16).contains(&of.bits) {
        return fail("bits", "1 to 16".into(), of.bits.into());
    }
    if !(0.0..=1e6).contains(&of.read_noise_e) {
        return fail("read_noise_e", "0 to 1000000".into(), of.read_noise_e);
    }
    let max_dn = f64::from((1u32 << of.bits) - 1);
    let (first, last) = of.transition_dn;
    match first <= last && last < max_dn {
        true => Ok(()),
        false => Err(wrong(
            path,
            "dual_gain.transition_dn",
            format!("two numbers of the high gain's reading, ascending, below its last of {max_dn} DN"),
            format!("[{first}, {last}]"),
        )),
    }
}

fn companding(path: &Path, of: &CompandingText, max_dn: f64) -> Result<(), SensorError> {
    let (x, y) = (&of.linear_dn, &of.coded_dn);
    let fail = |field: &str, expected: String, found: String| {
        Err(wrong(path, &format!("companding.{field}"), expected, found))
    };
    if x.len() != y.len() || !(2..=MAX_KNEES).contains(&x.len()) {
        let expected = format!("as many numbers as coded_dn, 2 to {MAX_KNEES}");
        return fail("linear_dn", expected, format!("{} and {}", x.len(), y.len()));
    }
    for (field, values, last) in [("linear_dn", x, MAX_LINEAR_DN), ("coded_dn", y, max_dn)] {
        let ascending = values[0] == 0.0 && values.is_sorted_by(|a, b| a < b);
        if !ascending || values.iter().any(|v| !v.is_finite()) || values[values.len() - 1] > last {
            let expected = format!("numbers that ascend from 0 to at most {last}");
            return fail(field, expected, format!("{values:?}"));
        }
    }
    for (x, y) in x.windows(2).zip(y.windows(2)) {
        if x[1] - x[0] < y[1] - y[0] {
            let expected = format!("at most as many numbers from {} to {} DN as linear_dn has", x[0], x[1]);
            return fail("coded_dn", expected, format!("{} for {}", y[1] - y[0], x[1] - x[0]));
        }
    }
    Ok(())
}
