//! The stages of a film that can be switched off, and sets of them. [`crate::stages::DESCRIPTIONS`] describes each.

/// A stage that can be switched off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Relative illumination.
    Ri,
    /// Radial distortion.
    Distortion,
    /// Spatially variant PSF.
    Svpsf,
    /// Scatter and veiling glare.
    Veil,
}

impl Stage {
    /// Those that the remap stage computes.
    pub const REMAP: &[Self] = &[Self::Ri, Self::Distortion];
    /// Those and the PSF.
    pub const REMAP_AND_PSF: &[Self] = &[Self::Ri, Self::Distortion, Self::Svpsf];
}

/// A set of stages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stages(u32);

impl Stages {
    /// Those in `stages`.
    pub const fn of(stages: &[Stage]) -> Self {
        let (mut set, mut i) = (0, 0);
        while i < stages.len() {
            set |= 1 << stages[i] as u32;
            i += 1;
        }
        Self(set)
    }

    /// These and `stage`.
    pub const fn with(self, stage: Stage) -> Self {
        Self(self.0 | 1 << stage as u32)
    }

    /// These without `stage`.
    pub const fn without(self, stage: Stage) -> Self {
        Self(self.0 & !(1 << stage as u32))
    }

    /// Whether `stage` is one of them.
    pub const fn has(self, stage: Stage) -> bool {
        self.0 & 1 << stage as u32 != 0
    }
}
