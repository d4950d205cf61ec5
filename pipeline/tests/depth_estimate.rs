//! Estimated depth nodes against those that are placed.

use lenscube_pipeline::design::depth::trace::{DepthOptions, estimated_nodes, nodes};
use lenscube_pipeline::design::system::ImagePlane;
use lenscube_pipeline::design::{System, TraceOptions};

/// Estimated and placed nodes of a Double Gauss in focus at 2 m, for vergences to either side of it.
fn counts(pitch_um: f64, range: (f64, f64), reach_mm: f64) -> (usize, usize) {
    let system = System::double_gauss_28();
    let system = system.focused_at(0.5, ImagePlane::Paraxial(system.primary_um()), 0.0).unwrap();
    let trace = TraceOptions {
        film_pitch_um: pitch_um,
        max_window_px: 639,
        ..TraceOptions::new(vec![550.0], reach_mm)
    };
    let options = DepthOptions { focus: 0.5, range, tolerance: 0.02, is_for_film: false };
    let estimated = estimated_nodes(&system, &trace, 0, &options).unwrap();
    assert!(estimated.windows(2).all(|w| w[0] < w[1]), "{estimated:?}");
    assert_eq!((estimated[0], estimated[estimated.len() - 1]), range);
    (estimated.len(), nodes(&system, &trace, 0, &options).unwrap().vergence.len())
}

#[test]
fn estimated_nodes_are_about_as_many_as_those_that_are_placed() {
    // On coarse pixels edges of the kernels need more nodes than their blur in pixels: 0.75 px of it have 15.
    for (pitch_um, range, reach_mm) in [(40.0, (0.485, 0.515), 2.0), (2.0, (0.49, 0.51), 2.0)] {
        let (estimated, placed) = counts(pitch_um, range, reach_mm);
        assert!(
            4 * estimated.abs_diff(placed) <= placed,
            "{pitch_um} µm: {estimated} estimated, {placed} placed"
        );
    }
}

#[test]
#[ignore = "long: some thousand PSFs"]
fn estimated_nodes_of_wide_blur_are_about_as_many_as_those_that_are_placed() {
    for (pitch_um, range, reach_mm) in
        [(40.0, (0.3, 0.62), 8.0), (20.0, (0.45, 0.6), 8.0), (6.3, (0.45, 0.55), 8.0)]
    {
        let (estimated, placed) = counts(pitch_um, range, reach_mm);
        assert!(
            4 * estimated.abs_diff(placed) <= placed,
            "{pitch_um} µm: {estimated} estimated, {placed} placed"
        );
    }
}
