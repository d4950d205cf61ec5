//! Scatter and veiling glare: flags of a job.

use super::ghosts::GhostArgs;
use super::values::{bounded, number, percent_or_number};
use clap::Args;
use pipeline::bounds::{Bound, ROUGHNESS_NM, SCATTER_REACH_MM, SCATTER_SHOULDER_UM, SCATTER_SLOPE};
use std::fmt;

/// Group of these flags in help.
const HEADING: &str = "Light beside the image";
/// Share of the light below which the image remains the larger part of it.
pub const MAX_SHARE: f64 = 0.5;
/// Sum of the shares below which an image remains.
pub const MAX_SUM: f64 = 0.9;

/// Light that spreads far over the film. Without flags as by default: none.
#[derive(Clone, Debug, Default, PartialEq, Args)]
pub struct VeilArgs {
    /// Share of the light that is spread evenly over the film, e.g. 1% or 0.01: veiling glare besides scatter [default: 0]
    #[arg(long, value_name = "SHARE", value_parser = light_share, help_heading = HEADING)]
    pub veiling_glare: Option<f64>,
    /// Share of the light that is scattered, e.g. 0.3% or 0.003,r0=20,slope=2.5,reach=10; of a design roughness=NM instead of SHARE, the RMS roughness of
    /// its surfaces. The shoulder r0 in µm and the reach in mm on the film, and the slope of the fall with distance [default: 0; r0=20, slope=2.5,
    /// reach: half the film's diagonal]
    #[arg(long, value_name = "SHARE|roughness=NM[,r0=UM][,slope=S][,reach=MM]", value_parser = ScatterArg::parse, help_heading = HEADING)]
    pub scatter: Option<ScatterArg>,
    /// Film pixels on a side of the bins on which this light is computed: 8, 16, 32, 64 or auto (at most 512 bins along the film) [default: auto]
    #[arg(long, value_name = "PX", value_parser = bin, help_heading = HEADING)]
    pub veil_bin: Option<BinArg>,
    /// Ghosts.
    #[command(flatten)]
    pub ghosts: GhostArgs,
}

/// `--veil-bin`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BinArg {
    /// That of the film's size.
    Auto,
    /// Film pixels.
    Px(usize),
}

/// How much of the light is scattered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ScatterAmount {
    /// A share, at all wavelengths.
    Share(f64),
    /// What surfaces of this RMS roughness in nm scatter.
    RoughnessNm(f64),
}

/// `--scatter`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScatterArg {
    /// How much of the light.
    pub amount: ScatterAmount,
    /// Shoulder, µm on the film.
    pub shoulder_um: f64,
    /// Slope.
    pub slope: f64,
    /// Reach, mm on the film.
    pub reach_mm: Option<f64>,
}

impl fmt::Display for ScatterArg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.amount {
            ScatterAmount::Share(share) => write!(f, "{share}")?,
            ScatterAmount::RoughnessNm(nm) => write!(f, "roughness={nm}")?,
        }
        write!(f, ",r0={},slope={}", self.shoulder_um, self.slope)?;
        self.reach_mm.map_or(Ok(()), |mm| write!(f, ",reach={mm}"))
    }
}

impl ScatterArg {
    /// Parses `SHARE|roughness=NM[,r0=UM][,slope=S][,reach=MM]`.
    fn parse(text: &str) -> Result<Self, String> {
        let mut parts = text.split(',').map(str::trim);
        let first = parts.next().unwrap_or_default();
        let amount = match first.split_once('=') {
            Some(("roughness", nm)) => ScatterAmount::RoughnessNm(bounded(ROUGHNESS_NM)(nm)?),
            _ => ScatterAmount::Share(light_share(first)?),
        };
        let mut scatter = Self { amount, shoulder_um: 20.0, slope: 2.5, reach_mm: None };
        let mut given = Vec::new();
        for part in parts {
            let expected = "expected SHARE|roughness=NM[,r0=UM][,slope=S][,reach=MM]";
            let (name, value) = part.split_once('=').ok_or(expected)?;
            if given.contains(&name) {
                return Err(format!("{name} is given twice"));
            }
            given.push(name);
            let within = |bound: Bound| bound.check(number(value)?).map_err(|e| e.to_string());
            match name {
                "r0" => scatter.shoulder_um = within(SCATTER_SHOULDER_UM)?,
                "slope" => scatter.slope = within(SCATTER_SLOPE)?,
                "reach" => scatter.reach_mm = Some(within(SCATTER_REACH_MM)?),
                _ => return Err(format!("`{name}` is not a part of it: {expected}")),
            }
        }
        Ok(scatter)
    }
}

impl BinArg {
    /// The largest bins, film pixels.
    pub const LARGEST_PX: usize = 64;
}

impl VeilArgs {
    /// Share of glare.
    pub fn glare(&self) -> f64 {
        self.veiling_glare.unwrap_or(0.0)
    }

    /// Scatter, if there is any.
    pub fn scattered(&self) -> Option<ScatterArg> {
        self.scatter.filter(|scatter| match scatter.amount {
            ScatterAmount::Share(amount) | ScatterAmount::RoughnessNm(amount) => amount > 0.0,
        })
    }

    /// Whether any light is spread, or there are ghosts.
    pub fn is_on(&self) -> bool {
        self.glare() > 0.0 || self.scattered().is_some() || self.ghosts.is_on()
    }

    /// Why the flags contradict each other, if they do.
    pub fn contradiction(&self) -> Option<String> {
        let is_given = matches!(self.veil_bin, Some(BinArg::Px(_)));
        let bin = (is_given && !self.is_on())
            .then(|| "--veil-bin requires --veiling-glare, --scatter or --ghosts on".into());
        self.ghosts.contradiction().or(bin)
    }
}

/// A share of the light: `1%` or `0.01`.
fn light_share(text: &str) -> Result<f64, String> {
    let share = percent_or_number(text)?;
    match (0.0..MAX_SHARE).contains(&share) {
        true => Ok(share),
        false => Err(format!("{text} is not a share of the light from 0 to below {}%", 100.0 * MAX_SHARE)),
    }
}

fn bin(text: &str) -> Result<BinArg, String> {
    match text {
        "auto" => Ok(BinArg::Auto),
        "8" | "16" | "32" | "64" => Ok(BinArg::Px(text.parse().expect("a number"))),
        _ => Err("expected 8, 16, 32, 64 or auto".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_percent_or_a_number() {
        assert_eq!([light_share("1%"), light_share("0.01"), light_share("0")], [Ok(0.01), Ok(0.01), Ok(0.0)]);
        for wrong in ["50%", "-1%", "0.5", "%", "one"] {
            assert!(light_share(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn scatter_has_a_shape_and_bounds() {
        let usual =
            ScatterArg { amount: ScatterAmount::Share(0.003), shoulder_um: 20.0, slope: 2.5, reach_mm: None };
        assert_eq!(ScatterArg::parse("0.3%"), Ok(usual));
        let given = ScatterArg { shoulder_um: 50.0, slope: 2.0, reach_mm: Some(3.5), ..usual };
        assert_eq!(ScatterArg::parse("0.3%,slope=2,r0=50,reach=3.5"), Ok(given));
        assert_eq!(ScatterArg::parse(&given.to_string()), Ok(given));
        let rough = ScatterArg { amount: ScatterAmount::RoughnessNm(1.5), ..given };
        assert_eq!(ScatterArg::parse("roughness=1.5,slope=2,r0=50,reach=3.5"), Ok(rough));
        assert_eq!(ScatterArg::parse(&rough.to_string()), Ok(rough));
        for wrong in [
            "roughness=-1",
            "roughness=",
            "0.3%,roughness=1",
            "0.3%,slope=1",
            "0.3%,slope=4.1",
            "0.3%,r0=0.5",
            "0.3%,reach=0",
            "0.3%,r0",
            "0.3%,r0=9,r0=9",
            "0.3%,s=2",
        ] {
            assert!(ScatterArg::parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn bins_belong_to_light() {
        let bin = VeilArgs { veil_bin: Some(BinArg::Px(8)), ..VeilArgs::default() };
        assert!(bin.contradiction().is_some() && !bin.is_on());
    }
}
