//! What an error changes.
//!
//! Values are in the units of the description; `built` converts them to mm and rad. The name of a quantity is the last part of an
//! error's identifier, which says nothing of its unit: a radius in percent and the same one in µm take the same draws.

/// Along which axis, or about which axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Direction {
    /// x.
    X,
    /// y.
    Y,
    /// A direction that is drawn as well, uniform over the circle: (cos α, sin α) of the value.
    Radial,
}

/// How an error of a radius is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum RadiusUnit {
    /// Percent of the radius.
    Percent,
    /// Fringes of power at the test wavelength over the semi-diameter S: Δc = N λ/S².
    Fringes,
    /// µm of the radius.
    Um,
}

/// Shape of an irregularity of N fringes at the test wavelength λ, with ρ = r/S; its azimuth φ₀ is drawn from 0 to π.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Figure {
    /// (N λ/4) ρ² cos 2(φ − φ₀): peak to valley N λ/2.
    Astigmatism,
    /// (N λ/4) (ρ⁴ + ρ² cos²(φ − φ₀)): half spherical, half astigmatism, as OpticStudio's TIRR.
    Mixed,
}

/// What an error changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Quantity {
    /// Place across the axis, µm.
    Decentre(Direction),
    /// Angle about x or y through the pivot, right-handed, arcmin.
    Tilt(Direction),
    /// Tilt of an element's last surface about its vertex, arcmin.
    Wedge(Direction),
    /// Place along z between fixed neighbours, µm.
    Shift,
    /// Radius of curvature.
    Radius(RadiusUnit),
    /// Figure error of one shape, fringes.
    Irregularity(Figure),
    /// Figure error of a Zernike term (standard, Noll's number): RMS of the sag, waves of the test wavelength.
    Zernike(u32),
    /// Conic constant.
    Conic,
    /// Thickness of a gap, µm.
    Thickness,
    /// Refractive index at all wavelengths.
    Index,
    /// Abbe number, percent: n − 1 is turned about the primary wavelength.
    Abbe,
}

/// Unit of a drawn value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// µm.
    Um,
    /// Minutes of arc.
    Arcmin,
    /// Percent.
    Percent,
    /// Fringes of half a test wavelength.
    Fringes,
    /// Test wavelengths.
    Waves,
    /// Radians: directions.
    Rad,
    /// A pure number.
    One,
}

impl Unit {
    /// Its name in records.
    pub fn name(self) -> &'static str {
        match self {
            Self::Um => "um",
            Self::Arcmin => "arcmin",
            Self::Percent => "percent",
            Self::Fringes => "fringes",
            Self::Waves => "waves",
            Self::Rad => "rad",
            Self::One => "1",
        }
    }
}

impl Quantity {
    /// Its unit.
    pub fn unit(self) -> Unit {
        match self {
            Self::Decentre(_) | Self::Shift | Self::Thickness | Self::Radius(RadiusUnit::Um) => Unit::Um,
            Self::Tilt(_) | Self::Wedge(_) => Unit::Arcmin,
            Self::Radius(RadiusUnit::Percent) | Self::Abbe => Unit::Percent,
            Self::Radius(RadiusUnit::Fringes) | Self::Irregularity(_) => Unit::Fringes,
            Self::Zernike(_) => Unit::Waves,
            Self::Conic | Self::Index => Unit::One,
        }
    }

    /// Its part of the identifier.
    pub(super) fn name(self) -> String {
        let along = |what: &str, direction: Direction| match direction {
            Direction::X => format!("{what}_x"),
            Direction::Y => format!("{what}_y"),
            Direction::Radial => what.to_owned(),
        };
        match self {
            Self::Decentre(direction) => along("decentre", direction),
            Self::Tilt(direction) => along("tilt", direction),
            Self::Wedge(direction) => along("wedge", direction),
            Self::Shift => "shift".to_owned(),
            Self::Radius(_) => "radius".to_owned(),
            Self::Irregularity(_) => "irregularity".to_owned(),
            Self::Zernike(term) => format!("zernike_{term}"),
            Self::Conic => "conic".to_owned(),
            Self::Thickness => "thickness".to_owned(),
            Self::Index => "index".to_owned(),
            Self::Abbe => "abbe".to_owned(),
        }
    }

    /// Largest angle of the direction that is drawn with it, rad; none has one of its own.
    pub(super) fn largest_angle(self) -> Option<f64> {
        match self {
            Self::Decentre(Direction::Radial)
            | Self::Tilt(Direction::Radial)
            | Self::Wedge(Direction::Radial) => Some(2.0 * std::f64::consts::PI),
            Self::Irregularity(_) => Some(std::f64::consts::PI),
            _ => None,
        }
    }

    /// The axes that it moves along or about, x and y.
    pub(super) fn axes(self) -> &'static [Direction] {
        match self {
            Self::Decentre(d) | Self::Tilt(d) | Self::Wedge(d) => match d {
                Direction::X => &[Direction::X],
                Direction::Y => &[Direction::Y],
                Direction::Radial => &[Direction::X, Direction::Y],
            },
            _ => &[],
        }
    }
}
