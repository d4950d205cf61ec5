use super::*;
use crate::sensor::noise::tests::{example, exposure};
use crate::sensor::{Exposure, Sensor};

const WELL: f64 = 1000.0;

fn blooming(share: f64) -> Overflow {
    Overflow { knee: 1.0, blooming: share }
}

/// One packet after another walks down (or up) until it is held.
fn by_packets(of: Overflow, charge: &[f64]) -> Vec<f64> {
    let in_order = |down_first: bool| {
        let mut free_e: Vec<f64> = charge.iter().map(|q| WELL - of.held(*q, WELL)).collect();
        let mut received = vec![0.0; charge.len()];
        for down in [down_first, !down_first] {
            let order: Vec<usize> =
                if down { (0..charge.len()).collect() } else { (0..charge.len()).rev().collect() };
            // A pixel's own flow passes those behind it only.
            for (k, from) in order.iter().enumerate() {
                let mut packet = 0.5 * of.blooming * (charge[*from] - of.held(charge[*from], WELL));
                for to in &order[k + 1..] {
                    let taken = packet.min(free_e[*to]);
                    (free_e[*to], received[*to], packet) =
                        (free_e[*to] - taken, received[*to] + taken, packet - taken);
                }
            }
        }
        received
    };
    std::iter::zip(in_order(true), in_order(false)).map(|(a, b)| 0.5 * (a + b)).collect()
}

fn column(seed: u64, rows: usize) -> Vec<f64> {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / (1u64 << 24) as f64
    };
    (0..rows).map(|_| if next() < 0.1 { 20_000.0 * next() } else { WELL * next() }).collect()
}

#[test]
fn charge_flows_as_packets_do() {
    for seed in 1..20 {
        let charge = column(seed, 120);
        for of in [blooming(1.0), blooming(0.3), Overflow { knee: 0.8, blooming: 1.0 }] {
            let got = of.spill(WELL, &charge, 1).unwrap();
            for (row, (got, expected)) in std::iter::zip(&got, by_packets(of, &charge)).enumerate() {
                assert!((f64::from(*got) - expected).abs() < 1e-3, "{seed} {row}: {got} {expected}");
            }
        }
    }
}

#[test]
fn charge_is_kept_and_a_column_upside_down_blooms_upside_down() {
    let mut charge = vec![100.0; 201];
    charge[100] = 50_000.0;
    let of = blooming(1.0);
    let got = of.spill(WELL, &charge, 1).unwrap();
    let total: f64 = got.iter().map(|v| f64::from(*v)).sum();
    assert!((total - (50_000.0 - WELL)).abs() < 0.05, "{total}");
    // 24500 e- in pixels that hold 900 more: 27 full ones and a part on each side.
    assert!(
        got[73..128].iter().enumerate().all(|(k, v)| k == 27 || *v == 900.0)
            && got[71] == 0.0
            && got[129] == 0.0
    );
    assert_eq!(got[72], 200.0);
    for seed in 1..10 {
        let mut charge = column(seed, 90);
        let got = of.spill(WELL, &charge, 1).unwrap();
        let over = std::iter::zip(&charge, &got).map(|(q, r)| of.held(*q, WELL) + f64::from(*r));
        assert!(over.fold(0.0, f64::max) <= WELL * (1.0 + 1e-6));
        charge.reverse();
        let mut other = of.spill(WELL, &charge, 1).unwrap();
        other.reverse();
        assert_eq!(got, other);
    }
    assert_eq!(of.spill(WELL, &[10.0; 64], 8), None);
    assert_eq!(Overflow::NONE.spill(WELL, &[1e5; 64], 8), None);
}

#[test]
fn the_knee_is_smooth_and_ends_at_the_full_well() {
    let of = Overflow { knee: 0.7, blooming: 0.0 };
    assert_eq!((of.held(700.0, WELL), of.held(300.0, WELL)), (700.0, 300.0));
    let slope = (of.held(700.1, WELL) - 700.0) / 0.1;
    assert!((slope - 1.0).abs() < 1e-3, "{slope}");
    assert!((of.held(1000.0, WELL) - (1000.0 - 300.0 * (-1.0f64).exp())).abs() < 1e-9);
    assert_eq!(of.held(1e9, WELL), WELL);
    let values: Vec<f64> = (0..3000).map(|q| of.held(f64::from(q), WELL)).collect();
    assert!(values.windows(2).all(|v| v[1] > v[0] && v[1] - v[0] <= 1.0 + 1e-9));
    assert_eq!(Overflow::NONE.held(1e4, WELL), WELL);
}

/// Columns of a strip are independent, and charges are those before the well that the raw's numbers follow from.
#[test]
fn what_a_sensor_receives_is_that_of_its_columns() {
    let mut sensor: Sensor = example();
    sensor.pixel.overflow = blooming(1.0);
    let exposer = Exposer::new(&sensor, &exposure());
    let rect = Rect::new(0, 10, 50, 150);
    let signal: Vec<f32> = (0..rect.size().pixels()).map(|k| if k % 977 == 0 { 2e7 } else { 3e5 }).collect();
    let all = received(&exposer, &signal, rect);
    assert!(all.iter().any(|v| *v > 0.0));
    let part = Rect::new(0, 85, 50, 5);
    let own: Vec<f32> = signal.chunks(150).flat_map(|line| line[75..80].to_vec()).collect();
    let few = received(&exposer, &own, part);
    let expected: Vec<f32> = all.chunks(150).flat_map(|line| line[75..80].to_vec()).collect();
    assert!(few == expected);
    // Full pixels are white, those beside them in a column brighter, others as without.
    let mut with = vec![0; signal.len()];
    exposer.expose_with(&signal, &all, rect, &mut with);
    let mut without = vec![0; signal.len()];
    exposer.expose(&signal, rect, &mut without);
    for (k, received) in all.iter().enumerate() {
        assert!(with[k] >= without[k] && (*received > 0.0 || with[k] == without[k]));
    }
}

/// A signal within the limit has no charge above it, whatever the noises of its pixels; a little more light than a full well has.
#[test]
fn no_charge_exceeds_a_limit_that_its_signal_is_within() {
    let mut sensor = Sensor { ..example() };
    sensor.noise.prnu = 0.05;
    sensor.noise.dark_nonuniformity = 0.3;
    sensor.defects = crate::sensor::Defects { hot_pixels: 0.3, hot_dark_e_per_s: 2.0, ..sensor.defects };
    for (limit_e, seconds) in [(300.0, 0.01), (1000.0, 0.1), (10_000.0, 1.0), (50.0, 0.01), (20.0, 100.0)] {
        let exposer = Exposer::new(&sensor, &Exposure { seconds, ..exposure() });
        let within = exposer.signal_within(limit_e, 7);
        if within == f64::NEG_INFINITY {
            assert!(limit_e < 100.0);
            continue;
        }
        let charges = |signal: f64| {
            let rect = Rect::new(7, 0, 1, 20_000);
            let mut out = vec![0.0; 20_000];
            exposer.charges(&vec![signal as f32; 20_000], rect, &mut out);
            out.into_iter().fold(0.0, f64::max)
        };
        assert!(charges(within) <= limit_e, "{limit_e}: {}", charges(within));
        assert!(charges(2.0 * limit_e / seconds) > limit_e);
    }
}
