//! Ideal thin lenses and telecentric object spaces in lens files.

use crate::chain::assert_survives_all_formats;
use crate::design_cases::relay;
use lenscube_formats::design::{ReadOptions, zmx};
use pipeline::design::System;
use pipeline::design::glass_library::GlassLibrary;

#[test]
fn ideal_lenses_and_telecentric_objects_are_read_and_survive_all_formats() {
    let text = "MODE SEQ\nUNIT CM X W X CM MR CPMM\nOBNA 0.1 0\nRAIM 0 2\nFTYP 1 1 2 1\nYFLN 0 0.8\nWAVM 1 0.55 1\nPWAV 1\n\
                SURF 0\n TYPE STANDARD\n DISZ 10\nSURF 1\n TYPE PARAXIAL\n PARM 1 10\n PARM 2 1\n DISZ 10\n\
                SURF 2\n STOP\n TYPE STANDARD\n DISZ 5\nSURF 3\n TYPE PARAXIAL\n PARM 1 5\n DISZ 5\nSURF 4\n TYPE STANDARD\n DISZ 0\n";
    let read = zmx::parse(text.as_bytes(), &GlassLibrary::new(), &ReadOptions::default()).unwrap();
    let expected = System { notes: read.notes.clone(), ..relay(0.1) };
    assert_eq!(read, expected);
    assert!(read.notes.iter().any(|n| n.contains("telecentric")), "{:?}", read.notes);
    // The relay is afocal: its focal length is not compared.
    let mut lens = read.clone();
    lens.surfaces[2].ideal_focal_mm = Some(60.0);
    assert_survives_all_formats("relay", &lens);
    let without = text.replace(" PARM 1 10\n", "");
    let error = zmx::parse(without.as_bytes(), &GlassLibrary::new(), &ReadOptions::default()).unwrap_err();
    assert!(error.to_string().contains("PARM 1"), "{error}");
}
