//! Camera models of a lens ([`pipeline::camera_model`]) as the files of the programs that have them.
//!
//! | file | written by | first pixel's centre |
//! |---|---|---|
//! | YAML of OpenCV's FileStorage | [`opencv::yaml`] | 0 |
//! | `cameras.txt` of COLMAP | [`colmap::cameras`] | 0.5 |
//! | rig of DriveWorks, JSON | [`rig::json`] | 0.5 |
//! | database of lensfun, XML | [`lensfun::xml`] | |
//! | table, CSV | [`table::csv`] | |
//!
//! Numbers have all digits of their f64.

pub mod colmap;
pub mod lensfun;
pub mod opencv;
pub mod rig;
pub mod table;

/// `name` without control characters and quotes, on one line.
fn plain(name: &str) -> String {
    name.chars().map(|c| if c.is_control() || matches!(c, '"' | '\\') { ' ' } else { c }).collect()
}

/// Numbers with spaces between them.
fn spaced(values: impl IntoIterator<Item = f64>) -> String {
    values.into_iter().map(|v| v.to_string()).collect::<Vec<_>>().join(" ")
}
