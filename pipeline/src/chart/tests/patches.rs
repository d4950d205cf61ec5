//! Patches and textures: places, reflectance, luminance.

use super::*;
use crate::colour;

#[test]
fn checker_luminance_corresponds_to_1000_lux() {
    let chart = generate("checker?size=900x600&wavelengths=380:780:5&overscan=10");
    let weights = colour::xyz_weights(chart.wavelengths_nm());
    let luminance = |patch: usize| {
        let p = chart.patches_px()[patch];
        let middle = Rect::new(p.y + 10 + p.height as i64 / 2, p.x + 10 + p.width as i64 / 2, 1, 1);
        (0..weights.len()).map(|b| f64::from(read(&chart, b, middle)[0]) * weights[b][1]).sum::<f64>()
    };
    // The white patch reflects about 0.9 of 1000 lx: 0.9·1000/π cd/m².
    assert!((luminance(18) - 286.0).abs() < 6.0, "{}", luminance(18));
    assert!((luminance(23) - 10.0).abs() < 1.0, "{}", luminance(23));
    assert_eq!(chart.patches_px().len(), 24);
}

#[test]
fn composite_covers_the_complete_film() {
    let chart = generate("composite?size=3000&wavelengths=550");
    assert!(chart.points_px().len() > 100 && chart.patches_px().len() == 24);
    assert_eq!(chart.size(), Size::new(3188, 3188));
    let film = chart.film_size().rect();
    assert!(chart.points_px().iter().all(|&(y, x)| film.contains(Rect::new(y as i64, x as i64, 1, 1))));
    assert!(chart.points_px().iter().any(|&(y, x)| y < 450.0 && x < 450.0));
}

#[test]
fn patches_have_their_reported_reflectance() {
    for spec in ["checker?size=300x200&illuminant=A", "iso12233-esfr?size=300&grid=3&fiducials=21"] {
        let chart = generate(&format!("{spec}&wavelengths=450,550,650&overscan=0"));
        let reflectance: Vec<Vec<f64>> =
            chart.wavelengths_nm().iter().map(|nm| chart.patch_reflectance(*nm)).collect();
        assert_eq!(reflectance[0].len(), chart.patches_px().len());
        for (band, reflectance) in reflectance.iter().enumerate() {
            let level = |i: usize| f64::from(read(&chart, band, chart.patches_px()[i])[0]);
            for i in 1..reflectance.len() {
                let ratio = level(i) / level(0) * reflectance[0] / reflectance[i];
                assert!((ratio - 1.0).abs() < 1e-6, "{spec}, band {band}, patch {i}: {ratio}");
            }
        }
    }
}

#[test]
fn grey_patches_lie_on_a_circle_and_have_equal_steps_of_density() {
    let chart = generate("oecf?size=900x700&wavelengths=550&overscan=0");
    let patches = chart.patches_px();
    assert_eq!(patches.len(), 20);
    for p in patches {
        let (y, x) = (p.y as f64 + (p.height as f64 - 1.0) / 2.0, p.x as f64 + (p.width as f64 - 1.0) / 2.0);
        let radius = (y - 349.5).hypot(x - 449.5);
        assert!((radius - 0.34 * 700.0).abs() < 1.0 && p.height.abs_diff(p.width) <= 1, "{p}");
    }
    let apart = |i: usize, j: usize| patches[i].intersect(patches[j]).is_empty();
    assert!((0..20).all(|i| (0..i).all(|j| apart(i, j))));
    let reflectance = chart.patch_reflectance(550.0);
    assert!((reflectance[19] - 0.9).abs() < 1e-12 && (reflectance[0] - 0.0009).abs() < 1e-12);
    let level = |rect: Rect| f64::from(read(&chart, 0, rect)[0]);
    let background = level(Rect::new(0, 0, 1, 1));
    for (p, reflectance) in std::iter::zip(patches, &reflectance) {
        assert!((level(*p) / background / (reflectance / 0.18) - 1.0).abs() < 1e-6, "{p}");
    }
    let ratios = reflectance.windows(2).map(|r| (r[1] / r[0]).log10());
    ratios.for_each(|step| assert!((step - 3.0 / 19.0).abs() < 1e-12, "{step}"));
}

#[test]
fn leaves_fill_the_middle_of_a_frame_of_their_mean() {
    let chart = generate("dead-leaves?size=400x300&wavelengths=450,550&fiducials=21&contrast=9");
    let texture = chart.texture_px().unwrap();
    // 16 modules of 3 px are wider than a tenth of the film.
    assert_eq!(texture, Rect::new(48, 48, 204, 304));
    let m = chart.overscan_px() as i64;
    let in_chart = |r: Rect| Rect { y: r.y + m, x: r.x + m, ..r };
    for band in 0..2 {
        let grey = read(&chart, band, in_chart(chart.patches_px()[0]));
        assert!(grey.iter().all(|v| *v == grey[0]));
        let mean = f64::from(grey[0]);
        // 0.08 to 0.72.
        let leaves = read(&chart, band, in_chart(texture));
        assert!(leaves.iter().all(|v| (0.2 - 1e-6..=1.8 + 1e-6).contains(&(f64::from(*v) / mean))));
        assert!(leaves.iter().any(|v| f64::from(*v) / mean < 0.4));
    }
    assert_eq!(chart.patch_reflectance(550.0), [0.4, 0.4]);
}
