//! Chart to film in memory through the executor: compared with the f64 model, the same bits for any way of running it, and its transpose.
//! Each case runs once per instruction set; sets that the machine lacks are reported as ignored.

mod adjoint_cases;
mod flow_case;
mod oracle;

use flow_case::{LostShards, Sink, Unreadable, case};
use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::lens::{PsfSample, PsfStack};
use lenscube_pipeline::simd::Simd;
use lenscube_pipeline::stage::{Stage, Stages};
use lenscube_pipeline::tiling::FilmRegion;
use oracle::{Image, Noise, errors};
use std::process::ExitCode;

fn film_equals_the_f64_model_in_every_band(simd: Simd) {
    let mut noise = Noise(21);
    for (film, chart, windows) in [
        (Size::new(301, 277), Size::new(310, 290), vec![9, 21, 5]),
        (Size::new(37, 1100), Size::new(30, 900), vec![15]),
        (Size::new(3, 2), Size::new(50, 60), vec![31, 1]),
    ] {
        let case = case(simd, &mut noise, film, chart, &windows);
        let (films, _) = case.run(&case.full_film(128), 2, 1 << 20);
        for (band, got) in films[0].iter().enumerate() {
            let expected = case.oracle(band);
            let (worst, l2) = errors(got, &expected.data);
            assert!(worst <= 2e-6 && l2 <= 1e-6, "film {film}, band {band}: max {worst:.1e}, L2 {l2:.1e}");
        }
    }
}

fn same_bits_for_threads_memory_shards_and_regions(simd: Simd) {
    let mut noise = Noise(5);
    let case = case(simd, &mut noise, Size::new(700, 620), Size::new(720, 640), &[25, 7]);
    let (full, _) = case.run(&case.full_film(256), 1, 64 << 20);
    let same =
        |a: &[f32], b: &[f32]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits());
    for (threads, spectra, shard) in [(2, 64 << 20, 256), (5, 1, 256), (3, 1 << 20, 64), (2, 1 << 20, 2048)] {
        let (films, _) = case.run(&case.full_film(shard), threads, spectra);
        assert_eq!((films.len(), films[0].len()), (1, full[0].len()), "regions, bands");
        for (a, b) in full[0].iter().zip(&films[0]) {
            assert!(same(a, b), "{threads} threads, {spectra} bytes, shards of {shard}");
        }
    }
    let regions = [Rect::new(0, 0, 1, 1), Rect::new(411, 300, 200, 320), Rect::new(650, 5, 50, 77)];
    let regions: Vec<FilmRegion> =
        regions.iter().map(|&rect| FilmRegion { rect, shard: Size::new(64, 48) }).collect();
    let (films, _) = case.run(&regions, 2, 1 << 20);
    assert_eq!(films.len(), regions.len());
    for (region, film) in regions.iter().map(|r| r.rect).zip(&films) {
        assert_eq!(film.len(), full[0].len(), "bands of {region}");
        for (band, got) in film.iter().enumerate() {
            for (i, v) in got.iter().enumerate() {
                let (y, x) = (region.y as usize + i / region.width, region.x as usize + i % region.width);
                assert_eq!(v.to_bits(), full[0][band][y * 620 + x].to_bits(), "{region}, band {band}");
            }
        }
    }
    let (_, corner) = case.run(&regions[..1], 2, 1 << 20);
    assert!(corner.tiles == 2, "one tile of each band reaches the corner, {} were computed", corner.tiles);
}

fn psfs_beyond_the_film_are_not_needed(simd: Simd) {
    let mut noise = Noise(8);
    let mut case = case(simd, &mut noise, Size::new(700, 620), Size::new(120, 110), &[25, 7]);
    case.frame = Frame::centred(Size::new(100, 90), Size::new(120, 110), 2.0);
    let (full, _) = case.run(&case.full_film(64), 2, 1 << 20);
    for (plan, stack) in case.plans().iter().zip(&mut case.stacks) {
        let sets = plan.psf_sets(&case.frame);
        // Heights of 0, 98, 154, 331 and 466 px or more; the corners of the film and its margin are at 67 to 84 px.
        assert_eq!((sets, stack.heights()), (2, 5));
        stack.samples.truncate(sets * stack.size * stack.size);
    }
    let (of_first, _) = case.run(&case.full_film(64), 2, 1 << 20);
    for (a, b) in full[0].iter().zip(&of_first[0]) {
        assert!(!a.is_empty() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
}

fn point_keeps_its_sum_and_coma_points_outwards(simd: Simd) {
    let mut noise = Noise(2);
    let film = Size::new(241, 241);
    let mut case = case(simd, &mut noise, film, film, &[11]);
    case.frame = Frame::centred(film, film, 2.0);
    // A point with a tail three pixels farther out on +x.
    let mut tail = vec![0f32; 121];
    tail[5 * 11 + 5] = 0.6;
    tail[5 * 11 + 8] = 0.4;
    let mut on_axis = vec![0f32; 121];
    on_axis[5 * 11 + 5] = 1.0;
    case.stacks[0].samples = [on_axis, tail.clone(), tail.clone(), tail.clone(), tail].concat();
    case.options.stages = Stages::of(&[Stage::Svpsf]);
    case.frame.scale = (1.0, 1.0);
    let last = case.frame.farthest_mm(film.rect().grown(5));
    case.lens.bands[0].psf_height_mm = vec![0.0, 0.05, 0.1, 0.2, last];
    for (y, x) in [(120, 220), (220, 120), (120, 20), (20, 120), (20, 20), (20, 220), (220, 20), (220, 220)] {
        case.chart.0[0] = Image::new(film, |row, col| f64::from(u8::from((row, col) == (y, x))));
        let (films, _) = case.run(&case.full_film(256), 1, 1 << 20);
        let got = &films[0][0];
        let sum: f64 = got.iter().map(|&v| f64::from(v)).sum();
        assert!((sum - 1.0).abs() < 1e-6, "sum of a point: {sum}");
        let mean = |axis: fn(usize) -> usize| -> f64 {
            got.iter().enumerate().map(|(i, v)| axis(i) as f64 * f64::from(*v)).sum()
        };
        let (dy, dx) = (mean(|i| i / 241) - y as f64, mean(|i| i % 241) - x as f64);
        let (oy, ox) = (y as f64 - 120.0, x as f64 - 120.0);
        let outwards = (dy * oy + dx * ox) / oy.hypot(ox);
        let across = (dy * ox - dx * oy) / oy.hypot(ox);
        assert!(outwards > 0.8 && across.abs() < 1e-3, "at {y},{x}: {outwards} out, {across} across");
    }
}

/// A uniform remapped image gives a film of 1 − div c to first order, with c the displacement of the PSF's centroid from the chief
/// ray. Here c = α·r outwards, so div c = 2α everywhere, up to the film's border; terms of α² (times r₁/r next to the axis, where
/// the PSF is interpolated with the axis node) stay below 5e-4.
fn uniform_chart_gives_one_minus_the_divergence_of_the_psf_centroid(simd: Simd) {
    const ALPHA: f64 = 0.004;
    let film = Size::new(150, 170);
    let mut noise = Noise(4);
    let mut case = case(simd, &mut noise, film, film, &[25]);
    case.frame = Frame::centred(film, film, 2.0);
    case.chart.0[0] = Image::new(film, |_, _| 1.0);
    case.options.stages = Stages::of(&[Stage::Svpsf]);
    case.options.azimuths = Some(144);
    case.lens.psf_sample = PsfSample::Point;
    let n = 49;
    case.lens.bands[0].psf_size = n;
    case.lens.bands[0].psf_pitch_um = 1.0;
    let last = case.frame.farthest_mm(film.rect().grown(13));
    let heights: Vec<f64> = (0..5).map(|k| last * f64::from(k) / 4.0).collect();
    let samples = heights.iter().flat_map(|h| {
        // Samples of 1 µm: a Gaussian of 3 µm, centred at α·h on +x.
        let out = ALPHA * h * 1e3;
        let w = (0..n * n).map(|i| {
            let (y, x) = ((i / n) as f64 - 24.0, (i % n) as f64 - 24.0 - out);
            (-(x * x + y * y) / 18.0).exp()
        });
        let w: Vec<f64> = w.collect();
        let sum: f64 = w.iter().sum();
        w.into_iter().map(move |v| (v / sum) as f32)
    });
    case.stacks[0] =
        PsfStack { size: n, pitch_um: 1.0, sample: PsfSample::Point, samples: samples.collect() };
    case.lens.bands[0].psf_height_mm = heights;
    let (films, _) = case.run(&case.full_film(256), 2, 64 << 20);
    for (i, v) in films[0][0].iter().enumerate() {
        let (y, x) = (i / 170, i % 170);
        assert!((f64::from(*v) - (1.0 - 2.0 * ALPHA)).abs() < 5e-4, "{v} at {y},{x}");
    }
}

fn read_error_loses_exactly_the_dependent_shards(simd: Simd) {
    let mut noise = Noise(8);
    let case = case(simd, &mut noise, Size::new(700, 620), Size::new(720, 640), &[25, 7]);
    let regions = case.full_film(100);
    let (full, _) = case.run(&regions, 1, 64 << 20);
    let rect = Rect::new(300, 310, 4, 4);
    for threads in [1, 3] {
        let (sink, lost) = (Sink::new(&regions, 2), LostShards::default());
        case.run_into(&regions, threads, 1 << 20, &Unreadable(&case.chart, 1, rect), &sink, &lost).unwrap();
        let (committed, lost) = (sink.committed.into_inner().unwrap(), lost.0.into_inner().unwrap());
        assert!(!lost.is_empty() && lost.iter().all(|id| id.position == 1), "{lost:?}");
        assert!(committed.is_disjoint(&lost), "a shard with unreadable pixels was committed");
        assert_eq!(committed.len() + lost.len(), 2 * 7 * 5, "neither committed nor lost");
        assert!(lost.len() < 7 * 5, "one unreadable rectangle lost the complete band");
        let films = sink.films.into_inner().unwrap();
        for id in committed {
            let shard = regions[0].shard_rect(id.row, id.col);
            for (y, x) in
                (shard.y..shard.bottom()).flat_map(|y| (shard.x..shard.right()).map(move |x| (y, x)))
            {
                let at = y as usize * 620 + x as usize;
                assert_eq!(films[0][id.position][at].to_bits(), full[0][id.position][at].to_bits(), "{id:?}");
            }
        }
        let sink = Sink::new(&regions, 2);
        let chart = Unreadable(&case.chart, 1, rect);
        let error = case.run_into(&regions, threads, 1 << 20, &chart, &sink, &()).unwrap_err();
        assert_eq!((error.position(), error.cause().to_string().as_str()), (1, "cannot be read"));
    }
}

fn main() -> ExitCode {
    let checks: [(&str, oracle::Check); 6] = [
        ("film_equals_the_f64_model_in_every_band", film_equals_the_f64_model_in_every_band),
        ("same_bits_for_threads_memory_shards_and_regions", same_bits_for_threads_memory_shards_and_regions),
        ("psfs_beyond_the_film_are_not_needed", psfs_beyond_the_film_are_not_needed),
        ("point_keeps_its_sum_and_coma_points_outwards", point_keeps_its_sum_and_coma_points_outwards),
        (
            "uniform_chart_gives_one_minus_the_divergence_of_the_psf_centroid",
            uniform_chart_gives_one_minus_the_divergence_of_the_psf_centroid,
        ),
        ("read_error_loses_exactly_the_dependent_shards", read_error_loses_exactly_the_dependent_shards),
    ];
    oracle::on_every_isa(&[&checks[..], &adjoint_cases::CHECKS].concat())
}
