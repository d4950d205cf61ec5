//! Weights in the light of a sun and a sky, of surfaces that emit, and of the background.

use super::*;

#[test]
fn without_light_weights_are_colours_times_the_number_of_hits() {
    let mesh = TestMesh::default().with(0, wall(2.0, 1.0));
    let materials = [material("red", [0.5, 0.25, 0.0])];
    let appearance = appearance(&mesh, &materials, Lighting::even(1000.0));
    let (triangle, hit) = hit(&mesh, 0, 0.1, 0.05).unwrap();
    assert_eq!(weights(&appearance, triangle, &[hit; 3]), [1.5, 0.75, 0.0]);
    assert_eq!(weights(&appearance, triangle, &[]), [0.0; 3]);
    assert!(appearance.is_opaque(0) && appearance.exists(0, &hit, 16));
    assert_eq!((appearance.clipped(), appearance.bytes(), appearance.notes().len()), (0, 0, 0));
}

#[test]
fn even_weights_are_those_of_a_hit_wherever_it_is() {
    let coloured = Geometry { colours: vec![[1.0; 4]; 4].into(), ..wall(2.0, 1.0) };
    let mesh = TestMesh::default()
        .with(0, wall(2.0, 1.0))
        .with(1, wall(2.0, 1.0))
        .with(2, wall(2.0, 1.0))
        .with(3, wall(2.0, 1.0))
        .with(0, coloured);
    let lamp = Material { emission: [1.0, 0.0, 0.0], ..material("lamp", [0.5; 3]) };
    let materials = [
        material("red", [0.5, 0.25, 0.0]),
        material("bright", [1.5, 0.5, 0.5]),
        lamp,
        material("grey", [0.4; 3]),
    ];
    let spectrum = Spectrum::new("grey", vec![400.0, 700.0], vec![0.4, 0.4], 1.0).unwrap();
    let assigned = [Assigned { materials: vec![3], spectrum, times_texture: false }];
    let of = |lighting| {
        let request = AppearanceRequest { assigned: &assigned, ..request(&mesh, &materials, lighting) };
        Appearance::new(request).unwrap()
    };
    let even = of(Lighting::even(1000.0));
    let found = |appearance: &Appearance<'_, TestMesh>, part: u32| {
        let mut weights = vec![0.0; appearance.bases()];
        appearance.even_weights(2 * part, &mut weights).then_some(weights)
    };
    assert_eq!(found(&even, 0), Some(vec![0.5, 0.25, 0.0, 0.0]));
    assert_eq!(found(&even, 3), Some(vec![0.0, 0.0, 0.0, 1.0]));
    // Limited colours are counted, a lamp has two terms, colours of vertices depend on the place.
    assert_eq!([1, 2, 4].map(|part| found(&even, part)), [None, None, None]);
    assert_eq!(even.clipped(), 0);
    let sun = Sun { azimuth_deg: 0.0, elevation_deg: -60.0, illuminance_lx: 2000.0 };
    assert_eq!(found(&of(lighting(light(Some(sun), None))), 0), None);
}

#[test]
fn a_sun_at_60_degrees_and_the_shadow_of_a_square() {
    // The sun is behind the camera and above it (y down): its direction is (0, −√3/2, −½). North is −Z, up +Y, so that it is 60° below.
    let sun = Sun { azimuth_deg: 0.0, elevation_deg: -60.0, illuminance_lx: 2000.0 };
    let blocker = quad([-0.01, -0.01 - 0.1 * 3f32.sqrt(), 1.9], [0.02, 0.0, 0.0], [0.0, 0.02, 0.0]);
    let mesh = TestMesh::default().with(1, wall(2.0, 3.0)).with(0, blocker);
    let materials = [material("red", [1.0, 0.0, 0.0]), material("green", [0.0, 0.5, 0.0])];
    let appearance = appearance(&mesh, &materials, lighting(light(Some(sun), None)));
    let mut dark = Vec::new();
    for row in 8..32 {
        for column in 16..32 {
            let (x, y) = ((f64::from(column) - 23.5) * 0.001, (f64::from(row) - 19.5) * 0.001);
            let found = seen(&appearance, &mesh, x, y);
            assert_eq!((found[0], found[2]), (0.0, 0.0));
            match found[1] {
                0.0 => dark.push((row, column)),
                lit => assert!((lit - 0.5 * 2.0 * 0.5).abs() < 1e-12, "{lit}"),
            }
        }
    }
    // The square itself, 0.02 m at 2 m, about the axis.
    assert_eq!(dark.len(), 100);
    assert!(dark.iter().all(|&(r, c)| (15..25).contains(&r) && (19..29).contains(&c)), "{dark:?}");
}

#[test]
fn an_open_sky_is_exact_and_a_wall_takes_half() {
    let sky = || lighting(light(None, Some(3000.0)));
    let white = [material("white", [1.0; 3])];
    let open = TestMesh::default().with(0, wall(2.0, 1e3));
    assert_eq!(seen(&appearance(&open, &white, sky()), &open, 0.0005, 0.0005), [3.0; 3]);
    let side = quad([0.05, -1e3, 2.0], [0.0, 2e3, 0.0], [0.0, 0.0, -1e3]);
    let mesh = TestMesh::default().with(0, wall(2.0, 1e3)).with(0, side);
    let half = seen(&appearance(&mesh, &white, sky()), &mesh, 0.0245, 0.0005)[0] / 3.0;
    assert!((half - 0.5).abs() <= 0.03, "{half}");
}

#[test]
fn the_side_that_the_camera_sees_is_lit_whatever_the_order_of_the_corners() {
    let sun = Sun { azimuth_deg: 0.0, elevation_deg: 0.0, illuminance_lx: 1000.0 };
    let mut reversed = wall(2.0, 1.0);
    reversed.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    for geometry in [wall(2.0, 1.0), reversed] {
        let mesh = TestMesh::default().with(0, geometry);
        let white = [material("white", [1.0; 3])];
        assert_eq!(
            seen(&appearance(&mesh, &white, lighting(light(Some(sun), None))), &mesh, 0.1, 0.1),
            [1.0; 3]
        );
        let behind = Sun { azimuth_deg: 180.0, ..sun };
        assert_eq!(
            seen(&appearance(&mesh, &white, lighting(light(Some(behind), None))), &mesh, 0.1, 0.1),
            [0.0; 3]
        );
    }
}

#[test]
fn interpolated_normals_are_rotated_and_scaled_with_the_part() {
    let sun = Sun { azimuth_deg: 0.0, elevation_deg: 0.0, illuminance_lx: 1000.0 };
    // Normals (0, ±1, 1)/√2 at the lower and upper corners, away from the camera: (0, 0, 1) in the middle.
    let mut geometry = wall(2.0, 1.0);
    let half = 0.5f32.sqrt();
    geometry.normals =
        vec![[0.0, -half, half], [0.0, -half, half], [0.0, half, half], [0.0, half, half]].into();
    let mut mesh = TestMesh::default().with(0, geometry);
    let white = [material("white", [1.0; 3])];
    let at = |mesh: &TestMesh, y: f64| {
        seen(&appearance(mesh, &white, lighting(light(Some(sun), None))), mesh, 0.01, y)[0]
    };
    // At a share s of the height the normal is (0, s, 1) up to its length.
    for share in [-0.5, 0.0, 0.25] {
        let expected = 1.0 / (1.0f64 + share * share).sqrt();
        assert!((at(&mesh, share / 2.0) - expected).abs() < 1e-7, "{share}");
    }
    // A part that is twice as deep (z doubled) has normals half as deep.
    mesh.parts[0].to_world[2][2] = 2.0;
    let expected = 1.0 / (1.0f64 + 0.25).sqrt();
    assert!((at(&mesh, 0.125) - expected).abs() < 1e-7, "{}", at(&mesh, 0.125));
}

#[test]
fn emission_adds_its_luminance_in_the_light_of_the_illuminant() {
    let mesh = TestMesh::default().with(0, wall(2.0, 1.0));
    let mut materials = [material("screen", [0.0; 3])];
    materials[0].emission = [200.0, 100.0, 0.0];
    let of = |lighting| seen(&appearance(&mesh, &materials, lighting), &mesh, 0.1, 0.2);
    let sky = lighting(light(None, Some(0.0)));
    for found in [of(Lighting::even(500.0)), of(sky).iter().map(|w| 2.0 * w).collect()] {
        // White of weight 1 has 500/π cd/m².
        assert!((found[0] - 200.0 * std::f64::consts::PI / 500.0).abs() < 1e-14, "{found:?}");
        assert!((found[1] / found[0] - 0.5).abs() < 1e-15 && found[2] == 0.0);
    }
}

#[test]
fn backgrounds_are_luminances() {
    let mesh = TestMesh::default().with(0, wall(2.0, 1.0));
    let materials = [material("plain", [0.5; 3])];
    let of = |lighting: Lighting, background| {
        let request = AppearanceRequest { background, ..request(&mesh, &materials, lighting) };
        let appearance = Appearance::new(request).unwrap();
        let mut sums = vec![0.0; appearance.bases()];
        appearance.add_background(&mut sums);
        (appearance.has_background(), sums)
    };
    assert_eq!(of(Lighting::even(500.0), Background::None), (false, vec![0.0; 3]));
    let (has, white) = of(Lighting::even(500.0), Background::Luminance(500.0));
    assert!(has && white.iter().all(|w| (w - std::f64::consts::PI).abs() < 1e-15));
}
