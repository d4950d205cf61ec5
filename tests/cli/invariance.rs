//! A film does not depend on threads, memory, codec, layout, interruption or regions; films of lenses with known results.

use crate::common::{
    Noise, Picture, bits, delta, files, identity_band, lens, lenscube, pixels, run, scattered, shards, text,
    write_pack,
};
use pipeline::geometry::Size;
use std::path::{Path, PathBuf};

struct LensJob {
    dir: tempfile::TempDir,
    chart: PathBuf,
    pack: PathBuf,
}

impl LensJob {
    /// Chart of two bands; film of several tiles and shards; lens with distortion, relative illumination and PSFs.
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let (chart, pack) = (dir.path().join("chart.zarr"), dir.path().join("pack.lens.zarr"));
        Picture::noise(7, Size::new(631, 705), 2).write(&chart);
        let band = |nm, size| {
            let mut band = identity_band(nm, 1.0, size);
            band.ideal_height_mm.iter_mut().for_each(|h| *h *= 1.01 + 0.02 * *h);
            band.relative_illumination.iter_mut().enumerate().for_each(|(i, r)| *r -= 0.008 * i as f64);
            band
        };
        let lens = lens(vec![band(450.0, 25), band(500.0, 7)]);
        let stacks = lens.bands.iter().zip(3..).map(|(b, seed)| scattered(seed, b)).collect();
        write_pack(&pack, &lens, stacks);
        Self { dir, chart, pack }
    }

    fn run(&self, name: &str, flags: &[&str]) -> PathBuf {
        let film = self.dir.path().join(name);
        run(text(&self.chart), &film, text(&self.pack), flags).ok();
        film
    }
}

const LAYOUT: [&str; 4] = ["--shard", "256", "--chunk", "128"];

fn with_layout<'a>(flags: &[&'a str]) -> Vec<&'a str> {
    [&LAYOUT[..], flags].concat()
}

#[test]
fn threads_and_memory_do_not_change_the_film_files() {
    let job = LensJob::new();
    let first = files(&job.run("first", &with_layout(&["--threads", "1", "--memory", "2GiB"])));
    assert!(first.len() > 2 * 9, "several shards: {:?}", first.keys());
    // The minimum memory is taken from the error message for a smaller limit.
    let film = job.dir.path().join("rejected");
    let rejected =
        run(text(&job.chart), &film, text(&job.pack), &with_layout(&["--threads", "2", "--memory", "1MiB"]));
    assert_eq!(rejected.code, 2, "{}", rejected.stderr);
    let min_memory = rejected.stderr.split("at least ").nth(1).unwrap().split(';').next().unwrap();
    for (name, flags) in [
        ("minimum", ["--threads", "2", "--memory", min_memory]),
        ("more", ["--threads", "2", "--memory", "1GiB"]),
        ("many", ["--threads", "7", "--memory", "2GiB"]),
    ] {
        let again = files(&job.run(name, &with_layout(&flags)));
        assert!(
            again == first,
            "{flags:?} changes {:?}",
            again.iter().find(|(k, v)| first.get(*k) != Some(*v)).map(|d| d.0)
        );
    }
}

#[test]
fn codec_shard_size_and_regions_do_not_change_pixels() {
    let job = LensJob::new();
    let (size, whole) = pixels(&job.run("whole", &[]), "film");
    let whole = bits(&whole);
    for (codec, shard, chunk) in [("none", "128", "128"), ("lz4", "512", "256"), ("zstd", "96", "32")] {
        let film = job.run(codec, &["--codec", codec, "--shard", shard, "--chunk", chunk]);
        assert!(bits(&pixels(&film, "film").1) == whole, "{codec}, shards of {shard}");
    }
    let regions = [(0, 0, 1, 1), (300, 411, 320, 200), (5, 600, 700, 31), (704, 630, 1, 1)];
    let words: Vec<String> = regions.iter().map(|(x, y, w, h)| format!("{x},{y},{w},{h}")).collect();
    let flags: Vec<&str> = words.iter().flat_map(|w| ["--roi", w.as_str()]).collect();
    let film = job.run("regions", &flags);
    let band_1 = job.run("regions-of-band-1", &[&flags[..], &["--bands", "1", "--threads", "1"]].concat());
    for (i, (x, y, w, h)) in regions.into_iter().enumerate() {
        let (roi_size, got) = pixels(&film, &format!("roi_{i}"));
        assert_eq!(roi_size, Size::new(h, w));
        let part = |band: &Vec<u32>| -> Vec<u32> {
            (y..y + h).flat_map(|row| band[row * size.width + x..][..w].to_vec()).collect()
        };
        let expected: Vec<_> = whole.iter().map(part).collect();
        assert!(bits(&got) == expected, "region {x},{y},{w},{h}");
        assert!(
            bits(&pixels(&band_1, &format!("roi_{i}")).1) == expected[1..],
            "region {x},{y},{w},{h} of band 1"
        );
    }
}

#[test]
fn kept_bits_round_pixels_and_are_part_of_the_job() {
    let job = LensJob::new();
    let exact = pixels(&job.run("exact", &[]), "film").1;
    let all = files(&job.run("all", &["--keep-bits", "23"]));
    assert!(all == files(&job.dir.path().join("exact")), "23 bits are all of f32");
    for codec in ["lz4", "none"] {
        let film = job.run(codec, &["--keep-bits", "9", "--codec", codec]);
        for (rounded, exact) in pixels(&film, "film").1.iter().flatten().zip(exact.iter().flatten()) {
            assert!((rounded - exact).abs() <= exact.abs() / 1024.0, "{exact} -> {rounded}");
            assert_eq!(rounded.to_bits() & 0x3fff, 0, "{rounded} has more than 9 bits");
        }
        let status = lenscube(&["status", text(&film)]).ok().stdout;
        assert!(status.contains("rounded to 9 of 23 bits"), "{status}");
        let verify = lenscube(&["verify", text(&film), "--json"]).ok().stdout;
        assert!(verify.contains("\"keep_bits\": 9"), "{verify}");
        let other = run(text(&job.chart), &film, text(&job.pack), &["--codec", codec]);
        assert_eq!(other.code, 3, "{}", other.stderr);
        assert!(other.stderr.contains("--keep-bits (film 9, requested nothing)"), "{}", other.stderr);
    }
    let film = job.dir.path().join("too-many");
    let rejected = run(text(&job.chart), &film, text(&job.pack), &["--keep-bits", "11", "--dtype", "f16"]);
    assert_eq!(rejected.code, 2, "{}", rejected.stderr);
    assert!(rejected.stderr.contains("use 1 to 10"), "{}", rejected.stderr);
}

#[test]
fn resumed_film_has_the_same_files() {
    let job = LensJob::new();
    let film = job.run("film", &LAYOUT);
    let first = files(&film);
    let all = shards(&film);
    let of_film: Vec<_> = all.iter().filter(|p| p.starts_with("film")).collect();
    assert_eq!(of_film.len(), 2 * 3 * 3);
    for lost in [&of_film[..1], &of_film[4..7], &[of_film[2], of_film[8], of_film[9], of_film[17]]] {
        lost.iter().for_each(|p| std::fs::remove_file(film.join(p)).unwrap());
        let again =
            run(text(&job.chart), &film, text(&job.pack), &[&LAYOUT[..], &["--threads", "1"]].concat()).ok();
        assert!(again.stderr.contains(&format!("{} of 18 shards", lost.len())), "{}", again.stderr);
        assert!(files(&film) == first, "without {lost:?}");
    }
    let done = run(text(&job.chart), &film, text(&job.pack), &LAYOUT).ok();
    assert!(done.stderr.contains("complete") && files(&film) == first, "{}", done.stderr);
    let anew = run(text(&job.chart), &film, text(&job.pack), &[&LAYOUT[..], &["--overwrite"]].concat()).ok();
    assert!(!anew.stderr.contains("resuming") && files(&film) == first, "{}", anew.stderr);
}

#[test]
fn stored_and_generated_chart_give_the_same_film() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let draw = |name: &str, threads: &str| {
        let path = at(name);
        let words = ["chart", "composite", text(&path), "--size", "300x260", "--wavelengths", "450,500"];
        lenscube(&[&words[..], &["--pitch-um", "10", "--threads", threads]].concat()).ok();
        path
    };
    let (one, two) = (draw("one", "1"), draw("two", "2"));
    assert!(files(&one) == files(&two), "the chart depends on its threads");
    let flags = ["--psf-window", "5", "--azimuths", "4"];
    run(text(&one), &at("stored"), "double-gauss-28-npz", &flags).ok();
    run(
        "gen:composite?size=300x260&wavelengths=450,500&pitch_um=10",
        &at("drawn"),
        "double-gauss-28-npz",
        &flags,
    )
    .ok();
    let (stored, drawn) = (pixels(&at("stored"), "film"), pixels(&at("drawn"), "film"));
    assert_eq!(stored.0, Size::new(260, 300));
    assert!(bits(&stored.1) == bits(&drawn.1));
}

/// The same samples as Zarr, NPY, raw, ENVI of each interleave and spectral OpenEXR.
#[test]
fn chart_in_each_file_format_gives_the_same_film() {
    let job = LensJob::new();
    let whole = pixels(&job.run("film.zarr", &[]), "film");
    let picture = Picture::noise(7, Size::new(631, 705), 2);
    let at = |name: &str| job.dir.path().join(name);
    let plane = |order: &mut dyn FnMut(usize, usize, usize)| {
        (0..2).for_each(|b| (0..631).for_each(|y| (0..705).for_each(|x| order(b, y, x))));
    };
    let value = |b: usize, y: usize, x: usize| picture.bands[b][y * 705 + x];
    let mut bsq = Vec::new();
    plane(&mut |b, y, x| bsq.extend(value(b, y, x).to_le_bytes()));
    let interleaved = |index: fn(usize, usize, usize) -> usize| {
        let mut bytes = vec![0; bsq.len()];
        plane(&mut |b, y, x| {
            bytes[4 * index(b, y, x)..][..4].copy_from_slice(&value(b, y, x).to_be_bytes());
        });
        bytes
    };
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 631, 705), }\n";
    let mut npy = b"\x93NUMPY\x01\x00".to_vec();
    npy.extend((header.len() as u16).to_le_bytes());
    npy.extend(header.as_bytes());
    npy.extend(&bsq);
    std::fs::write(at("c.npy"), npy).unwrap();
    std::fs::write(at("c.samples"), &bsq).unwrap();
    for (name, bytes) in [
        ("bil", interleaved(|b, y, x| (y * 2 + b) * 705 + x)),
        ("bip", interleaved(|b, y, x| (y * 705 + x) * 2 + b)),
    ] {
        std::fs::write(at(&format!("{name}.img")), bytes).unwrap();
        let text = format!(
            "ENVI\nsamples = 705\nlines = 631\nbands = 2\ndata type = 4\ninterleave = {name}\nbyte order = 1\n\
             wavelength units = nm\nwavelength = {{450, 500}}\n"
        );
        std::fs::write(at(&format!("{name}.hdr")), text).unwrap();
    }
    lenscube(&["export", text(&job.chart), text(&at("c.exr"))]).ok();
    let pitch = ["--film-pitch-um", "2"];
    let flat = [&pitch[..], &["--wavelengths", "450,500"]].concat();
    let raw = [&flat[..], &["--chart-shape", "2,631,705", "--chart-dtype", "<f4"]].concat();
    for (chart, flags) in [
        ("c.npy", &flat[..]),
        ("c.samples", &raw[..]),
        ("bil.hdr", &pitch[..]),
        ("bip.img", &pitch[..]),
        ("c.exr", &pitch[..]),
    ] {
        let film = at(&format!("{chart}.zarr"));
        let ran = run(text(&at(chart)), &film, text(&job.pack), flags).ok();
        assert!(!chart.contains("exr") || ran.stderr.contains("decoding its bands once"), "{}", ran.stderr);
        assert!(bits(&pixels(&film, "film").1) == bits(&whole.1), "{chart}");
    }
}

#[test]
fn film_of_a_uniform_chart_equals_relative_illumination() {
    let dir = tempfile::tempdir().unwrap();
    let pack = formats::lens::builtin("double-gauss-28-npz").unwrap();
    for (name, axis) in [("middle", (128.0, 150.0)), ("aside", (100.25, 171.5))] {
        let film = dir.path().join(name);
        let words = format!("{},{}", axis.0, axis.1);
        let chart = "gen:uniform?size=257x301&wavelengths=420,550,700&pitch_um=85";
        run(chart, &film, "double-gauss-28-npz", &["--stages", "ri,distortion", "--axis", &words]).ok();
        let (size, got) = pixels(&film, "film");
        assert_eq!(got.len(), 3, "bands");
        for (band, nm) in got.iter().zip([420.0, 550.0, 700.0]) {
            let tables = pack.lens().bands.iter().find(|b| b.wavelength_nm == nm).unwrap();
            let (heights, ri) = (&tables.image_height_mm, &tables.relative_illumination);
            for (i, v) in band.iter().enumerate() {
                let (y, x) = ((i / size.width) as f64 - axis.1, (i % size.width) as f64 - axis.0);
                let r = 0.085 * y.hypot(x);
                let k = heights.partition_point(|&h| h <= r).clamp(1, heights.len() - 1);
                let share = (r - heights[k - 1]) / (heights[k] - heights[k - 1]);
                let expected = ri[k - 1] + share * (ri[k] - ri[k - 1]);
                assert!(
                    (f64::from(*v) - expected).abs() <= 1e-6,
                    "{name}, {nm} nm, r = {r} mm: {v}, not {expected}"
                );
            }
        }
    }
}

fn identity_film(dir: &Path, size: Size, window: usize) -> (Picture, Vec<Vec<f32>>) {
    let at = |name: &str| dir.join(format!("{name}-{size}-{window}"));
    let mut chart = Picture::noise(size.width as u64, size, 2);
    // A chart may hold negative values, and values over nine decades.
    let mut noise = Noise(99);
    for v in chart.bands[1].iter_mut() {
        *v = (noise.next() - 0.5) * 10f32.powi((noise.next() * 9.0) as i32);
    }
    chart.write(&at("chart"));
    let lens = lens(vec![identity_band(450.0, 1.0, window), identity_band(500.0, 1.0, window)]);
    write_pack(&at("pack"), &lens, lens.bands.iter().map(delta).collect());
    run(text(&at("chart")), &at("film"), text(&at("pack")), &[]).ok();
    let (film_size, film) = pixels(&at("film"), "film");
    assert_eq!(film_size, size);
    (chart, film)
}

#[test]
fn identity_lens_returns_the_chart() {
    let dir = tempfile::tempdir().unwrap();
    for size in [Size::new(1, 1), Size::new(300, 301), Size::new(129, 640)] {
        let (chart, film) = identity_film(dir.path(), size, 1);
        assert!(bits(&film) == bits(&chart.bands), "film of {size}: not bit for bit");
        // Rounding of the Fourier transforms: 1e-6 of the maximum value.
        let (chart, film) = identity_film(dir.path(), size, 9);
        assert_eq!(film.len(), chart.bands.len(), "bands");
        for (got, expected) in film.iter().zip(&chart.bands) {
            assert_eq!(got.len(), expected.len());
            let peak = expected.iter().fold(0f32, |m, v| m.max(v.abs()));
            let worst = got.iter().zip(expected).fold(0f32, |m, (g, e)| m.max((g - e).abs()));
            assert!(worst <= 1e-6 * peak, "film of {size}: {worst} of {peak}");
        }
    }
}
