//! Attributes of a lens pack of traced bands: where it comes from and how exact it is.

use crate::args::{CoatingsArg, DesignArgs};
use formats::lens::PackAttributes;
use pipeline::design::trace::{BandReport, ESF_SHARE, TraceOptions};
use serde_json::{Value, json};

/// Attributes of a traced pack.
pub fn attributes(
    design: &str,
    place: &DesignArgs,
    options: &TraceOptions,
    reports: &[BandReport],
) -> PackAttributes {
    let bands: Vec<_> = reports
        .iter()
        .map(|r| {
            json!({
                "wavelength_nm": r.wavelength_nm,
                "kernel_l1": r.psf_error.map(|e| e.worst),
                "kernel_l1_median": r.psf_error.map(|e| e.median),
                "kernel_l1_at_mm": r.psf_error.map(|e| e.at_mm),
                "kernel_edge": r.psf_error.map(|e| e.edge),
                "least_energy": r.min_energy,
            })
        })
        .collect();
    PackAttributes {
        image_plane: Some(format!("{:?}", place.image_plane).to_lowercase()),
        defocus_mm: Some(place.defocus_mm),
        frame: Some("field point on +x, row down; heights real unless named ideal; mm".into()),
        psf_tolerance: Some(
            json!({ "requested_l1": options.psf_tolerance, "requested_edge": ESF_SHARE * options.psf_tolerance, "bands": bands }),
        ),
        source: Some(with_coatings(
            json!({
                "program": concat!("lenscube ", env!("CARGO_PKG_VERSION")),
                "design": design,
                "film_pitch_um": options.film_pitch_um,
                "energy": options.energy,
                "aiming": place.aiming.map_or("as in the design".into(), |a| format!("{a:?}").to_lowercase()),
            }),
            &place.coatings,
        )),
        ..PackAttributes::default()
    }
}

/// Coatings other than ideal ones.
fn with_coatings(mut source: Value, coatings: &CoatingsArg) -> Value {
    if *coatings != CoatingsArg::Ideal {
        source["coatings"] = coatings.to_string().into();
    }
    source
}
