use super::*;

#[test]
fn ln_and_exp_agree_with_the_c_library_within_a_few_units() {
    for i in -3000..=3000 {
        let x = (f64::from(i) * 0.1).exp();
        let near = 1.0 + f64::from(i) * 3.3e-7;
        for x in [x, near] {
            let expected = x.ln();
            assert!((ln(x) - expected).abs() <= 8e-16 * expected.abs().max(1e-16), "ln {x}");
        }
        let x = f64::from(i) * 0.2;
        assert!((exp(x) / x.exp() - 1.0).abs() < 5e-16, "exp {x}");
    }
}

/// Φ(z) = u by the complementary error function.
#[test]
fn normal_quantile_inverts_the_distribution() {
    let mut worst: f64 = 0.0;
    let tails = (2..54).map(|k| 2f64.powi(-k));
    for u in (1..2000).map(|i| f64::from(i) / 4000.0).chain(tails) {
        let z = normal_quantile(u);
        worst = worst.max((0.5 * libm::erfc(-z / std::f64::consts::SQRT_2) / u - 1.0).abs());
    }
    for i in 1..4096 {
        let u = f64::from(i) / 4096.0;
        assert_eq!(normal_quantile(1.0 - u), -normal_quantile(u));
    }
    assert!(worst < 2e-14, "{worst}");
    assert!((normal_quantile(0.975) - 1.959_963_984_540_054).abs() < 1e-15);
}

#[test]
fn vectors_have_the_bits_of_single_numbers() {
    for start in [0.0, 2f64.powi(-53), 1e-12, 1e-3, 0.4] {
        let u: [f64; LANES] = std::array::from_fn(|i| match i % 3 {
            0 => start + 2f64.powi(-53) + (i as f64) * 1e-13,
            1 => (i as f64 + 0.5) / LANES as f64,
            _ => 1.0 - 2f64.powi(-53) - (i as f64) * 1e-13,
        });
        let each = u.map(normal_quantile);
        assert_eq!(normal_quantiles(&u).map(f64::to_bits), each.map(f64::to_bits));
        let mean: [f64; LANES] = std::array::from_fn(|i| (i as f64) * 0.7);
        let each: [f64; LANES] = std::array::from_fn(|i| poisson(mean[i], u[i]));
        assert_eq!(poissons(&mean, &u), each);
    }
}

/// Cumulative probability of each count, by the measure of the uniforms that lead to it; the grid itself errs by 10⁻⁶.
#[test]
fn poisson_counts_have_their_probabilities() {
    let n = 1 << 20;
    for (mean, allowed) in [
        (0.003, 2e-6),
        (0.7, 2e-6),
        (5.0, 2e-6),
        (31.99, 2e-6),
        (32.0, 6e-6),
        (50.0, 4e-6),
        (400.0, 2e-6),
        (2e4, 2e-6),
    ] {
        let mean: f64 = mean;
        let end = (mean + 12.0 * mean.sqrt() + 12.0) as usize;
        let mut counts = vec![0u32; end + 1];
        let mut last = 0.0;
        for i in 0..n {
            let k = poisson(mean, (f64::from(i) + 0.5) / f64::from(n));
            assert!(k >= last);
            last = k;
            counts[k as usize] += 1;
        }
        let (mut got, mut expected, mut log_factorial) = (0.0, 0.0, 0.0);
        for (k, count) in counts.iter().enumerate() {
            log_factorial += (k.max(1) as f64).ln();
            got += f64::from(*count) / f64::from(n);
            expected += (k as f64 * mean.ln() - mean - log_factorial).exp();
            assert!((got - expected).abs() < allowed, "P(n ≤ {k}) of {mean}: {got}, expected {expected}");
        }
    }
}

/// One step back is allowed, at the seam between the two methods.
#[test]
fn more_light_never_gives_fewer_electrons() {
    for u in [1e-6, 0.03, 0.5, 0.97, 1.0 - 1e-6] {
        let counts: Vec<f64> = (0..=4000).map(|i| poisson(f64::from(i) * 0.025, u)).collect();
        let falls: Vec<f64> = counts.windows(2).map(|w| w[1] - w[0]).filter(|d| *d < 0.0).collect();
        assert!(falls.is_empty() || falls == [-1.0], "{u}: {falls:?}");
    }
    assert_eq!(poisson(0.0, 1.0 - 2f64.powi(-53)), 0.0);
}
