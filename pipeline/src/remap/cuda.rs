//! Remap stage on a GPU: the field's tables on the device, and launches of `remap.cu` over the tiles of a batch.
//!
//! Input of a tile is its chart rectangle ([`Remap::upload_rect`]) including the surround ([`Remap::fill`]) in a buffer of charts;
//! output are its pixels in a buffer of remapped tiles. They do not depend on the division of the film into tiles, nor on the other
//! tiles of a launch: a tile whose chart rectangle is too large may be divided into strips of rows.
#![allow(unsafe_code)]

use super::map::{ANCHOR_SPACING_PX, Map, NEAR_AXIS_PX};
use super::{BandMap, Remap};
use crate::cuda::handle::CudaStream;
use crate::cuda::launch::{CudaFunction, LaunchConfig};
use crate::cuda::ptx;
use crate::cuda::slice::{CudaSlice, DeviceMemory, DeviceRepr};
use crate::cuda::{CudaError, Device};
use crate::field::{Field, TableInterval};
use crate::geometry::Rect;
use crate::resample::Interp;
use std::sync::Arc;

/// Film rows and columns of a thread block: one anchor a thread.
const AREA_ROWS: usize = 32;
const AREA_COLS: usize = 128;
/// Threads of a thread block.
const THREADS: usize = 256;
/// Maximum of tiles in a launch: its parameters are limited to 4 KB.
const TILES: usize = 32;

/// `Step` in `remap.cu`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
struct DeviceStep {
    from: f64,
    until: f64,
    h_at: f64,
    h_slope: f64,
    gain_at: f64,
    gain_slope: f64,
    clear: [f64; 2],
    slope_change: f64,
    r_slope: f32,
    outer: [f32; 2],
    inner: [f32; 2],
    unused: f32,
}
const _: () = assert!(size_of::<DeviceStep>() == 96);
// SAFETY: numbers in C's layout, as declared in `remap.cu`.
unsafe impl DeviceRepr for DeviceStep {}

/// `Map` in `remap.cu`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
struct DeviceMap {
    axis: [f64; 2],
    offset: [f64; 2],
    per_scale: [f64; 2],
    whole_columns: f64,
    buckets_per_px: f64,
    last_px: f64,
    on_axis: [f64; 2],
    boxes: [f64; 2],
    buckets: i32,
    unused: i32,
}
const _: () = assert!(size_of::<DeviceMap>() == 112);
// SAFETY: likewise.
unsafe impl DeviceRepr for DeviceMap {}

/// `Tile` in `remap.cu`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
struct DeviceTile {
    y: i32,
    x: i32,
    height: i32,
    width: i32,
    chart_y: i32,
    chart_x: i32,
    chart_width: i32,
    unused: i32,
    chart_offset: i64,
    remapped_offset: i64,
}
const _: () = assert!(size_of::<DeviceTile>() == 48);
// SAFETY: likewise.
unsafe impl DeviceRepr for DeviceTile {}

/// A film rectangle, and the places of its chart and remapped pixels on the device; rows follow one another.
#[derive(Clone, Copy, Debug)]
pub struct RemapTile {
    /// The film rectangle.
    pub rect: Rect,
    /// The chart rectangle; contains [`Remap::upload_rect`] of the film rectangle.
    pub chart_rect: Rect,
    /// Index of its first pixel in the charts.
    pub chart_offset: usize,
    /// Index of its first pixel in the remapped tiles.
    pub remapped_offset: usize,
}

/// The remap stage of one band on one GPU.
#[derive(Debug)]
pub struct RemapOnDevice {
    device: Arc<Device>,
    kernel: CudaFunction,
    map: DeviceMap,
    steps: CudaSlice<DeviceStep>,
    buckets: CudaSlice<u32>,
}

impl RemapOnDevice {
    /// The stage on `device`; its tables are uploaded when this returns.
    ///
    /// # Errors
    /// Out of memory, or another error of the driver.
    ///
    /// # Panics
    /// A lens without rotational symmetry: jobs with one have no GPU.
    pub fn new(device: &Arc<Device>, remap: &Remap) -> Result<Self, CudaError> {
        let stream = &device.context.default_stream();
        let (sy, sx) = remap.frame.scale;
        let name = match (sy.min(sx) < 1.0, remap.interpolation.interp) {
            (true, _) => "remap_mean",
            (false, Interp::Bicubic) => "remap_bicubic",
            (false, Interp::Bilinear) => "remap_bilinear",
        };
        let field = radial(remap);
        let steps = device_steps(field);
        let (buckets, _) = field.buckets();
        let mut on_device = Self {
            kernel: device.kernel(&ptx::REMAP, name)?,
            map: device_map(remap),
            steps: device.allocate(stream, steps.len(), "a band's field")?,
            buckets: device.allocate(stream, buckets.len(), "a band's field")?,
            device: Arc::clone(device),
        };
        let failed = |e| CudaError::new(device.index(), "uploading a band's field", e);
        stream.memcpy_htod(&steps, &mut on_device.steps).map_err(failed)?;
        stream.memcpy_htod(buckets, &mut on_device.buckets).map_err(failed)?;
        stream.synchronize().map_err(failed)?;
        Ok(on_device)
    }

    /// Computes the remapped pixels of `tiles` in the order of `stream`.
    ///
    /// # Errors
    /// An error of the driver.
    ///
    /// # Panics
    /// If a tile lies beyond `charts` or `remapped`.
    pub fn launch(
        &self,
        stream: &Arc<CudaStream>,
        tiles: &[RemapTile],
        charts: &CudaSlice<f32>,
        remapped: &mut CudaSlice<f32>,
    ) -> Result<(), CudaError> {
        for tile in tiles {
            assert!(tile.chart_offset + tile.chart_rect.size().pixels() <= charts.len());
            assert!(tile.remapped_offset + tile.rect.size().pixels() <= remapped.len());
        }
        for part in tiles.chunks(TILES) {
            let mut all = [DeviceTile::default(); TILES];
            all.iter_mut().zip(part).for_each(|(to, tile)| *to = DeviceTile::from(tile));
            let areas = part.iter().map(|tile| areas(tile.rect));
            let (rows, cols) = areas.fold((0, 0), |(a, b), (c, d)| (a.max(c), b.max(d)));
            let shape = LaunchConfig {
                grid_dim: (cols as u32, rows as u32, part.len() as u32),
                block_dim: (THREADS as u32, 1, 1),
                shared_mem_bytes: 0,
            };
            let mut launch = stream.launch_builder(&self.kernel);
            launch.arg(&self.map).arg(&all).arg(&self.steps).arg(&self.buckets).arg(charts).arg(&*remapped);
            // SAFETY: the arguments match the kernels in remap.cu; tiles lie within their buffers, and their chart rectangles contain
            // every tap.
            unsafe { launch.launch(shape) }.map_err(self.device.failed("launching the remap stage"))?;
        }
        Ok(())
    }
}

impl From<&RemapTile> for DeviceTile {
    fn from(tile: &RemapTile) -> Self {
        let (rect, chart) = (tile.rect, tile.chart_rect);
        Self {
            y: rect.y as i32,
            x: rect.x as i32,
            height: rect.height as i32,
            width: rect.width as i32,
            chart_y: chart.y as i32,
            chart_x: chart.x as i32,
            chart_width: chart.width as i32,
            unused: 0,
            chart_offset: tile.chart_offset as i64,
            remapped_offset: tile.remapped_offset as i64,
        }
    }
}

/// Thread blocks (down, across) that cover a film rectangle.
fn areas(rect: Rect) -> (usize, usize) {
    let before = rect.x.rem_euclid(ANCHOR_SPACING_PX as i64) as usize;
    (rect.height.div_ceil(AREA_ROWS), (before + rect.width).div_ceil(AREA_COLS))
}

fn radial(remap: &Remap) -> &Field {
    match &remap.band_map {
        BandMap::Radial { field, .. } => field,
        BandMap::Planar(_) => panic!("the remap stage of a GPU has rotational symmetry"),
    }
}

fn device_map(remap: &Remap) -> DeviceMap {
    let field = radial(remap);
    let map = Map::new(&remap.frame, field);
    let (buckets, buckets_per_px) = field.buckets();
    let (sy, sx) = remap.frame.scale;
    DeviceMap {
        axis: map.axis_px.into(),
        offset: map.offset.into(),
        per_scale: map.per_scale.into(),
        whole_columns: map.integer_columns(),
        buckets_per_px,
        last_px: field.last_px(),
        on_axis: field.at(0.0).into(),
        boxes: [(1.0 / sy).max(1.0), (1.0 / sx).max(1.0)],
        buckets: buckets.len() as i32,
        unused: 0,
    }
}

/// The field's steps with the slope changes at their knots.
fn device_steps(field: &Field) -> Vec<DeviceStep> {
    let steps = field.steps();
    let half = ANCHOR_SPACING_PX as f64 / 2.0;
    let slope_change = |i: usize| match (1..steps.len()).contains(&i) {
        true => (steps[i].h_slope - steps[i - 1].h_slope, steps[i].gain_slope - steps[i - 1].gain_slope),
        false => (0.0, 0.0),
    };
    let narrow = |(h, r): (f64, f64)| [h as f32, r as f32];
    let one = |(i, s): (usize, &TableInterval)| {
        let before = i.checked_sub(1).map_or(f64::NEG_INFINITY, |k| steps[k].from + half);
        let after = steps.get(i + 1).map_or(f64::INFINITY, |s| s.until - half);
        let (inner, outer) = (slope_change(i), slope_change(i + 1));
        DeviceStep {
            from: s.from,
            until: s.until,
            h_at: s.h_at,
            h_slope: s.h_slope,
            gain_at: s.gain_at,
            gain_slope: s.gain_slope,
            clear: [before.max(NEAR_AXIS_PX), after],
            slope_change: inner.0.abs() + outer.0.abs(),
            r_slope: s.gain_slope as f32,
            outer: narrow(outer),
            inner: narrow(inner),
            unused: 0.0,
        }
    };
    steps.iter().enumerate().map(one).collect()
}
