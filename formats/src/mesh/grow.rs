//! Lists whose memory is counted before it is allocated; those beyond memory are in a scratch file, and not counted.

use super::context::Context;
use super::error::MeshError;
use bytemuck::Pod;
use pipeline::scratch::List;

/// Counts a list of `count` items of type `T` that is about to be allocated.
///
/// # Errors
/// [`MeshError::Memory`]; `what` names the items.
pub(super) fn charge_items<T>(context: &Context<'_>, what: &str, count: u64) -> Result<(), MeshError> {
    context.charge(count.saturating_mul(size_of::<T>() as u64), || what.into())
}

/// Counts a list that is about to be made, unless it will be in the scratch file.
fn charge_list<T>(context: &Context<'_>, what: &str, count: u64) -> Result<(), MeshError> {
    match context.limits.scratch.takes(count.saturating_mul(size_of::<T>() as u64)) {
        true => Ok(()),
        false => charge_items::<T>(context, what, count),
    }
}

/// An empty list with capacity for `count` items.
///
/// # Errors
/// [`MeshError::Memory`], `what` names the items; [`MeshError::Scratch`].
pub(super) fn list<T: Pod>(context: &Context<'_>, what: &str, count: u64) -> Result<List<T>, MeshError> {
    charge_list::<T>(context, what, count)?;
    Ok(context.limits.scratch.list(usize::try_from(count).unwrap_or(usize::MAX))?)
}

/// A list of `count` zeros.
///
/// # Errors
/// As [`list`].
pub(super) fn zeros<T: Pod>(context: &Context<'_>, what: &str, count: u64) -> Result<List<T>, MeshError> {
    charge_list::<T>(context, what, count)?;
    Ok(context.limits.scratch.zeros(usize::try_from(count).unwrap_or(usize::MAX))?)
}

/// Frees a list of [`list`] or [`push`].
pub(super) fn free<T: Pod>(context: &Context<'_>, items: List<T>) {
    context.release(items.memory_bytes() as u64);
}

/// `items.push(item)`. A list that is full is copied to one of twice the size; both are counted while they exist.
///
/// # Errors
/// As [`list`].
pub(super) fn push<T: Pod>(
    context: &Context<'_>,
    what: &str,
    items: &mut List<T>,
    item: T,
) -> Result<(), MeshError> {
    if items.len() == items.capacity() {
        let old = items.capacity();
        let mut more = list(context, what, (old + old.max(16)) as u64)?;
        more.extend(items.iter().copied());
        free(context, std::mem::replace(items, more));
    }
    items.push(item);
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::mesh::Limits;

    #[test]
    fn growth_stops_at_the_limit() {
        let limits = Limits { max_total_bytes: 1 << 16, ..Limits::of_memory(0) };
        let context = Context::new(Path::new("a"), &limits);
        let mut items = List::default();
        let grown = (0..1_000_000u64).try_for_each(|k| push(&context, "items", &mut items, k));
        assert!(matches!(grown, Err(MeshError::Memory { allowed: 65_536, .. })));
        assert!(items.capacity() * 8 <= 1 << 16);
        free(&context, items);
        assert!(list::<u8>(&context, "bytes", 1 << 16).is_ok());
        assert!(list::<u8>(&context, "bytes", 1).is_err());
        assert!(list::<u64>(&context, "numbers", u64::MAX).is_err());
    }
}
