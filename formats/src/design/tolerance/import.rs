//! TOL lines of OpticStudio's .zmx files as a description.
//!
//! ```text
//! TOL TEDX   1   2          -0.02           0.02   0 0 0
//!     operand Int1 Int2      min            max    integers
//! ```
//! min and max are the greatest changes from the nominal value. Files differ in the digits of min and max and in the number of
//! integers behind them, which are not read: three in files of versions up to 2011, four or five in later ones. TCMM lines are
//! comments. TOFF is an unused row.
//!
//! | operand | Int1, Int2 | limits | imported as |
//! |---|---|---|---|
//! | TWAV | – | min: wavelength, µm | `fringe_nm`; absent: 632.8, that of the program |
//! | COMP | surface, 0 = thickness | lens units | `focus_um`, if the gap is that before the film |
//! | TRAD | surface | lens units | `radius_um` |
//! | TCUR | surface | 1/lens unit | `radius_fringes` = Δc S²/λ, which is exact |
//! | TFRN | surface | fringes | `radius_fringes` |
//! | TCON | surface | conic constant | `conic` |
//! | TIRR | surface | fringes | `irregularity_fringes`, `figure = "mixed"`: half spherical, half astigmatism |
//! | TEXI | surface, greatest term (fringe) | fringes, zero to peak | `zernike`: standard terms to its radial order, same RMS |
//! | TTHI | surface, surface that absorbs it (Int1 or 0: none) | lens units | `[[gap]]` |
//! | TIND | surface | index | `index` |
//! | TABB | surface | Abbe number V_d, not a share of it | `abbe_percent` |
//! | TEDX, TEDY, TEDR | first, last surface | lens units | `decentre`, R: `radial` |
//! | TETX, TETY, TETR | first, last surface | degrees about the first vertex | `tilt`, R: `tilt_radial` |
//! | TSDX, TSDY, TSDR; TSTX, TSTY | surface | lens units; degrees | `decentre`, `tilt` of a surface |
//! | TIRX, TIRY | surface | runout T, lens units: sag T x/(2S), T y/(2S) | tilt −T/(2S) about y, T/(2S) about x |
//!
//! Sources: the columns and what they count, by the lines of a lens of Edmund Optics (54852), of six files of a course on
//! tolerancing (versions 80915 to 110201), and of later files with TOFF, TWAV and TIND alone. TABB by one of these, whose limits are
//! 1 % of V_d of each glass to nine digits. Operands by the help of OpticStudio (TIRR, TTHI, TETX, TEZI, summary of operands).
//! TCUR, TCON, TEXI, TEDR, TETR and TSDR were in no file. Assumed: the wavelength without TWAV; the axes and signs of TIRX and TIRY;
//! the sign of TFRN, positive as Δc; of TEXI, the terms from 5 on and the meaning of its limit.

use pipeline::design::System;
use pipeline::design::system::{Medium, Surface};
use pipeline::design::tolerance::{
    Compensation, Direction, Figure, Law, Limits, Quantity, RadiusUnit, Target, Tolerance, Tolerances,
};

use super::write::write;
use crate::design::text::{decode, number, quote};

/// Wavelength of fringes of the program where a file has no TWAV, nm.
const DEFAULT_FRINGE_NM: f64 = 632.8;
/// Most operands that are read.
const MAX_OPERANDS: usize = 2000;
/// Arcmin in a radian and in a degree.
const ARCMIN_PER_RAD: f64 = 180.0 * 60.0 / std::f64::consts::PI;
const ARCMIN_PER_DEG: f64 = 60.0;
/// Fraunhofer lines d, F, C, µm.
const LINES_UM: [f64; 3] = [0.587_561_8, 0.486_132_7, 0.656_272_5];
/// Zernike terms of a description.
const TERMS: std::ops::RangeInclusive<usize> = 5..=37;

/// A description made from the TOL lines of a design.
#[derive(Clone, Debug, PartialEq)]
pub struct Import {
    /// Its text.
    pub text: String,
    /// The errors in it.
    pub list: Vec<Tolerance>,
    /// What was left out or changed, with the line.
    pub notes: Vec<String>,
}

/// An operand with its numbers.
struct Operand<'a> {
    line: usize,
    text: &'a str,
    name: &'a str,
    surfaces: [usize; 2],
    low: f64,
    high: f64,
}

/// The tolerances in the .zmx file `bytes`, whose design is `system`.
pub fn import(bytes: &[u8], system: &System) -> Import {
    let text = decode(bytes);
    let mut importer = Importer {
        system,
        scale_mm: scale_mm(&text),
        fringe_nm: DEFAULT_FRINGE_NM,
        compensation: None,
        list: Vec::new(),
        notes: Vec::new(),
    };
    let (mut operands, mut count) = (Vec::new(), 0);
    for (i, line) in text.lines().enumerate().filter(|(_, line)| line.starts_with("TOL ")) {
        let words: Vec<&str> = line.split_whitespace().collect();
        if words.get(1) == Some(&"TOFF") {
            continue;
        }
        count += 1;
        if count > MAX_OPERANDS {
            importer
                .notes
                .push(format!("line {}: only the first {MAX_OPERANDS} operands are imported", i + 1));
            break;
        }
        match operand(i + 1, line, &words) {
            Some(operand) => operands.push(operand),
            None => importer.notes.push(format!(
                "line {}: `{}`: expected an operand, two surface numbers, and two limits; it is left out",
                i + 1,
                quote(line)
            )),
        }
    }
    // The wavelength of fringes counts for operands before it as well.
    for operand in operands.iter().filter(|o| o.name == "TWAV") {
        importer.wavelength(operand);
    }
    for operand in operands.iter().filter(|o| o.name != "TWAV") {
        importer.read(operand);
    }
    importer.finish(!operands.is_empty())
}

/// The lens unit of a design, mm.
fn scale_mm(text: &str) -> f64 {
    let unit = text.lines().find_map(|line| line.strip_prefix("UNIT ")?.split_whitespace().next());
    match unit.map(str::to_ascii_uppercase).as_deref() {
        Some("CM") => 10.0,
        Some("IN" | "INCH") => 25.4,
        Some("METER" | "M") => 1000.0,
        _ => 1.0,
    }
}

fn operand<'a>(line: usize, text: &'a str, words: &[&'a str]) -> Option<Operand<'a>> {
    let [_, name, first, second, low, high, ..] = words else { return None };
    // A negative Int2 means none in some operands that are not imported.
    let surface = |word: &str| Some(word.parse::<i64>().ok()?.max(0) as usize);
    let surfaces = [surface(first)?, surface(second)?];
    Some(Operand { line, text, name, surfaces, low: number(low)?, high: number(high)? })
}

struct Importer<'a> {
    system: &'a System,
    scale_mm: f64,
    fringe_nm: f64,
    compensation: Option<Compensation>,
    list: Vec<Tolerance>,
    notes: Vec<String>,
}

impl Importer<'_> {
    fn note(&mut self, operand: &Operand<'_>, what: impl std::fmt::Display) {
        self.notes.push(format!("line {}: `{}`: {what}", operand.line, quote(operand.text)));
    }

    fn wavelength(&mut self, operand: &Operand<'_>) {
        let nm = operand.low * 1e3;
        match pipeline::bounds::WAVELENGTH_NM.contains(nm) {
            true => self.fringe_nm = nm,
            false => self
                .note(operand, format!("expected a wavelength in µm; fringes are of {} nm", self.fringe_nm)),
        }
    }

    /// Surface `number`, if the lens has it.
    fn surface(&self, number: usize) -> Option<&Surface> {
        self.system.surfaces.get(number.checked_sub(1)?)
    }

    /// Clear radius of a surface, mm, if the design gives it.
    fn semi_diameter_mm(&self, number: usize) -> Option<f64> {
        let s = self.surface(number)?;
        [s.semi_diameter_mm, s.aperture_mm.unwrap_or(0.0)].into_iter().find(|r| *r > 0.0)
    }

    fn read(&mut self, operand: &Operand<'_>) {
        use Direction::{Radial, X, Y};
        let [a, b] = operand.surfaces;
        let (um, degrees) = (self.scale_mm * 1e3, ARCMIN_PER_DEG);
        let (element, surface) = (Target::element(a, b), Target::Surface(a));
        match operand.name {
            "COMP" => self.compensator(operand),
            "TRAD" => self.add(operand, surface, Quantity::Radius(RadiusUnit::Um), um),
            "TFRN" => self.add(operand, surface, Quantity::Radius(RadiusUnit::Fringes), 1.0),
            "TCUR" => match self.semi_diameter_mm(a) {
                Some(s) => {
                    let fringes = s * s / (self.fringe_nm * 1e-6 * self.scale_mm);
                    self.add(operand, surface, Quantity::Radius(RadiusUnit::Fringes), fringes);
                }
                None => self.without_semi_diameter(operand),
            },
            "TCON" => self.add(operand, surface, Quantity::Conic, 1.0),
            "TIRR" => self.add(operand, surface, Quantity::Irregularity(Figure::Mixed), 1.0),
            "TEXI" => self.zernike(operand),
            "TTHI" => {
                let absorb = Some(b).filter(|b| *b != a && *b != 0);
                self.add(operand, Target::Gap { after: a, absorb }, Quantity::Thickness, um);
            }
            "TIND" => self.add(operand, Target::Glass(a), Quantity::Index, 1.0),
            "TABB" => match self.abbe_number(a) {
                Some(v) => self.add(operand, Target::Glass(a), Quantity::Abbe, 100.0 / v),
                None => self.note(operand, "there is no glass with an index at the lines d, F and C behind this surface; it is left out"),
            },
            "TEDX" => self.add(operand, element, Quantity::Decentre(X), um),
            "TEDY" => self.add(operand, element, Quantity::Decentre(Y), um),
            "TEDR" => self.add(operand, element, Quantity::Decentre(Radial), um),
            "TETX" => self.add(operand, element, Quantity::Tilt(X), degrees),
            "TETY" => self.add(operand, element, Quantity::Tilt(Y), degrees),
            "TETR" => self.add(operand, element, Quantity::Tilt(Radial), degrees),
            "TSDX" => self.add(operand, surface, Quantity::Decentre(X), um),
            "TSDY" => self.add(operand, surface, Quantity::Decentre(Y), um),
            "TSDR" => self.add(operand, surface, Quantity::Decentre(Radial), um),
            "TSTX" => self.add(operand, surface, Quantity::Tilt(X), degrees),
            "TSTY" => self.add(operand, surface, Quantity::Tilt(Y), degrees),
            "TIRX" | "TIRY" => match self.semi_diameter_mm(a) {
                Some(s) => {
                    let arcmin = ARCMIN_PER_RAD * self.scale_mm / (2.0 * s);
                    // A sag that grows with x is a negative tilt about y.
                    match operand.name {
                        "TIRX" => self.add(operand, surface, Quantity::Tilt(Y), -arcmin),
                        _ => self.add(operand, surface, Quantity::Tilt(X), arcmin),
                    }
                }
                None => self.without_semi_diameter(operand),
            },
            name => self.note(operand, format!("{name} is not imported")),
        }
    }

    fn without_semi_diameter(&mut self, operand: &Operand<'_>) {
        self.note(operand, "the design gives this surface no semi-diameter; it is left out");
    }

    /// Adds the error whose limits are those of the operand times `factor`, if it fits the lens and the errors so far.
    fn add(&mut self, operand: &Operand<'_>, target: Target, quantity: Quantity, factor: f64) {
        let [a, b] = [operand.low * factor, operand.high * factor];
        let (low, high) = if factor < 0.0 { (b, a) } else { (a, b) };
        self.add_all(
            operand,
            &[Tolerance { target, quantity, limits: Limits { low, high, law: Law::Normal } }],
        );
    }

    fn add_all(&mut self, operand: &Operand<'_>, tolerances: &[Tolerance]) {
        let before = self.list.len();
        self.list.extend_from_slice(tolerances);
        if let Err(error) = Tolerances::new(&self.list, self.fringe_nm, self.system) {
            self.list.truncate(before);
            self.note(operand, format!("{error}; it is left out"));
        }
    }

    fn compensator(&mut self, operand: &Operand<'_>) {
        let before_film = self.system.surfaces.len() - 1;
        if operand.surfaces != [before_film, 0] || self.compensation.is_some() || operand.low > operand.high {
            self.note(
                operand,
                format!(
                    "only the gap before the film (surface {before_film}, 0) compensates; it is left out"
                ),
            );
            return;
        }
        let um = self.scale_mm * 1e3;
        let focus_um = Some((operand.low * um, operand.high * um));
        self.compensation = Some(Compensation { focus_um, ..Compensation::default() });
    }

    /// V_d of the glass behind a surface.
    fn abbe_number(&self, surface: usize) -> Option<f64> {
        let Medium::Glass(glass) = &self.surface(surface)?.medium else { return None };
        let [d, f, c] = LINES_UM.map(|um| glass.index(um).ok());
        Some((d? - 1.0) / (f? - c?)).filter(|v| v.is_finite() && *v > 0.0)
    }

    /// Fringe Zernike terms 5 to Int2 of equal coefficients, whose root of the sum of squares is the limit.
    fn zernike(&mut self, operand: &Operand<'_>) {
        let [surface, last] = operand.surfaces;
        if !TERMS.contains(&last) {
            self.note(operand, "expected the greatest fringe term as Int2, 5 to 37; it is left out");
            return;
        }
        // A term of peak 1 has the mean square 1/((n + 1) (2 − δ_m0)).
        let orders = (5..=last).map(fringe_orders);
        let mean_square = |(n, m): (usize, usize)| 1.0 / ((n + 1) * if m == 0 { 1 } else { 2 }) as f64;
        let share = orders.clone().map(mean_square).sum::<f64>() / (last - 4) as f64;
        let order = orders.map(|(n, _)| n).max().unwrap_or(2);
        let last_standard = (order + 1) * (order + 2) / 2;
        // A fringe is half a wavelength of sag.
        let waves = operand.low.abs().max(operand.high.abs()) / 2.0 * share.sqrt();
        let count = last_standard - 3;
        let limits = Limits::symmetric(waves / (count as f64).sqrt(), Law::Normal);
        let term = |j: usize| Tolerance {
            target: Target::Surface(surface),
            quantity: Quantity::Zernike(j as u32),
            limits,
        };
        let before = self.list.len();
        self.add_all(operand, &(4..=last_standard).map(term).collect::<Vec<_>>());
        if self.list.len() > before {
            self.note(operand, format!("fringe terms 5 to {last} become standard terms 4 to {last_standard} of the same RMS, {waves:.4} waves"));
        }
    }

    fn finish(mut self, has_operands: bool) -> Import {
        if !has_operands {
            self.notes.push("the design has no tolerances (TOL lines)".to_owned());
        }
        let compensation = self.compensation.unwrap_or_default();
        if has_operands && self.compensation.is_none() {
            self.notes.push(
                "no operand COMP for the gap before the film: the film is refocused within ±1000 µm; `focus = false` leaves it in place"
                    .to_owned(),
            );
        }
        let text = write(&self.list, self.fringe_nm, &compensation);
        Import { text, list: self.list, notes: self.notes }
    }
}

/// Radial and absolute azimuthal order of a fringe Zernike term (from 1): groups of equal (n + m)/2 = k, in each m from k down,
/// cosine and sine.
fn fringe_orders(term: usize) -> (usize, usize) {
    let k = (1..).find(|k| k * k >= term).unwrap_or(1) - 1;
    let place = term - k * k - 1;
    let m = k - place / 2;
    (2 * k - m, m)
}

#[cfg(test)]
mod tests {
    use super::fringe_orders;

    /// The first 16 terms of the University of Arizona's list, and its last.
    #[test]
    fn fringe_terms_in_their_order() {
        let orders = [
            (0, 0),
            (1, 1),
            (1, 1),
            (2, 0),
            (2, 2),
            (2, 2),
            (3, 1),
            (3, 1),
            (4, 0),
            (3, 3),
            (3, 3),
            (4, 2),
            (4, 2),
            (5, 1),
            (5, 1),
            (6, 0),
        ];
        for (i, expected) in orders.into_iter().enumerate() {
            assert_eq!(fringe_orders(i + 1), expected, "{}", i + 1);
        }
        assert_eq!(fringe_orders(36), (10, 0));
    }
}
