//! The layers of light that have a switch of their own, one row each: the stages, layers and identity of jobs are made from them.

use super::inputs::Inputs;
use super::layers::JobLayer;
use super::lens::UntracedLens;
use super::veil;
use crate::args::RunArgs;
use anyhow::Result;
use pipeline::stage::{Stage, Stages};
use serde_json::{Map, Value};

/// A layer, if the arguments ask for it: computed by as many threads.
type Made = Result<Option<Box<dyn JobLayer>>>;

/// A layer with a switch of its own.
struct OwnLayer {
    stage: Stage,
    is_on: fn(&RunArgs) -> bool,
    make: fn(&RunArgs, &Inputs, &UntracedLens, usize) -> Made,
    /// What it adds to the identity of a job; nothing where it is off.
    identity: fn(&RunArgs, &Inputs) -> Map<String, Value>,
}

/// All, in the order in which their light is added.
static OWN_LAYERS: [OwnLayer; 1] = [OwnLayer {
    stage: Stage::Veil,
    is_on: |args| args.veil.is_on(),
    make: veil::layer,
    identity: veil::identity,
}];

/// The stages `chosen` by `--stages`, and those of the layers that are on.
pub fn with_layers(chosen: Stages, args: &RunArgs) -> Stages {
    let on = OWN_LAYERS.iter().filter(|layer| (layer.is_on)(args));
    on.fold(chosen, |stages, layer| stages.with(layer.stage))
}

/// The layers of a job.
///
/// # Errors
/// Usage: arguments that contradict each other or do not fit film and lens.
pub fn layers(
    args: &RunArgs,
    inputs: &Inputs,
    lens: &UntracedLens,
    threads: usize,
) -> Result<Vec<Box<dyn JobLayer>>> {
    OWN_LAYERS.iter().filter_map(|layer| (layer.make)(args, inputs, lens, threads).transpose()).collect()
}

/// What they add to the identity of a job.
pub fn identity(args: &RunArgs, inputs: &Inputs) -> Map<String, Value> {
    OWN_LAYERS.iter().flat_map(|layer| (layer.identity)(args, inputs)).collect()
}
