//! Raws of a sensor: frames and their development; raws of other cameras.

pub mod dng;
pub mod frame;
mod noise;
pub mod recipe;
pub mod shading;

use crate::args::DevelopStyle;
use crate::failure::usage;
use anyhow::Result;
use frame::Frame;
use pipeline::develop::Development;
use pipeline::geometry::Rect;
use shading::ShadingSource;

/// A development of a frame, ready to make strips of rows.
pub struct Developer {
    /// The frame.
    pub frame: Frame,
    development: Development,
    shading: ShadingSource,
    /// White, demosaicing and matrix.
    pub description: String,
}

impl Developer {
    /// Resolves `style` for a frame. `cache`: bytes of decoded chunks of a flat.
    pub fn new(frame: Frame, style: &DevelopStyle, threads: usize, cache: usize) -> Result<Self> {
        let named = recipe::resolve(&frame, style, threads)?;
        let origin = (frame.rect.y as usize, frame.rect.x as usize);
        let development = Development::new(named.recipe, origin).map_err(|e| usage(e.to_string()))?;
        let bin = style.bin == 2;
        let shading = ShadingSource::open(&style.shading, &frame, &development, bin, threads, cache)?;
        Ok(Self { frame, development, shading, description: named.description })
    }

    /// Rectangle of the whole picture.
    pub fn rect(&self) -> Rect {
        self.development.size().rect()
    }

    /// Channels of the picture.
    pub fn channels(&self) -> usize {
        self.development.channels()
    }

    /// Linear values of a part of the picture.
    pub fn linear(&self, part: Rect) -> Result<Vec<f32>> {
        let needs = self.development.needs(part);
        let (raw, flat) = (self.frame.read(needs)?, self.shading.read(needs)?);
        Ok(self.development.develop(&raw, self.shading.with(&flat), part))
    }
}
