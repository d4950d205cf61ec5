//! The description of a sensor.

use crate::failure::usage;
use anyhow::Result;
use formats::sensor::{SensorError, SensorFile};

/// The sensor of a name or path, with `--set` applied.
pub fn open_sensor(name: &str, set: &[String]) -> Result<SensorFile> {
    SensorFile::open(name, set).map_err(|e| match e {
        SensorError::Storage(_) => e.into(),
        e => usage(e.to_string()),
    })
}
