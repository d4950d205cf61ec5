//! Tests of the tracer against closed forms, the symmetric tracer and the model (`fields_reference.py`).

mod asymmetric;
mod closed_forms;
pub(super) mod lenses;
mod maps;
mod nominal;
mod psfs;
mod symmetries;
mod tables;
