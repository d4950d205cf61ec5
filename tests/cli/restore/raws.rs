//! Raws restored by the noise of their sensor.

use super::*;
use formats::raw::RawStore;

/// Of a sensor without a mosaic, and of a Bayer sensor: the residual is the noise that the sensor has by its description, and the chart the mean of the bands.
#[test]
fn raws_are_restored_by_the_noise_of_their_sensor() {
    let folder = Folder(tempfile::tempdir().unwrap(), Vec::new());
    let (chart, film) = (folder.at("chart.zarr"), folder.at("film.zarr"));
    let words = ["chart", "composite", text(&chart), "--size=128", "--overscan=0", "--pitch-um=2"];
    lenscube(&[&words[..], &["--wavelengths=500:600:100"]].concat()).ok();
    run(text(&chart), &film, LENS, &["--axis=1500,1000", "--center=-2.873,-1.873", "--film-size=128"]).ok();
    let (size, bands) = pixels(&chart, "chart");
    let inside = |i: usize| [i / size.width, i % size.width].iter().all(|k| (8..120).contains(k));
    let rms = |a: &[f32], b: &[f32]| {
        let (sum, count) = (0..a.len())
            .filter(|i| inside(*i))
            .fold((0.0, 0), |(sum, n), i| (sum + f64::from(a[i] - b[i]).powi(2), n + 1));
        (sum / f64::from(count)).sqrt()
    };
    let (_, film_bands) = pixels(&film, "film");
    // (sensor, exposure, planes, greatest rms over that of the film)
    for (sensor, exposure, planes, share) in
        [("ideal-mono", "auto:0.9", 1, 0.6), ("example-2um", "auto:0.9", 3, 0.97)]
    {
        let raw = folder.at(&format!("{sensor}.zarr"));
        expose(&film, &raw, sensor, &["--exposure", exposure, "--size=128", "--center=-2.873,-1.873"]);
        let out = format!("of-{sensor}.zarr");
        let flags = ["--film", text(&film), "--json"];
        let report = report(&folder.restore(&format!("{sensor}.zarr"), &out, &flags).ok());
        let restored = pixels(&folder.at(&out), "chart").1;
        assert_eq!(restored.len(), planes);
        for (plane, values) in report["bands"].as_array().unwrap().iter().zip(&restored) {
            let residual = plane["mean_square_residual_of_noise"].as_f64().unwrap();
            assert!((residual - 1.0).abs() < 0.1 && plane["noise_is_estimated"] == false, "{plane}");
            let shares: Vec<f64> =
                plane["film_bands"].as_array().unwrap().iter().map(|b| b[1].as_f64().unwrap()).collect();
            assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-9 && shares.len() <= 2, "{plane}");
            let of = |bands: &[Vec<f32>]| -> Vec<f32> {
                let at = |nm: f64| ((nm - 500.0) / 100.0) as usize;
                let share = |i: usize| -> f64 {
                    let all = plane["film_bands"].as_array().unwrap().iter();
                    all.map(|b| b[1].as_f64().unwrap() * f64::from(bands[at(b[0].as_f64().unwrap())][i]))
                        .sum()
                };
                (0..bands[0].len()).map(|i| share(i) as f32).collect()
            };
            let (expected, film) = (of(&bands), of(&film_bands));
            let (before, after) = (rms(&film, &expected), rms(values, &expected));
            assert!(after < share * before, "{sensor} {plane}: film {before}, restored {after}");
            let mean = |v: &[f32]| v.iter().map(|v| f64::from(*v)).sum::<f64>() / v.len() as f64;
            assert!((mean(values) / mean(&expected) - 1.0).abs() < 0.02, "{sensor} {plane}");
        }
    }
    // Sixteen tiles differ by less than 1e-4 of the peak; steps of photons are not negative.
    let flags = ["--film", text(&film), "--bands", "#0"];
    let many = [&flags[..], &["--tile", "64"]].concat();
    folder.restore("ideal-mono.zarr", "many.zarr", &many).ok();
    let [(_, one), (_, many)] =
        ["of-ideal-mono.zarr", "many.zarr"].map(|name| pixels(&folder.at(name), "chart"));
    let peak = one[0].iter().fold(0.0f32, |m, v| m.max(*v));
    let largest = pairs(&one, &many).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(largest < 1e-4 * peak, "{} of the peak", largest / peak);
    let steps = [&flags[..], &["--method", "richardson-lucy", "--iterations", "10"]].concat();
    folder.restore("example-2um.zarr", "steps.zarr", &steps).ok();
    assert!(pixels(&folder.at("steps.zarr"), "chart").1[0].iter().all(|v| *v >= 0.0));
}

/// Of pixels that are twice the film's, every 23rd at white.
#[test]
#[ignore = "long: 55 s"]
fn saturated_pixels_of_a_raw_are_left_out() {
    let folder = Folder(tempfile::tempdir().unwrap(), Vec::new());
    let (chart, film) = (folder.at("chart.zarr"), folder.at("film.zarr"));
    let words = ["chart", "composite", text(&chart), "--size=256", "--overscan=0", "--pitch-um=1"];
    lenscube(&[&words[..], &["--wavelengths=550"]].concat()).ok();
    let place = ["--axis=127.5,127.5", "--center=0,0", "--film-size=256", "--film-pitch-um=1"];
    run(text(&chart), &film, LENS, &place).ok();
    expose(&film, &folder.at("raw.zarr"), "ideal-mono", &["--exposure=auto:0.8"]);
    let raw = RawStore::open(&folder.at("raw.zarr"), false).unwrap();
    let white = raw.attributes()["white_dn"].as_f64().unwrap() as u16;
    let (size, frames) = pixels(&folder.at("raw.zarr"), "raw");
    let mut numbers: Vec<u16> = frames[0].iter().map(|v| *v as u16).collect();
    numbers.iter_mut().step_by(23).for_each(|dn| *dn = white);
    let damaged =
        RawStore::create(&folder.at("white.zarr"), raw.spec().clone(), raw.attributes().clone(), false)
            .unwrap();
    let shards = raw.spec().all_shards();
    assert_eq!((shards.len(), size.pixels()), (1, 128 * 128));
    damaged.commit_counts(shards[0], &numbers).unwrap();
    let [(_, all), (_, without)] = ["raw.zarr", "white.zarr"].map(|raw| {
        let out = format!("of-{raw}");
        let flags = ["--film", text(&film), "--json"];
        let report = report(&folder.restore(raw, &out, &flags).ok());
        let residual = report["bands"][0]["mean_square_residual_of_noise"].as_f64().unwrap();
        assert!((residual - 1.0).abs() < 0.1, "{report}");
        pixels(&folder.at(&out), "chart")
    });
    let peak = all[0].iter().fold(0.0f32, |m, v| m.max(*v));
    let square: f32 = pairs(&all, &without).map(|(a, b)| (a - b) * (a - b)).sum();
    let rms = (square / all[0].len() as f32).sqrt();
    assert!(rms < 0.03 * peak, "{rms} of {peak}");
}
