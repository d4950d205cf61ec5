//! Lens files: readers, writers, the built-in lenses.

extern crate pipeline as lenscube_pipeline;

mod asymmetric;
mod builtin;
mod chain;
mod ideal;
mod mirrors;
mod survival;
mod zmx;

#[path = "../../../pipeline/tests/design_cases/mod.rs"]
mod design_cases;
#[path = "../../../pipeline/tests/lens_suite/suite.rs"]
mod suite;
