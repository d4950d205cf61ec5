//! Manufacturing errors of a lens: what may be wrong by how much, and the lenses drawn from that.
//!
//! | module | content |
//! |---|---|
//! | `draw` | the uniform number of seed, sample and identifier: [`uniform`] |
//! | `law` | laws between limits: [`Law`], [`Limits`] |
//! | `quantity` | what an error changes, its unit and its part of the identifier: [`Quantity`] |
//! | `entry` | an error of a target: [`Tolerance`], [`Target`] |
//! | `check`, `problem` | errors that cannot be: surfaces that do not exist, ranges that cross, two errors that draw one parameter |
//! | `set` | all errors of a lens in their order: [`Tolerances`]: parameters, draws, sensitivity |
//! | `built` | drawn values as errors of the traced lens, mm and rad |
//! | `settings` | what is compensated and what is judged: [`Compensation`], [`Criterion`] |
//! | `fields` | the places of a criterion and their rays |
//! | `compensate` | the film focused and tilted, the boresight removed: [`compensate()`] |
//! | `figures`, `focus_mtf`, `pupil_fit` | spots, wavefronts and MTF of a built lens: [`LensFigures`] |
//! | `batch` | lenses of a batch with their figures: [`Batch`] |
//! | [`statistics`] | percentiles, yield |
//!
//! Surfaces are numbered as in the design file: the object is 0, surface k is `System::surfaces[k − 1]`, the film is the last.
//! Elements are bodies of surfaces first..last that move as one; one whose range contains another's is a group, and the other one
//! moves in its frame. A drawn lens is a vector of values in the units of the description, one a parameter; it determines the
//! lens, whatever drew it.

mod batch;
mod built;
mod check;
mod compensate;
mod draw;
mod entry;
mod fields;
mod figures;
mod focus_mtf;
mod law;
mod problem;
mod pupil_fit;
mod quantity;
mod set;
mod settings;
pub mod statistics;
#[cfg(test)]
mod tests;

pub use batch::{AssessedLens, Batch, LensFailure};
pub use compensate::{Compensated, compensate};
pub use draw::uniform;
pub use entry::{Pivot, Target, Tolerance};
pub use figures::{FieldFigures, LensFigures};
pub use law::{Law, Limits};
pub use problem::{Problem, ToleranceError};
pub use quantity::{Direction, Figure, Quantity, RadiusUnit, Unit};
pub use set::{Extreme, Parameter, Tolerances};
pub use settings::{Boresight, Compensation, Criterion, CriterionFields, CriterionKind};
