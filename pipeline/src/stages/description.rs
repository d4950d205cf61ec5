//! What each stage says of itself: the switch, the identity of a job, devices, memory and cost are made from these rows.
//!
//! The remap stage itself, reading, overlap-add, encoding and writing belong to every film; `clock::Phase` lists what is timed, them and
//! stages.

use crate::band::BandPlan;
use crate::psf::memory;
use crate::stage::{Stage, Stages};

/// Seconds per PSF sample of making a band's kernels, from 1.6 s for 21 million samples of 31 traced bands.
const KERNEL_S: f64 = 76e-9;

/// Adding a layer to a film pixel, ns.
const LAYER_NS: f64 = 0.8;

/// One stage.
#[derive(Debug)]
pub struct Description {
    /// Which.
    pub stage: Stage,
    /// Its name in `--stages`, in the identity of jobs and in records.
    pub name: &'static str,
    /// One line of help.
    pub help: &'static str,
    /// Whether it is applied without `--stages`.
    pub on_by_default: bool,
    /// Flags of its own that switch it on, in place of `--stages`; empty: it has none.
    pub flags: &'static str,
    /// Whether an identity names it also where it is off. A later stage is absent there: films without it keep their digests.
    pub always_in_identity: bool,
    /// Whether GPUs compute it; else a job with it is computed on the CPU.
    pub on_gpus: bool,
    /// Film pixels around a tile that its light reaches: rows of film that are in memory. The margin of tiles is that of the PSF (`tiling`).
    pub reach_px: fn(&BandPlan) -> usize,
    /// Bytes of one worker's scratch.
    pub scratch_bytes: fn(&BandPlan) -> usize,
    /// Bytes of a band's tables while the band is computed.
    pub table_bytes: fn(&BandPlan) -> usize,
    /// Cost on a 2.2 GHz Xeon with AVX-512.
    pub cost: fn(&BandPlan) -> Cost,
}

/// Cost of a stage, in seconds of one core.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cost {
    /// Nanoseconds per film pixel.
    pub pixel_ns: f64,
    /// Seconds per band.
    pub band_s: f64,
}

/// All stages, in the order in which light passes them.
pub static DESCRIPTIONS: [Description; 4] = [
    Description { stage: Stage::Ri, name: "ri", help: "Relative illumination", ..OF_REMAP },
    Description { stage: Stage::Distortion, name: "distortion", help: "Radial distortion", ..OF_REMAP },
    Description {
        stage: Stage::Svpsf,
        name: "svpsf",
        help: "Spatially variant PSF",
        on_by_default: true,
        flags: "",
        always_in_identity: true,
        on_gpus: true,
        reach_px: |plan| plan.depth.as_ref().map_or(plan.tiling.margin(), |depth| depth.reach),
        scratch_bytes: |plan| {
            let between =
                plan.grid.as_ref().map_or(0, |grid| memory::interpolation_bytes(grid, plan.samples.size));
            between + plan.blocks.map_or(0, |blocks| memory::scratch_bytes(&blocks, plan.samples.size))
        },
        table_bytes: |plan| if plan.reads_on_demand() { 0 } else { plan.kernels_bytes() },
        cost: |plan| {
            let Some((blocks, grid)) = plan.blocks.zip(plan.grid.as_ref()) else { return Cost::default() };
            let samples = plan.lens.psf_count() * plan.samples.size.pow(2);
            Cost { pixel_ns: blocks.cost_ns(grid), band_s: samples as f64 * KERNEL_S }
        },
    },
    Description {
        stage: Stage::Veil,
        name: "veil",
        help: "Scatter, veiling glare and ghosts",
        on_by_default: false,
        flags: "--veiling-glare, --scatter, --ghosts",
        always_in_identity: false,
        on_gpus: true,
        // A layer: its memory and the cost of making it are those of the job's layers.
        cost: |_| Cost { pixel_ns: LAYER_NS, band_s: 0.0 },
        ..OF_REMAP
    },
];

/// A stage of the remap stage, which needs nothing more for it.
const OF_REMAP: Description = Description {
    stage: Stage::Ri,
    name: "",
    help: "",
    on_by_default: true,
    flags: "",
    always_in_identity: true,
    on_gpus: true,
    reach_px: |_| 0,
    scratch_bytes: |_| 0,
    table_bytes: |_| 0,
    cost: |_| Cost::default(),
};

/// The stages of a film without `--stages`.
pub fn default_stages() -> Stages {
    Stages::of(&DESCRIPTIONS.iter().filter(|d| d.on_by_default).map(|d| d.stage).collect::<Vec<_>>())
}

/// The flags that switch on the stage of name `name`; nothing if it has none.
pub fn flags_of(name: &str) -> &'static str {
    DESCRIPTIONS.iter().find(|stage| stage.name == name).map_or("", |stage| stage.flags)
}

/// The descriptions of `stages`.
pub fn described(stages: Stages) -> impl Iterator<Item = &'static Description> {
    DESCRIPTIONS.iter().filter(move |d| stages.has(d.stage))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stage_is_described_once_under_a_name_of_its_own() {
        for (i, description) in DESCRIPTIONS.iter().enumerate() {
            assert_eq!(description.stage as usize, i, "{} stands in another place", description.name);
            assert!(!description.name.is_empty() && !description.help.is_empty());
            let same = DESCRIPTIONS.iter().filter(|d| d.name == description.name).count();
            assert_eq!(same, 1, "{}", description.name);
        }
    }

    #[test]
    fn a_set_has_the_stages_that_it_was_made_of() {
        let all = default_stages();
        assert!(DESCRIPTIONS.iter().all(|d| all.has(d.stage) == d.flags.is_empty()));
        let with = all.with(Stage::Veil);
        assert!(with.has(Stage::Veil) && with != all && with.without(Stage::Veil) == all);
        let without = all.without(Stage::Svpsf);
        assert!(without.has(Stage::Ri) && without.has(Stage::Distortion) && !without.has(Stage::Svpsf));
        assert_eq!(Stages::of(&[Stage::Ri, Stage::Distortion]), without);
        assert_eq!(described(without).map(|d| d.name).collect::<Vec<_>>(), ["ri", "distortion"]);
    }
}
