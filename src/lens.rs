//! `lenscube lens`: creates, shows and compares lenses; the lens of a run.

mod aberrations;
pub mod cache;
mod camera;
pub mod convert;
mod cross_section;
mod curves;
mod diff;
mod list;
pub mod plots;
mod psf_figure;
pub mod samples;
mod show;
mod shown;
pub mod source;
mod spot_figure;

use crate::args::{LensArgs, LensCommand};
use crate::{import, trace};
use anyhow::Result;
pub use curves::short_number;
use formats::lens::LensPack;
use pipeline::lens::PsfSample;
use pipeline::psf::kernel::NodeKernels;
use pipeline::simd::Simd;

/// Runs the command.
pub fn command(args: &LensArgs) -> Result<()> {
    match &args.command {
        LensCommand::Show(args) => show::command(args),
        LensCommand::Diff(args) => diff::command(args),
        LensCommand::Camera(args) => camera::command(args),
        LensCommand::List(args) => list::command(args),
        LensCommand::Convert(args) => convert::command(args),
        LensCommand::Trace(args) => trace::command(args),
        LensCommand::Import(args) => import::command(args),
    }
}

/// Estimated L1 error of rotating the kernels of an integrated pack at the primary wavelength; none for point samples.
pub fn rotation_error(pack: &LensPack) -> Result<Option<f64>> {
    let lens = pack.lens();
    if lens.psf_sample != PsfSample::Integrated || lens.bands.is_empty() {
        return Ok(None);
    }
    let band = samples::nearest_band(&lens.bands, lens.primary_wavelength_nm);

    let kernels = NodeKernels::new(&pack.psf(band)?, lens.bands[band].psf_pitch_um, None, Simd::PORTABLE);
    Ok(Some(kernels.rotation_error()))
}
