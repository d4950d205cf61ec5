//! Non-finite pixels are rejected; cost of that check.

use super::*;

fn encoder(sample: SampleType, chunk: usize) -> ShardEncoder {
    ShardEncoder::new(Codec::Zstd, sample, chunk).unwrap()
}

#[test]
fn non_finite_pixel_is_an_error_with_row_and_column() {
    for sample in [SampleType::F32, SampleType::F16] {
        for value in [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut pixels = vec![1.0; 20 * 30];
            (pixels[13 * 30 + 7], pixels[19 * 30 + 29]) = (value, value);
            let error = encoder(sample, 16).encode(&pixels, (20, 30), (2, 2)).unwrap_err();
            assert!(matches!(error, ShardError::NotFinite { row: 13, column: 7, .. }), "{error}");
        }
    }
    assert!(encoder(SampleType::F32, 16).encode(&[f32::MAX; 4], (2, 2), (1, 1)).is_ok());
}

/// `cargo test -p lenscube-formats --release --lib cost_of_finite_check -- --ignored --nocapture`
#[test]
#[ignore = "measurement: run alone, in release, with --nocapture"]
fn cost_of_finite_check() {
    let side = 2048;
    let pixels: Vec<f32> = (0..side * side).map(|k| ((k as f32 * 0.37).sin() + 2.0) * 100.0).collect();
    for codec in [Codec::None, Codec::Lz4, Codec::Zstd] {
        let encoder = ShardEncoder::new(codec, SampleType::F32, 512).unwrap();
        let best = |run: &dyn Fn()| {
            let time = || {
                let start = std::time::Instant::now();
                run();
                start.elapsed().as_secs_f64()
            };
            (0..7).map(|_| time()).fold(f64::INFINITY, f64::min)
        };
        let check = best(&|| check_finite(std::hint::black_box(&pixels), side).unwrap());
        let encode = best(&|| drop(encoder.encode_pixels(&pixels, (side, side), (4, 4)).unwrap()));
        println!(
            "{codec:?}: check {:.2} ms, encode {:.2} ms: {:.2} %",
            1e3 * check,
            1e3 * encode,
            100.0 * check / encode
        );
    }
}
