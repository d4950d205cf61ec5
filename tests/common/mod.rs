//! Helpers for tests that run the binary: commands, and stores that it reads and writes.
#![allow(missing_docs, dead_code, reason = "each test binary uses a subset")]

pub mod camera;
pub mod exr;
pub mod test_job;

use formats::chart::{ChartMeta, ChartOptions, ChartStore, Codec, write_chart};
use formats::lens::{LensPackError, PackAttributes};
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use pipeline::lens::{Lens, LensBand, PsfSample, PsfStack};
use pipeline::simd::Isa;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Exit code and output of a command; the code is -1 after a signal.
#[derive(Debug)]
pub struct CommandResult {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

impl CommandResult {
    pub fn new(output: &Output) -> Self {
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        Self {
            code: output.status.code().unwrap_or(-1),
            stdout: text(&output.stdout),
            stderr: text(&output.stderr),
        }
    }

    /// Asserts exit code 0.
    pub fn ok(self) -> Self {
        assert_eq!(self.code, 0, "{}", self.stderr);
        self
    }
}

/// Asserts the exit code, that stdout or stderr contains all `texts`, and that there was no panic.
pub fn assert_exit(result: &CommandResult, code: i32, texts: &[&str]) {
    let CommandResult { stdout, stderr, .. } = result;
    assert_eq!(result.code, code, "{stdout}{stderr}");
    assert!(!stderr.contains("panicked"), "{stderr}");
    for text in texts {
        assert!(stdout.contains(text) || stderr.contains(text), "`{text}` is not in: {stdout}{stderr}");
    }
}

/// Asserts the exit code, and that stderr ends with one error line that contains all `texts`, without repeated parts.
pub fn assert_error_line(result: &CommandResult, code: i32, texts: &[&str]) {
    let CommandResult { stderr, .. } = result;
    assert_eq!(result.code, code, "{stderr}");
    let lines: Vec<&str> = stderr.lines().filter(|l| l.starts_with("lenscube: ")).collect();
    assert!(lines.len() == 1 && stderr.trim_end().ends_with(lines[0]), "not one line at the end: {stderr}");
    for text in texts {
        assert!(lines[0].contains(text), "`{text}` is not in: {}", lines[0]);
    }
    let parts: Vec<&str> = lines[0].split(": ").filter(|p| p.len() > 12).collect();
    let repeated = parts.iter().enumerate().find(|(i, p)| parts[..*i].contains(p));
    assert!(repeated.is_none(), "repeated: {}", lines[0]);
    assert!(!stderr.contains("panicked"), "{stderr}");
}

pub fn lenscube(words: &[&str]) -> CommandResult {
    CommandResult::new(&Command::new(env!("CARGO_BIN_EXE_lenscube")).args(words).output().unwrap())
}

pub fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// `lenscube run CHART FILM --lens LENS FLAGS`, on two threads and without fsync unless the flags say so.
pub fn run(chart: &str, film: &Path, lens: &str, flags: &[&str]) -> CommandResult {
    run_by(&mut Command::new(env!("CARGO_BIN_EXE_lenscube")), chart, film, lens, flags)
}

/// [`run`] with the engine of `isa`.
pub fn run_on(isa: Isa, chart: &str, film: &Path, lens: &str, flags: &[&str]) -> CommandResult {
    let engine = ["--device", "cpu", "--engine", isa.name()];
    run(chart, film, lens, &[&engine[..], flags].concat())
}

fn run_by(command: &mut Command, chart: &str, film: &Path, lens: &str, flags: &[&str]) -> CommandResult {
    let mut words = vec!["run", chart, text(film), "--lens", lens, "--no-fsync"];
    if !flags.contains(&"--threads") {
        words.extend(["--threads", "2"]);
    }
    words.extend(flags);
    CommandResult::new(&command.args(&words).output().unwrap())
}

/// Pairs of values of two images, whose bands and sizes must be equal.
pub fn pairs<'a>(a: &'a [Vec<f32>], b: &'a [Vec<f32>]) -> impl Iterator<Item = (f32, f32)> + 'a {
    let lengths = |bands: &[Vec<f32>]| bands.iter().map(Vec::len).collect::<Vec<_>>();
    assert_eq!(lengths(a), lengths(b), "values in each band");
    a.iter().flatten().copied().zip(b.iter().flatten().copied())
}

/// Size and bands of one array of a store.
pub fn pixels(store: &Path, array: &str) -> (Size, Vec<Vec<f32>>) {
    let store = ChartStore::open(&format!("{}//{array}", text(store)), ChartOptions::default()).unwrap();
    let size = store.size();
    let read = |band| {
        let mut out = vec![f32::NAN; size.pixels()];
        store.read_rect(band, size.rect(), &mut out).unwrap();
        out
    };
    (size, (0..store.bands()).map(read).collect())
}

pub fn bits(bands: &[Vec<f32>]) -> Vec<Vec<u32>> {
    bands.iter().map(|b| b.iter().map(|v| v.to_bits()).collect()).collect()
}

/// Files of a store by path, without `runs/`, which may differ from run to run.
pub fn files(store: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut todo = vec![store.to_path_buf()];
    while let Some(directory) = todo.pop() {
        for entry in std::fs::read_dir(&directory).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true if path != store.join("runs") => todo.push(path),
                true => (),
                false => {
                    let bytes = std::fs::read(&path).unwrap();
                    found.insert(path.strip_prefix(store).unwrap().into(), bytes);
                }
            }
        }
    }
    found
}

/// Shard files of a film.
pub fn shards(store: &Path) -> Vec<PathBuf> {
    let inside = |p: &PathBuf| p.components().any(|c| c.as_os_str() == "c");
    files(store).into_keys().filter(inside).collect()
}

/// Reproducible noise in [0, 1): SplitMix64.
pub struct Noise(pub u64);

impl Noise {
    pub fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
    }
}

/// A chart in memory.
pub struct Picture {
    pub size: Size,
    pub bands: Vec<Vec<f32>>,
}

impl Picture {
    pub fn noise(seed: u64, size: Size, bands: usize) -> Self {
        let mut noise = Noise(seed);
        let band = |_| (0..size.pixels()).map(|_| noise.next()).collect();
        Self { size, bands: (0..bands).map(band).collect() }
    }

    /// Writes a chart with wavelengths 450, 500, … nm and a pitch of 2 µm.
    pub fn write(&self, path: &Path) {
        let meta = ChartMeta {
            wavelengths_nm: (0..self.bands.len()).map(|b| 450.0 + 50.0 * b as f64).collect(),
            pitch_um: Some(2.0),
            ..ChartMeta::default()
        };
        write_chart(path, self, &meta, Codec::Zstd, 1, &|_, _| ()).unwrap();
    }
}

impl ChartSource for Picture {
    fn size(&self) -> Size {
        self.size
    }
    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        for (row, out) in out.chunks_exact_mut(rect.width).enumerate() {
            let first = (rect.y as usize + row) * self.size.width + rect.x as usize;
            out.copy_from_slice(&self.bands[band][first..][..rect.width]);
        }
        Ok(())
    }
}

/// Tables up to `reach_mm` without distortion and with R = 1; PSF windows of `size` samples of 2 µm at four heights.
pub fn identity_band(wavelength_nm: f64, reach_mm: f64, size: usize) -> LensBand {
    let heights: Vec<f64> = (0..50).map(|i| reach_mm * f64::from(i) / 49.0).collect();
    LensBand {
        psf_height_mm: [0.0, 0.2, 0.7, 1.0].map(|h| h * reach_mm).into(),
        azimuth_count: vec![1, 4, 4, 4],
        psf_size: size,
        psf_energy: vec![1.0; 4],
        ..LensBand::ideal(wavelength_nm, heights)
    }
}

pub fn lens(bands: Vec<LensBand>) -> Lens {
    Lens {
        name: "test".into(),
        distortion_focal_length_mm: 50.0,
        effective_focal_length_mm: 50.0,
        f_number: 2.0,
        primary_wavelength_nm: bands[0].wavelength_nm,
        object_distance_mm: None,
        magnification: 0.0,
        psf_sample: PsfSample::Integrated,
        bands,
        depth: None,
    }
}

/// PSFs with all light on the chief ray.
pub fn delta(band: &LensBand) -> PsfStack {
    let n = band.psf_size;
    let mut samples = vec![0.0; band.psf_height_mm.len() * n * n];
    samples[n * n / 2..].iter_mut().step_by(n * n).for_each(|v| *v = 1.0);
    PsfStack { size: n, pitch_um: band.psf_pitch_um, sample: PsfSample::Integrated, samples }
}

/// PSFs with noise over the entire window, different at every height.
pub fn scattered(seed: u64, band: &LensBand) -> PsfStack {
    let n = band.psf_size;
    let mut noise = Noise(seed);
    let mut stack = delta(band);
    for window in stack.samples.chunks_exact_mut(n * n) {
        window.iter_mut().for_each(|v| *v = noise.next());
        let sum: f64 = window.iter().map(|&v| f64::from(v)).sum();
        window.iter_mut().for_each(|v| *v = (f64::from(*v) / sum) as f32);
    }
    stack
}

pub fn write_pack(path: &Path, lens: &Lens, stacks: Vec<PsfStack>) {
    let stacks = stacks.into_iter().map(Ok::<_, LensPackError>);
    formats::lens::write(path, lens, &PackAttributes::default(), stacks).unwrap();
}

/// The values of a .npy file of f32.
pub fn read_npy(path: &Path) -> Vec<f32> {
    let bytes = std::fs::read(path).unwrap();
    let (header, values) = bytes.split_at(10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]])));
    assert!(String::from_utf8_lossy(header).contains("'<f4'"), "{}: not of f32", path.display());
    values.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
}

/// Writes a .npy file of f32 of a picture.
pub fn write_npy(path: &Path, size: Size, values: &[f32]) {
    write_npy_of(path, &[size.height, size.width], values);
}

/// Writes a .npy file of f32 of these sides.
pub fn write_npy_of(path: &Path, shape: &[usize], values: &[f32]) {
    assert_eq!(values.len(), shape.iter().product::<usize>());
    let sides: String = shape.iter().map(|side| format!("{side}, ")).collect();
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({sides}), }}");
    let padding = 63 - (10 + header.len()) % 64;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(((header.len() + padding + 1) as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend(std::iter::repeat_n(b' ', padding));
    bytes.push(b'\n');
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    std::fs::write(path, bytes).unwrap();
}
