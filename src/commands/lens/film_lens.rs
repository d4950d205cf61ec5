//! A lens at places of its film: the bands of a pack, or of a design those that are traced for it.

use super::comparison::WAVELENGTH_TOLERANCE_NM;
use crate::failure::usage;
use anyhow::Result;
use formats::lens::LensPack;
use pipeline::design::System;
use pipeline::design::trace::{LensTrace, TraceOptions};
use pipeline::figures::on_film::BandOnFilm;
use pipeline::lens::{Lens, PsfStack};

/// A lens with its bands and their PSFs.
pub struct FilmLens {
    pub lens: Lens,
    psfs: Psfs,
}

enum Psfs {
    Pack(Box<LensPack>),
    /// Of each band, of a lens with rotational symmetry.
    Traced(Vec<PsfStack>),
}

impl FilmLens {
    /// The lens of a pack that was opened as `name`.
    ///
    /// # Errors
    /// Usage: a pack with depth nodes.
    pub fn of_pack(name: &str, pack: LensPack) -> Result<Self> {
        match pack.lens().depth {
            None => Ok(Self { lens: pack.lens().clone(), psfs: Psfs::Pack(Box::new(pack)) }),
            Some(_) => Err(usage(format!(
                "`{name}` has depth nodes: expected a lens of one object distance beside a lens without rotational symmetry"
            ))),
        }
    }

    /// `system`, traced as `options` say.
    ///
    /// # Errors
    /// As [`LensTrace`].
    pub fn traced(system: &System, options: &TraceOptions) -> Result<Self> {
        let trace = LensTrace::new(system, options)?;
        let mut stacks = Vec::new();
        let lens = trace.all(&mut |_| (), |_, band| {
            stacks.push(band.psf);
            Ok::<_, std::convert::Infallible>(())
        })?;
        Ok(Self { lens, psfs: Psfs::Traced(stacks) })
    }

    /// Index of the band at `nm`.
    ///
    /// # Errors
    /// Usage: there is none.
    pub fn band(&self, name: &str, nm: f64) -> Result<usize> {
        let is = |band_nm: f64| (band_nm - nm).abs() < WAVELENGTH_TOLERANCE_NM;
        self.lens.bands.iter().position(|band| is(band.wavelength_nm)).ok_or_else(|| {
            let all: Vec<f64> = self.lens.bands.iter().map(|band| band.wavelength_nm).collect();
            let list = pipeline::wavelengths::format(&all);
            usage(format!("{name} has no band at {nm} nm; its bands are at {list} nm"))
        })
    }

    /// The kernel of `film`, band `band` of the lens, at a place of the film: side and pixels.
    ///
    /// # Errors
    /// A PSF cannot be read.
    pub fn kernel(
        &self,
        band: usize,
        film: &BandOnFilm<'_>,
        place_mm: [f64; 2],
    ) -> Result<(usize, Vec<f32>)> {
        film.kernel(place_mm, self.lens.psf_sample, |set| match &self.psfs {
            Psfs::Pack(pack) => Ok(pack.psfs_of_sets(band, 0, set..set + 1, 1)?),
            Psfs::Traced(stacks) => Ok(stacks[band].window(set).to_vec()),
        })
    }
}
