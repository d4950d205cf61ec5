//! A built lens: the nominal design, the place of each surface as built, and the changes of surfaces and glasses. Or a lens that has no
//! rotational symmetry by design, with the places and shapes of its design file; its nominal lens is then the straightened one.
//!
//! ```text
//! W' = G₁ G₂ … W        G = P · pose · P⁻¹        W, P nominal poses of a surface and of a pivot in the lens frame
//! ```
//! *Lens frame*: right-handed, z along the light at the first surface, origin at the first vertex of the nominal lens, mm; also
//! behind mirrors. Nominal poses have the axes of that frame. Deviations are listed from the outermost group inwards, so that an
//! element inside a tilted group is decentred in the group's frame. The stop moves with what it is named in, the film only if
//! named, or with a gap.
//!
//! *Surface frames* of the tracer have z along the light: behind an odd number of mirrors z is reversed. From the frame behind
//! surface i to that before surface i + 1 there is one matrix and one vector. Where both moved alike it is the nominal gap, so a
//! lens without deviations has the numbers of its nominal lens, bit for bit.
//! Coatings and ideal lenses are not supported.

use super::deviation::{Deviation, Pivot, ShapeChange};
use super::error::SkewError;
use super::ideal_plane::IdealPlane;
use crate::design::prescription::asymmetry::{Asymmetry, FreeSurface, Outline};
use crate::design::prescription::error::DesignError;
use crate::design::prescription::freeform::SkewShape;
use crate::design::prescription::pose::{Matrix, Pose, Vector, product, times, transpose};
use crate::design::prescription::system::{RayAiming, Surface, System};
use crate::design::rays::paraxial::Paraxial;
use crate::design::rays::scalar::Scalar;
use crate::design::rays::surface::Ray;

/// A lens as built.
#[derive(Clone, Debug)]
pub struct BuiltLens {
    nominal: System,
    deviations: Vec<Deviation>,
    surfaces: Vec<BuiltSurface>,
    /// What makes it asymmetric by design; its ideal plane is then that of its own rays.
    design: Option<(Asymmetry, IdealPlane)>,
}

/// A surface as built, with what lies between it and the surface before.
#[derive(Clone, Debug)]
pub(super) struct BuiltSurface {
    pub(super) shape: SkewShape,
    pub(super) pose: Pose,
    pub(super) arrival: Arrival,
    /// Whether it is a frame alone, which no ray meets.
    pub(super) is_frame: bool,
    pub(super) aperture: Option<Outline>,
    pub(super) obscuration: Option<Outline>,
    glass: GlassChange,
}

#[derive(Clone, Copy, Debug, Default)]
struct GlassChange {
    index: f64,
    abbe: f64,
}

/// From the frame behind a surface to that of the next one.
#[derive(Clone, Copy, Debug)]
pub(super) enum Arrival {
    /// Along a gap, mm.
    Straight(f64),
    /// v' = matrix v + shift.
    Skew(Matrix, Vector),
}

impl Arrival {
    /// The ray in the frame of the next surface.
    pub(super) fn apply<T: Scalar>(&self, ray: &mut Ray<T>) {
        match self {
            Self::Straight(gap_mm) => ray.p[2] = ray.p[2] - T::of(*gap_mm),
            Self::Skew(matrix, shift) => {
                let rotated = |v: [T; 3]| {
                    matrix.map(|row| T::of(row[0]) * v[0] + T::of(row[1]) * v[1] + T::of(row[2]) * v[2])
                };
                let p = rotated(ray.p);
                ray.p = std::array::from_fn(|i| p[i] + T::of(shift[i]));
                ray.d = rotated(ray.d);
            }
        }
    }
}

impl BuiltLens {
    /// `nominal` with `deviations`, from the outermost group inwards.
    ///
    /// # Errors
    /// A design that [`System::check`] rejects or with coatings or ideal lenses; surfaces that do not exist; numbers that are not
    /// finite.
    pub fn new(nominal: &System, deviations: &[Deviation]) -> Result<Self, SkewError> {
        if nominal.asymmetry.is_some() {
            return Err(DesignError::Asymmetric.into());
        }
        check_parts(nominal)?;
        let mut building = Building::new(nominal);
        // The innermost first: outer motions are multiplied from the left.
        for deviation in deviations.iter().rev() {
            building.add(deviation)?;
        }
        let surfaces = building.surfaces();
        Ok(Self { nominal: nominal.clone(), deviations: deviations.to_vec(), surfaces, design: None })
    }

    /// The lens of a design without rotational symmetry. Its rays are aimed at the stop, except in a telecentric object space.
    ///
    /// # Errors
    /// A design that [`System::check`] rejects, that has rotational symmetry, coatings or ideal lenses, or whose film no chief ray
    /// reaches.
    pub fn of_design(design: &System) -> Result<Self, SkewError> {
        let Some(asymmetry) = &design.asymmetry else {
            return rejected(
                "the design".to_owned(),
                "has rotational symmetry; expected tilted or freeform surfaces",
            );
        };
        check_parts(design)?;
        let aiming = if design.is_telecentric { RayAiming::Paraxial } else { RayAiming::Real };
        let nominal = System { aiming, ..design.straightened() };
        let surfaces = surfaces_of(&nominal, &asymmetry.surfaces);
        let mut lens = Self { nominal, deviations: Vec::new(), surfaces, design: None };
        let straight = IdealPlane::straight(&Paraxial::new(&lens.nominal, lens.nominal.primary_um())?);
        lens.design = Some((asymmetry.clone(), straight));
        let own = IdealPlane::of_rays(&lens)?;
        lens.design = Some((asymmetry.clone(), own));
        Ok(lens)
    }

    /// Whether it has no rotational symmetry by design.
    pub fn is_asymmetric_design(&self) -> bool {
        self.design.is_some()
    }

    /// Its ideal plane, if that is its own and not that of the nominal lens.
    pub(super) fn ideal_plane(&self) -> Option<&IdealPlane> {
        self.design.as_ref().map(|(_, ideal)| ideal)
    }

    /// Text of everything that determines its tables, for digests.
    pub fn identity(&self) -> String {
        let asymmetry = self.design.iter().map(|(asymmetry, _)| format!("\n{asymmetry:?}"));
        let text = format!("{}\n{:?}", self.nominal.identity(), self.deviations);
        asymmetry.fold(text, |text, part| text + &part)
    }

    /// This lens with further deviations, inside those that it has.
    ///
    /// # Errors
    /// As [`BuiltLens::new`].
    pub fn with(&self, deviations: &[Deviation]) -> Result<Self, SkewError> {
        Self::new(&self.nominal, &[&self.deviations, deviations].concat())
    }

    /// The nominal design.
    pub fn nominal(&self) -> &System {
        &self.nominal
    }

    /// Its deviations, from the outermost group inwards.
    pub fn deviations(&self) -> &[Deviation] {
        &self.deviations
    }

    /// Whether it is the nominal design: no deviation moves or changes anything.
    pub fn is_nominal(&self) -> bool {
        self.deviations.iter().all(Deviation::is_none)
    }

    /// Pose of each surface in the lens frame as built, the film last.
    pub fn poses(&self) -> Vec<Pose> {
        self.surfaces.iter().map(|s| s.pose).collect()
    }

    pub(super) fn surfaces(&self) -> &[BuiltSurface] {
        &self.surfaces
    }

    /// Index in front of each surface as built at `um`, and behind the last.
    ///
    /// # Errors
    /// [`DesignError::Wavelength`] of a glass.
    pub fn indices(&self, um: f64) -> Result<Vec<f64>, DesignError> {
        let mut indices = vec![1.0];
        for (s, built) in self.nominal.surfaces.iter().zip(&self.surfaces) {
            let mut n = s.medium.index(um)?;
            if built.glass.abbe != 0.0 {
                let primary = s.medium.index(self.nominal.primary_um())?;
                n = primary + (n - primary) / (1.0 + built.glass.abbe);
            }
            indices.push(n + built.glass.index);
        }
        Ok(indices)
    }
}

/// A lens while deviations are added.
struct Building<'a> {
    nominal: &'a System,
    /// z of each nominal vertex and direction of the light there.
    axis: Vec<(f64, f64)>,
    /// Motion of each surface; none if it is in its nominal place.
    motions: Vec<Option<Pose>>,
    shapes: Vec<SkewShape>,
    glasses: Vec<GlassChange>,
}

impl<'a> Building<'a> {
    fn new(nominal: &'a System) -> Self {
        let shape = |base| SkewShape { base, ..SkewShape::default() };
        Self {
            nominal,
            axis: nominal.axis(),
            motions: vec![None; nominal.surfaces.len()],
            shapes: nominal.surfaces.iter().map(|s| shape(s.shape.clone())).collect(),
            glasses: vec![GlassChange::default(); nominal.surfaces.len()],
        }
    }

    fn film(&self) -> usize {
        self.motions.len() - 1
    }

    fn add(&mut self, deviation: &Deviation) -> Result<(), SkewError> {
        match deviation {
            Deviation::Element {
                surfaces: [first, last],
                decentre_mm,
                tilt_rad,
                wedge_rad,
                shift_mm,
                pivot,
            } => {
                let what = || format!("the element of surfaces {} to {}", first + 1, last + 1);
                self.check(what(), &[*first, *last], self.film() - 1)?;
                let pivot = pivot.unwrap_or(Pivot { surface: *first, offset_mm: 0.0 });
                self.check(what(), &[pivot.surface], self.film())?;
                if first > last {
                    return rejected(what(), "ends before it begins; give the first surface first");
                }
                let [dx, dy] = *decentre_mm;
                let [wx, wy] = *wedge_rad;
                finite(
                    what(),
                    &[dx, dy, *shift_mm, wx, wy, pivot.offset_mm, tilt_rad[0], tilt_rad[1], tilt_rad[2]],
                )?;
                self.turn([*last, *last], [0.0; 3], [wx, wy, 0.0], Pivot { surface: *last, offset_mm: 0.0 });
                self.turn([*first, *last], [dx, dy, *shift_mm], *tilt_rad, pivot);
            }
            Deviation::Surface { surface, decentre_mm: [dx, dy], tilt_rad: [tx, ty], shape } => {
                let what = || format!("surface {}", surface + 1);
                self.check(what(), &[*surface], self.film() - 1)?;
                finite(what(), &[*dx, *dy, *tx, *ty, shape.curvature, shape.conic])?;
                finite(what(), &shape.figure.iter().map(|t| t.coefficient).collect::<Vec<_>>())?;
                let pivot = Pivot { surface: *surface, offset_mm: 0.0 };
                self.turn([*surface, *surface], [*dx, *dy, 0.0], [*tx, *ty, 0.0], pivot);
                self.bend(*surface, shape);
            }
            Deviation::Gap { after, thickness_mm, absorb } => {
                let what = || format!("the gap after surface {}", after + 1);
                self.check(what(), &[*after], self.film() - 1)?;
                finite(what(), &[*thickness_mm])?;
                if let Some(absorb) = absorb {
                    self.check(what(), &[*absorb], self.film() - 1)?;
                    if absorb <= after {
                        return rejected(what(), "is absorbed by a gap before it; name a later surface");
                    }
                }
                let last = absorb.unwrap_or(self.film());
                let dz = self.axis[after + 1].1 * thickness_mm;
                self.turn(
                    [after + 1, last],
                    [0.0, 0.0, dz],
                    [0.0; 3],
                    Pivot { surface: *after, offset_mm: 0.0 },
                );
            }
            Deviation::Glass { after, index, abbe } => {
                let what = || format!("the glass after surface {}", after + 1);
                self.check(what(), &[*after], self.film())?;
                finite(what(), &[*index, *abbe])?;
                if *abbe <= -1.0 {
                    return rejected(what(), "takes all of its Abbe number; give a relative change above -1");
                }
                // A mirror has the medium behind it that is in front of it.
                let mirrors = self.nominal.surfaces[after + 1..].iter().take_while(|s| s.is_mirror).count();
                for glass in &mut self.glasses[*after..=after + mirrors] {
                    glass.index += index;
                    glass.abbe = (1.0 + glass.abbe) * (1.0 + abbe) - 1.0;
                }
            }
            Deviation::Film { decentre_mm: [dx, dy], tilt_rad: [tx, ty], shift_mm } => {
                finite("the film".to_owned(), &[*dx, *dy, *tx, *ty, *shift_mm])?;
                let film = self.film();
                self.turn(
                    [film, film],
                    [*dx, *dy, *shift_mm],
                    [*tx, *ty, 0.0],
                    Pivot { surface: film, offset_mm: 0.0 },
                );
            }
        }
        Ok(())
    }

    fn check(&self, what: String, surfaces: &[usize], last: usize) -> Result<(), SkewError> {
        match surfaces.iter().find(|i| **i > last) {
            Some(i) => {
                let problem =
                    format!("names surface {}; the last one that it can name is {}", i + 1, last + 1);
                rejected(what, &problem)
            }
            None => Ok(()),
        }
    }

    /// Moves surfaces by a decentre (mm) and tilts (rad) about a pivot in its nominal place.
    fn turn(&mut self, [first, last]: [usize; 2], decentre_mm: Vector, tilt_rad: Vector, pivot: Pivot) {
        if decentre_mm == [0.0; 3] && tilt_rad == [0.0; 3] {
            return;
        }
        let place = Pose::at([0.0, 0.0, self.axis[pivot.surface].0 + pivot.offset_mm]);
        let motion = Pose::new(decentre_mm, tilt_rad).within(&place);
        for inner in &mut self.motions[first..=last] {
            *inner = Some(inner.map_or(motion, |inner| motion.compose(&inner)));
        }
    }

    fn bend(&mut self, surface: usize, change: &ShapeChange) {
        let shape = &mut self.shapes[surface];
        if change.curvature != 0.0 {
            shape.base.curvature += change.curvature;
        }
        if change.conic != 0.0 {
            shape.base.conic += change.conic;
        }
        shape.xy.extend_from_slice(&change.figure);
    }

    fn surfaces(self) -> Vec<BuiltSurface> {
        let place = |i: usize| {
            let nominal = Pose::at([0.0, 0.0, self.axis[i].0]);
            self.motions[i].map_or(nominal, |motion| motion.compose(&nominal))
        };
        let arrival = |i: usize| {
            let (before, gap_mm) = match i {
                0 => (None, 0.0),
                _ => (self.motions[i - 1], self.nominal.surfaces[i - 1].thickness_mm),
            };
            match before == self.motions[i] {
                true => Arrival::Straight(gap_mm),
                false => {
                    let from = if i == 0 { Pose::IDENTITY } else { place(i - 1) };
                    between((&from, self.axis[i].1), (&place(i), self.axis[i].1))
                }
            }
        };
        let all = self.shapes.iter().zip(&self.glasses).enumerate();
        let surface = |(i, (shape, glass)): (usize, (&SkewShape, &GlassChange))| BuiltSurface {
            shape: shape.clone(),
            pose: place(i),
            arrival: arrival(i),
            is_frame: false,
            aperture: self.nominal.surfaces[i].aperture_mm.map(Outline::disc),
            obscuration: self.nominal.surfaces[i].obscuration_mm.map(Outline::disc),
            glass: *glass,
        };
        all.map(surface).collect()
    }
}

/// From the frame at one pose to that at another, z of both along the light, which goes along ±1 of the z of each pose.
fn between((from, along_from): (&Pose, f64), (to, along_to): (&Pose, f64)) -> Arrival {
    let back = transpose(&to.rotation);
    let shift = std::array::from_fn(|i| from.origin_mm[i] - to.origin_mm[i]);
    let (mut matrix, mut shift) = (product(&back, &from.rotation), times(&back, shift));
    let negate = |v: &mut f64| *v = -*v;
    if along_from < 0.0 {
        matrix.iter_mut().for_each(|row| negate(&mut row[2]));
    }
    if along_to < 0.0 {
        matrix[2].iter_mut().for_each(negate);
        negate(&mut shift[2]);
    }
    Arrival::Skew(matrix, shift)
}

/// The surfaces of a design without symmetry, with their places before the light and behind mirrors.
fn surfaces_of(straight: &System, free: &[FreeSurface]) -> Vec<BuiltSurface> {
    let along = |is_reversed: bool| if is_reversed { -1.0 } else { 1.0 };
    let mut behind = (Pose::IDENTITY, 1.0);
    let surface = |(s, free): (&Surface, &FreeSurface)| {
        let here = (free.pose, along(free.is_reversed));
        let arrival = between((&behind.0, behind.1), (&here.0, here.1));
        behind = (here.0, along(free.is_reversed != s.is_mirror));
        BuiltSurface {
            shape: free.shape.clone(),
            pose: free.pose,
            arrival,
            is_frame: free.is_frame,
            aperture: free.aperture,
            obscuration: free.obscuration,
            glass: GlassChange::default(),
        }
    };
    straight.surfaces.iter().zip(free).map(surface).collect()
}

/// Checks a design, and that it has no part that is not supported here.
fn check_parts(design: &System) -> Result<(), SkewError> {
    design.check()?;
    for (i, s) in design.surfaces.iter().enumerate() {
        let unsupported = |part| Err(SkewError::Unsupported { surface: i + 1, part });
        if s.coating.is_some() {
            return unsupported("a coating (`--coatings ideal` leaves coatings out)");
        }
        if s.ideal_focal_mm.is_some() {
            return unsupported("an ideal lens");
        }
    }
    Ok(())
}

fn rejected<T>(what: String, problem: &str) -> Result<T, SkewError> {
    Err(SkewError::Deviation { what, problem: problem.to_owned() })
}

fn finite(what: String, numbers: &[f64]) -> Result<(), SkewError> {
    match numbers.iter().all(|v| v.is_finite()) {
        true => Ok(()),
        false => rejected(what, "has a number that is not finite"),
    }
}
