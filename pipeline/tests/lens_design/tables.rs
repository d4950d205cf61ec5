//! The built-in Double Gauss compared with figures of the design program and with tables computed by other software.
//!
//! Source of the tables: `data/SOURCES.md`. Field points as there: ideal height over EFL is tan(field angle).

use lenscube_pipeline::design::film_pixel::FilmPixels;
use lenscube_pipeline::design::illumination::solid_angle_sr;
use lenscube_pipeline::design::paraxial::Paraxial;
use lenscube_pipeline::design::pattern_spot::{RINGS, pattern_spot, weighted_tracers};
use lenscube_pipeline::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use lenscube_pipeline::design::ray::Tracer;
use lenscube_pipeline::design::{System, describe};

struct Tables {
    um: Vec<f64>,
    ideal: Vec<f64>,
    efl: f64,
    real: Vec<f64>,
    ri: Vec<f64>,
    energy: Vec<f64>,
    size: usize,
    psf: Vec<f32>,
}

fn read(bytes: &[u8]) -> Tables {
    let word = |i: usize| u32::from_le_bytes(bytes[4 * i..][..4].try_into().unwrap()) as usize;
    let (b, k, size) = (word(0), word(1), word(2));
    let mut at = 12;
    let mut doubles = |n: usize| {
        let v: Vec<f64> =
            bytes[at..][..8 * n].chunks_exact(8).map(|c| f64::from_le_bytes(c.try_into().unwrap())).collect();
        at += 8 * n;
        v
    };
    let (um, ideal, efl) = (doubles(b), doubles(k), doubles(1)[0]);
    let (real, ri, energy) = (doubles(b * k), doubles(b * k), doubles(b * k));
    let psf = bytes[at..].chunks_exact(4).map(|c| f32::from_le_bytes(c.try_into().unwrap())).collect();
    Tables { um, ideal, efl, real, ri, energy, size, psf }
}

/// Largest errors: height [mm], RI, PSF over its peak, energy.
fn compare(t: &Tables) -> [f64; 4] {
    let system = System::double_gauss_28();
    let mut worst = [0.0_f64; 4];
    // 2 µm pixels from 0.5 µm samples, with a margin for the interpolation.
    let grid = PsfGrid::new(51 * 2 + 22, 0.5);
    let film = FilmPixels::new(grid.size(), 0.5, t.size, 2.0);
    let mut scratch = PsfScratch::default();
    for (b, um) in t.um.iter().enumerate() {
        let tracer = Tracer::new(&system, *um).unwrap();
        let axis = solid_angle_sr(&tracer, 0.0).unwrap();
        for (k, ideal) in t.ideal.iter().enumerate() {
            let i = b * t.ideal.len() + k;
            let tan = ideal / t.efl;
            let f = PupilFunction::trace(&tracer, tan).unwrap();
            let kernel = film.integrate(&grid.psf(&f, 0.0, &mut scratch));
            let energy: f64 = kernel.iter().sum();
            let n = t.size;
            let theirs = &t.psf[i * n * n..][..n * n];
            let peak = theirs.iter().fold(0.0_f64, |a, v| a.max(f64::from(*v)));
            // Their field point is on +y, rows along +y: transpose.
            let psf = (0..n * n)
                .map(|j| (kernel[(j % n) * n + j / n] / energy - f64::from(theirs[j])).abs() / peak)
                .fold(0.0, f64::max);
            let ri = solid_angle_sr(&tracer, tan).unwrap() / axis;
            let errors = [f.height_mm - t.real[i], ri - t.ri[i], psf, energy - t.energy[i]];
            for (w, e) in worst.iter_mut().zip(errors) {
                *w = w.max(e.abs());
            }
        }
    }
    worst
}

fn check(worst: [f64; 4]) {
    let [height, ri, psf, energy] = worst;
    println!("height {height:.2e} mm, RI {ri:.2e}, PSF {psf:.2e} of the peak, energy {energy:.2e}");
    assert!(height <= 1e-6 && ri <= 1e-4 && psf <= 1e-4 && energy <= 1e-4, "{worst:?}");
}

#[test]
fn subset_of_reference_tables_is_reproduced() {
    check(compare(&read(include_bytes!("../data/double-gauss-28-subset.bin"))));
}

/// All 31 × 22 tables, which `scripts/check-long` extracts from the built-in lens pack.
#[test]
#[ignore = "long: scripts/check --full"]
fn all_reference_tables_are_reproduced() {
    let path =
        std::env::var("LENSCUBE_DOUBLE_GAUSS_TABLES").expect("LENSCUBE_DOUBLE_GAUSS_TABLES names the file");
    check(compare(&read(&std::fs::read(path).unwrap())));
}

#[test]
fn first_order_figures_equal_the_design_program() {
    let system = System::double_gauss_28();
    let p = Paraxial::new(&system, system.primary_um()).unwrap();
    // Printed by the design program: distortion focal length at 0.5876 µm, chief ray at 0.0014°; EFL of the sample lens.
    let chief = Tracer::new(&system, system.primary_um())
        .unwrap()
        .chief_height_mm(0.0014_f64.to_radians().tan())
        .unwrap();
    println!("EFL {} f_d {} chief {chief:e}", p.effective_focal_length_mm, p.distortion_focal_length_mm);
    assert!((p.effective_focal_length_mm - 99.50068).abs() < 5e-6);
    assert!((p.distortion_focal_length_mm - 99.332_063_0).abs() < 5e-8);
    assert!((chief - 2.427_140_174_4e-3).abs() < 5e-14);
    let d = describe(&system).unwrap();
    assert!((d.image_space_f_number - 99.50068 / 33.33).abs() < 1e-6);
    assert!((d.total_track_mm - 132.988_419_345).abs() < 1e-9 && (d.paraxial_focus_mm - 0.1834).abs() < 5e-5);
    // Printed by the design program: n sin atan 1/(2 F#), f tan 14°.
    assert!((d.image_space_na - 0.16519).abs() < 5e-6 && (d.paraxial_image_height_mm - 24.808).abs() < 5e-4);
    // The real cone is a little wider than the paraxial one.
    assert!(
        (d.working_f_number - 0.5 / d.real_na).abs() < 1e-12 && d.working_f_number < d.image_space_f_number
    );
}

/// The design program's own spots of this lens (RMS, GEO in µm at 0, 10, 14 degrees, centroid, six rings), printed to 1e-6 µm.
#[test]
fn spots_equal_the_design_program() {
    let system = System::double_gauss_28();
    let tracers = weighted_tracers(&system).unwrap();
    for (degrees, rms, geo) in
        [(0.0_f64, 8.500_623, 16.872_411), (10.0, 9.353_259, 29.988_542), (14.0, 11.496_265, 38.214_342)]
    {
        let got = pattern_spot(&tracers, degrees.to_radians().tan(), RINGS, 0.0).unwrap();
        assert!((got.rms_um - rms).abs() < 2e-6 && (got.geo_um - geo).abs() < 2e-6, "{degrees}: {got:?}");
    }
}
