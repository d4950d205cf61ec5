//! Tables of depth nodes: (bands, nodes, ...), padded with NaN (azimuths: 0) past a band's last node, height or field point.

use super::LensPackWriter;
use crate::lens::error::LensPackError;
use pipeline::lens::depth::{BandDepth, DepthNode, LensDepth};

impl LensPackWriter {
    pub(super) fn depth_tables(&mut self, depth: &LensDepth) -> Result<(), LensPackError> {
        let bands = &depth.bands;
        let nodes = bands.iter().map(|b| b.nodes.len()).max().unwrap_or(0);
        let points = bands.iter().map(|b| b.pupil_shift_mm.len()).max().unwrap_or(0);
        let per_band = |values: &dyn Fn(&BandDepth) -> Vec<f64>, width: usize| -> Vec<u8> {
            let padded = bands.iter().flat_map(|b| padded(values(b), width));
            padded.flat_map(f64::to_ne_bytes).collect()
        };
        let dims = ["wavelength", "depth_node"];
        let vergence = per_band(&|b| b.vergence.clone(), nodes);
        self.array("vergence", "float64", &[bands.len(), nodes], "1/m", &dims, &vergence)?;
        let pitch = per_band(&|b| b.nodes.iter().map(|n| n.psf_pitch_um).collect(), nodes);
        self.array("psf_pitch", "float64", &[bands.len(), nodes], "um", &dims, &pitch)?;
        let shift = per_band(&|b| b.pupil_shift_mm.clone(), points);
        let field_dims = ["wavelength", "field_point"];
        self.array("pupil_shift", "float64", &[bands.len(), points], "mm", &field_dims, &shift)?;
        let counts: Vec<u8> = bands.iter().flat_map(|b| (b.nodes.len() as i32).to_ne_bytes()).collect();
        self.array("vergence_count", "int32", &[bands.len()], "1", &["wavelength"], &counts)?;
        self.node_table(bands, nodes, ("psf_height", "mm", "psf_height"), |n| n.psf_height_mm.clone())?;
        self.node_table(bands, nodes, ("psf_energy", "1", "psf_height"), |n| n.psf_energy.clone())?;
        self.node_table(bands, nodes, ("etendue_ratio", "1", "field_point"), |n| n.etendue_ratio.clone())?;
        let azimuths = |n: &DepthNode| n.azimuth_count.iter().map(|&j| j as f64).collect();
        self.node_table(bands, nodes, ("azimuth_count", "1", "psf_height"), azimuths)
    }

    /// A table of name, unit and last dimension `about`.
    fn node_table(
        &mut self,
        bands: &[BandDepth],
        nodes: usize,
        about: (&str, &str, &str),
        values: impl Fn(&DepthNode) -> Vec<f64>,
    ) -> Result<(), LensPackError> {
        let (name, unit, along) = about;
        let of_node = |b: &BandDepth, d: usize| b.nodes.get(d).map_or_else(Vec::new, &values);
        let width = bands.iter().flat_map(|b| &b.nodes).map(|n| values(n).len()).max().unwrap_or(0);
        let all = bands.iter().flat_map(|b| (0..nodes).flat_map(|d| padded(of_node(b, d), width)));
        let dims = ["wavelength", "depth_node", along];
        let shape = [bands.len(), nodes, width];
        match name {
            "azimuth_count" => {
                let counts = all.map(|v| if v.is_nan() { 0 } else { v as i32 });
                let bytes: Vec<u8> = counts.flat_map(i32::to_ne_bytes).collect();
                self.array(name, "int32", &shape, unit, &dims, &bytes)
            }
            _ => {
                let bytes: Vec<u8> = all.flat_map(f64::to_ne_bytes).collect();
                self.array(name, "float64", &shape, unit, &dims, &bytes)
            }
        }
    }
}

/// `values` and NaN up to `width` of them.
fn padded(values: Vec<f64>, width: usize) -> impl Iterator<Item = f64> {
    let missing = width - values.len();
    values.into_iter().chain(std::iter::repeat_n(f64::NAN, missing))
}
