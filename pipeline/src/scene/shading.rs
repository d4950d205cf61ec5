//! What visibility asks of materials: whether a hit exists, and what its samples show.

/// A sample of a pixel that hits a triangle.
#[derive(Clone, Copy)]
pub struct SampleHit {
    /// Number of the sample in its pixel.
    pub sample: u32,
    /// Direction (x, y, 1) in the camera frame.
    pub x: f64,
    /// Its y.
    pub y: f64,
    /// 1/z in 1/m.
    pub vergence: f64,
    /// Barycentric coordinates, 0…1.
    pub barycentric: [f64; 3],
}

/// Materials as visibility sees them. Triangles are numbered in the order of the file.
pub trait Shader: Sync {
    /// Number of bases of the weights.
    fn bases(&self) -> usize;
    /// Whether every place of `triangle` exists (no alpha): [`Shader::exists`] is not asked then.
    fn is_opaque(&self, triangle: u32) -> bool;
    /// Whether the surface is there at the hit of a sample.
    fn exists(&self, triangle: u32, hit: &SampleHit, samples: usize) -> bool;
    /// Writes the weights of a hit of `triangle`, one per basis, if they are the same for all its hits and [`Shader::add_weights`] of n hits adds n times them; false, with anything
    /// written, if not.
    fn even_weights(&self, _triangle: u32, _weights: &mut [f64]) -> bool {
        false
    }
    /// Adds to `sums` the weights of the background in the direction (x, y, 1) that are not the same in all directions.
    fn add_background_at(&self, _x: f64, _y: f64, _sums: &mut [f64]) {}
    /// Adds to `sums` (one per basis) the weights of the hits of one triangle in one sheet of one pixel, summed over the hits.
    fn add_weights(&self, triangle: u32, hits: &[SampleHit], sums: &mut [f64]);
}
