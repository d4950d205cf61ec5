//! The picture of the light around a scene.

use super::prepared::check_memory;
use crate::args::LookArgs;
use crate::failure::usage;
use crate::machine::MemoryLimit;
use crate::progress::log_line;
use anyhow::{Context, Result};
use formats::chart::image::{ImageFile, Transfer};
use pipeline::scene::horizon::Horizon;
use pipeline::scene::light::environment::Environment;

/// The light of `--environment`; none without it.
///
/// # Errors
/// A picture that cannot be read, is too large for the memory, or holds no light.
pub fn environment(look: &LookArgs, limit: &MemoryLimit, horizon: Horizon) -> Result<Option<Environment>> {
    let Some(given) = &look.environment else { return Ok(None) };
    let flag = format!("--environment {}", given.path.display());
    let file = ImageFile::open(&given.path).with_context(|| flag.clone())?;
    if file.spectral().is_some() {
        return Err(usage(format!("{flag}: expected red, green and blue, found spectral channels")));
    }
    file.notes().iter().for_each(|note| log_line(format!("note: {note}")));
    let (size, is_grey) = (file.size(), file.is_grey());
    let pixels = size.pixels();
    // Channels as they are read, and the map.
    check_memory(limit, 2 * pixels * size_of::<[f32; 3]>() + file.decoder_bytes(), &flag)?;
    let channels = file.linear_part(Transfer::Srgb, size.rect()).with_context(|| flag.clone())?;
    let channel = |c: usize| if is_grey { 0 } else { c * pixels };
    let values = (0..pixels).map(|k| std::array::from_fn(|c| channels[channel(c) + k])).collect();
    let lx = given.illuminance_lx.unwrap_or(look.illuminance);
    let turned_deg = look.environment_azimuth.unwrap_or(0.0);
    let map = Environment::new((size.height, size.width), values, lx, (horizon, turned_deg));
    Ok(Some(map.map_err(|e| usage(format!("{flag}: {e}")))?))
}
