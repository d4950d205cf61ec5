use super::*;
use crate::figures::kernel_l1;
use crate::lens::planar::{PlanarBand, PlanarMap};
use std::convert::Infallible;

const N: usize = 41;

/// A Gaussian of deviations `sx` and `sy` samples about (x0, y0), sum 1.
fn gauss(sx: f64, sy: f64, (x0, y0): (f64, f64)) -> Vec<f32> {
    let at = |i: usize| i as f64 - (N / 2) as f64;
    let value = |i: usize| {
        let (x, y) = (at(i % N) - x0, at(i / N) - y0);
        (-0.5 * ((x / sx).powi(2) + (y / sy).powi(2))).exp()
    };
    let sum: f64 = (0..N * N).map(value).sum();
    (0..N * N).map(|i| (value(i) / sum) as f32).collect()
}

/// Distortion of 1 % at 10 mm, PSFs at 0 and 10 mm.
fn symmetric() -> LensBand {
    let heights: Vec<f64> = (0..=40).map(|i| 0.3 * f64::from(i)).collect();
    LensBand {
        wavelength_nm: 550.0,
        ideal_height_mm: heights.iter().map(|r| r * (1.0 - 1e-4 * r * r)).collect(),
        relative_illumination: heights.iter().map(|r| 1.0 - 1e-3 * r * r).collect(),
        image_height_mm: heights,
        psf_height_mm: vec![0.0, 10.0],
        azimuth_count: vec![1, 8],
        psf_size: N,
        psf_pitch_um: 1.0,
        kernel_pitch_um: None,
        psf_energy: vec![1.0; 2],
        solid_angle_sr: 0.1,
        transmission: 1.0,
        tail: None,
        cones: None,
        planar: None,
    }
}

/// The same with the image 0.02 mm to the right and 0.01 mm down, and PSFs at `psfs`.
fn planar(psfs: PsfPlaces) -> LensBand {
    let nodes: Vec<f64> = (-8..=8).map(f64::from).collect();
    let ideal = |axis: usize| {
        let at = |i: usize| {
            let [x, y] = [nodes[i % 17] - 0.02, nodes[i / 17] - 0.01];
            [x, y][axis] * (1.0 - 1e-4 * (x * x + y * y))
        };
        (0..17 * 17).map(at).collect()
    };
    let map = PlanarMap {
        ideal_x_mm: ideal(0),
        ideal_y_mm: ideal(1),
        relative_illumination: (0..17 * 17).map(|i| 1.0 - 1e-3 * nodes[i % 17]).collect(),
        x_mm: nodes.clone(),
        y_mm: nodes,
    };
    let is_polar = matches!(psfs, PsfPlaces::Polar { .. });
    let band = LensBand {
        ideal_height_mm: Vec::new(),
        image_height_mm: Vec::new(),
        relative_illumination: Vec::new(),
        psf_energy: vec![1.0; psfs.count()],
        planar: Some(PlanarBand { map, psfs }),
        ..symmetric()
    };
    match is_polar {
        true => band,
        false => LensBand { psf_height_mm: Vec::new(), azimuth_count: Vec::new(), ..band },
    }
}

fn kernel(film: &BandOnFilm<'_>, place: [f64; 2], sets: &[Vec<f32>]) -> (usize, Vec<f32>) {
    film.kernel(place, PsfSample::Point, |set| Ok::<_, Infallible>(sets[set].clone())).unwrap()
}

fn l1(a: &(usize, Vec<f32>), b: &(usize, Vec<f32>)) -> f64 {
    kernel_l1((a.0, &a.1), (b.0, &b.1))
}

/// The kernel of samples as they are, on a film of 2 µm.
fn on_film(samples: Vec<f32>) -> (usize, Vec<f32>) {
    let stack = PsfStack { size: N, pitch_um: 1.0, sample: PsfSample::Point, samples };
    let kernels = NodeKernels::new(&stack, 2.0, None, Simd::PORTABLE);
    (kernels.size(), kernels.unrotated(0, &mut KernelScratch::default()).to_vec())
}

#[test]
fn places_of_ideal_points_are_found_and_moved_with_the_image() {
    let polar = PsfPlaces::Polar { azimuth_samples: vec![1, 1] };
    for (band, [x, y]) in [(symmetric(), [0.0, 0.0]), (planar(polar), [0.02, 0.01])] {
        let film = BandOnFilm::new(&band, 2.0);
        let boresight = film.place_of([0.0; 2]).unwrap();
        assert!((boresight[0] - x).abs() < 1e-8 && (boresight[1] - y).abs() < 1e-8, "{boresight:?}");
        for place in [[3.0, -4.0], [-6.5, 0.3], [0.01, 0.02]] {
            let (ideal, _) = film.at(place);
            let found = film.place_of(ideal).unwrap();
            assert!((found[0] - place[0]).abs() < 1e-8 && (found[1] - place[1]).abs() < 1e-8);
        }
    }
    let band = symmetric();
    let film = BandOnFilm::new(&band, 2.0);
    assert!(film.covers([6.0, -8.0]) && !film.covers([6.1, -8.0]) && film.half_sides_mm() == [10.0; 2]);
    let ([x, y], r) = film.at([3.0, -4.0]);
    assert!((x - 3.0 * 0.9975).abs() < 1e-4 && (y + 4.0 * 0.9975).abs() < 1e-4 && (r - 0.975).abs() < 1e-4);
}

#[test]
fn kernels_of_heights_are_rotated_and_linear_between_nodes() {
    let band = symmetric();
    let film = BandOnFilm::new(&band, 2.0);
    // A tail away from the axis at 10 mm.
    let (axis, edge) = (gauss(2.0, 2.0, (0.0, 0.0)), gauss(4.0, 2.0, (3.0, 0.0)));
    let sets = [axis.clone(), edge.clone()];
    assert!(l1(&kernel(&film, [0.0, 0.0], &sets), &on_film(axis.clone())) < 1e-5);
    assert!(l1(&kernel(&film, [10.0, 0.0], &sets), &on_film(edge.clone())) < 1e-5);
    // Y is down, and so are rows.
    let down = gauss(2.0, 4.0, (0.0, 3.0));
    assert!(l1(&kernel(&film, [0.0, 10.0], &sets), &on_film(down.clone())) < 1e-5);
    assert!(l1(&kernel(&film, [0.0, -10.0], &sets), &on_film(down)) > 0.5);
    let half: Vec<f32> = std::iter::zip(&axis, &edge).map(|(a, b)| 0.5 * (a + b)).collect();
    assert!(l1(&kernel(&film, [5.0, 0.0], &sets), &on_film(half)) < 1e-5);
}

#[test]
fn kernels_of_azimuths_are_those_of_their_rows_and_grids_are_not_rotated() {
    // Four azimuths at 10 mm, seen in the frame that is rotated with them: the tail of the third points towards the axis.
    let rows: Vec<Vec<f32>> = [3.0, 1.0, -3.0, 1.0].map(|x| gauss(3.0, 2.0, (x, 0.0))).into();
    let band = planar(PsfPlaces::Polar { azimuth_samples: vec![1, 4] });
    let film = BandOnFilm::new(&band, 2.0);
    let sets = [gauss(2.0, 2.0, (0.0, 0.0)), rows.concat()];
    assert!(l1(&kernel(&film, [10.0, 0.0], &sets), &on_film(rows[0].clone())) < 1e-5);
    assert!(l1(&kernel(&film, [-10.0, 0.0], &sets), &on_film(gauss(3.0, 2.0, (3.0, 0.0)))) < 1e-4);

    let psfs = PsfPlaces::Cartesian { x_mm: vec![-5.0, 5.0], y_mm: vec![-5.0, 5.0] };
    let band = planar(psfs);
    let film = BandOnFilm::new(&band, 2.0);
    let sets = [(-3.0, -1.0), (2.0, -1.0), (-3.0, 4.0), (2.0, 4.0)].map(|centre| gauss(3.0, 2.0, centre));
    assert!(l1(&kernel(&film, [5.0, -5.0], &sets), &on_film(sets[1].clone())) < 1e-5);
    assert!(l1(&kernel(&film, [-7.0, 9.0], &sets), &on_film(sets[2].clone())) < 1e-5, "beyond the nodes");
    let mean = (0..N * N).map(|i| sets.iter().map(|set| 0.25 * set[i]).sum()).collect();
    assert!(l1(&kernel(&film, [0.0, 0.0], &sets), &on_film(mean)) < 1e-5);
}
