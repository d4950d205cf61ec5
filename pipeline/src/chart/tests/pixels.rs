//! Pixels of all kinds: the same bits in any rectangle and from band to band, any size of film, cost.

use super::*;

/// Deterministic pseudo-random numbers.
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % end
    }
}

#[test]
fn any_rectangle_has_the_bits_of_the_complete_chart() {
    let mut random = Random(7);
    for spec in CHARTS {
        let chart = generate(spec);
        let full = chart.size().rect();
        let all = read(&chart, 0, full);
        assert!(all.iter().all(|v| v.is_finite() && *v >= 0.0), "{spec}");
        for _ in 0..60 {
            let (y, x) = (random.below(full.height), random.below(full.width));
            let rect = Rect::new(
                y as i64,
                x as i64,
                1 + random.below((full.height - y).min(90)),
                1 + random.below((full.width - x).min(90)),
            );
            let part = read(&chart, 0, rect);
            for (i, row) in part.chunks(rect.width).enumerate() {
                let from = (y + i) * full.width + x;
                let same = row.iter().zip(&all[from..]).all(|(a, b)| a.to_bits() == b.to_bits());
                assert!(same, "{spec}: row {i} of {rect}");
            }
        }
    }
}

#[test]
fn shares_kept_from_band_to_band_do_not_change_bits() {
    for spec in CHARTS {
        let spec = format!("{}&wavelengths=450,500,550,600", spec.split("&wavelengths").next().unwrap());
        let plain = generate(&spec);
        let full = plain.size().rect();
        for cache_bytes in [plain.useful_cache_bytes(), 1500] {
            let mut cached = generate(&spec);
            cached.set_cache_bytes(cache_bytes);
            for band in [0, 3, 0] {
                let (a, b) = (read(&plain, band, full), read(&cached, band, full));
                let differing = a.iter().zip(&b).position(|(a, b)| a.to_bits() != b.to_bits());
                assert_eq!(differing, None, "{spec}, band {band}, {cache_bytes} bytes");
            }
        }
    }
}

/// CPU time of this thread in s.
fn thread_cpu_s() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

#[test]
#[ignore = "measurement: run alone, in release, with --nocapture"]
fn cost_of_drawing_a_band_with_and_without_kept_shares() {
    for size in [4000, 8000, 14141] {
        let spec = format!("composite?size={size}&wavelengths=450,500,550,600");
        let (plain, mut kept) = (generate(&spec), generate(&spec));
        kept.set_cache_bytes(usize::MAX);
        let tiles: Vec<Rect> = plain.size().rect().tiles(442, 442).collect();
        for band in 0..3 {
            let seconds = [&plain, &kept].map(|chart| {
                let start = thread_cpu_s();
                tiles.iter().for_each(|tile| drop(read(chart, band, *tile)));
                thread_cpu_s() - start
            });
            println!("{size} px, band {band}: {:.3} s, with kept shares {:.3} s", seconds[0], seconds[1]);
        }
        let all = kept.useful_cache_bytes();
        println!("{size} px: {} of {all} bytes", all - kept.picture.cache_bytes_left());
    }
}

#[test]
fn very_small_and_very_long_films_can_be_drawn() {
    for size in ["1", "7x5", "2x1", "3x400", "64x1"] {
        for kind in [
            "uniform",
            "points?count=1",
            "slanted-edge",
            "siemens",
            "siemens?profile=sine",
            "checker",
            "composite",
            "dead-leaves",
        ] {
            let separator = if kind.contains('?') { '&' } else { '?' };
            let chart = generate(&format!("{kind}{separator}size={size}&wavelengths=550&overscan=2"));
            assert_eq!(chart.size().height, chart.film_size().height + 4);
            assert!(read(&chart, 0, chart.size().rect()).iter().all(|v| v.is_finite()), "{kind} {size}");
        }
    }
}

#[test]
fn ink_share_of_a_pixel_is_the_same_in_every_band() {
    let chart = generate("slanted-edge?size=64&wavelengths=450,550,650&overscan=0");
    let bands: Vec<_> = (0..3).map(|b| read(&chart, b, chart.size().rect())).collect();
    let share = |b: usize, i: usize| {
        let (light, dark) = (f64::from(bands[b][63]), f64::from(bands[b][0]));
        (f64::from(bands[b][i]) - light) / (dark - light)
    };
    for i in 0..64 * 64 {
        assert!((share(0, i) - share(1, i)).abs() < 1e-6 && (share(0, i) - share(2, i)).abs() < 1e-6);
    }
}

#[test]
fn reading_outside_the_chart_is_an_error() {
    let chart = generate("uniform?size=10&overscan=0");
    let mut out = [0.0; 4];
    assert!(chart.read(31, Rect::new(0, 0, 2, 2), &mut out).is_err());
    assert!(chart.read(0, Rect::new(9, 9, 2, 2), &mut out).is_err());
    assert!(chart.read(0, Rect::new(0, 0, 3, 2), &mut out).is_err());
}

/// Prints pixels per second of one core, in tiles of 512 as a job reads them.
#[test]
#[ignore = "measurement: run alone, in release, with --nocapture"]
fn reading_speed_per_chart_kind_is_printed() {
    for kind in ["uniform", "points", "slanted-edge", "siemens", "checker", "composite", "dead-leaves"] {
        let chart = generate(&format!("{kind}?size=14141&wavelengths=550"));
        let mut out = vec![0.0; 512 * 512];
        let (start, mut slowest) = (std::time::Instant::now(), std::time::Duration::ZERO);
        for tile in chart.size().rect().tiles(512, 512) {
            let began = std::time::Instant::now();
            chart.read(0, tile, &mut out[..tile.size().pixels()]).unwrap();
            slowest = slowest.max(began.elapsed());
        }
        let seconds = start.elapsed().as_secs_f64();
        let rate = chart.size().pixels() as f64 / seconds / 1e6;
        println!("{kind:13} {rate:7.0} Mpx/s  {seconds:.2} s  slowest tile {slowest:?}");
    }
}
