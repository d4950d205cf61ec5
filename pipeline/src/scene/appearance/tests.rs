//! Weights of pixels of small meshes against closed forms.

use super::*;
use crate::scene::description::{Geometry, Light, LightKind, Material, Texture, Wrap};
use crate::scene::horizon::{Horizon, UpAxis};
use crate::scene::light::{LightRequest, Sun};
use crate::scene::test_mesh::{POSE, TestMesh, material, quad, wall};
use crate::scene::weights::{LightSpectrum, Spectrum};

/// 1 mrad a pixel.
const FRAME: Frame = Frame::centred(100, 100, 0.001, 1.0);

fn request<'a>(
    mesh: &'a TestMesh,
    materials: &'a [Material],
    lighting: Lighting,
) -> AppearanceRequest<'a, TestMesh> {
    AppearanceRequest {
        triangles: mesh,
        parts: &mesh.parts,
        materials,
        textures: Vec::new(),
        assigned: &[],
        pose: POSE,
        frame: FRAME,
        lighting,
        background: Background::None,
    }
}

fn appearance<'a>(
    mesh: &'a TestMesh,
    materials: &'a [Material],
    lighting: Lighting,
) -> Appearance<'a, TestMesh> {
    Appearance::new(request(mesh, materials, lighting)).unwrap()
}

fn light(sun: Option<Sun>, sky_lx: Option<f64>) -> LightRequest<'static> {
    LightRequest {
        illuminance_lx: 1000.0,
        sun,
        sky_lx,
        lights: &[],
        unit_m: 1.0,
        environment: None,
        sky_samples: 64,
    }
}

fn lighting(request: LightRequest<'_>) -> Lighting {
    Lighting::new(request, &POSE, &Horizon::new(&POSE, UpAxis::Y)).unwrap()
}

/// The nearest hit of a ray: the triangle and the place on it.
fn hit(mesh: &TestMesh, sample: u32, x: f64, y: f64) -> Option<(u32, SampleHit)> {
    let of = |triangle| {
        let v = mesh.corners(triangle);
        let edges = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| {
            let n = cross(v[i], v[j]);
            (n[0] * x + n[1] * y) + n[2]
        });
        let n = cross(std::array::from_fn(|k| v[1][k] - v[0][k]), std::array::from_fn(|k| v[2][k] - v[0][k]));
        let vergence = dot(n, [x, y, 1.0]) / dot(n, v[0]);
        let is_hit = (edges.iter().all(|e| *e >= 0.0) || edges.iter().all(|e| *e <= 0.0)) && vergence > 0.0;
        let sum: f64 = edges.iter().sum();
        is_hit.then(|| (triangle, SampleHit { sample, x, y, vergence, barycentric: edges.map(|e| e / sum) }))
    };
    (0..mesh.triangles()).filter_map(of).reduce(|a, b| if b.1.vergence > a.1.vergence { b } else { a })
}

fn weights(appearance: &Appearance<'_, TestMesh>, triangle: u32, hits: &[SampleHit]) -> Vec<f64> {
    let mut sums = vec![0.0; appearance.bases()];
    appearance.add_weights(triangle, hits, &mut sums);
    sums
}

/// The weights of one ray.
fn seen(appearance: &Appearance<'_, TestMesh>, mesh: &TestMesh, x: f64, y: f64) -> Vec<f64> {
    let (triangle, hit) = hit(mesh, 0, x, y).unwrap();
    weights(appearance, triangle, &[hit])
}

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
    let coloured = Geometry { colours: vec![[1.0; 4]; 4], ..wall(2.0, 1.0) };
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
    geometry.normals = vec![[0.0, -half, half], [0.0, -half, half], [0.0, half, half], [0.0, half, half]];
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

fn picture(width: usize, height: usize, texel: impl Fn(usize, usize) -> [u8; 4]) -> Pyramid {
    let texels = (0..width * height).map(|i| texel(i % width, i / width)).collect();
    Pyramid::new(Texture { name: "picture".into(), width, height, texels }).unwrap()
}

fn textured(mut material: Material) -> Material {
    let transform = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let wrap = [Wrap::Repeat; 2];
    material.texture = Some(TextureUse { texture: 0, set: 0, wrap, nearest: true, transform });
    material
}

#[test]
fn textures_are_looked_up_once_at_the_mean_place() {
    // 4 × 4 texels on a wall of 2 m at 2 m: 0.25 in x a texel. Red of each column: 0, 1, 0, 0.
    let mesh = TestMesh::default().with(0, wall(2.0, 1.0));
    let materials = [textured(material("wood", [0.5, 1.0, 1.0]))];
    let columns = |x: usize, _| [if x == 1 { 255 } else { 0 }, 0, 255, 255];
    let mut request = request(&mesh, &materials, Lighting::even(1000.0));
    request.textures = vec![picture(4, 4, columns)];
    let appearance = Appearance::new(request).unwrap();
    let at = |x| hit(&mesh, 0, x, -0.45).unwrap();
    // −0.4, in the first column, and −0.05, in the second: the mean is in the second.
    let (triangle, first) = at(-0.4);
    let (other, second) = at(-0.05);
    assert_eq!((triangle, other), (0, 0));
    assert_eq!(weights(&appearance, triangle, &[first, second]), [1.0, 0.0, 2.0]);
    assert_eq!(weights(&appearance, triangle, &[first]), [0.0, 0.0, 1.0]);
    assert_eq!(appearance.bytes(), 4 * 16 + 12 * 5);
    // Mirrored by the transform: columns are rows.
    let mut rotated = materials.clone();
    rotated[0].texture.as_mut().unwrap().transform = [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
    let request = AppearanceRequest {
        textures: vec![picture(4, 4, columns)],
        ..self::request(&mesh, &rotated, Lighting::even(1000.0))
    };
    let appearance = Appearance::new(request).unwrap();
    assert_eq!(seen(&appearance, &mesh, 0.3, -0.1), [0.5, 0.0, 1.0]);
    assert_eq!(seen(&appearance, &mesh, 0.3, 0.1), [0.0, 0.0, 1.0]);
}

#[test]
fn far_textures_are_the_mean_of_what_a_pixel_covers() {
    // 1 mrad a pixel; 1024 texels of black and white on 2 m at 16 m: 8.2 texels a pixel, level 3.03.
    let mesh = TestMesh::default().with(0, wall(16.0, 1.0));
    let mut materials = [textured(material("checker", [1.0; 3]))];
    materials[0].texture.as_mut().unwrap().nearest = false;
    let mut request = request(&mesh, &materials, Lighting::even(1000.0));
    request.textures =
        vec![picture(1024, 1024, |x, y| [if (x + y) % 2 == 0 { 255 } else { 0 }, 255, 255, 255])];
    let appearance = Appearance::new(request).unwrap();
    for x in [-0.03, 0.0123, 0.04] {
        assert_eq!(seen(&appearance, &mesh, x, 0.011), [0.5, 1.0, 1.0]);
    }
}

#[test]
fn vertex_colours_are_interpolated_in_perspective_and_clipped_ones_counted() {
    // A floor from z = 1 to 3; colours 0 and 1 at its ends, twice that in green.
    let mut floor = quad([-1.0, 0.5, 1.0], [2.0, 0.0, 0.0], [0.0, 0.0, 2.0]);
    floor.colours =
        vec![[0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 1.0, 1.0], [1.0, 2.0, 1.0, 1.0], [1.0, 2.0, 1.0, 1.0]];
    let mesh = TestMesh::default().with(0, floor);
    let materials = [material("floor", [1.0; 3])];
    let appearance = appearance(&mesh, &materials, Lighting::even(1000.0));
    for (i, (z, green)) in [(1.5, 0.5), (2.0, 1.0), (2.5, 1.0)].into_iter().enumerate() {
        let found = seen(&appearance, &mesh, 0.1, 0.5 / z);
        let share = (z - 1.0) / 2.0;
        assert!(
            (found[0] - share).abs() < 1e-15
                && (found[1] - green).abs() < 1e-14
                && (found[2] - 1.0).abs() < 1e-15
        );
        // 1 up to rounding is not clipped.
        assert!(found[1] <= 1.0 && appearance.clipped() == u64::from(i == 2));
    }
    seen(&appearance, &mesh, 0.1, 0.5 / 2.9);
    seen(&appearance, &mesh, 0.1, 0.5 / 1.1);
    assert_eq!(appearance.clipped(), 2);
}

#[test]
fn shares_of_blended_materials_are_their_alpha_to_one_sample() {
    let mesh = TestMesh::default().with(0, wall(1.0, 1.0)).with(3, wall(2.0, 1.0));
    for alpha in [0.0f32, 0.1, 0.25, 0.5, 0.62, 1.0] {
        let mut materials: Vec<Material> = (0..4).map(|_| material("glass", [1.0; 3])).collect();
        materials.iter_mut().for_each(|m| (m.alpha, m.alpha_mode) = (alpha, AlphaMode::Blend));
        let appearance = appearance(&mesh, &materials, Lighting::even(1000.0));
        assert!(!appearance.is_opaque(0));
        for (samples, triangle) in [(1, 0), (4, 0), (16, 0), (64, 0), (16, 2), (64, 2)] {
            let (_, at) = hit(&mesh, 0, 0.01, 0.02).unwrap();
            let exists = |sample| appearance.exists(triangle, &SampleHit { sample, ..at }, samples);
            let share = (0..samples as u32).filter(|s| exists(*s)).count() as f64 / samples as f64;
            let alpha = f64::from(alpha);
            assert!((share - alpha).abs() < 1.0 / samples as f64, "{share} of {alpha}, {samples}");
            if [0.0, 0.25, 0.5, 1.0].contains(&alpha) && samples >= 4 && triangle == 0 {
                assert_eq!(share, alpha);
            }
        }
    }
    // The fourth material differs from the first.
    let differ = (0..16).filter(|&s| (blend_threshold(s, 16, 0) < 0.5) != (blend_threshold(s, 16, 3) < 0.5));
    assert!(differ.count() > 0);
    assert_eq!(blend_threshold(3, 16, 0), 3.5 / 16.0);
}

#[test]
fn masked_texels_are_holes_for_the_camera_and_for_shadows() {
    // The left half is opaque, the right half below the cutoff.
    let blocker = quad([-0.5, -0.5, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
    let mesh = TestMesh::default().with(0, blocker).with(1, wall(2.0, 3.0));
    let mut leaf = textured(material("leaf", [0.0, 1.0, 0.0]));
    leaf.alpha_mode = AlphaMode::Mask(0.5);
    let materials = [leaf, material("wall", [1.0; 3])];
    let sun = Sun { azimuth_deg: 0.0, elevation_deg: 0.0, illuminance_lx: 1000.0 };
    let mut request = request(&mesh, &materials, lighting(light(Some(sun), None)));
    request.textures = vec![picture(8, 8, |x, _| [255, 255, 255, if x < 4 { 128 } else { 127 }])];
    let appearance = Appearance::new(request).unwrap();
    let exists = |x: f64| {
        let (triangle, at) = hit(&mesh, 0, x, 0.1).unwrap();
        appearance.exists(triangle, &at, 4)
    };
    assert!(exists(-0.3) && !exists(0.3) && appearance.is_opaque(2) && !appearance.is_opaque(0));
    let (_, at) = hit(&mesh, 0, 0.0, 0.7).unwrap();
    // Places on the wall at x = −0.3 and 0.3 m, the sun along the axis.
    let lit = |x: f64| {
        let at = SampleHit { x: x / 2.0, y: 0.05, vergence: 0.5, ..at };
        weights(&appearance, 2, &[at])[0]
    };
    assert_eq!((lit(-0.3), lit(0.3), lit(-0.6)), (0.0, 1.0, 1.0));
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

fn paint(name: &str) -> Spectrum {
    Spectrum::new(name, vec![400.0, 700.0], vec![0.2, 0.8], 1.0).unwrap()
}

#[test]
fn named_spectra_have_bases_of_their_own_in_each_light() {
    let mesh = TestMesh::default().with(0, wall(2.0, 1.0)).with(1, wall(1.0, 0.1)).with(2, wall(0.5, 0.01));
    let materials = [
        material("plain", [0.5; 3]),
        textured(material("wood", [0.5; 3])),
        textured(material("cloth", [0.5; 3])),
    ];
    let named = |name: &str| materials_named(&materials, name).unwrap();
    let assigned = [
        Assigned { materials: named("cloth"), spectrum: paint("b.csv"), times_texture: true },
        Assigned { materials: named("wood"), spectrum: paint("a.csv"), times_texture: false },
    ];
    let colour = LightSpectrum::Colour([1.0, 0.0, 0.0]);
    let lamp = [Light {
        name: "red".into(),
        // It shines along +z.
        to_world: [[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 1.0]],
        colour: [1.0, 0.0, 0.0],
        intensity: 500.0,
        kind: LightKind::Directional,
    }];
    let light = lighting(LightRequest { lights: &lamp, ..light(None, Some(1000.0)) });
    let mut request = request(&mesh, &materials, light);
    request.assigned = &assigned;
    request.textures = vec![picture(1, 1, |_, _| [255, 0, 0, 255])];
    let appearance = Appearance::new(request).unwrap();
    let bases = appearance.list_of_bases();
    assert_eq!(
        (bases.len(), bases[3].name(), bases[4].name(), &bases[8].light),
        (10, "b.csv", "a.csv", &colour)
    );
    assert_eq!(
        appearance.notes(),
        ["the texture of material `wood` is ignored: its reflectance is the spectrum `a.csv`"]
    );
    // The sky's light is the illuminant's, the lamp's half of it.
    let places = [
        (0.4, [0.5, 0.5, 0.5, 0.0, 0.0]),
        (0.05, [0.0, 0.0, 0.0, 0.0, 1.0]),
        (0.0, [0.0, 0.0, 0.0, 0.2126, 0.0]),
    ];
    for (x, expected) in places {
        let mut found = seen(&appearance, &mesh, x, 0.001).into_iter();
        for unit in [1.0, 0.5] {
            for (r, (found, expected)) in found.by_ref().zip(expected).take(5).enumerate() {
                // The nearest wall shades one or two of 64 directions of the one behind it.
                let shaded = unit * expected * 2.0 / 64.0;
                assert!(
                    (found - unit * expected).abs() < 1e-12 + shaded,
                    "{x}, reflectance {r}: {found}, {unit} {expected}"
                );
            }
        }
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

#[test]
fn scenes_that_cannot_be_shown_are_errors() {
    let mesh = TestMesh::default().with(0, wall(2.0, 1.0));
    let plain = [material("plain", [0.5; 3]), material("other", [0.5; 3])];
    let error = |change: &dyn Fn(&mut AppearanceRequest<'_, TestMesh>)| {
        let mut request = request(&mesh, &plain, Lighting::even(1000.0));
        change(&mut request);
        Appearance::new(request).err().expect("an error").to_string()
    };
    let unknown = materials_named(&plain, "wood").unwrap_err().to_string();
    assert_eq!(unknown, "no material is called `wood`; the materials are `other`, `plain`");
    assert!(error(&|r| r.background = Background::Luminance(f64::NAN)).contains("NaN cd/m²"));
    let with = |materials: Vec<usize>, times_texture| Assigned {
        materials,
        spectrum: paint("a.csv"),
        times_texture,
    };
    let assign = |assigned: &[Assigned]| {
        let request = AppearanceRequest { assigned, ..request(&mesh, &plain, Lighting::even(1.0)) };
        Appearance::new(request).err().expect("an error").to_string()
    };
    assert_eq!(
        assign(&[with(vec![0], false), with(vec![1, 0], false)]),
        "material `plain` has two spectra, `a.csv` and `a.csv`"
    );
    assert!(assign(&[with(vec![0], true)]).contains("`plain` has no texture"));
    assert_eq!(
        assign(&[with(vec![7], false)]),
        "material of spectrum `a.csv`, number 7 does not exist: there are 2"
    );
    let refer = |mesh: &TestMesh, materials: &[Material]| {
        Appearance::new(request(mesh, materials, Lighting::even(1.0)))
            .map(|a| a.notes().join(";"))
            .map_err(|e| e.to_string())
    };
    let nowhere = TestMesh::default().with(2, wall(2.0, 1.0));
    assert_eq!(
        refer(&nowhere, &plain).unwrap_err(),
        "material of part `part 0`, number 2 does not exist: there are 2"
    );
    let wood = [textured(material("wood", [0.5; 3]))];
    assert_eq!(
        refer(&mesh, &wood).unwrap_err(),
        "texture of material `wood`, number 0 does not exist: there are 0"
    );
    let short = TestMesh::default().with(0, Geometry { normals: vec![[0.0, 0.0, 1.0]], ..wall(2.0, 1.0) });
    assert_eq!(refer(&short, &plain).unwrap_err(), "part `part 0` has 1 normals for 4 vertices");
    let bare = TestMesh::default().with(0, Geometry { texcoords: Vec::new(), ..wall(2.0, 1.0) });
    let mut request = request(&bare, &wood, Lighting::even(1.0));
    request.textures = vec![picture(1, 1, |_, _| [0, 0, 0, 255])];
    let appearance = Appearance::new(request).unwrap();
    assert_eq!(
        appearance.notes(),
        ["part `part 0` has no texture coordinates of set 0: a texture of its material `wood` is not used"]
    );
    assert_eq!(seen(&appearance, &bare, 0.1, 0.1), [0.5; 3]);
}
