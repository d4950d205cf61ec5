//! Packs of pupil functions of the whole pupil, in place of PSFs of lenses without rotational symmetry.

use crate::planar::attributes;
use crate::pupils::traced;
use crate::*;
use lenscube_formats::lens::PLANAR_SCHEMA;
use pipeline::design::pupil_stack::{PupilStack, VALUE_ROWS, WHOLE_SEGMENT_NUMBERS};
use pipeline::lens::planar::{PlanarMap, PsfPlaces};
use std::f64::consts::PI;

/// PSFs a height, and the height of each.
const AZIMUTHS: [usize; 3] = [1, 3, 2];
const HEIGHTS: [usize; 6] = [0, 1, 1, 1, 2, 2];

/// Spokes of a whole pupil without a rim, which is that of the axis.
const SPOKES: usize = 40;

/// Numbers of a segment of a whole pupil but its index, and its values by quantity.
type Segment = ([f64; 8], [Vec<f64>; VALUE_ROWS]);

/// The mirror image of a segment of the half pupil at −θ, where M has the other sign; or for the half circle, of a rotationally symmetric pupil on
/// the axis, none, and the whole circle in its place.
fn segments_of(numbers: &[f64; 8], values: &[Vec<f64>; VALUE_ROWS]) -> Vec<Segment> {
    let [_, rings, spokes, from, to, limit, centre, sign] = *numbers;
    if (from, to) == (0.0, PI) {
        let chebyshev = |j: usize, n: usize| (1.0 - (PI * (j as f64 + 0.5) / n as f64).cos()) / 2.0;
        let (sin, cos) = (PI * chebyshev(0, spokes as usize)).sin_cos();
        let table = |of: &dyn Fn(usize, f64) -> f64| {
            let ring = |i: usize| {
                (0..SPOKES).map(move |j| of(i * spokes as usize, PI * (2.0 * chebyshev(j, SPOKES) - 1.0)))
            };
            (0..rings as usize).flat_map(ring).collect::<Vec<f64>>()
        };
        let radial = |first: usize| values[1][first] * cos + values[2][first] * sin;
        let tables = [
            table(&|first, _| values[0][first]),
            table(&|first, theta| radial(first) * theta.cos()),
            table(&|first, theta| radial(first) * theta.sin()),
            table(&|first, _| values[3][first]),
            table(&|first, _| values[4][first]),
        ];
        return vec![([rings, SPOKES as f64, -PI, PI, limit, centre, 0.0, sign], tables)];
    }
    let mirrored = std::array::from_fn(|quantity| {
        let sign = if quantity == 2 { -1.0 } else { 1.0 };
        values[quantity]
            .chunks_exact(spokes as usize)
            .flat_map(|r| r.iter().rev())
            .map(|v| sign * v)
            .collect()
    });
    vec![
        ([rings, spokes, from, to, limit, centre, 0.0, sign], values.clone()),
        ([rings, spokes, -to, -from, limit, centre, 0.0, sign], mirrored),
    ]
}

/// The whole pupils of band `b`, one for each PSF of a height.
fn whole_pupils(b: usize) -> PupilStack {
    let (lens, bands) = traced();
    let (segments, values) = bands[b].pupils.parts();
    let width = values.len() / VALUE_ROWS / segments.len();
    let mut whole = Vec::new();
    for (row, height) in HEIGHTS.into_iter().enumerate() {
        let all = segments.iter().zip(values.chunks_exact(VALUE_ROWS * width));
        for (s, values) in all.filter(|(s, _)| s[0] == height as f64) {
            let points = (s[1] * s[2]) as usize;
            let values = std::array::from_fn(|quantity| values[quantity * width..][..points].to_vec());
            whole.extend(segments_of(s, &values).into_iter().map(|segment| (row, segment)));
        }
    }
    let width = whole.iter().map(|(_, (_, tables))| tables[0].len()).max().unwrap();
    let numbers: Vec<[f64; WHOLE_SEGMENT_NUMBERS]> = whole
        .iter()
        .map(|(row, (numbers, _))| std::array::from_fn(|i| if i == 0 { *row as f64 } else { numbers[i - 1] }))
        .collect();
    let padded = |table: Vec<f64>| {
        let missing = width - table.len();
        table.into_iter().chain(std::iter::repeat_n(f64::NAN, missing))
    };
    let tables: Vec<f64> = whole.into_iter().flat_map(|(_, (_, tables))| tables).flat_map(padded).collect();
    let band = &lens.bands[b];
    let heights_mm = HEIGHTS.map(|height| band.psf_height_mm[height]);
    let samples = (band.psf_size, band.psf_pitch_um);
    PupilStack::from_whole_parts(band.wavelength_nm, &heights_mm, samples, &numbers, &tables).unwrap()
}

fn planar_lens() -> Lens {
    let mut lens = traced().0.clone();
    for band in &mut lens.bands {
        let nodes = vec![-10.0, -3.0, 4.0, 11.0];
        let [across, down] =
            [|i: usize| i % 4, |i: usize| i / 4].map(|at| (0..16).map(|i| nodes[at(i)]).collect());
        *band = band.clone().with_map(PlanarMap {
            ideal_x_mm: across,
            ideal_y_mm: down,
            relative_illumination: vec![1.0; 16],
            x_mm: nodes.clone(),
            y_mm: nodes,
        });
        band.tail = None;
        band.psf_energy = vec![0.9; AZIMUTHS.iter().sum()];
        band.planar.as_mut().unwrap().psfs = PsfPlaces::Polar { azimuth_samples: AZIMUTHS.to_vec() };
    }
    lens
}

fn write_pupils(path: &Path) -> Result<(), LensPackError> {
    let mut writer = LensPackWriter::create_planar(path)?;
    (0..2).try_for_each(|b| writer.pupils(b, &whole_pupils(b)))?;
    writer.finish(&planar_lens(), &attributes())
}

#[test]
fn whole_pupils_of_mirrored_halves_give_the_psfs_of_the_halves() {
    let tmp = tempfile::tempdir().unwrap();
    let [folder, zip] = ["a.lens.zarr", "a.lens.zip"].map(|name| {
        let path = tmp.path().join(name);
        write_pupils(&path).unwrap();
        LensPack::open(path).unwrap()
    });
    let root = std::fs::read_to_string(folder.path().join("zarr.json")).unwrap();
    assert!(root.contains(PLANAR_SCHEMA) && folder.has_pupils() && !folder.is_symmetric());
    assert_eq!(*folder.lens(), planar_lens());
    assert_eq!(WHOLE_SEGMENT_NUMBERS, 9);
    for b in 0..2 {
        let (stack, halves) = (folder.psf(b).unwrap(), &traced().1[b].psf);
        assert_eq!(stack.heights(), 6);
        for (row, height) in HEIGHTS.into_iter().enumerate() {
            let pairs = stack.window(row).iter().zip(halves.window(height));
            let l1: f64 = pairs.map(|(a, b)| f64::from((a - b).abs())).sum();
            // Found: 5e-7; the samples of both are rounded to 16 bits.
            assert!(l1 < 1e-5, "band {b}, PSF {row}: L1 {l1}");
        }
        let mut first = 0;
        for (set, count) in AZIMUTHS.into_iter().enumerate() {
            let samples = stack.size * stack.size;
            let expected = &stack.samples[first * samples..(first + count) * samples];
            assert_eq!(zip.psfs_of_sets(b, 0, set..set + 1, 2).unwrap(), expected, "band {b}, height {set}");
            first += count;
        }
        assert_eq!(zip.band_digest(b).unwrap(), folder.band_digest(b).unwrap());
    }
    assert_eq!(zip.digest().unwrap(), folder.digest().unwrap());
    folder.check_unchanged().unwrap();
}

#[test]
fn half_pupils_belong_to_lenses_with_symmetry_and_whole_ones_to_others() {
    let tmp = tempfile::tempdir().unwrap();
    let (symmetric, bands) = traced();
    let mut writer = LensPackWriter::create(tmp.path().join("a.lens.zarr")).unwrap();
    writer.pupils(0, &bands[0].pupils).unwrap();
    let e = writer.pupils(1, &whole_pupils(1)).unwrap_err().to_string();
    assert!(e.contains("pupil/1: some bands have whole pupils, others half ones"), "{e}");
    writer.pupils(1, &bands[1].pupils).unwrap();
    let e = writer.finish(&planar_lens(), &attributes()).unwrap_err().to_string();
    assert!(e.contains("the lens is without rotational symmetry, but has half pupils"), "{e}");
    let mut writer = LensPackWriter::create(tmp.path().join("b.lens.zarr")).unwrap();
    (0..2).for_each(|b| writer.pupils(b, &whole_pupils(b)).unwrap());
    let e = writer.finish(symmetric, &attributes()).unwrap_err().to_string();
    assert!(e.contains("the lens is with rotational symmetry, but has whole pupils"), "{e}");
}

#[test]
fn invalid_segments_of_whole_pupils_are_errors() {
    let tmp = tempfile::tempdir().unwrap();
    let path = tmp.path().join("a.lens.zarr");
    write_pupils(&path).unwrap();
    let (segments, _) = whole_pupils(0).whole_parts();
    let error = |change: fn(&mut Vec<f64>), numbers: usize| {
        let mut values = segments.as_flattened().to_vec();
        change(&mut values);
        let shape = [values.len() / numbers, numbers];
        let bytes = crate::errors::f64s(&values);
        crate::errors::replace_array(path.join("pupil_segment/0"), "float64", &shape, &bytes);
        LensPack::open(&path).and_then(|pack| pack.psf(0)).unwrap_err().to_string()
    };
    let e = error(|s| s[7] = 1.5, 9);
    assert!(e.contains("array `pupil_segment/0`: segment 0") && e.contains("1.5"), "{e}");
    let e = error(|s| s[0] = 6.0, 9);
    assert!(e.contains("segment 0 is of height index 6"), "{e}");
    let e = error(|s| s.truncate(9), 9);
    assert!(e.contains("`pupil/0` has shape"), "{e}");
    let e = error(|s| s.truncate(8 * 3), 8);
    assert!(e.contains("expected [3, 9] (segments, numbers of a segment)"), "{e}");
}
