//! Focus, light and depth nodes of the built-in Double Gauss against an independent float64 model (tests/golden/depth/make_nodes.py).

use formats::design::builtin::BuiltinLens;
use pipeline::design::System;
use pipeline::design::depth::nodes::{ESF_TOLERANCE, NodeOptions, Placement, place};
use pipeline::design::depth::trace::{DepthOptions, band, header, nodes};
use pipeline::design::illumination::irradiance_sr;
use pipeline::design::ray::Tracer;
use pipeline::design::system::{ImagePlane, RayAiming};
use pipeline::design::trace::{Azimuths, PsfHeights, TraceOptions};
use pipeline::lens::{LensError, PsfStack, linear};
use pipeline::psf::kernel::{KernelScratch, NodeKernels};
use pipeline::simd::Simd;
use serde_json::Value;

fn expected() -> Value {
    serde_json::from_str(include_str!("../golden/depth/nodes.json")).unwrap()
}

fn number(v: &Value, key: &str) -> f64 {
    v[key].as_f64().unwrap()
}

fn double_gauss(focus: f64, aiming: RayAiming) -> System {
    let mut system = BuiltinLens::named("double-gauss-28").unwrap().system();
    system.aiming = aiming;
    let um = system.primary_um();
    system.focused_at(focus, ImagePlane::Paraxial(um), 0.0).unwrap()
}

fn near(found: f64, expected: f64, relative: f64, what: &str) {
    assert!((found / expected - 1.0).abs() <= relative, "{what}: {found}, expected {expected}");
}

#[test]
fn focus_moves_the_film_and_the_blur_per_dioptre_follows() {
    for row in expected()["focus"].as_array().unwrap() {
        let focus = number(row, "vergence");
        let system = double_gauss(focus, RayAiming::Paraxial);
        let options = DepthOptions { focus, range: (0.0, 1.0), tolerance: 0.02, is_for_film: false };
        let head = header(&system, &options).unwrap();
        let film_mm = system.surfaces[system.image() - 1].thickness_mm;
        near(film_mm, number(row, "film_mm"), 1e-6, "film");
        near(head.blur_per_dioptre_um, number(row, "blur_per_dioptre_um"), 1e-6, "blur");
        near(head.entrance_pupil_mm, number(row, "entrance_pupil_mm"), 1e-6, "entrance pupil");
    }
}

#[test]
fn light_of_a_bundle_follows_the_distance_of_its_object() {
    let system = double_gauss(0.5, RayAiming::Paraxial);
    let g = |v: f64, tan: f64| {
        let moved = system.at_vergence(v).unwrap();
        let tracer = Tracer::new(&moved, moved.primary_um()).unwrap();
        irradiance_sr(&tracer, tan).unwrap()
    };
    for row in expected()["light"].as_array().unwrap() {
        let ratios = std::iter::zip(row["tan"].as_array().unwrap(), row["etendue_ratio"].as_array().unwrap());
        for (tan, ratio) in ratios.map(|(t, r)| (t.as_f64().unwrap(), r.as_f64().unwrap())) {
            let v = number(row, "vergence");
            near(g(v, tan) / g(0.5, tan), ratio, 1e-6, &format!("G at {v} 1/m, tan {tan}"));
        }
    }
}

#[test]
fn nodes_lie_where_the_independent_model_places_them() {
    let row = &expected()["placement"][0];
    let system = double_gauss(0.5, RayAiming::Paraxial);
    let tracer = Tracer::new(&system, 0.55).unwrap();
    let edge_mm = tracer.chief_height_mm(10f64.to_radians().tan()).unwrap();
    let options = NodeOptions {
        range: (number(row, "first"), number(row, "last")),
        focus: 0.5,
        l1_tolerance: number(row, "l1_tolerance"),
        film_pitch_um: 2.0,
        blur_px: 868.8225,
        max_window_px: 401,
    };
    let found = place(&system, 0.55, &[0.0, edge_mm], &options).unwrap();
    let expected: Vec<f64> =
        row["vergence"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    assert!(found.l1 <= options.l1_tolerance && found.esf <= ESF_TOLERANCE, "{found:?}");
    let (n, m) = (found.vergence.len(), expected.len());
    assert!(n.abs_diff(m) <= 1, "{n} nodes, expected {m}: {:?}", found.vergence);
    // Where an equal number is placed, each lies within half a cell.
    if n == m {
        for (i, (a, b)) in std::iter::zip(&found.vergence, &expected).enumerate() {
            let cell = expected[(i + 1).min(m - 1)] - expected[(i + 1).min(m - 1) - 1];
            assert!((a - b).abs() < cell / 2.0, "node {i} at {a}, expected {b}");
        }
    }
}

#[test]
fn range_narrower_than_a_cell_is_placed_whatever_the_rounding_of_its_bounds() {
    let system = BuiltinLens::named("phone").unwrap().system();
    let system = system.focused_at(0.25, ImagePlane::Paraxial(system.primary_um()), 0.0).unwrap();
    // 0.05 + 0.1 is above 0.25 - 0.1 by one unit in the last place.
    let range = (0.05, 0.25);
    let options = NodeOptions {
        range,
        focus: 0.25,
        l1_tolerance: 0.02,
        film_pitch_um: 1.0,
        blur_px: 3.0,
        max_window_px: 401,
    };
    let found = place(&system, 0.55, &[0.0], &options).unwrap();
    assert_eq!(found.vergence.first().copied().zip(found.vergence.last().copied()), Some(range));
    assert!(found.l1 <= options.l1_tolerance && found.esf <= ESF_TOLERANCE, "{found:?}");
}

#[test]
fn nodes_of_similar_blur_share_heights_within_their_tolerance() {
    let system = BuiltinLens::named("phone").unwrap().system();
    let system = system.focused_at(2.5, ImagePlane::Paraxial(system.primary_um()), 0.0).unwrap();
    let trace = TraceOptions::new(vec![550.0], 2.0);
    let options = DepthOptions { focus: 2.5, range: (2.5, 2.52), tolerance: 0.02, is_for_film: false };
    let placement = Placement { vergence: vec![2.5, 2.51, 2.52], l1: 0.0, esf: 0.0 };
    let sink = |_: usize, _: &_| Ok::<(), LensError>(());
    let traced = band(&system, &trace, 0, (&options, placement), &mut |_| (), sink).unwrap();
    let first = &traced.nodes.nodes[0];
    let all = std::iter::zip(&traced.nodes.nodes, &traced.reports).skip(1);
    let shared: Vec<_> = all.filter(|(node, _)| node.psf_height_mm == first.psf_height_mm).collect();
    assert!(
        !shared.is_empty(),
        "{:?}",
        traced.nodes.nodes.iter().map(|n| n.psf_height_mm.len()).collect::<Vec<_>>()
    );
    for (node, report) in shared {
        assert_eq!(node.azimuth_count, first.azimuth_count);
        assert!(2 * report.psfs < traced.reports[0].psfs, "{} of {}", report.psfs, traced.reports[0].psfs);
        assert!(report.psf_error.unwrap().worst <= trace.psf_tolerance, "{report:?}");
    }
}

/// Kernels of 2 µm pixels, blur of 0 and 5 px: of PSFs for any film, and of those for films of this pitch, within the tolerance of nodes, 0.02.
#[test]
fn wide_psfs_for_a_film_have_fewer_samples_and_the_same_kernels() {
    let system = BuiltinLens::named("phone").unwrap().system();
    let system = system.focused_at(2.5, ImagePlane::Paraxial(system.primary_um()), 0.0).unwrap();
    let mut trace = TraceOptions::new(vec![550.0], 1.0);
    trace.heights = PsfHeights::Given(vec![0.0, 1.0]);
    trace.azimuths = Azimuths::Given(4);
    let placement = || Placement { vergence: vec![2.5, 6.5, 6.55], l1: 0.0, esf: 0.0 };
    let traced = |is_for_film: bool| {
        let options = DepthOptions { focus: 2.5, range: (2.5, 6.55), tolerance: 0.02, is_for_film };
        let mut stacks = Vec::new();
        let sink = |_: usize, stack: &PsfStack| {
            stacks.push(stack.clone());
            Ok::<(), LensError>(())
        };
        let traced = band(&system, &trace, 0, (&options, placement()), &mut |_| (), sink).unwrap();
        (stacks, traced)
    };
    let ((any, _), (film, of_film)) = (traced(false), traced(true));
    assert_eq!(any[0], film[0], "in focus");
    for node in [1, 2] {
        let (fine_um, coarse_um) = (any[node].pitch_um, film[node].pitch_um);
        assert!(coarse_um > 1.3 * fine_um && coarse_um <= 1.0, "node {node}: {fine_um} and {coarse_um} um");
        assert!(of_film.nodes.nodes[node].psf_energy.iter().all(|share| *share > 0.985), "{node}");
        for row in 0..2 {
            let kernel = |stack: &PsfStack| {
                let kernels = NodeKernels::new(stack, 2.0, Some(31), Simd::detect());
                kernels.unrotated(row, &mut KernelScratch::default()).to_vec()
            };
            let (a, b) = (kernel(&any[node]), kernel(&film[node]));
            let l1: f32 = std::iter::zip(&a, &b).map(|(a, b)| (a - b).abs()).sum();
            println!("node {node}, height {row}: L1 {l1:.1e}");
            assert!(a.len() == b.len() && l1 < 0.015, "node {node}, height {row}: {l1}");
        }
    }
}

#[test]
fn chief_rays_of_real_aiming_cross_the_axis_where_the_independent_model_has_them() {
    let system = double_gauss(0.5, RayAiming::Real);
    // The model's wavelength: the pupil of another one is elsewhere.
    let mut trace = TraceOptions::new(vec![system.primary_um() * 1e3], 20.0);
    trace.heights = PsfHeights::Given(vec![0.0, 20.0]);
    trace.azimuths = Azimuths::Given(4);
    trace.window_px = Some(33);
    let options = DepthOptions { focus: 0.5, range: (0.499, 0.501), tolerance: 0.5, is_for_film: false };
    let mut stacks = 0;
    let sink = |_: usize, _: &_| {
        stacks += 1;
        Ok::<(), LensError>(())
    };
    let placement = nodes(&system, &trace, 0, &options).unwrap();
    let traced = band(&system, &trace, 0, (&options, placement), &mut |_| (), sink).unwrap();
    assert_eq!(stacks, traced.nodes.nodes.len());
    traced.nodes.check(&traced.tables).unwrap();
    assert!(traced.nodes.vergence.contains(&0.5), "{:?}", traced.nodes.vergence);
    for row in expected()["chief"].as_array().unwrap() {
        let (r, shift) = (number(row, "height_mm"), number(row, "pupil_shift_mm"));
        if r > 20.0 {
            continue;
        }
        let found = linear(&traced.tables.image_height_mm, &traced.nodes.pupil_shift_mm, r);
        assert!((found - shift).abs() < 1e-3, "at {r} mm: {found}, expected {shift}");
    }
}
