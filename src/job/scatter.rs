//! Scatter of a job: its share of the light in each band, given or of the roughness of a design's surfaces.

use crate::args::{MAX_SHARE, MAX_SUM, RunArgs, ScatterAmount, ScatterArg};
use crate::failure::usage;
use crate::job::lens::UntracedLens;
use crate::progress::number;
use anyhow::Result;
use formats::object;
use pipeline::design::roughness::scattered_share;
use serde_json::{Value, json};

/// Scatter of a job.
#[derive(Clone, Debug, PartialEq)]
pub struct JobScatter {
    /// As it was asked for.
    pub asked: ScatterArg,
    /// Share of the light per band of the film.
    pub shares: Vec<f64>,
}

impl JobScatter {
    /// That of `args` in bands of `wavelengths_nm`; `None` without scatter.
    ///
    /// # Errors
    /// Usage: roughness of a lens whose surfaces are not known; so much scatter, alone or with glare, that no image remains. A wavelength outside the range
    /// of a glass.
    pub fn new(args: &RunArgs, lens: &UntracedLens, wavelengths_nm: &[f64]) -> Result<Option<Self>> {
        let Some(asked) = args.veil.scattered() else { return Ok(None) };
        let shares: Vec<f64> = match asked.amount {
            ScatterAmount::Share(share) => vec![share; wavelengths_nm.len()],
            ScatterAmount::RoughnessNm(rms_nm) => {
                let UntracedLens::Design(design) = lens else {
                    return Err(usage(format!(
                        "--scatter {asked}: the roughness is that of a design's surfaces, lens `{}` is a lens pack; give the share of the light, --scatter SHARE",
                        args.lens
                    )));
                };
                let share = |nm: &f64| scattered_share(&design.system, rms_nm, *nm);
                wavelengths_nm.iter().map(share).collect::<Result<_, _>>()?
            }
        };
        let glare = args.veil.glare();
        for (nm, share) in std::iter::zip(wavelengths_nm, &shares) {
            let at = format!("at {} nm", number(*nm));
            if *share >= MAX_SHARE {
                return Err(usage(format!(
                    "--scatter {asked}: {at} {:.1} % of the light are scattered, expected below {}%",
                    100.0 * share,
                    100.0 * MAX_SHARE
                )));
            }
            if glare + share >= MAX_SUM {
                return Err(usage(format!(
                    "--veiling-glare and --scatter spread {} of the light {at}, expected less than {MAX_SUM}",
                    glare + share
                )));
            }
        }
        Ok(Some(Self { asked, shares }))
    }

    /// The shares, one number if all bands have the same.
    pub fn described(&self) -> Value {
        match self.shares.as_slice() {
            [first, others @ ..] if others.iter().all(|share| share == first) => json!(first),
            all => json!(all),
        }
    }

    /// What it adds to the identity of the job.
    pub fn identity(&self) -> Value {
        let ScatterArg { amount, shoulder_um, slope, reach_mm } = self.asked;
        let mut map = object! {
            "share": self.described(),
            "r0_um": shoulder_um,
            "slope": slope,
            "reach_mm": reach_mm,
        };
        if let ScatterAmount::RoughnessNm(nm) = amount {
            map.insert("roughness_nm".into(), nm.into());
        }
        map.into()
    }
}
