//! Against the model in float64 (NumPy), whose values at some pixels are written below, and by properties.

use super::*;

const SIZE: Size = Size::new(13, 18);
const MATRIX: [[f64; 3]; 3] = [[1.5, -0.375, -0.125], [-0.25, 1.625, -0.375], [0.0625, -0.5625, 1.5]];
/// Pixels (row, column) of the values below: corners, borders, all phases of the patterns.
const PLACES: [(usize, usize); 12] =
    [(0, 0), (0, 1), (1, 0), (1, 1), (0, 17), (12, 0), (12, 17), (6, 7), (7, 6), (6, 6), (7, 7), (5, 16)];

const MALVAR: [[f64; 3]; 12] = [
    [-0.546969374, -0.090143284, 1.516302029],
    [1.269851300, 1.361845129, 2.776465664],
    [-1.325556394, -0.190429688, 1.120831145],
    [0.712808561, 0.934332327, 2.394436876],
    [1.893792673, 0.478909533, 1.979122899],
    [1.212521337, 0.385824252, 1.473501510],
    [2.036337973, 0.438058036, 1.914062500],
    [1.742195706, 0.368164062, 2.280339089],
    [2.198332458, 0.772912290, 2.426175158],
    [2.111024488, 0.705004267, 2.568576845],
    [2.158535485, 0.666040244, 2.464243656],
    [1.596482734, 0.327164850, 2.012514772],
];
const MALVAR_11: [[f64; 3]; 12] = [
    [-1.376624869, -0.273519564, 1.129858193],
    [0.727580095, 0.870322348, 2.416594177],
    [-0.428440126, 0.004628414, 1.593265822],
    [1.352908351, 1.446904543, 2.828843061],
    [2.288044905, 0.751805410, 2.432067358],
    [1.206309086, 0.254825368, 1.637440914],
    [1.930700991, 0.685620733, 2.455624877],
    [2.041622899, 0.565790769, 2.453726119],
    [2.225356158, 0.879144236, 2.603700269],
    [2.050329898, 0.554170496, 2.481424796],
    [1.992425486, 0.523609835, 2.493086102],
    [1.573467864, 0.338559447, 1.886123785],
];
const BILINEAR: [[f64; 3]; 12] = [
    [-0.892069328, 0.561712185, 2.551601891],
    [0.468290441, 1.652113971, 2.147288603],
    [-0.411896008, -0.835445116, 3.032604057],
    [0.712808561, 0.934332327, 2.394436876],
    [2.407891282, 0.232471113, 2.611836922],
    [1.294724921, 0.230550814, 1.226890756],
    [2.116219144, 0.545479911, 1.458278624],
    [1.742195706, 0.368164063, 2.280339089],
    [2.198332458, 0.772912290, 2.426175158],
    [2.183663504, 0.567797236, 2.350659795],
    [1.946133141, 0.524438682, 2.517344242],
    [1.548688616, 0.313509388, 2.092740612],
];
const QUAD: [[f64; 3]; 12] = [
    [-1.044997374, 1.224400385, 2.322209821],
    [2.289180672, 0.746883754, 2.433771008],
    [-0.888471639, 1.229715949, 2.317740612],
    [2.281643908, 0.779543067, 2.422465861],
    [1.839459690, 1.457010460, 0.279639903],
    [1.399386161, 0.192118566, 0.619721639],
    [1.913294380, -0.042318803, 2.150425092],
    [1.455940824, 0.444190787, 2.506047481],
    [1.936540876, 0.716528628, 2.450272632],
    [1.766366654, 0.594611160, 2.495779983],
    [1.736488150, 0.559379514, 2.508609034],
    [1.510551389, 0.543524734, 1.916328494],
];
const QUAD_31: [[f64; 3]; 12] = [
    [0.709151786, -1.119942665, 3.113494070],
    [0.577467715, 1.164076789, 2.316281995],
    [-0.893097060, 1.457682453, 1.928035116],
    [0.463515953, 1.865790769, 1.762586988],
    [1.937274160, 0.406922269, 2.558622637],
    [0.510510110, 0.504383535, 1.100449383],
    [0.268479478, 0.232706750, 2.641848463],
    [1.750036416, 0.391686191, 2.186250574],
    [1.613816718, 0.870331580, 2.401820335],
    [1.703565582, 0.670271160, 2.245257722],
    [1.716339368, 0.644505605, 2.196836071],
    [1.569266867, 0.631657448, 1.373768013],
];

fn raw(size: Size) -> Vec<f32> {
    let value = |k: usize| {
        let (y, x) = (k / size.width, k % size.width);
        ((y * 7919 + x * 104_729 + y * x * 31) % 3900) as f32
    };
    (0..size.pixels()).map(value).collect()
}

fn bayer() -> Pattern {
    Pattern { rows: 2, columns: 2, channels: vec![0, 1, 2, 3] }
}

fn quad() -> Pattern {
    Pattern { rows: 4, columns: 4, channels: vec![0, 0, 1, 1, 0, 0, 1, 1, 2, 2, 3, 3, 2, 2, 3, 3] }
}

fn recipe(pattern: Pattern, demosaic: Demosaic) -> Recipe {
    Recipe {
        size: SIZE,
        pattern,
        plane_of: vec![0, 1, 1, 2],
        black_white_dn: (256.0, 4064.0),
        limit: 1.0,
        gains: vec![1.75, 1.0, 1.0, 2.25],
        bin: false,
        demosaic,
        matrix: MATRIX.map(|r| r.to_vec()).to_vec(),
        exposure: 2.0,
    }
}

fn part_of(development: &Development, raw: &[f32], part: Rect) -> Vec<f32> {
    let (needs, width) = (development.needs(part), development.recipe.size.width);
    let rows = (needs.y as usize..needs.bottom() as usize)
        .flat_map(|y| &raw[y * width + needs.x as usize..][..needs.width]);
    development.develop(&rows.copied().collect::<Vec<_>>(), Shading::None, part)
}

fn whole(development: &Development, raw: &[f32]) -> Vec<f32> {
    part_of(development, raw, development.size().rect())
}

#[test]
fn developments_agree_with_the_model_in_float64() {
    let cases = [
        (bayer(), Demosaic::Malvar, (0, 0), &MALVAR),
        (bayer(), Demosaic::Malvar, (1, 0), &MALVAR_11),
        (bayer(), Demosaic::Bilinear, (0, 0), &BILINEAR),
        (quad(), Demosaic::Bilinear, (0, 0), &QUAD),
        (quad(), Demosaic::Bilinear, (3, 1), &QUAD_31),
    ];
    for (pattern, method, origin, expected) in cases {
        let development = Development::new(recipe(pattern, method), origin).unwrap();
        let linear = whole(&development, &raw(SIZE));
        for ((y, x), wanted) in std::iter::zip(PLACES, expected) {
            for c in 0..3 {
                let found = f64::from(linear[(y * SIZE.width + x) * 3 + c]);
                assert!(
                    (found - wanted[c]).abs() <= 2e-6,
                    "{method:?} {origin:?} {y},{x}: {found} for {}",
                    wanted[c]
                );
            }
        }
    }
}

#[test]
fn parts_have_the_values_of_the_whole() {
    let size = Size::new(40, 51);
    for (pattern, method, bin) in [
        (bayer(), Demosaic::Malvar, false),
        (quad(), Demosaic::Malvar, true),
        (quad(), Demosaic::Bilinear, false),
        (quad(), Demosaic::Superpixel, false),
    ] {
        let development = Development::new(Recipe { size, bin, ..recipe(pattern, method) }, (0, 0)).unwrap();
        let (all, raw, picture) = (whole(&development, &raw(size)), raw(size), development.size());
        for part in [
            Rect::new(3, 5, 4, 3),
            Rect::new(0, 0, 1, 1),
            Rect::new(2, 1, picture.height - 2, picture.width - 1),
        ] {
            let values = part_of(&development, &raw, part);
            for (k, found) in values.chunks(3).enumerate() {
                let (y, x) = (part.y as usize + k / part.width, part.x as usize + k % part.width);
                assert_eq!(found, &all[(y * picture.width + x) * 3..][..3], "{method:?} {part} {y},{x}");
            }
        }
    }
}

#[test]
fn flat_raw_is_flat_and_clipped_highlights_are_white() {
    let level = |dn: f32, exposure: f64, pattern: Pattern, method, bin| {
        let recipe = Recipe { exposure, bin, gains: vec![1.0; 4], ..recipe(pattern, method) };
        whole(&Development::new(recipe, (0, 0)).unwrap(), &vec![dn; SIZE.pixels()])
    };
    for (pattern, method, bin) in [
        (bayer(), Demosaic::Malvar, false),
        (quad(), Demosaic::Bilinear, false),
        (quad(), Demosaic::Malvar, true),
        (quad(), Demosaic::Superpixel, false),
    ] {
        for (dn, expected) in [(256.0, 0.0), (2160.0, 0.5), (4064.0, 1.0), (4095.0, 1.0)] {
            let rows = MATRIX.map(|r| r.iter().sum::<f64>() as f32 * expected);
            for pixel in level(dn, 1.0, pattern.clone(), method, bin).chunks(3) {
                for c in 0..3 {
                    assert!((pixel[c] - rows[c]).abs() < 1e-6, "{method:?} {dn}: {pixel:?}");
                }
            }
        }
    }
}

#[test]
fn shading_divides_by_lens_and_flat() {
    let lens_value = 0.5f32;
    let band = crate::lens::LensBand {
        relative_illumination: vec![1.0, 0.0],
        ..crate::lens::LensBand::ideal(550.0, vec![0.0, 10.0])
    };
    let lens = crate::lens::Lens {
        name: "cone".into(),
        distortion_focal_length_mm: 50.0,
        effective_focal_length_mm: 50.0,
        f_number: 2.0,
        primary_wavelength_nm: 550.0,
        object_distance_mm: None,
        magnification: 0.0,
        psf_sample: crate::lens::PsfSample::Integrated,
        bands: vec![band],
        depth: None,
    };
    // R = 1 - r/10 mm; 1 mm pixels, axis at (6, 8).
    let shading = LensShading::new(&lens, &[550.0], &[vec![2.0]], (1.0, (6.0, 8.0), 10.0)).unwrap();
    assert!((shading.divisor(0, 6, 8) - 1.0).abs() < 1e-6);
    assert!((shading.divisor(0, 6, 13) - lens_value).abs() < 1e-3);
    assert_eq!(shading.divisor(0, 12, 16), shading::MIN_DIVISOR);
    assert!(
        LensShading::new(&lens, &[550.0], &[vec![1.0]], (2.0, (6.0, 8.0), 10.0))
            .unwrap_err()
            .contains("10.000 mm")
    );
    assert!(
        LensShading::new(&lens, &[560.0], &[vec![1.0]], (1.0, (6.0, 8.0), 10.0)).unwrap_err().contains("560")
    );
    let mono = Recipe {
        pattern: Pattern { rows: 1, columns: 1, channels: vec![0] },
        plane_of: vec![0],
        gains: vec![1.0],
        matrix: vec![vec![1.0]],
        exposure: 1.0,
        ..recipe(bayer(), Demosaic::Malvar)
    };
    let development = Development::new(mono, (0, 0)).unwrap();
    let raw: Vec<f32> = (0..SIZE.pixels()).map(|k| 300.0 + k as f32).collect();
    let flat = Flat { raw: &raw, black_white_dn: (256.0, 4064.0), middle: &[0.5] };
    let out = development.develop(&raw, Shading::Flat(flat), SIZE.rect());
    // Divided by itself: the flat's value in the middle, where it is not below an eighth of that.
    let far = (0.125 * 0.5 * 3808.0f32 - 44.0).ceil() as usize;
    assert!(out[far..].iter().all(|v| (v - 0.5).abs() < 1e-6), "{:?}", &out[far..far + 3]);
}

#[test]
fn developments_that_are_not_possible_are_errors() {
    let error = |recipe| Development::new(recipe, (0, 0)).unwrap_err().to_string();
    assert!(error(recipe(quad(), Demosaic::Malvar)).contains("use bilinear"));
    assert!(error(Recipe { bin: true, ..recipe(bayer(), Demosaic::Bilinear) }).contains("one filter"));
    assert!(error(Recipe { size: Size::new(1, 9), ..recipe(bayer(), Demosaic::Malvar) }).contains("smaller"));
}
