//! Tracing of a band: validity of its tables, energy in the window, error bound between nodes, the same bits for any threads.

use std::f64::consts::PI;

use lenscube_pipeline::design::film_pixel::FilmPixels;
use lenscube_pipeline::design::glass::{Dispersion, Glass};
use lenscube_pipeline::design::illumination::irradiance_sr;
use lenscube_pipeline::design::paraxial::Paraxial;
use lenscube_pipeline::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use lenscube_pipeline::design::ray::Tracer;
use lenscube_pipeline::design::system::{Aperture, Medium, Surface};
use lenscube_pipeline::design::trace::{
    Azimuths, BandRange, ESF_SHARE, LensTrace, PsfHeights, SharedNodes, TraceOptions, TracedBand, lens_header,
};
use lenscube_pipeline::design::{DesignError, System, trace_lens};

/// Two lenses of 50 mm, 150 mm apart: f₁f₂/(f₁ + f₂ − d) is negative, and the image of an object at 100 mm is real.
#[test]
fn focal_length_of_a_relay_has_no_sign_in_its_pack() {
    let glass = || {
        let dispersion = Dispersion::constant(1.5);
        Medium::Glass(Glass::new("n".to_owned(), dispersion, (0.0, 9.0)))
    };
    let lens = |gap| [Surface::new(0.02, 0.01, glass()), Surface::new(-0.02, gap, Medium::Air)];
    let surfaces = [&lens(150.0)[..], &lens(100.0), &[Surface::new(0.0, 0.0, Medium::Air)]].concat();
    let (aperture, object_distance_mm) = (Aperture::EntrancePupil(1.0), Some(100.0));
    let relay = System { surfaces, stop: 0, aperture, object_distance_mm, ..System::double_gauss_28() };
    let signed = Paraxial::new(&relay, relay.primary_um()).unwrap().effective_focal_length_mm;
    assert!((signed + 50.0).abs() < 0.1, "{signed}");
    assert_eq!(lens_header(&relay).unwrap().effective_focal_length_mm, -signed);
}

fn band(options: &TraceOptions) -> TracedBand {
    let system = System::double_gauss_28();
    let mut steps = 0;
    let band = LensTrace::new(&system, options).unwrap().band(0, &mut |_| steps += 1).unwrap();
    assert!(steps > 3);
    band
}

/// The largest share of light that a difference of kernels of `n` × `n` pixels has on one side of a line, of 16 directions.
fn edge(difference: &[f64], n: usize) -> f64 {
    let of = |i: usize| {
        let (sin, cos) = (PI * i as f64 / 16.0).sin_cos();
        let mut lines = vec![0.0; 2 * n];
        for (k, d) in difference.iter().enumerate() {
            let centred = |index: usize| index as f64 - (n / 2) as f64;
            let at = centred(k % n) * cos + centred(k / n) * sin;
            lines[(at.round() + n as f64) as usize] += d;
        }
        let running = lines.iter().scan(0.0, |sum, d| {
            *sum += d;
            Some(f64::abs(*sum))
        });
        running.fold(0.0, f64::max)
    };
    (0..16).map(of).fold(0.0, f64::max)
}

/// L1 errors, ascending, of the kernel interpolated from four nodes at random places, compared with the one traced there, and the largest error of an edge.
fn errors(band: &TracedBand, places: usize) -> (Vec<f64>, f64) {
    let system = System::double_gauss_28();
    let tables = &band.tables;
    let tracer = Tracer::new(&system, tables.wavelength_nm / 1e3).unwrap();
    let grid = PsfGrid::new(tables.psf_size / 2, tables.psf_pitch_um);
    let film = FilmPixels::new(grid.size(), grid.pitch_um(), band.report.window_px, 2.0);
    let mut scratch = PsfScratch::default();
    let mut kernel = |height: f64, azimuth: f64| {
        let f = PupilFunction::trace(&tracer, tracer.field_of_height(height).unwrap()).unwrap();
        let k = film.integrate(&grid.psf(&f, azimuth, &mut scratch));
        let sum: f64 = k.iter().sum();
        k.into_iter().map(|v| v / sum).collect::<Vec<f64>>()
    };
    let mut seed = 11_u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1_u64 << 53) as f64
    };
    let heights = &tables.psf_height_mm;
    let mut edges = 0.0;
    let mut out: Vec<f64> = (0..places)
        .map(|_| {
            let (r, theta) = (random() * heights[heights.len() - 1], random() * 2.0 * PI);
            let k = heights.partition_point(|h| *h <= r).clamp(1, heights.len() - 1);
            let u = (r - heights[k - 1]) / (heights[k] - heights[k - 1]);
            let mut error = kernel(r, theta);
            for (k, share) in [(k - 1, 1.0 - u), (k, u)] {
                let step = 2.0 * PI / tables.azimuth_count[k] as f64;
                let v = (theta / step).fract();
                let j = (theta / step).floor();
                for (j, share) in [(j, share * (1.0 - v)), (j + 1.0, share * v)] {
                    let node = kernel(heights[k], j * step);
                    assert_eq!(node.len(), error.len());
                    for (e, n) in error.iter_mut().zip(node) {
                        *e -= share * n;
                    }
                }
            }
            edges = edge(&error, band.report.window_px).max(edges);
            error.iter().map(|e| e.abs()).sum()
        })
        .collect();
    out.sort_by(f64::total_cmp);
    (out, edges)
}

#[test]
fn traced_band_is_within_its_tolerance_between_nodes() {
    let options = TraceOptions { psf_tolerance: 0.03, ..TraceOptions::new(vec![550.0], 12.0) };
    let band = band(&options);
    band.tables.check().unwrap();
    let error = band.report.psf_error.unwrap();
    let bound = error.worst;
    assert!(!error.limited && error.median <= error.worst && error.at_mm <= 12.0);
    assert!(bound <= 0.03, "{bound}");
    assert!(band.report.min_energy >= 0.99);
    let (found, edges) = errors(&band, 12);
    println!("bound {bound:.4}, found {found:.4?}, edges {:.4}, found {edges:.4}", error.edge);
    // The orientation of the pixel grid changes the L1 norm a little.
    assert!(found[found.len() - 1] <= 1.2 * bound);
    assert!(error.edge <= ESF_SHARE * options.psf_tolerance && edges <= 1.2 * error.edge);
    assert!(edges > 0.0, "of kernels that differ");
    for k in 0..band.psf.heights() {
        let sum: f64 = band.psf.window(k).iter().map(|v| f64::from(*v)).sum();
        assert!((sum - 1.0).abs() < 1e-5);
    }
    // Dense tables: real heights half-way between field points, within 1e-4 of a 2 µm pixel.
    let system = System::double_gauss_28();
    let tracer = Tracer::new(&system, 0.55).unwrap();
    let t = &band.tables;
    for i in [0, 300, 999] {
        let ideal = 0.5 * (t.ideal_height_mm[i] + t.ideal_height_mm[i + 1]);
        let real = tracer.chief_height_mm(ideal / tracer.ideal_scale_mm()).unwrap();
        assert!((real - 0.5 * (t.image_height_mm[i] + t.image_height_mm[i + 1])).abs() < 2e-7);
    }
    assert!((t.image_height_mm[1000] - 12.0).abs() < 1e-9 && t.relative_illumination[0] == 1.0);
}

/// The band at 560 nm has the nodes of 550 nm, whatever is traced before it, and its told error holds.
#[test]
fn neighbouring_bands_share_nodes_that_do_not_depend_on_other_bands() {
    let system = System::double_gauss_28();
    let options = |nm| TraceOptions { psf_tolerance: 0.03, ..TraceOptions::new(vec![nm], 12.0) };
    let trace = |nm, shared: &mut SharedNodes| {
        LensTrace::new(&system, &options(nm)).unwrap().band_sharing(0, shared, &mut |_| ()).unwrap()
    };
    let mut shared = SharedNodes::default();
    let others: Vec<TracedBand> = [550.0, 640.0].map(|nm| trace(nm, &mut shared)).to_vec();
    let after = trace(560.0, &mut shared);
    let alone = trace(560.0, &mut SharedNodes::default());
    assert_eq!((&after.tables, &after.psf), (&alone.tables, &alone.psf));
    assert_eq!(after.tables.psf_height_mm, others[0].tables.psf_height_mm);
    assert_ne!(after.tables.psf_height_mm, others[1].tables.psf_height_mm);
    assert!(after.report.psfs < alone.report.psfs && after.report.psfs < others[0].report.psfs);
    let bound = after.report.psf_error.unwrap().worst;
    let (found, _) = errors(&after, 12);
    println!("bound {bound:.4}, found {found:.4?}");
    assert!(bound <= 0.03 && found[found.len() - 1] <= 1.2 * bound);
}

/// The error bound with default options, in six bands; run by `scripts/check-long`.
#[test]
#[ignore = "long: scripts/check --full"]
fn kernels_between_nodes_are_within_1_5_percent() {
    let (system, mut shared) = (System::double_gauss_28(), SharedNodes::default());
    for nm in [400.0, 440.0, 480.0, 560.0, 620.0, 700.0] {
        let options = TraceOptions::new(vec![nm], 20.5);
        let trace = LensTrace::new(&system, &options).unwrap();
        let band = trace.band_sharing(0, &mut shared, &mut |_| ()).unwrap();
        let (found, edges) = errors(&band, 60);
        let (median, worst) = (found[30], found[59]);
        println!(
            "{nm} nm: bound {:.4}, found median {median:.4}, worst {worst:.4}, edges {edges:.4}",
            band.report.psf_error.unwrap().worst
        );
        assert!(worst <= 0.015 && median <= 0.005 && edges <= 0.002);
    }
}

#[test]
fn same_bits_for_any_number_of_threads() {
    let mut options = TraceOptions::new(vec![600.0], 6.0);
    options.heights = PsfHeights::Given(vec![0.0, 2.0, 6.0]);
    options.azimuths = Azimuths::Given(8);
    options.window_px = Some(31);
    let run = |threads| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| band(&options))
    };
    let (one, three) = (run(1), run(3));
    assert_eq!(one, three);
    assert_eq!(one.tables.azimuth_count, [1, 8, 8]);
}

#[test]
fn bands_are_passed_to_the_sink_and_errors_are_returned() {
    let system = System::double_gauss_28();
    let mut options = TraceOptions::new(vec![500.0, 600.0], 3.0);
    options.heights = PsfHeights::Given(vec![0.0, 3.0]);
    options.azimuths = Azimuths::Given(8);
    options.field_points = 11;
    let mut passed = Vec::new();
    let lens = trace_lens(&system, &options, &mut |_| (), |i, b| {
        passed.push((i, b.psf.size));
        Ok::<(), String>(())
    });
    let lens = lens.unwrap();
    assert_eq!((lens.bands.len(), passed.len()), (2, 2));
    assert!((lens.distortion_focal_length_mm - 99.332_063).abs() < 1e-6 && lens.object_distance_mm.is_none());
    let full = trace_lens(&system, &options, &mut |_| (), |_, _| Err("disk full"));
    assert!(matches!(full, Err(DesignError::Sink { problem, .. }) if problem == "disk full"));
    let far = TraceOptions::new(vec![550.0], 200.0);
    assert!(
        matches!(LensTrace::new(&system, &far), Err(DesignError::Height { reached_mm, .. }) if reached_mm > 20.0)
    );
    let odd = TraceOptions { window_px: Some(50), ..TraceOptions::new(vec![550.0], 5.0) };
    assert!(matches!(LensTrace::new(&system, &odd), Err(DesignError::Option { .. })));
    let uv = TraceOptions::new(vec![200.0], 5.0);
    assert!(matches!(LensTrace::new(&system, &uv), Err(DesignError::Wavelength { .. })));
}

#[test]
fn node_budget_is_kept_and_the_error_reported() {
    let options =
        TraceOptions { max_nodes: 150, psf_tolerance: 0.01, ..TraceOptions::new(vec![550.0], 12.0) };
    let band = band(&options);
    let nodes: usize = band.tables.azimuth_count.iter().sum();
    let error = band.report.psf_error.unwrap();
    println!("{nodes} nodes, {error:?}");
    assert!(nodes <= 150 && nodes > 60 && error.limited);
    assert!(error.worst > 0.01 && error.worst < 0.5 && error.median <= error.worst);
}

#[test]
fn window_that_cannot_hold_the_light_is_an_error_before_any_psf() {
    let system = System::double_gauss_28()
        .with_image_plane(lenscube_pipeline::design::system::ImagePlane::AsDesigned, 8.0)
        .unwrap();
    let options = TraceOptions::new(vec![550.0], 12.0);
    let start = std::time::Instant::now();
    let error = LensTrace::new(&system, &options).unwrap().band(0, &mut |_| ()).unwrap_err();
    assert!(matches!(error, DesignError::Window { max_px: 401, held, .. } if held < 0.9), "{error}");
    assert!(error.to_string().contains("--energy") && start.elapsed().as_secs() < 5);
}

/// A band of the Double Gauss at 410 nm with fixed nodes and window.
fn blue(range: Option<BandRange>) -> TracedBand {
    let mut options = TraceOptions::new(vec![410.0], 18.0);
    options.heights = PsfHeights::Given(vec![0.0, 9.0, 18.0]);
    options.azimuths = Azimuths::Given(8);
    options.window_px = Some(81);
    LensTrace::new(&System::double_gauss_28(), &options).unwrap().over(range).band(0, &mut |_| ()).unwrap()
}

#[test]
fn a_band_of_no_width_is_that_of_its_wavelength() {
    let (plain, mean) = (blue(None), blue(Some(BandRange { from_nm: 410.0, to_nm: 410.0, samples: 3 })));
    assert_eq!(mean.tables.image_height_mm, plain.tables.image_height_mm);
    assert_eq!(mean.tables.psf_pitch_um, plain.tables.psf_pitch_um);
    for (a, b) in mean.tables.relative_illumination.iter().zip(&plain.tables.relative_illumination) {
        assert!((a - b).abs() < 1e-12, "{a} {b}");
    }
    assert!((mean.tables.solid_angle_sr / plain.tables.solid_angle_sr - 1.0).abs() < 1e-12);
    let l1: f32 = mean.psf.samples.iter().zip(&plain.psf.samples).map(|(a, b)| (a - b).abs()).sum();
    // Sums of three in f32, and the sum's own rounding to 16 bits.
    assert!(mean.psf.samples.len() == plain.psf.samples.len() && l1 < 3.0 * 2e-5, "{l1:e}");
}

#[test]
fn psfs_of_a_band_lie_where_the_chief_rays_of_its_wavelengths_land() {
    // To one side of the band's wavelength, so that all are shifted in one direction.
    let range = BandRange { from_nm: 420.0, to_nm: 480.0, samples: 2 };
    let mean = blue(Some(range));
    let system = System::double_gauss_28();
    let own = Tracer::new(&system, 0.41).unwrap();
    let n = mean.tables.psf_size;
    let grid = PsfGrid::new(n / 2, mean.tables.psf_pitch_um);
    // Sum, and first moment in µm.
    let moments = |psf: &mut dyn Iterator<Item = f64>| {
        let x_um = |i: usize| ((i % n) as f64 - (n / 2) as f64) * grid.pitch_um();
        psf.enumerate().fold((0.0, 0.0), |(sum, moment), (i, v)| (sum + v, moment + v * x_um(i)))
    };
    for (k, height_mm) in [0.0, 9.0, 18.0].into_iter().enumerate() {
        let tan = own.field_of_height(height_mm).unwrap();
        let (mut expected, mut light, mut shift_um) = (0.0, 0.0, 0.0);
        for (nm, weight) in range.wavelengths_nm() {
            let tracer = Tracer::new(&system, nm / 1e3).unwrap();
            let f = PupilFunction::trace(&tracer, tan).unwrap();
            let (sum, moment) = moments(&mut grid.psf(&f, 0.0, &mut PsfScratch::default()).into_iter());
            let shift = 1e3 * (tracer.chief_height_mm(tan).unwrap() - height_mm);
            let share = weight * irradiance_sr(&tracer, tan).unwrap();
            expected += share * (moment + shift * sum);
            light += share * sum;
            shift_um += 0.5 * shift;
        }
        let (sum, moment) = moments(&mut mean.psf.window(k).iter().map(|v| f64::from(*v)));
        let (found, expected) = (moment / sum, expected / light);
        println!("{height_mm} mm: {found:.4} µm, expected {expected:.4}, mean shift {shift_um:.3}");
        // Light that a shift moves over the border of the window.
        assert!(
            (found - expected).abs() < 0.05 * shift_um.abs() + 1e-3,
            "{height_mm} mm: {found} {expected}"
        );
    }
    // A uniform chart: the mean of the irradiances, at the same place of the film.
    let light = |um: f64, h: f64| {
        let tracer = Tracer::new(&system, um).unwrap();
        irradiance_sr(&tracer, tracer.field_of_height(h).unwrap()).unwrap()
    };
    let [from, to] = [0.420, 0.480].map(|um| light(um, 0.0));
    let found = mean.tables.solid_angle_sr * mean.tables.transmission;
    assert!(
        from.min(to) * (1.0 - 1e-3) < found && found < from.max(to) * (1.0 + 1e-3),
        "{found} {from} {to}"
    );
}
