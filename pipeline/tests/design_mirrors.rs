//! Mirrors, central obscurations and folded axes: design files, and the pupil and PSF of an obscured lens compared with closed forms.

mod design_cases;

use std::f64::consts::PI;

use design_cases::{bessel_j1_over_x, system};
use lenscube_pipeline::design::glass::{Dispersion, Glass};
use lenscube_pipeline::design::glass_library::GlassLibrary;
use lenscube_pipeline::design::illumination::{field_light, numerical_aperture};
use lenscube_pipeline::design::paraxial::Paraxial;
use lenscube_pipeline::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use lenscube_pipeline::design::pupil::Pupil;
use lenscube_pipeline::design::ray::Tracer;
use lenscube_pipeline::design::spots::spot;
use lenscube_pipeline::design::surface::Shape;
use lenscube_pipeline::design::system::{Medium, Surface};
use lenscube_pipeline::design::{DesignError, ReadOptions, System, optiland, table, zmx};

/// Newtonian telescope: paraboloid of f = 300 mm, a plane mirror at 45 degrees 150 mm before it, the film beside the tube.
const NEWTON: &str = "MODE SEQ\nUNIT MM\nENPD 100\nRAIM 0 2\nFTYP 0 0 1 1\nYFLN 0.3\nWAVM 1 0.55 1\nPWAV 1\nSURF 0\n  TYPE STANDARD\n  CURV 0\n\
    \x20 DISZ INFINITY\nSURF 1\n  TYPE STANDARD\n  CURV 0\n  DISZ 200\n  OBSC 0 20\nSURF 2\n  STOP\n  TYPE STANDARD\n  CURV -0.00166666666666666667\n  CONI -1\n\
    \x20 GLAS MIRROR\n  DISZ -150\n  CLAP 15 60\nSURF 3\n  TYPE COORDBRK\n  PARM 3 45\n  DISZ 0\nSURF 4\n  TYPE STANDARD\n  CURV 0\n  GLAS MIRROR\n  DISZ 0\n\
    SURF 5\n  TYPE COORDBRK\n  PARM 3 45\n  DISZ 150\nSURF 6\n  TYPE STANDARD\n  CURV 0\n  DISZ 0\n";

fn read(text: &str) -> Result<System, DesignError> {
    zmx::parse(text.as_bytes(), &GlassLibrary::new(), &ReadOptions::default())
}

#[test]
fn newtonian_telescope_is_in_focus_and_its_obscuration_takes_its_light() {
    let system = read(NEWTON).unwrap();
    assert!(system.notes.iter().any(|n| n.contains("fold the axis at 1 plane mirror")), "{:?}", system.notes);
    assert_eq!(
        (system.surfaces[0].obscuration_mm, system.surfaces[1].obscuration_mm),
        (Some(20.0), Some(15.0))
    );
    // The shadow of a curved mirror, drawn as large as it is.
    let shadow = NEWTON.replace("CURV 0\n  DISZ 200\n", "CURV -0.01\n  DIAM 20 1\n  DISZ 200\n");
    let shadow = &read(&shadow).unwrap().surfaces[0];
    assert_eq!(
        (shadow.shape.curvature, shadow.aperture_mm, shadow.obscuration_mm),
        (-0.01, None, Some(20.0))
    );
    let p = Paraxial::new(&system, 0.55).unwrap();
    assert!((p.effective_focal_length_mm - 300.0).abs() < 1e-9 && p.focus_shift_mm().abs() < 1e-9, "{p:?}");
    // The fold mirror turns the light back along z.
    assert!((p.total_track_mm - 200.0).abs() < 1e-9, "{}", p.total_track_mm);
    let tracer = Tracer::new(&system, 0.55).unwrap();
    assert!(!tracer.passes(0.0, 0.39, 0.0) && tracer.passes(0.0, 0.41, 0.0) && tracer.passes(0.0, 0.0, 0.99));
    // A paraboloid images the axis in a point.
    let axis = spot(&tracer, 0.0).unwrap();
    assert!(axis.strehl > 0.999_999 && axis.geo_um < 1e-6, "{axis:?}");
    let open = read(&NEWTON.replace("  OBSC 0 20\n", "").replace("CLAP 15 60", "CLAP 0 60")).unwrap();
    let whole = Tracer::new(&open, 0.55).unwrap();
    let share =
        field_light(&tracer, 0.0).unwrap().irradiance_sr / field_light(&whole, 0.0).unwrap().irradiance_sr;
    assert!((share - 0.84).abs() < 1e-9, "{share}");
    // The numerical aperture is that of the marginal ray.
    let (a, b) = (numerical_aperture(&tracer).unwrap(), numerical_aperture(&whole).unwrap());
    assert!((a - b).abs() < 1e-9, "{a} {b}");
}

#[test]
fn folded_systems_are_written_along_z_and_read_again() {
    let system = read(NEWTON).unwrap();
    let written = [
        (zmx::write(&system, "own").unwrap().text, zmx::parse as fn(&[u8], &GlassLibrary, &ReadOptions) -> _),
        (table::write(&system, "own").unwrap().text, table::parse),
        (optiland::write(&system).unwrap().text, optiland::parse),
    ];
    for (text, parse) in written {
        let again: Result<System, DesignError> =
            parse(text.as_bytes(), &GlassLibrary::new(), &ReadOptions::default());
        for (a, b) in system.surfaces.iter().zip(&again.unwrap().surfaces) {
            assert!((a.thickness_mm - b.thickness_mm).abs() < 1e-9, "{text}");
            assert!((a.shape.curvature - b.shape.curvature).abs() < 1e-15, "{text}");
            assert_eq!(
                (a.is_mirror, a.obscuration_mm, a.aperture_mm),
                (b.is_mirror, b.obscuration_mm, b.aperture_mm)
            );
        }
    }
}

/// A lens in front of a prism of glass: a path of 20 mm, straight or folded at 45 degrees after 10 mm.
fn prism(folded: bool, operands: &str) -> String {
    let glass = "GLAS N-BK7 0 0 1.5 40";
    let fold = format!(
        "SURF 4\n  TYPE COORDBRK\n  PARM 3 45\n  DISZ 0\nSURF 5\n  TYPE STANDARD\n  GLAS MIRROR\n  DISZ 0\n\
         SURF 6\n  TYPE COORDBRK\n  PARM 3 45\n  DISZ -10\n  {glass}\nSURF 7\n  TYPE STANDARD\n  DISZ -30\nSURF 8\n"
    );
    let (length, rest) = match folded {
        true => (10, fold),
        false => (20, "SURF 4\n  TYPE STANDARD\n  DISZ 30\nSURF 5\n".to_owned()),
    };
    format!(
        "MODE SEQ\nUNIT MM\nENPD 10\nGCAT SCHOTT\nRAIM 0 0\nFTYP 0 0 1 1\nYFLN 0\nWAVM 1 0.5876 1\nPWAV 1\nSURF 0\n  TYPE STANDARD\n\
         \x20 DISZ INFINITY\nSURF 1\n  STOP\n  TYPE STANDARD\n  CURV 0.02\n  DISZ 5\n  {glass}\nSURF 2\n  TYPE STANDARD\n  CURV -0.02\n  DISZ 5\n\
         SURF 3\n  TYPE STANDARD\n  DISZ {length}\n  {glass}\n{rest}  TYPE STANDARD\n  DISZ 0\n{operands}"
    )
}

/// Coordinate breaks behind a mirror, or behind a glass of another configuration, continue the medium before them.
#[test]
fn prism_is_of_glass_behind_its_mirror() {
    let paraxial = |text: &str, configuration| {
        let options = ReadOptions { strict: false, configuration };
        let system = zmx::parse(text.as_bytes(), &GlassLibrary::new(), &options).unwrap();
        let p = Paraxial::new(&system, 0.5876).unwrap();
        [p.effective_focal_length_mm.abs(), p.focus_shift_mm()]
    };
    let (straight, folded) = (prism(false, ""), prism(true, ""));
    let same = |a: [f64; 2], b: [f64; 2]| (0..2).all(|k| (a[k] - b[k]).abs() < 1e-9);
    let (a, b) = (paraxial(&straight, None), paraxial(&folded, None));
    assert!(same(a, b), "{a:?} {b:?}");
    // The prism of another configuration, in place of the saved one.
    let operands = "MNUM 2 1\nGLSS 3 1 \"N-BK7\" 0\nGLSS 3 2 \"F2\" 0\n";
    let heavy = straight.replacen("DISZ 20\n  GLAS N-BK7", "DISZ 20\n  GLAS F2", 1);
    let (a, b) = (paraxial(&heavy, None), paraxial(&prism(true, operands), Some(2)));
    assert!(same(a, b), "{a:?} {b:?}");
}

#[test]
fn impossible_folds_and_obscurations_name_the_surface() {
    for (from, to, words) in [
        (
            "SURF 5\n  TYPE COORDBRK\n  PARM 3 45",
            "SURF 5\n  TYPE COORDBRK\n  PARM 3 44",
            ["surface 6", "surface 5"],
        ),
        ("SURF 3\n  TYPE COORDBRK", "SURF 3\n  TYPE COORDBRK\n  PARM 1 2", ["surface 6", "off the axis"]),
        ("OBSC 0 20", "OBSC 0 60", ["all others are blocked", "(0.0000, 0.0000)"]),
        ("CLAP 15 60", "CLAP 70 60", ["obscuration", "as large as its aperture"]),
    ] {
        let result = read(&NEWTON.replace(from, to)).and_then(|system| {
            let tracer = Tracer::new(&system, 0.55)?;
            field_light(&tracer, 0.0).map(|_| ())
        });
        let error = result.unwrap_err().to_string();
        assert!(words.iter().all(|w| error.contains(w)), "{to}: {error}");
    }
}

/// A disc of radius 3 at 20 mm before a stop of radius 5: the open area is that of the stop less the overlap of the two discs.
#[test]
fn open_area_behind_a_disc_is_that_of_overlapping_circles() {
    let mut disc = Surface::new(0.0, 20.0, Medium::Air);
    disc.obscuration_mm = Some(3.0);
    let plane = |t| Surface::new(0.0, t, Medium::Air);
    let system = system(vec![disc, plane(50.0), plane(0.0)], 1, 10.0);
    let tracer = Tracer::new(&system, 0.55).unwrap();
    for tan in [0.0, 0.05, 0.15, 0.25, 0.35, 0.5] {
        let (stop, hidden, d): (f64, f64, f64) = (5.0, 3.0, 20.0 * tan);
        let overlap = if d >= stop + hidden {
            0.0
        } else if d <= stop - hidden {
            PI * hidden * hidden
        } else {
            let angle = |r: f64, s: f64| ((d * d + r * r - s * s) / (2.0 * d * r)).acos();
            let root = (stop + hidden - d) * (d + stop - hidden) * (d - stop + hidden) * (d + stop + hidden);
            stop * stop * angle(stop, hidden) + hidden * hidden * angle(hidden, stop) - 0.5 * root.sqrt()
        };
        let nodes = Pupil::new(&tracer, tan).unwrap().nodes(&tracer, tan, 7, 9);
        let area = 2.0 * stop * stop * nodes.iter().map(|n| n.weight).sum::<f64>();
        let expected = PI * stop * stop - overlap;
        assert!((area / expected - 1.0).abs() < 1e-6, "tan {tan}: {area} against {expected}");
    }
}

/// PSF of an annulus of inner radius ε: (2 J₁(x)/x − ε² 2 J₁(εx)/(εx))² of the open lens's peak (Born & Wolf, 8.6.2).
#[test]
fn obscured_lens_gives_the_pattern_of_an_annulus() {
    let (n, f, hidden): (f64, f64, f64) = (1.5, 100.0, 0.4);
    let glass = Glass { name: "n".to_owned(), dispersion: Dispersion::constant(n), range_um: (0.0, 9.0) };
    let mut front = Surface::new(0.0, 2.0, Medium::Glass(glass));
    front.obscuration_mm = Some(0.5 * hidden);
    let mut back = Surface::new(0.0, f, Medium::Air);
    back.shape = Shape { curvature: -1.0 / ((n - 1.0) * f), conic: -n * n, ..Shape::default() };
    let system = system(vec![front, back, Surface::new(0.0, 0.0, Medium::Air)], 0, 1.0);
    let tracer = Tracer::new(&system, 0.55).unwrap();
    let pupil = PupilFunction::trace(&tracer, 0.0).unwrap();
    let (half, pitch) = (40, 7.0);
    let psf = PsfGrid::new(half, pitch).psf(&pupil, 0.0, &mut PsfScratch::default());
    let na = numerical_aperture(&tracer).unwrap();
    let size = 2 * half + 1;
    // Peak as a share of the energy of the annulus.
    let peak = PI * (na / 0.55).powi(2) * (1.0 - hidden * hidden) * pitch * pitch;
    let mut worst = 0.0_f64;
    for (i, v) in psf.iter().enumerate() {
        let at = |i: usize| (i as f64 - half as f64) * pitch;
        let x = 2.0 * PI / 0.55 * na * at(i % size).hypot(at(i / size));
        let amplitude = 2.0 * bessel_j1_over_x(x) - hidden * hidden * 2.0 * bessel_j1_over_x(hidden * x);
        let expected = (amplitude / (1.0 - hidden * hidden)).powi(2);
        worst = worst.max((v / peak - expected).abs());
    }
    assert!(worst < 1e-4, "{worst:.2e} of the peak");
}
