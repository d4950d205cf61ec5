//! STUB
#![allow(missing_docs, unsafe_code, clippy::all)]
use super::*;
use crate::cuda::{CudaError, Device};
use cudarc::driver::{CudaSlice, CudaStream};
#[derive(Debug)]
pub struct PsfOnDevice(*const BandPsf, Frame, SpectrumCache, Arc<Device>);
pub struct PsfTile { pub rect: Rect, pub scene_offset: usize, pub light_offset: usize, pub light_stride: usize }
unsafe impl Send for PsfOnDevice {}
impl PsfOnDevice {
    pub fn least_bytes(_b: &Blocks, _g: &NodeGrid, _tile: usize) -> usize { 0 }
    pub fn new(d: &Arc<Device>, f: &Frame, s: &BandPsf, _b: usize) -> Result<Self, CudaError> { Ok(Self(s, *f, SpectrumCache::new(1 << 24), d.clone())) }
    pub fn prepare(&mut self, _tiles: &[Rect], _stream: &Arc<CudaStream>) -> Result<(), CudaError> { Ok(()) }
    pub fn launch(&mut self, stream: &Arc<CudaStream>, tiles: &[PsfTile], scene: &CudaSlice<f32>, light: &mut CudaSlice<f32>) -> Result<(), CudaError> {
        let d = &self.3;
        let s = stream.clone_dtoh(scene).map_err(d.failed("stub"))?;
        stream.synchronize().map_err(d.failed("stub"))?;
        let mut l = vec![0f32; light.len()];
        for t in tiles {
            let n = t.rect.size().pixels();
            let mut out = Scattered::default();
            let psf = unsafe { &*self.0 };
            psf.scatter(&self.1, t.rect, &s[t.scene_offset..t.scene_offset + n], &self.2, &mut out, &mut PsfScratch::default());
            let r = psf.reaches(t.rect);
            for y in 0..r.height { l[t.light_offset + y * t.light_stride..][..r.width].copy_from_slice(&out.data[y * out.stride..][..r.width]); }
        }
        stream.memcpy_htod(&l, light).map_err(d.failed("stub"))
    }
}
