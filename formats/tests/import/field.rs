//! Measured fields: round trips from arrays to packs, and errors of descriptions and arrays.

mod maps;
mod refusals;
mod windows;

use lenscube_formats::import::field;
use lenscube_formats::lens::LensPack;
use std::fs;
use std::path::Path;

/// An NPY array of f8.
fn npy(shape: &[usize], values: &[f64]) -> Vec<u8> {
    assert_eq!(shape.iter().product::<usize>(), values.len());
    let sizes: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({sizes}), }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

/// Side of the windows.
const N: usize = 21;

/// Centre of the Gaussian of band b, row j, column i, samples from the middle: column, row.
fn centre(b: usize, j: usize, i: usize) -> [f64; 2] {
    [0.5 * i as f64 - 0.3, 0.4 * j as f64 + 0.25 * b as f64]
}

/// A Gaussian of σ = 2 samples and sum 1.
fn gaussian([x, y]: [f64; 2]) -> Vec<f64> {
    let half = (N / 2) as f64;
    let of = |i: usize| {
        let (u, v) = ((i % N) as f64 - half - x, (i / N) as f64 - half - y);
        (-(u * u + v * v) / 8.0).exp()
    };
    let window: Vec<f64> = (0..N * N).map(of).collect();
    let sum: f64 = window.iter().sum();
    window.into_iter().map(|v| v / sum).collect()
}

/// The windows of a band, scaled as counts of a camera.
fn windows(b: usize) -> Vec<f64> {
    let places = (0..2).flat_map(|j| (0..3).map(move |i| (j, i)));
    places.flat_map(|(j, i)| gaussian(centre(b, j, i)).into_iter().map(|v| 5e4 * v)).collect()
}

const HEAD: &str = "name = \"unit 17\"\nwavelengths_nm = [500, 600]\ndistortion_focal_length_mm = 35.0\n";
const PSF: &str = "[psf]\nfiles = \"psf-{band}.npy\"\nx_mm = [-2, 0, 2]\ny_mm = [-1, 2]\npitch_um = 1.5\nsample = \"point\"\n";

/// A folder with the windows of two bands, and a description.
fn folder(description: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    for b in 0..2 {
        fs::write(dir.path().join(format!("psf-{b}.npy")), npy(&[2, 3, N, N], &windows(b))).unwrap();
    }
    fs::write(dir.path().join("field.toml"), description).unwrap();
    dir
}

/// Imports the description of a folder into a pack beside it.
fn pack(dir: &Path) -> LensPack {
    let out = dir.join("out.lens.zarr");
    field::write(&out, field::open(&dir.join("field.toml")).unwrap(), |_, _| ()).unwrap();
    LensPack::open(&out).unwrap()
}
