//! Tests of the program from outside that need no harness of their own: a module for each subject.

#[path = "../common/mod.rs"]
mod common;

mod addresses;
mod arrays;
mod bad_input;
mod band_samples;
mod bounds;
mod chart_motion;
mod check_input;
mod dataset;
mod depth;
mod depth_cells;
mod depth_edges;
mod depth_inputs;
mod depth_nodes;
mod depth_report;
mod depth_scene;
mod develop;
mod export;
mod faults;
mod formats;
mod ghosts;
mod import;
mod import_field;
mod invariance;
mod lens;
mod outputs;
mod plan;
mod pyramid;
mod replaced;
mod report;
mod restore;
mod resume;
mod run_output;
#[cfg(feature = "mesh")]
mod scene;
mod sensor;
mod tails;
mod terminal;
mod validate;
mod veil;
mod view;
