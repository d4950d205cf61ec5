//! `lenscube lens`: making, showing and comparing lenses; where a run's lens comes from.

pub mod cache;
mod diff;
pub mod look;
mod plots;
mod show;
pub mod source;

use crate::args::{LensArgs, LensCommand};
use crate::{import, trace};
use anyhow::Result;
use formats::lens::LensPack;
use pipeline::lens::PsfSample;
use pipeline::psf::kernel::NodeKernels;
use pipeline::simd::Simd;

/// Runs the command.
pub fn command(args: &LensArgs) -> Result<()> {
    match &args.command {
        LensCommand::Show(args) => show::command(args),
        LensCommand::Diff(args) => diff::command(args),
        LensCommand::Trace(args) => trace::command(args),
        LensCommand::Import(args) => import::command(args),
    }
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
