//! Textures, colours of vertices, and opacity.

use super::*;

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
        vec![[0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 1.0, 1.0], [1.0, 2.0, 1.0, 1.0], [1.0, 2.0, 1.0, 1.0]].into();
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
