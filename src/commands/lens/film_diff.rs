//! `lens diff` where a lens has no rotational symmetry: two lenses at the same wavelengths and places of the film.
//!
//! ```text
//! X             film place from the film's centre, or with `--boresight remove` from the lens's own boresight b (head of
//!               `pipeline::figures::on_film`)
//! shift(X)      place where B images what A images at X, minus X:  X_B(I_A(X_A)) − X_A, less b_B − b_A if removed
//! R(X)          relative illumination of each lens at its place
//! PSF L1        distance of the film kernels there, each cropped to the smaller window and normalised there
//! ```
//! The boresight is that at the primary wavelength of A, or the band nearest to it: one for all bands, so lateral colour remains. Kernels are compared at
//! 3 × 3 places over the rectangle that all bands of both lenses cover, maps at 33 × 33, those left out that a lens with rotational symmetry does not reach.

use super::comparison::{common, scalars};
use super::film_lens::FilmLens;
use crate::args::DiffArgs;
use crate::commands::lens::trace::wavelengths;
use crate::failure::usage;
use crate::job::lens::samples::nearest;
use crate::progress::print;
use anyhow::{Context, Result, anyhow};
use formats::lens::LensPack;
use pipeline::design::tolerance::Boresight;
use pipeline::design::trace::TraceOptions;
use pipeline::figures::kernel_l1;
use pipeline::figures::on_film::BandOnFilm;
use pipeline::lens::Lens;
use pipeline::real;
use serde_json::{Value, json};

/// Places of kernels and of maps along each side of the film.
const KERNELS: usize = 3;
const PLACES: usize = 33;
/// The outermost places, of half a side: those of a map's edge may have their counterpart beyond the other map.
const MARGIN: f64 = 0.95;

/// A lens by its name: a pack, or a design (none).
pub type Side<'a> = (&'a str, Option<LensPack>);

/// The lenses at one place of the film.
struct Place {
    /// Of A, from its origin, mm.
    at_mm: [f64; 2],
    shift_um: [f64; 2],
    illumination: [f64; 2],
}

/// A place with the kernels there.
struct Pair {
    place: Place,
    /// Sides of the windows, µm.
    windows_um: [f64; 2],
    l1: f64,
}

/// Both lenses at one wavelength.
struct Band {
    nm: f64,
    /// Film places of the ideal point 0 of each lens, µm.
    boresight_um: [[f64; 2]; 2],
    pairs: Vec<Pair>,
    /// Places with the largest shift and the largest difference of R.
    largest: [Place; 2],
}

/// Compares the lenses `a` and `b`, of which one at least has no rotational symmetry.
///
/// # Errors
/// Usage: flags of image heights, no common wavelength or film; a pack that cannot be read.
pub fn diff(args: &DiffArgs, a: Side<'_>, b: Side<'_>) -> Result<()> {
    if args.heights.is_some() {
        let name = if a.1.as_ref().is_some_and(|pack| !pack.lens().is_symmetric()) { a.0 } else { b.0 };
        return Err(usage(format!(
            "--heights: expected lenses with rotational symmetry, `{name}` has none: places of the film are compared"
        )));
    }
    let nm = match &args.wavelengths {
        Some(text) => wavelengths(text)?,
        None => {
            let packs = [&a, &b].map(|side| side.1.as_ref().map(|pack| wavelengths_of(pack.lens())));
            common(packs).unwrap_or_else(|| Ok(Vec::new()))?
        }
    };
    let reach_mm = [&a, &b].into_iter().filter_map(|side| side.1.as_ref()).map(|pack| {
        let corner = |band| {
            let [x, y] = BandOnFilm::new(band, args.film_pitch_um).half_sides_mm();
            real::hypot(x, y)
        };
        pack.lens().bands.iter().map(corner).fold(0.0, f64::max)
    });
    let reach_mm = reach_mm.fold(f64::INFINITY, f64::min);
    let open = |(name, pack): Side<'_>| match pack {
        Some(pack) => FilmLens::of_pack(name, pack),
        None => {
            let options =
                TraceOptions { film_pitch_um: args.film_pitch_um, ..TraceOptions::new(nm.clone(), reach_mm) };
            let system = crate::design::open(name, &args.design)?;
            FilmLens::traced(&system, &options).with_context(|| format!("tracing {name}"))
        }
    };
    let lenses = [open(a)?, open(b)?];
    let bands = compared(args, &lenses, &nm)?;
    match args.json {
        true => print(serde_json::to_string_pretty(&json(args, &lenses, &bands))?),
        false => print(text(args, &lenses, &bands).trim_end()),
    }
    Ok(())
}

fn wavelengths_of(lens: &Lens) -> Vec<f64> {
    lens.bands.iter().map(|band| band.wavelength_nm).collect()
}

fn compared(args: &DiffArgs, lenses: &[FilmLens; 2], nm: &[f64]) -> Result<Vec<Band>> {
    let names = [&args.a, &args.b];
    let index = |nm: f64| -> Result<[usize; 2]> {
        Ok([lenses[0].band(names[0], nm)?, lenses[1].band(names[1], nm)?])
    };
    let all = nm.iter().map(|nm| index(*nm)).collect::<Result<Vec<_>>>()?;
    let films = |index: &[usize; 2]| {
        [0, 1].map(|i| BandOnFilm::new(&lenses[i].lens.bands[index[i]], args.film_pitch_um))
    };
    let all: Vec<_> = all.iter().map(|index| (*index, films(index))).collect();
    let boresight = |film: &BandOnFilm<'_>, i: usize| {
        film.place_of([0.0; 2])
            .ok_or_else(|| anyhow!("{}: its map has no place of the ideal centre", names[i]))
    };
    let of_a = all.iter().map(|(index, _)| lenses[0].lens.bands[index[0]].wavelength_nm);
    let primary = nearest(of_a, lenses[0].lens.primary_wavelength_nm);
    let (_, films) = all.get(primary).context("no wavelength to compare")?;
    let origins = match args.boresight {
        Boresight::Keep => [[0.0; 2]; 2],
        Boresight::Remove => [boresight(&films[0], 0)?, boresight(&films[1], 1)?],
    };
    let half_mm = half_sides_mm(all.iter().flat_map(|(_, films)| films.iter().zip(&origins)));
    if half_mm.iter().any(|half| *half <= 0.0) {
        return Err(usage(
            "the lenses have no film place in common: the map of one of them lies beside its axis",
        ));
    }
    let places = |count: usize| {
        let at = move |i: usize| MARGIN * (2.0 * i as f64 / (count - 1) as f64 - 1.0);
        (0..count * count).map(move |k| [half_mm[0] * at(k % count), half_mm[1] * at(k / count)])
    };
    let is_covered = |films: &[BandOnFilm<'_>; 2], at: &[f64; 2]| {
        films.iter().zip(&origins).all(|(film, origin)| film.covers(add(*at, *origin)))
    };
    let mut bands = Vec::with_capacity(nm.len());
    for (&nm, (index, films)) in nm.iter().zip(&all) {
        let place = |at: [f64; 2]| place(films, &origins, at);
        let pair = |at: [f64; 2]| -> Result<Pair> {
            let kernel = |i: usize| lenses[i].kernel(index[i], &films[i], add(at, origins[i]));
            let ((an, ak), (bn, bk)) = (kernel(0)?, kernel(1)?);
            Ok(Pair {
                place: place(at),
                windows_um: [an, bn].map(|n| n as f64 * args.film_pitch_um),
                l1: kernel_l1((an, &ak), (bn, &bk)),
            })
        };
        let largest = |size: &dyn Fn(&Place) -> f64| {
            let covered = places(PLACES).filter(|at| is_covered(films, at));
            let all = covered.map(place).filter(|p| size(p).is_finite());
            all.max_by(|a, b| size(a).total_cmp(&size(b))).context("the maps have no common place")
        };
        bands.push(Band {
            nm,
            boresight_um: [boresight(&films[0], 0)?, boresight(&films[1], 1)?].map(um),
            pairs: places(KERNELS).filter(|at| is_covered(films, at)).map(pair).collect::<Result<_>>()?,
            largest: [
                largest(&Place::shift_size_um)?,
                largest(&|p: &Place| p.illumination_difference().abs())?,
            ],
        });
    }
    Ok(bands)
}

/// Half the sides of the rectangle about the origins that all `films` cover, mm.
fn half_sides_mm<'a>(films: impl Iterator<Item = (&'a BandOnFilm<'a>, &'a [f64; 2])>) -> [f64; 2] {
    films.fold([f64::INFINITY; 2], |least, (film, origin)| {
        let half = film.half_sides_mm();
        [0, 1].map(|i| least[i].min(half[i] - origin[i].abs()))
    })
}

fn place(films: &[BandOnFilm<'_>; 2], origins: &[[f64; 2]; 2], at_mm: [f64; 2]) -> Place {
    let (ideal, a) = films[0].at(add(at_mm, origins[0]));
    let (_, b) = films[1].at(add(at_mm, origins[1]));
    let found = films[1].place_of(ideal).unwrap_or([f64::NAN; 2]);
    let shift = [0, 1].map(|i| found[i] - origins[1][i] - at_mm[i]);
    Place { at_mm, shift_um: um(shift), illumination: [a, b] }
}

fn add(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

fn um(mm: [f64; 2]) -> [f64; 2] {
    mm.map(|v| 1e3 * v)
}

impl Place {
    fn shift_size_um(&self) -> f64 {
        real::hypot(self.shift_um[0], self.shift_um[1])
    }

    fn illumination_difference(&self) -> f64 {
        self.illumination[1] - self.illumination[0]
    }
}

impl Band {
    fn largest_l1(&self) -> f64 {
        self.pairs.iter().map(|pair| pair.l1).fold(0.0, f64::max)
    }
}

fn json(args: &DiffArgs, lenses: &[FilmLens; 2], bands: &[Band]) -> Value {
    let fields = |band: &Band| -> Vec<Value> {
        let one = |pair: &Pair| {
            let Place { at_mm, shift_um, illumination } = &pair.place;
            let side = |i: usize| json!({ "relative_illumination": illumination[i], "psf_window_um": pair.windows_um[i] });
            json!({
                "wavelength_nm": band.nm, "x_mm": at_mm[0], "y_mm": at_mm[1], "shift_um": shift_um,
                "shift_px": pair.place.shift_size_um() / args.film_pitch_um,
                "a": side(0), "b": side(1), "psf_l1": pair.l1,
            })
        };
        band.pairs.iter().map(one).collect()
    };
    let of_band = |band: &Band| {
        let [shift, light] = &band.largest;
        json!({
            "wavelength_nm": band.nm,
            "boresight_um": { "a": band.boresight_um[0], "b": band.boresight_um[1] },
            "largest_shift_um": shift.shift_size_um(), "largest_shift_at_mm": shift.at_mm,
            "largest_illumination_difference": light.illumination_difference().abs(),
            "largest_illumination_difference_at_mm": light.at_mm,
            "largest_psf_l1": band.largest_l1(),
        })
    };
    let lens: serde_json::Map<String, Value> = scalars(&lenses[0].lens, &lenses[1].lens)
        .into_iter()
        .map(|(name, a, b)| (name.to_owned(), json!({ "a": a, "b": b, "b_minus_a": b - a })))
        .collect();
    json!({
        "a": args.a,
        "b": args.b,
        "film_pitch_um": args.film_pitch_um,
        "boresight": if args.boresight == Boresight::Keep { "keep" } else { "remove" },
        "lens": lens,
        "bands": bands.iter().map(of_band).collect::<Vec<_>>(),
        "fields": bands.iter().flat_map(fields).collect::<Vec<_>>(),
    })
}

fn text(args: &DiffArgs, lenses: &[FilmLens; 2], bands: &[Band]) -> String {
    let [a, b] = lenses.each_ref().map(|lens| &lens.lens);
    let mut out = format!("A  {}  ({})\nB  {}  ({})\n\n", a.name, args.a, b.name, args.b);
    out += &format!("{:<28} {:>14} {:>14} {:>12}\n", "", "A", "B", "B - A");
    for (name, a, b) in scalars(a, b) {
        out += &format!("{name:<28} {a:>14.6} {b:>14.6} {:>12.2e}\n", b - a);
    }
    let origin = match args.boresight {
        Boresight::Keep => "the film's centre".to_owned(),
        Boresight::Remove => {
            let primary = nearest(bands.iter().map(|band| band.nm), a.primary_wavelength_nm);
            format!("the boresight of each lens at {} nm", bands[primary].nm)
        }
    };
    let pitch_um = args.film_pitch_um;
    out += &format!(
        "\nX, Y: film place from {origin}, Y down; shift: place where B images what A images there, minus it, and its length in px of {pitch_um} µm;\nRI: relative illumination; window: side of the PSF \
         window; PSF L1: L1 distance of the film kernels, in the smaller window, each with sum 1\n"
    );
    out += "     nm      X mm      Y mm |     shift X, Y µm          px |    RI: A, B - A    | window µm: A, B | PSF L1\n";
    for band in bands {
        for Pair { place, windows_um, l1 } in &band.pairs {
            out += &format!(
                "{:7.2} {:9.4} {:9.4} | {:10.3} {:10.3} {:9.3} | {:8.6} {:+9.2e} | {:7.1} {:7.1} | {l1:.4}\n",
                band.nm,
                place.at_mm[0],
                place.at_mm[1],
                place.shift_um[0],
                place.shift_um[1],
                place.shift_size_um() / pitch_um,
                place.illumination[0],
                place.illumination_difference(),
                windows_um[0],
                windows_um[1],
            );
        }
    }
    out.push('\n');
    for band in bands {
        let ([shift, light], [a, b]) = (&band.largest, band.boresight_um);
        out += &format!(
            "{:7.2} nm: boresight A ({:.3}, {:.3}) µm, B ({:.3}, {:.3}) µm; largest shift {:.3} µm ({:.3} px) at ({:.3}, {:.3}) mm, \
             RI {:.2e} at ({:.3}, {:.3}) mm, PSF L1 {:.4}\n",
            band.nm,
            a[0],
            a[1],
            b[0],
            b[1],
            shift.shift_size_um(),
            shift.shift_size_um() / pitch_um,
            shift.at_mm[0],
            shift.at_mm[1],
            light.illumination_difference().abs(),
            light.at_mm[0],
            light.at_mm[1],
            band.largest_l1(),
        );
    }
    out
}
