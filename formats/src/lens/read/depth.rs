//! Depth nodes of a pack of schema [`DEPTH_SCHEMA`](super::super::attributes::DEPTH_SCHEMA): tables (bands, nodes, ...), rows past a band's last
//! node unused.

use super::{AZIMUTHS, Arrays, PackArray, Rows, psfs};
use crate::lens::attributes::Attributes;
use crate::lens::error::LensPackError;
use pipeline::bounds;
use pipeline::lens::LensBand;
use pipeline::lens::depth::{BandDepth, DepthNode, LensDepth};

/// Reads the depth nodes of `bands`, whose PSF tables become those of the node nearest to focus; `chunks` receives the bytes of the largest
/// decoded chunk of PSFs of each band.
pub(super) fn read(
    tables: &Arrays<'_>,
    head: &Attributes<'_>,
    field_points: usize,
    bands: &mut [LensBand],
    chunks: &mut Vec<usize>,
) -> Result<LensDepth, LensPackError> {
    let focus_distance_m = head.bounded("focus_distance_m", bounds::FOCUS_M)?;
    let blur_per_dioptre_um = head.bounded("blur_per_dioptre_um", bounds::BLUR_PER_DIOPTRE_UM)?;
    let entrance_pupil_mm = head.bounded("entrance_pupil_mm", bounds::DEFOCUS_MM)?;
    let entrance_pupil_diameter_mm = head.bounded("entrance_pupil_diameter_mm", bounds::PUPIL_MM)?;
    let tolerance = head.positive("depth_tolerance")?;
    let vergence = tables.rows_of("vergence", None, None)?;
    let nodes = vergence.width;
    if !bounds::DEPTH_NODES.contains(nodes as f64) {
        let array = PackArray::open(tables.store, "vergence")?;
        return Err(array.shape_error(format!("[{}, {}]", tables.bands, bounds::DEPTH_NODES)));
    }
    let heights = tables.rows_of("psf_height", Some(nodes), None)?;
    let azimuths = tables.rows_of("azimuth_count", Some(nodes), Some(heights.width))?;
    let energy = tables.rows_of("psf_energy", Some(nodes), Some(heights.width))?;
    let pitch = tables.rows_of("psf_pitch", None, Some(nodes))?;
    let shift = tables.optional("pupil_shift", None, field_points)?;
    let etendue = tables.optional("etendue_ratio", Some(nodes), field_points)?;
    let mut depths = Vec::with_capacity(bands.len());
    for (b, band) in bands.iter_mut().enumerate() {
        let row = vergence.row(b);
        let count = row.iter().position(|v| v.is_nan()).unwrap_or(nodes);
        let points = band.ideal_height_mm.len();
        let mut chunk = 0;
        let mut list = Vec::with_capacity(count);
        for d in 0..count {
            let at = b * nodes + d;
            let psf_height_mm = heights.numbers(at)?;
            let k = psf_height_mm.len();
            let (psf_size, bytes) =
                psfs::size(tables.store, &format!("psf/{b}/{d}"), (k, "heights of psf_height"))?;
            chunk = chunk.max(bytes);
            list.push(DepthNode {
                azimuth_count: azimuths.counts(at, k, AZIMUTHS)?,
                psf_energy: energy.first(at, k)?,
                psf_size,
                psf_pitch_um: pitch.first(b, nodes.min(d + 1))?[d],
                etendue_ratio: etendue.as_ref().map_or(Ok(vec![1.0; points]), |e| e.first(at, points))?,
                psf_height_mm,
            });
        }
        let depth = BandDepth {
            vergence: row[..count].to_vec(),
            nodes: list,
            pupil_shift_mm: shift.as_ref().map_or(Ok(vec![0.0; points]), |s| s.first(b, points))?,
        };
        let invalid = |source| LensPackError::Table { path: tables.store.path.clone(), source };
        depth.check(band).map_err(invalid)?;
        depth.set_psfs(band, depth.nearest(1.0 / focus_distance_m));
        depths.push(depth);
        chunks.push(chunk);
    }
    Ok(LensDepth {
        focus_distance_m,
        blur_per_dioptre_um,
        entrance_pupil_mm,
        entrance_pupil_diameter_mm,
        tolerance,
        bands: depths,
    })
}

impl Arrays<'_> {
    /// A required array (bands, width), or (bands, `nodes`, width), of a given width if it is known.
    fn rows_of(
        &self,
        name: &'static str,
        nodes: Option<usize>,
        width: Option<usize>,
    ) -> Result<Rows<'_>, LensPackError> {
        let array = PackArray::open(self.store, name)?;
        let rank = if nodes.is_some() { 3 } else { 2 };
        let found = array.shape.last().map_or(0, |n| *n as usize);
        let mut expected = vec![self.bands];
        expected.extend(nodes);
        expected.push(width.unwrap_or(found));
        if array.shape.len() != rank {
            return Err(array.shape_error(format!("{expected:?}")));
        }
        array.expect_shape(&expected, "bands, nodes of vergence, heights or field points")?;
        array.expect_at_most(&bounds::TABLE_NUMBERS)?;
        let width = expected[rank - 1];
        Ok(Rows { tables: self, name, per_band: nodes.unwrap_or(1), width, values: array.read()? })
    }

    fn optional(
        &self,
        name: &'static str,
        nodes: Option<usize>,
        width: usize,
    ) -> Result<Option<Rows<'_>>, LensPackError> {
        match PackArray::open_optional(self.store, name)? {
            Some(_) => self.rows_of(name, nodes, Some(width)).map(Some),
            None => Ok(None),
        }
    }
}
