//! Tables of figures of a lens: `lens show --json` and `--csv`.
//!
//! Of a design: first and third order, rays, wavefront, spots, MTF and encircled energy. Of a pack: its figures, MTF and encircled energy. A field
//! point whose rays do not reach the film has no rows. Each module computes one kind; `table` writes them.

mod diffraction;
mod first_order;
mod rays;
mod request;
mod table;
mod wavefronts;

pub use first_order::{design_figures, design_json};
pub use request::Request;
pub use table::{Table, csv_file, csv_line};

use super::shown::Shown;
use crate::args::{ShowArgs, TableName};
use crate::failure::usage;
use crate::job::lens::samples::{FieldFigures, LensData};
use anyhow::Result;
use clap::ValueEnum;
use std::path::{Path, PathBuf};

/// Tables that need a design.
fn needs_design(name: TableName) -> bool {
    !matches!(name, TableName::Fields | TableName::Mtf | TableName::EncircledEnergy)
}

/// The tables of `--json` and `--csv`: those of `--tables`, or all that the lens has but the wavefront maps.
///
/// # Errors
/// A requested table needs a design.
pub fn chosen(lens: &LensData, args: &ShowArgs) -> Result<Vec<TableName>> {
    let is_design = matches!(lens, LensData::Design(..));
    let Some(names) = &args.tables else {
        let all = TableName::value_variants().iter().copied();
        return Ok(all
            .filter(|n| *n != TableName::WavefrontMap && (is_design || !needs_design(*n)))
            .collect());
    };
    match names.iter().find(|n| needs_design(**n) && !is_design) {
        Some(name) => Err(usage(format!(
            "`{}` is a lens pack, which has no rays: the table {} needs its design",
            args.lens,
            name.name()
        ))),
        None => Ok(names.clone()),
    }
}

/// Names of all files that `--csv` may write.
pub fn all_files() -> impl Iterator<Item = PathBuf> {
    TableName::value_variants().iter().map(|name| csv_file(Path::new(""), *name))
}

/// The table `name`.
pub fn table(name: TableName, lens: &LensData, shown: &Shown, request: &Request<'_>) -> Result<Table> {
    if name == TableName::Fields {
        return Ok(fields(name, shown));
    }
    let LensData::Design(system, description) = lens else {
        return diffraction::of_pack(name, lens, request);
    };
    match name {
        TableName::FirstOrder => Ok(Table::of_objects(name, std::iter::once(design_json(description)))),
        TableName::CardinalPoints => first_order::cardinal(name, system, request),
        TableName::Seidel => first_order::seidel_sums(name, system),
        TableName::ParaxialRays => first_order::rays(name, system),
        TableName::RealRays => rays::real_rays(name, system, request),
        TableName::FieldCurvature => rays::curvature(name, system, request),
        TableName::Spots => rays::spots(name, system, request),
        TableName::Wavefront
        | TableName::ZernikeStandard
        | TableName::ZernikeFringe
        | TableName::WavefrontMap => wavefronts::table(name, system, request),
        TableName::Mtf | TableName::EncircledEnergy => diffraction::monochromatic(name, system, request),
        TableName::MtfPolychromatic => diffraction::polychromatic(name, system, request),
        TableName::MtfThroughFocus => diffraction::through_focus(name, system, request),
        TableName::Fields => Ok(fields(name, shown)),
    }
}

/// The figures of field points that `lens show` prints.
fn fields(name: TableName, shown: &Shown) -> Table {
    Table::of_objects(name, shown.fields.iter().map(FieldFigures::json))
}
