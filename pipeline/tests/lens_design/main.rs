//! Designs against closed forms, and the tables and PSFs traced from them.

#[path = "../design_cases/mod.rs"]
mod design_cases;

mod ideal;
mod light_budget;
mod mirrors;
mod physics;
mod tables;
mod trace;
