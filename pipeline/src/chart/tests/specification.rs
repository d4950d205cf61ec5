//! Specifications as text: round trips, and errors with a hint.

use super::*;

#[test]
fn specification_text_round_trips() {
    for spec in CHARTS.iter().chain(&["slanted-edge?centers=10,20;300,40.5&patch_px=90", "gen:composite"]) {
        let read: ChartSpec = spec.parse().unwrap();
        let written = read.to_string();
        let again: ChartSpec = written.parse().unwrap();
        assert_eq!(again.to_string(), written);
        assert_eq!(ChartSpec { overscan_px: read.overscan_px, ..again }, read);
    }
    let chart = generate("gen:composite?size=14141&wavelengths=400:700:10&pitch_um=2");
    assert_eq!((chart.overscan_px(), chart.size().height, chart.wavelengths_nm().len()), (206, 14553, 31));
}

#[test]
fn invalid_specification_is_an_error_with_a_hint() {
    for (spec, hint) in [
        ("composit", "'composite'"),
        ("slantededge", "'slanted-edge'"),
        ("", "Kinds: uniform, points"),
        ("points?wavelength=550", "'wavelengths'"),
        ("checker?spokes=5", "a checker chart has no setting 'spokes'"),
        ("composite?size=1e18", "size=1e18"),
        ("composite?size=999999999999999999999999", "1 to 1000000"),
        ("composite?size=0", "1 to 1000000"),
        ("composite?size=-3x10", "1 to 1000000"),
        ("composite?overscan=18446744073709551615", "overscan="),
        ("composite?size=10&size=20", "twice"),
        ("composite?size", "key=value"),
        ("composite?pitch_um=0", "pitch"),
        ("composite?pitch_um=nan", "a number"),
        ("composite?wavelengths=400:700:0", "step above 0"),
        ("composite?wavelengths=350", "380 to 780"),
        ("composite?illuminant=F2", "D65, A or E"),
        ("uniform?value=1e300", "32-bit"),
        ("uniform?value=inf", "a number"),
        ("points?size=20", "reduce the number"),
        ("points?count=100000", "1 to 128"),
        ("points?blob=square", "gaussian or disc"),
        ("points?width_px=0.1", "2.2"),
        ("slanted-edge?contrast=0", "light over dark"),
        ("slanted-edge?centers=5", "X,Y;X,Y"),
        ("slanted-edge?centers=5000,5", "on the film"),
        ("slanted-edge?centers=50,50;52,50&patch_px=9", "apart"),
        ("siemens?spokes=1", "2 to 720"),
        ("siemens?profile=saw", "square or sine"),
        ("dead-leaves?r_min_px=0.5", "1 to 10000 px"),
        ("dead-leaves?r_min_px=9&r_max_px=8", "r_min_px to 100000 px"),
        ("dead-leaves?seed=-1", "a whole number"),
        ("oecf?patches=1", "2 to 64"),
        ("oecf?density=6", "0.1 to 5"),
        ("oecf?size=50&patches=60", "grey patches"),
        ("checker?fiducials=20", "21 to 100000 px"),
        ("checker?fiducials=-7", "21 to 100000 px"),
        ("checker?size=200x300&fiducials=70", "corner marks are 200.0 px apart and need 270.0 px"),
        ("uniform?value=0&fiducials=30", "without light"),
        ("depth-scene?near_m=0", "0.0001 to 100000 m"),
        ("depth-scene?near_m=2&far_m=2", "more than near_m"),
        ("depth-scene?part=dept", "one of chart, depth, coverage"),
    ] {
        let error =
            spec.parse::<Generator>().err().unwrap_or_else(|| panic!("{spec} was accepted")).to_string();
        assert!(error.contains(hint), "{spec}: {error}");
    }
    assert!("uniform?wavelengths=350".parse::<Generator>().is_ok());
}
