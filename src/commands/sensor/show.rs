//! `lenscube sensor list` and `show`.

use super::open::open_sensor;
use crate::args::{SensorShowArgs, check_directory};
use crate::outputs::check_absent_in;
use crate::progress::{log_line, number, print};
use anyhow::{Context, Result};
use formats::picture::plot::{Axis, Plot, Series, stacked};
use formats::picture::style::Colour;
use formats::sensor::{SensorFile, builtin_names};
use pipeline::colour::Illuminant;
use pipeline::geometry::Size;
use pipeline::sensor::angle::{Microlenses, PlateKind, radians, slope};
use pipeline::sensor::emva::Bench;
use pipeline::sensor::figures::{Over, Quantity};
use pipeline::sensor::{NoiseSet, Sensor};
use std::path::Path;

/// Film pitch for sensors that have the film's.
const DEFAULT_PITCH_UM: f64 = 2.0;

/// Wavelengths at which crosstalk is printed, nm.
const SHOWN_NM: [f64; 4] = [450.0, 550.0, 650.0, 850.0];

/// Files of [`plots`].
pub const FIGURES: [&str; 3] = ["quantum-efficiency.png", "signal-to-noise.png", "patches.png"];

/// Lists the built-in sensors.
pub fn list() -> Result<()> {
    for name in builtin_names() {
        let file = open_sensor(name, &[])?;
        let sensor = file.sensor(DEFAULT_PITCH_UM);
        let pitch = file.pitch_um().map_or("film".to_owned(), |p| p.to_string());
        print(format!("{name:14}  {pitch:>5} µm  {:2} bits  {}", sensor.adc.bits, sensor.description));
    }
    Ok(())
}

/// Shows one sensor.
pub fn show(args: &SensorShowArgs) -> Result<()> {
    if let Some(directory) = &args.plot {
        check_absent_in(directory, FIGURES, args.overwrite)?;
    }
    let file = open_sensor(&args.sensor, &args.set)?;
    let sensor = file.sensor(DEFAULT_PITCH_UM);
    figures(&file, &sensor).iter().for_each(print);
    if let Some(warning) = super::warnings::of_black(&sensor, 1.0, None) {
        log_line(warning);
    }
    match &args.plot {
        Some(directory) => plots(&sensor, directory),
        None => Ok(()),
    }
}

fn figures(file: &SensorFile, s: &Sensor) -> Vec<String> {
    let (p, a) = (&s.pixel, &s.adc);
    let pitch = match file.pitch_um() {
        Some(pitch) => format!("{pitch} µm"),
        None => format!("the film's (figures below for {DEFAULT_PITCH_UM} µm)"),
    };
    let size = p.size.map_or("any".into(), |(h, w)| format!("{} px", Size::new(h, w)));
    let mut lines = vec![
        format!("{}: {}", s.name, s.description),
        format!("  pixels            {pitch}, aperture {} µm, {size}", p.aperture_um),
        format!(
            "  full well         {} e-, saturation {:.0} e- at gain 1 (white {} DN)",
            p.full_well_e,
            s.saturation_e(1.0),
            s.white_dn(1.0)
        ),
    ];
    lines.extend(overflow(s));
    lines.extend([format!(
        "  converter         {} bits, {} DN/e-, black {} DN",
        a.bits, a.gain_dn_per_e, a.black_dn
    )]);
    lines.extend(range(s));
    lines.extend([
        format!("  dark              {} (RMS)", noises(s, Over::Frames)),
        format!(
            "  dark current      {} e-/s at {} °C, doubling every {} K",
            p.dark_current_e_per_s, p.dark_reference_c, p.dark_doubling_k
        ),
        format!("  fixed patterns    {}", noises(s, Over::Die)),
        format!("  dynamic range     {:.1} dB", 20.0 * s.dynamic_range().log10()),
    ]);
    lines.extend(defects(s));
    lines.extend(angles(s));
    lines.extend(crosstalk(s));
    for (c, channel) in s.channels.iter().enumerate() {
        let (nm, peak) = peak(s, c);
        let d65 = s.electrons_per_lux_second(c, Illuminant::D65);
        lines.push(format!(
            "  {:<16}  plane {}, quantum efficiency {:.1} % at {nm} nm; {:.4} ke- per lx s, saturates at {:.3} lx s (D65)",
            channel.name,
            channel.plane,
            100.0 * peak,
            d65 / 1e3,
            s.saturation_e(1.0) / d65
        ));
    }
    let rows: Vec<String> = s
        .pattern
        .channels
        .chunks(s.pattern.columns)
        .map(|row| row.iter().map(|c| s.channels[*c].name.as_str()).collect::<Vec<_>>().join(" "))
        .collect();
    lines.push(format!("  mosaic            {}", rows.join(" / ")));
    lines.push("  sources".into());
    for source in file.sources() {
        lines.push(format!("    {:<26} {}", source.field, source.text));
    }
    lines
}

/// What depends on the angle of incidence.
fn angles(s: &Sensor) -> Vec<String> {
    let mut lines = Vec::new();
    if let Some(angle) = &s.angle {
        let shifted = match &angle.microlenses {
            Microlenses::Centred => "centred".into(),
            Microlenses::OfLens => "shifted for the chief rays of the film's lens".into(),
            Microlenses::Table(rows) => {
                let (height_mm, sine) = rows[rows.len() - 1];
                let degrees = pipeline::real::asin(sine).to_degrees();
                format!("shifted for a table of chief rays, {degrees:.1} degrees at {height_mm} mm")
            }
        };
        let at = |nm: f64, degrees: f64| {
            let sine = pipeline::real::sin(radians(degrees));
            let along = [slope(sine, angle.stack_index), 0.0];
            let responses = angle.channels.iter().map(|of| format!("{:.1}", 100.0 * of.at_nm(nm, along)));
            format!("{degrees} degrees {} %", responses.collect::<Vec<_>>().join(", "))
        };
        let row = |nm: f64| [10.0, 20.0, 30.0].map(|degrees| at(nm, degrees)).join(", ");
        let spectral = angle.channels.iter().map(|of| &of.wavelengths_nm).find(|nodes| !nodes.is_empty());
        let rows = match spectral {
            None => row(0.0),
            Some(nodes) => {
                nodes.iter().map(|nm| format!("at {nm} nm {}", row(*nm))).collect::<Vec<_>>().join("; ")
            }
        };
        lines.push(format!(
            "  angles            response of each filter along rows {rows}; microlenses {shifted}; stack index {}",
            angle.stack_index
        ));
    }
    for plate in &s.plates {
        let kind = match plate.kind {
            PlateKind::Interference => "interference",
            PlateKind::Absorbing => "absorbing",
        };
        lines.push(format!("  plate             {kind}, index {}", plate.index));
    }
    lines
}

/// Defects, and rows that start one after another.
fn defects(s: &Sensor) -> Option<String> {
    let d = s.defects;
    let mut parts = Vec::new();
    if d.hot_pixels > 0.0 {
        parts.push(format!(
            "hot pixels {} %, {} e-/s more on average",
            number(100.0 * d.hot_pixels),
            number(d.hot_dark_e_per_s)
        ));
    }
    if d.telegraph_pixels > 0.0 {
        let (share, levels_e) = (number(100.0 * d.telegraph_pixels), number(d.telegraph_e));
        parts.push(format!("telegraph noise {share} %, levels {levels_e} e- apart on average"));
    }
    if s.row_time_s > 0.0 {
        parts.push(format!("a row starts every {} µs", number(1e6 * s.row_time_s)));
    }
    (!parts.is_empty()).then(|| format!("  defects, rows     {}", parts.join("; ")))
}

/// Two conversion gains, and the curve of a companding converter.
fn range(s: &Sensor) -> Vec<String> {
    let mut lines = Vec::new();
    if let Some(dual) = &s.adc.dual_gain {
        let (first, last) = dual.transition_dn;
        lines.push(format!(
            "  dual gain         1:{} in two readings of {} bits; the low one has a read noise of {} e- and is used above {} to {} DN of the high one",
            number(dual.ratio),
            dual.bits,
            number(dual.read_noise_e),
            number(first),
            number(last)
        ));
    }
    if let Some(curve) = &s.adc.companding {
        let points = std::iter::zip(&curve.linear_dn, &curve.coded_dn);
        let points: Vec<String> = points.map(|(x, y)| format!("{x} -> {y}")).collect();
        lines.push(format!("  companding        {} DN", points.join(", ")));
    }
    lines
}

/// How pixels fill and overflow, where the full well is more than a limit.
fn overflow(s: &Sensor) -> Option<String> {
    let of = s.pixel.overflow;
    let mut parts = Vec::new();
    if of.knee < 1.0 {
        parts.push(format!("knee at {} % of the full well", number(100.0 * of.knee)));
    }
    if of.flows() {
        parts.push(format!("{} % of what is above it flows along the column", number(100.0 * of.blooming)));
    }
    (!parts.is_empty()).then(|| format!("  overflow          {}", parts.join("; ")))
}

/// What pixels collect of the light of others.
fn crosstalk(s: &Sensor) -> Vec<String> {
    let Some(crosstalk) = &s.crosstalk else { return Vec::new() };
    let (r, side) = (crosstalk.radius, crosstalk.side());
    let at = |nm: f64| {
        let share = |down: usize, right: usize| 100.0 * crosstalk.share_at(down * side + right, nm);
        format!(
            "  {:<16}  {:.2} % of the charge of {nm} nm goes to other pixels: right {:.2}, left {:.2}, below {:.2}, above {:.2}, others {:.2}",
            if nm == SHOWN_NM[0] { "crosstalk" } else { "" },
            100.0 - share(r, r),
            share(r, r + 1),
            share(r, r - 1),
            share(r + 1, r),
            share(r - 1, r),
            100.0
                - [(r, r), (r, r + 1), (r, r - 1), (r + 1, r), (r - 1, r)]
                    .map(|(y, x)| share(y, x))
                    .iter()
                    .sum::<f64>()
        )
    };
    SHOWN_NM.map(at).into()
}

/// The noises that differ over frames or over a die: `read 2 e-, reset 0 e-`.
fn noises(sensor: &Sensor, over: Over) -> String {
    let rows = sensor.noise.rows().filter(|(row, _)| row.over == over);
    // Exponents stand with what they are the spectrum of.
    let spectrum = |field: &str| {
        let exponent = match field {
            "row_noise_e" => sensor.noise_spectrum.row_exponent,
            "column_offset_e" => sensor.noise_spectrum.column_exponent,
            _ => 0.0,
        };
        if exponent > 0.0 { format!(" (1/f^{exponent})") } else { String::new() }
    };
    let texts = rows.map(|(row, value)| match row.quantity {
        Quantity::Charge => format!("{} {value} e-{}", row.label, spectrum(row.field)),
        Quantity::Number => format!("{} {value} DN", row.label),
        Quantity::LightShare | Quantity::DarkShare | Quantity::ChargeShare => {
            format!("{} {} %", row.label, number(100.0 * value))
        }
    });
    texts.collect::<Vec<_>>().join(", ")
}

/// Wavelength (nm) and value of the highest quantum efficiency of a channel on a grid of 5 nm and at the nodes of its curves.
pub fn peak(sensor: &Sensor, channel: usize) -> (f64, f64) {
    let (first, last) = sensor.channels[channel].curve.range_nm();
    let grid = (60..=400).map(|i| f64::from(i) * 5.0).filter(|nm| (first..=last).contains(nm));
    let nodes = sensor.nodes_nm(channel).into_iter().filter(|nm| (first..=last).contains(nm));
    grid.chain(nodes)
        .map(|nm| (nm, sensor.quantum_efficiency(channel, nm)))
        .fold((first, 0.0), |best, new| if new.1 > best.1 { new } else { best })
}

/// Writes [`FIGURES`]: quantum efficiency, signal-to-noise ratio, colours of a ColorChecker.
pub fn plots(s: &Sensor, directory: &Path) -> Result<()> {
    check_directory(directory)?;
    std::fs::create_dir_all(directory).with_context(|| format!("creating {}", directory.display()))?;
    let curves = (0..s.channels.len()).map(|c| {
        let (first, last) = s.channels[c].curve.range_nm();
        let (first, last) = (first.max(300.0), last.min(1100.0));
        let points = (0..=400).map(|i| first + (last - first) * f64::from(i) / 400.0);
        let curve = points.map(|nm| (nm, 100.0 * s.quantum_efficiency(c, nm))).collect();
        // Red, green and blue in their colours; filters of one plane differ by their dashes.
        let colour = match s.channels[c].plane.as_str() {
            "R" => 4,
            "G" => 2,
            "B" => 0,
            _ => c,
        };
        Series::line(&s.channels[c].name, curve, Colour::Palette(colour)).dashed(c)
    });
    let mut plot = Plot::new(
        format!("{}: quantum efficiency", s.name),
        Axis::new("wavelength (nm)", 300.0, 1100.0),
        Axis::new("electrons per photon (%)", 0.0, 1.0),
    );
    plot.series = curves.collect();
    write(&directory.join("quantum-efficiency.png"), plot)?;
    let path = directory.join("signal-to-noise.png");
    stacked(&format!("{}: signal-to-noise ratio", s.name), &signal_to_noise_plots(s), Default::default())
        .write(&path)?;
    log_line(format!("wrote {}", path.display()));
    super::figures::patches(&directory.join("patches.png"), s)
}

/// Signal-to-noise ratio over photons on a pixel at the wavelength of the highest quantum efficiency, and over the lx s of D65, of the filter
/// that has it.
fn signal_to_noise_plots(s: &Sensor) -> Vec<Plot> {
    let best = (0..s.channels.len()).max_by(|a, b| peak(s, *a).1.total_cmp(&peak(s, *b).1)).unwrap_or(0);
    let (nm, efficiency) = peak(s, best);
    let range = (0..=120).map(|i| 10f64.powf(f64::from(i) / 120.0 * s.saturation_e(1.0).log10()));
    let electrons: Vec<f64> = range.collect();
    let over = |name: String, per_electron: f64| {
        let ratio = |total: bool| {
            let of = |e: &f64| ((e * per_electron).log10(), 20.0 * signal_to_noise(s, *e, total).log10());
            electrons.iter().map(of).collect::<Vec<_>>()
        };
        let end = |k: usize| (electrons[k] * per_electron).log10();
        let x = Axis::new(name, end(0), end(electrons.len() - 1));
        let mut plot = Plot::new(String::new(), x, Axis::new("ratio (dB)", 0.0, 1.0));
        plot.series = vec![
            Series::distinct("temporal", ratio(false), 0),
            Series::distinct("with fixed patterns", ratio(true), 1),
        ];
        plot
    };
    let filter = &s.channels[best].name;
    let lux_seconds = s.electrons_per_lux_second(best, Illuminant::D65);
    vec![
        over(
            format!("log10 of the photons of {nm} nm on a pixel ({filter})"),
            1.0 / (efficiency * area_share(s)),
        ),
        over(format!("log10 of the exposure to D65 in lx s ({filter})"), 1.0 / lux_seconds),
    ]
}

/// EMVA 1288 signal-to-noise ratio of a mean charge; `total`: with the fixed patterns.
fn signal_to_noise(s: &Sensor, electrons: f64, total: bool) -> f64 {
    let variance = s.noise_variance(NoiseSet::ALL, 1.0, electrons, 0.0);
    electrons / if total { variance.total_e2() } else { variance.temporal_e2() }.sqrt()
}

/// Writes a figure and logs its path.
pub fn write(path: &Path, plot: Plot) -> Result<()> {
    let title = plot.title.clone();
    stacked(&title, &[plot], Default::default()).write(path)?;
    log_line(format!("wrote {}", path.display()));
    Ok(())
}

/// Area that the quantum efficiency belongs to, as a share of the pixel's.
fn area_share(sensor: &Sensor) -> f64 {
    sensor.area_m2() / (sensor.pixel.pitch_um * sensor.pixel.pitch_um * 1e-12)
}

/// A bench for the channel of the highest quantum efficiency.
pub fn bench(sensor: &Sensor, seed: u64, die: u64) -> Bench<'_> {
    let best = (0..sensor.channels.len()).map(|c| peak(sensor, c).1).fold(0.0, f64::max);
    // On a pixel: the efficiency of a photodiode is that of its own area.
    Bench { sensor, quantum_efficiency: best * area_share(sensor), seconds: 0.01, seed, die }
}
