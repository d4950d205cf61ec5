//! `lenscube sensor list | show | validate`.

use super::{OTHER_JOB, USAGE};
use crate::common::camera::Place;
use crate::common::{assert_exit, lenscube, text};

#[test]
fn sensors_are_listed_shown_and_validated() {
    let list = lenscube(&["sensor", "list"]).ok();
    assert_eq!(list.stdout.lines().count(), 7);
    let place = Place::new();
    let plots = place.at("plots");
    let shown = lenscube(&["sensor", "show", "sony-a7r2", "--plot", text(&plots)]).ok();
    for word in ["50384", "80.", "assumed", "Claff"] {
        assert!(shown.stdout.contains(word), "{word}: {}", shown.stdout);
    }
    assert!(plots.join("quantum-efficiency.png").exists() && plots.join("signal-to-noise.png").exists());
    let again = ["sensor", "show", "sony-a7r2", "--plot", text(&plots)];
    assert_exit(&lenscube(&again), OTHER_JOB, &["quantum-efficiency.png already exists", "--overwrite"]);
    lenscube(&[&again[..], &["--overwrite"]].concat()).ok();
    assert!(shown.stdout.contains("7952x5304 px"), "{}", shown.stdout);
    let out = place.at("report");
    let ran = lenscube(&["sensor", "validate", "example-2um", "--require", "--out", text(&out)]).ok();
    assert!(!ran.stdout.contains("OUTSIDE"), "{}", ran.stdout);
    assert!(out.join("photon-transfer.png").exists() && out.join("figures.csv").exists());
    let again = lenscube(&["sensor", "validate", "example-2um", "--out", text(&out)]);
    assert_exit(&again, OTHER_JOB, &["photon-transfer.csv already exists"]);
    // A name that is checked and not written, or written and not checked, would change the number.
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), 10);
    assert_exit(&lenscube(&["sensor", "show", "no-such"]), USAGE, &["built in are"]);
}

/// A filter narrower than the grid on which its maximum is sought.
#[test]
fn the_peak_of_a_narrow_filter_is_that_of_its_nodes() {
    let place = Place::new();
    let toml = place.at("narrow.toml");
    std::fs::write(place.at("narrow.csv"), "wavelength_nm,Y\n551,0\n552,0.4\n552.5,0.8\n553,0.4\n554,0\n")
        .unwrap();
    let description = "schema = \"lenscube/sensor/1\"\nname = \"narrow\"\ndescription = \"one line\"\n\
        [pixel]\npitch_um = 2.0\nfull_well_e = 1000\n[noise]\n[adc]\nbits = 10\ngain_dn_per_e = 0.5\nblack_dn = 64\n\
        [spectral]\nfile = \"narrow.csv\"\nquantity = \"quantum_efficiency\"\n[cfa]\npattern = [[\"Y\"]]\n\
        Y = { column = \"Y\", plane = \"Y\" }\n[source]\n\"*\" = \"assumed\"\n";
    std::fs::write(&toml, description).unwrap();
    assert_exit(&lenscube(&["sensor", "show", text(&toml)]), 0, &["quantum efficiency 80.0 % at 552.5 nm"]);
}
