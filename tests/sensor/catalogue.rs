//! `lenscube sensor list | show | validate`.

use crate::common::camera::Place;
use crate::common::{assert_exit, lenscube, text};
use crate::{OTHER_JOB, USAGE};

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
