//! `lenscube lens`: looking at lens packs.

use crate::args::{LensArgs, LensCommand};
use crate::{open, trace};
use anyhow::Result;
use formats::lens::{LensPack, summary};
use pipeline::lens::PsfSample;
use pipeline::psf::kernel::NodeKernels;
use pipeline::simd::Simd;

/// Runs the command.
pub fn command(args: &LensArgs) -> Result<()> {
    match &args.command {
        LensCommand::Show { lens, all_bands, json } => {
            let pack = open::lens(lens)?;
            let summary = summary(&pack, *all_bands, turning_error(&pack)?);
            match json {
                true => println!("{}", serde_json::to_string_pretty(&summary)?),
                false => println!("{summary}"),
            }
        }
        LensCommand::Trace(args) => return trace::command(args),
    }
    Ok(())
}

/// Estimated L1 error of turning an integrated pack's kernels at the primary wavelength; none for point samples.
pub fn turning_error(pack: &LensPack) -> Result<Option<f64>> {
    let lens = pack.lens();
    if lens.psf_sample != PsfSample::Integrated {
        return Ok(None);
    }
    let off = |b: usize| (lens.bands[b].wavelength_nm - lens.primary_wavelength_nm).abs();
    let Some(band) = (0..lens.bands.len()).min_by(|a, b| off(*a).total_cmp(&off(*b))) else {
        return Ok(None);
    };
    let kernels = NodeKernels::new(&pack.psf(band)?, lens.bands[band].psf_pitch_um, None, Simd::PORTABLE);
    Ok(Some(kernels.turning_error()))
}
