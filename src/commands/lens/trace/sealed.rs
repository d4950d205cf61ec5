//! `lens trace --sealed`: a pack without what its design is made of.
//!
//! Tables and PSFs are those of any pack of the design. What is only recorded is left out ([`PackAttributes::sealed`]), and the title of the design has the
//! maker's name in its place. Pupil functions, the wavefronts of the design, are not stored.

use crate::args::{Store, TraceArgs};
use crate::failure::usage;
use anyhow::Result;
use formats::lens::{LensPackError, LensPackWriter, PackAttributes};
use pipeline::lens::Lens;

/// Fails for what a sealed pack does not have.
///
/// # Errors
/// Usage: pupil functions.
pub fn check(args: &TraceArgs) -> Result<()> {
    match args.sealed && args.store == Some(Store::Pupils) {
        false => Ok(()),
        true => Err(usage(
            "--store pupils: pupil functions are the wavefronts of the design, which a sealed pack does not have; leave it out, or --sealed",
        )),
    }
}

/// What a pack has of its PSFs: as given, else `default`; a sealed one has their samples.
pub fn stored(args: &TraceArgs, default: Store) -> Store {
    args.store.unwrap_or(if args.sealed { Store::Psfs } else { default })
}

/// Finishes `pack`, sealed if `args` say so.
///
/// # Errors
/// As [`LensPackWriter::finish`].
pub fn finish(
    args: &TraceArgs,
    pack: LensPackWriter,
    lens: &Lens,
    attributes: PackAttributes,
) -> Result<(), LensPackError> {
    match args.sealed {
        false => pack.finish(lens, &attributes),
        true => pack.finish(&Lens { name: args.name.clone(), ..lens.clone() }, &attributes.sealed()),
    }
}
