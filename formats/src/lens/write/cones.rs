//! Directions of the light at the film: the group `cones`.

use super::LensPackWriter;
use crate::lens::error::LensPackError;
use pipeline::lens::LensBand;
use pipeline::lens::cone::ConeTable;
use pipeline::lens::cone_field::{ConeField, ConeGrid};

fn bytes<'a>(values: impl IntoIterator<Item = &'a f64>) -> Vec<u8> {
    values.into_iter().flat_map(|v| v.to_ne_bytes()).collect()
}

impl LensPackWriter {
    /// Writes the cones of `bands`: tables of as many heights each, or grids of the same places of the film.
    pub(super) fn cones(&mut self, bands: &[LensBand], cones: &[&ConeField]) -> Result<(), LensPackError> {
        let (mut tables, mut grids) = (Vec::new(), Vec::new());
        for field in cones {
            match field {
                ConeField::Symmetric(table) => tables.push(table),
                ConeField::Planar(grid) => grids.push(grid),
            }
        }
        let heights = |table: &ConeTable| table.directions().count();
        match bands[0].is_symmetric() {
            true if grids.is_empty() && tables.iter().all(|table| heights(table) == heights(tables[0])) => {
                self.cone_tables(bands, &tables)
            }
            false if tables.is_empty() && grids.iter().all(|grid| grid.nodes_mm() == grids[0].nodes_mm()) => {
                self.cone_grids(bands, &grids)
            }
            _ => Err(self.invalid("expected cones at the same places of all bands, over the film of a lens without rotational symmetry, else over the height".into())),
        }
    }

    fn cone_tables(&mut self, bands: &[LensBand], tables: &[&ConeTable]) -> Result<(), LensPackError> {
        let steps: Vec<f64> = tables.iter().map(|table| table.step_mm()).collect();
        self.array("cones/height_step", "float64", &[bands.len()], "mm", &["wavelength"], &bytes(&steps))?;
        let heights = tables[0].directions().count();
        let values: Vec<f64> = tables.iter().flat_map(|table| table.directions().flatten()).collect();
        let axes = ["wavelength", "height", "chief_centre_tangential_sagittal"];
        self.array("cones/direction", "float64", &[bands.len(), heights, 4], "1", &axes, &bytes(&values))
    }

    fn cone_grids(&mut self, bands: &[LensBand], grids: &[&ConeGrid]) -> Result<(), LensPackError> {
        let [x_mm, y_mm] = grids[0].nodes_mm();
        for (name, axis, nodes) in [("cones/x", "x", x_mm), ("cones/y", "y", y_mm)] {
            self.array(name, "float64", &[nodes.len()], "mm", &[axis], &bytes(nodes))?;
        }
        let values = bytes(grids.iter().flat_map(|grid| grid.cones().as_flattened()));
        // Row by row.
        let shape = [bands.len(), y_mm.len() * x_mm.len(), ConeGrid::NUMBERS];
        let axes = ["wavelength", "y_x", "chief_xy_centre_xy_root"];
        self.array("cones/direction", "float64", &shape, "1", &axes, &values)
    }
}
