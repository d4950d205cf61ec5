//! Light on a place against closed forms.

use super::directions::tangents;
use super::environment::Environment;
use super::*;
use crate::scene::description::{Light, LightKind};
use crate::scene::horizon::{Horizon, UpAxis};
use crate::scene::test_mesh::{IDENTITY, POSE, Random};
use crate::scene::vector::unit;

fn horizon() -> Horizon {
    Horizon::new(&POSE, UpAxis::Y)
}

fn request() -> LightRequest<'static> {
    LightRequest {
        environment: None,
        illuminance_lx: 1000.0,
        sun: None,
        sky_lx: None,
        lights: &[],
        unit_m: 1.0,
        sky_samples: 64,
    }
}

fn lighting(request: LightRequest<'_>) -> Lighting {
    Lighting::new(request, &POSE, &horizon()).unwrap()
}

/// A place at (0, 0, 2) whose normal is `normal`.
fn site(normal: [f64; 3]) -> Site {
    let normal = unit(normal).unwrap();
    Site { start: [0.0, 0.0, 2.0], geometric: normal, shading: normal }
}

fn sums(lighting: &Lighting, site: &Site, is_blocked: impl FnMut(&ShadowRay) -> bool) -> Vec<f64> {
    let mut sums = vec![0.0; lighting.spectra().len()];
    lighting.add(site, (0, 1), is_blocked, &mut sums);
    sums
}

fn close(a: [f64; 3], b: [f64; 3]) -> bool {
    (0..3).all(|k| (a[k] - b[k]).abs() < 1e-15)
}

#[test]
fn azimuths_are_compass_bearings_about_the_up_axis() {
    let y_up = horizon();
    for (azimuth, elevation, expected) in [
        (0.0, 0.0, [0.0, 0.0, -1.0]),
        (90.0, 0.0, [1.0, 0.0, 0.0]),
        (180.0, 0.0, [0.0, 0.0, 1.0]),
        (-90.0, 0.0, [-1.0, 0.0, 0.0]),
        (123.0, 90.0, [0.0, 1.0, 0.0]),
        (90.0, 30.0, [0.75f64.sqrt(), 0.5, 0.0]),
    ] {
        assert!(close(y_up.direction(azimuth, elevation), expected), "{azimuth} {elevation}");
    }
    let z_up = Horizon::new(&POSE, UpAxis::Z);
    let mut random = Random(2);
    for _ in 0..50 {
        let (azimuth, elevation) = (random.between(-180.0, 180.0), random.between(-89.0, 89.0));
        let [x, y, z] = z_up.direction(azimuth, elevation);
        // Converted to y up.
        assert!(close(y_up.direction(azimuth, elevation), [x, z, -y]));
        let (a, e) = z_up.angles_rad([3.0 * x, 3.0 * y, 3.0 * z]);
        assert!((a.to_degrees() - azimuth).abs() < 1e-12 && (e.to_degrees() - elevation).abs() < 1e-12);
    }
    // A camera that looks east: north is on its left.
    let east = crate::scene::pose::Pose {
        right: [0.0, 0.0, 1.0],
        down: [0.0, -1.0, 0.0],
        forward: [1.0, 0.0, 0.0],
        ..POSE
    };
    assert!(close(Horizon::new(&east, UpAxis::Y).direction(0.0, 0.0), [-1.0, 0.0, 0.0]));
}

#[test]
fn directions_of_the_sky_have_the_density_of_the_cosine() {
    for count in [1, 4, 16, 64] {
        let all = cosine_directions(count).unwrap();
        assert_eq!(all.len(), count);
        assert!(all.iter().all(|d| (dot(*d, *d) - 1.0).abs() < 1e-15 && d[2] > 0.0));
        // ∫ cos²/π over the hemisphere is 2/3; the midpoint rule for √ in `count` steps.
        let mean = all.iter().map(|d| d[2]).sum::<f64>() / count as f64;
        assert!((mean - 2.0 / 3.0).abs() < 0.05 / count as f64, "{count}: {mean}");
    }
    // i = 0 of 4: squared radius 1/8, angle (2·1 mod 5 − ½)/4 = 3/8.
    let first = cosine_directions(4).unwrap()[0];
    assert!(close(first, [-0.25, 0.25, 0.875f64.sqrt()]), "{first:?}");
    // Computed by another program.
    let all = cosine_directions(64).unwrap();
    let sum = |k: usize| all.iter().enumerate().map(|(i, d)| (i + 1) as f64 * d[k]).sum::<f64>();
    let expected = [-5.998_540_626_236_398, -28.297_745_175_906_286, 1_114.130_358_030_584];
    assert!((0..3).all(|k| (sum(k) - expected[k]).abs() < 1e-10));
    assert!(cosine_directions(8).is_none());
    let mut random = Random(9);
    for _ in 0..100 {
        let n = unit(std::array::from_fn(|_| random.between(-1.0, 1.0))).unwrap();
        let [t, b] = tangents(n);
        for (a, b, expected) in [(t, n, 0.0), (b, n, 0.0), (t, b, 0.0), (t, t, 1.0), (b, b, 1.0)] {
            assert!((dot(a, b) - expected).abs() < 1e-15);
        }
    }
}

#[test]
fn a_sun_has_the_cosine_of_its_angle_to_the_normal() {
    let sun = Sun { azimuth_deg: 0.0, elevation_deg: 30.0, illuminance_lx: 50_000.0 };
    let light = lighting(LightRequest { sun: Some(sun), ..request() });
    // Toward the horizon: 30°; straight up: 60°; away: nothing.
    for (normal, expected) in
        [([0.0, 0.0, -1.0], 50.0 * 0.75f64.sqrt()), ([0.0, 1.0, 0.0], 25.0), ([0.0, 0.0, 1.0], 0.0)]
    {
        let found = sums(&light, &site(normal), |_| false);
        assert!((found[0] - expected).abs() < 1e-12, "{found:?} {expected}");
    }
    assert_eq!(sums(&light, &site([0.0, 1.0, 0.0]), |_| true), [0.0]);
    // Below the triangle's plane nothing is lit, whatever the interpolated normal.
    let tilted = Site { geometric: [0.0, 0.0, 1.0], ..site([0.0, 1.0, 1.0]) };
    assert_eq!(sums(&light, &tilted, |_| panic!("no ray is needed")), [0.0]);
    assert_eq!((light.rays_per_site(), light.is_even()), (1, false));
}

#[test]
fn an_open_sky_is_exact_and_half_of_one_within_3_percent() {
    let light = lighting(LightRequest { sky_lx: Some(3000.0), ..request() });
    let mut random = Random(4);
    let mut worst = 0f64;
    for _ in 0..200 {
        let normal = unit(std::array::from_fn(|_| random.between(-1.0, 1.0))).unwrap();
        assert_eq!(sums(&light, &site(normal), |_| false), [3.0]);
        // A wall along the normal, in any direction about it.
        let [t, b] = tangents(normal);
        let (s, c) = random.between(0.0, std::f64::consts::TAU).sin_cos();
        let wall: [f64; 3] = std::array::from_fn(|k| c * t[k] + s * b[k]);
        let half = sums(&light, &site(normal), |ray| dot(ray.direction, wall) > 0.0)[0] / 3.0;
        worst = worst.max((half - 0.5).abs());
    }
    assert!(worst <= 0.03 + 1e-12, "{worst}");
}

/// A white map lights as an open sky, each of its three parts alone; a map lit in the north lights what faces north.
#[test]
fn hits_of_a_pixel_share_the_directions_of_the_sky() {
    let sun = Sun { azimuth_deg: 0.0, elevation_deg: 60.0, illuminance_lx: 700.0 };
    let light = lighting(LightRequest { sun: Some(sun), sky_lx: Some(300.0), ..request() });
    let ground = site([0.0, 1.0, 0.0]);
    // A quarter of the sky is hidden.
    let is_hidden = |ray: &ShadowRay| ray.direction[0] > 0.0 && ray.direction[2] > 0.0;
    let one = sums(&light, &ground, is_hidden);
    for hits in [1, 3, 16, 64, 100] {
        let (mut rays, mut all) = (0, vec![0.0; one.len()]);
        for hit in 0..hits {
            let count = |ray: &ShadowRay| {
                rays += 1;
                is_hidden(ray)
            };
            light.add(&ground, (hit, hits), count, &mut all);
        }
        assert_eq!(rays, 64 + hits, "one ray a hit to the sun, one a direction");
        for (all, one) in all.iter().zip(&one) {
            assert!((all - hits as f64 * one).abs() < 1e-12 * hits as f64, "{hits}: {all} {one}");
        }
    }
}

#[test]
fn a_map_lights_from_its_directions() {
    let of = |value: &dyn Fn(usize) -> f32| {
        let values = (0..36 * 72).map(|k| [value(k % 72); 3]).collect();
        let map = Environment::new((36, 72), values, 3000.0, (horizon(), 0.0)).unwrap();
        lighting(LightRequest { environment: Some(map), ..request() })
    };
    let white = of(&|_| 0.7);
    assert_eq!((white.spectra().len(), white.rays_per_site(), white.is_even()), (4, 64, false));
    let found = sums(&white, &site([0.0, 1.0, 0.0]), |_| false);
    assert!(found[0] == 0.0 && found[1..].iter().all(|v| (v - 3.0).abs() < 1e-4), "{found:?}");
    assert_eq!(sums(&white, &site([0.0, 1.0, 0.0]), |_| true), [0.0; 4]);
    // North is in the middle of the map, 60 degrees wide here; a camera without rotation looks there.
    let north = of(&|column| if (30..42).contains(&column) { 1.0 } else { 0.0 });
    let facing = |normal: [f64; 3]| sums(&north, &site(normal), |_| false)[1];
    let horizon = horizon();
    let (to, away) = (facing(horizon.direction(0.0, 0.0)), facing(horizon.direction(180.0, 0.0)));
    // Of luminance L: ∫∫ L cos²(elevation) cos(azimuth) = L π/2 on a wall that faces it; L π/6 on the ground, which has 3 (of 1000 lx).
    let expected = 9.0;
    assert!(away == 0.0 && (to / expected - 1.0).abs() < 0.1, "{to} {expected}");
}

fn point(kind: LightKind, intensity: f64, colour: [f32; 3]) -> Light {
    let mut to_world = IDENTITY;
    [to_world[0][3], to_world[1][3], to_world[2][3]] = [0.0, 3.0, 2.0];
    Light { name: "lamp".into(), to_world, colour, intensity, kind }
}

#[test]
fn points_fall_off_with_the_square_of_the_distance() {
    let up = site([0.0, 1.0, 0.0]);
    let of = |light: Light, unit_m: f64| {
        let lights = [light];
        let light = lighting(LightRequest { lights: &lights, unit_m, ..request() });
        let mut rays = Vec::new();
        let found = sums(&light, &up, |ray| {
            rays.push(*ray);
            false
        });
        (found, rays)
    };
    // 900 cd at 3 m: 100 lx of 1000.
    let (found, rays) = of(point(LightKind::Point(None), 900.0, [1.0; 3]), 1.0);
    assert!((found[0] - 0.1).abs() < 1e-15, "{found:?}");
    assert_eq!((rays[0].direction, rays[0].end), ([0.0, 3.0, 0.0], 1.0));
    // At range 6 the window is 1 − (3/6)⁴.
    let (found, _) = of(point(LightKind::Point(Some(6.0)), 900.0, [1.0; 3]), 1.0);
    assert!((found[0] - 0.1 * (1.0 - 0.0625)).abs() < 1e-15);
    assert_eq!(of(point(LightKind::Point(Some(2.9)), 900.0, [1.0; 3]), 1.0).0, [0.0]);
    // In a file in centimetres it is at (0, 0.03, 0.02) m.
    let (_, rays) = of(point(LightKind::Point(None), 900.0, [1.0; 3]), 0.01);
    assert!(rays.iter().all(|r| (r.direction[2] + 1.98).abs() < 1e-15));
    // The colour is a spectrum of its own, and its largest component intensity.
    let (found, _) = of(point(LightKind::Point(None), 900.0, [0.5, 0.25, 0.0]), 1.0);
    assert!(found[0] == 0.0 && (found[1] - 0.05).abs() < 1e-15);
}

#[test]
fn spots_are_limited_to_their_cone_and_shine_along_minus_z() {
    let up = site([0.0, 1.0, 0.0]);
    let of = |axis_deg: f64| {
        let mut light = point(LightKind::Spot(10f64.to_radians(), 30f64.to_radians(), None), 900.0, [1.0; 3]);
        // +Z of the node, the direction against the light, is up, rotated about x.
        let (s, c) = axis_deg.to_radians().sin_cos();
        [light.to_world[0][2], light.to_world[1][2], light.to_world[2][2]] = [0.0, 2.0 * c, 2.0 * s];
        let lights = [light];
        sums(&lighting(LightRequest { lights: &lights, ..request() }), &up, |_| false)[0]
    };
    let cos = |deg: f64| deg.to_radians().cos();
    let share = (cos(20.0) - cos(30.0)) / (cos(10.0) - cos(30.0));
    for (angle, expected) in [(0.0, 0.1), (9.0, 0.1), (20.0, 0.1 * share * share), (31.0, 0.0), (180.0, 0.0)]
    {
        assert!((of(angle) - expected).abs() < 1e-14, "{angle}: {}", of(angle));
    }
    let mut sun = point(LightKind::Directional, 2000.0, [1.0; 3]);
    (sun.to_world[1][2], sun.to_world[2][2]) = (7.0, 0.0);
    let lights = [sun];
    assert_eq!(sums(&lighting(LightRequest { lights: &lights, ..request() }), &up, |_| false), [2.0]);
}

#[test]
fn lights_of_one_colour_share_a_spectrum() {
    let of = |colour| point(LightKind::Point(None), 900.0, colour);
    let lights = [
        of([1.0; 3]),
        of([1.0, 0.5, 0.0]),
        of([0.25; 3]),
        of([0.5, 0.25, 0.0]),
        of([0.0; 3]),
        of([0.0, 1.0, 0.0]),
    ];
    let light = lighting(LightRequest { lights: &lights, ..request() });
    let expected = [
        LightSpectrum::Illuminant,
        LightSpectrum::Colour([1.0, 0.5, 0.0]),
        LightSpectrum::Colour([0.0, 1.0, 0.0]),
    ];
    assert_eq!(light.spectra(), expected);
    let found = sums(&light, &site([0.0, 1.0, 0.0]), |_| false);
    for (found, expected) in found.iter().zip([0.125, 0.15, 0.1]) {
        assert!((found - expected).abs() < 1e-15, "{found}");
    }
}

#[test]
fn without_light_of_its_own_a_scene_is_evenly_lit() {
    let light = lighting(request());
    assert!(light.is_even() && light.rays_per_site() == 0);
    assert_eq!(sums(&light, &site([0.0, 0.3, 1.0]), |_| panic!("no shadows")), [1.0]);
}

#[test]
fn light_that_cannot_be_is_an_error() {
    let error = |request: LightRequest<'_>| {
        Lighting::new(request, &POSE, &horizon()).err().expect("an error").to_string()
    };
    let sun = Sun { azimuth_deg: 0.0, elevation_deg: 91.0, illuminance_lx: 1.0 };
    assert_eq!(
        error(LightRequest { sun: Some(sun), ..request() }),
        "the elevation of the sun in degrees is 91; expected −90 to 90"
    );
    let sun = Sun { elevation_deg: 0.0, illuminance_lx: f64::NAN, ..sun };
    assert!(error(LightRequest { sun: Some(sun), ..request() }).contains("the sun in lx is NaN"));
    assert!(error(LightRequest { sky_lx: Some(-1.0), ..request() }).contains("the sky in lx is -1"));
    assert!(
        error(LightRequest { sky_lx: Some(1.0), sky_samples: 5, ..request() })
            .contains("is 5; expected 1, 4, 16 or 64")
    );
    assert!(
        error(LightRequest { illuminance_lx: 0.0, ..request() }).contains("is 0; expected a positive number")
    );
    let of = |light: Light| error(LightRequest { lights: &[light], ..request() });
    let mut flat = point(LightKind::Directional, 1.0, [1.0; 3]);
    flat.to_world = [[0.0; 4]; 4];
    assert_eq!(of(flat), "light `lamp`: its matrix gives it no direction");
    assert!(of(point(LightKind::Point(None), f64::INFINITY, [1.0; 3])).contains("intensity"));
    assert!(of(point(LightKind::Point(Some(0.0)), 1.0, [1.0; 3])).contains("range"));
    assert!(of(point(LightKind::Spot(1.0, 0.5, None), 1.0, [1.0; 3])).contains("cone"));
}
