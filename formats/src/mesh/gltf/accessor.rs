//! Values of an accessor (glTF 2.0, 3.6.2), sparse ones included, read from the bytes of its buffer.
//!
//! Element i starts at byte offset + i·stride of its view. All of them lie within the view, checked when the accessor is opened, in
//! products that cannot overflow; nothing is allocated before. Without a view the elements are 0. Sparse elements replace those at
//! strictly increasing numbers.

use super::super::context::Context;
use super::super::error::MeshError;
use super::super::grow;
use super::document::{Document, slice};
use super::element::{Component, components, to_f32, unsigned};
use super::json;
use bytemuck::Pod;
use pipeline::scratch::List;

/// An accessor whose elements are all within its buffers.
pub(super) struct Accessor<'d> {
    /// Its number.
    pub(super) number: usize,
    pub(super) component: Component,
    /// Components per element.
    pub(super) components: usize,
    pub(super) is_normalised: bool,
    /// Number of elements.
    pub(super) count: usize,
    /// Whether `min` and `max` are given.
    pub(super) has_bounds: bool,
    base: Option<Elements<'d>>,
    sparse: Option<Sparse<'d>>,
}

/// Elements at a constant distance.
#[derive(Clone, Copy)]
struct Elements<'d> {
    bytes: &'d [u8],
    stride: usize,
    size: usize,
}

struct Sparse<'d> {
    numbers: Elements<'d>,
    component: Component,
    count: usize,
    values: Elements<'d>,
}

impl<'d> Elements<'d> {
    fn element(&self, i: usize) -> &'d [u8] {
        &self.bytes[i * self.stride..][..self.size]
    }
}

impl Sparse<'_> {
    fn number(&self, i: usize) -> usize {
        unsigned(self.component, self.numbers.element(i)) as usize
    }
}

/// Which elements are read.
#[derive(Clone, Copy)]
pub(super) enum Selection<'s> {
    /// All.
    All,
    /// Those of these numbers, which increase and are below the count.
    Some(&'s [u32]),
}

impl Selection<'_> {
    /// How many of `count` elements.
    pub(super) fn len(self, count: usize) -> usize {
        match self {
            Self::All => count,
            Self::Some(numbers) => numbers.len(),
        }
    }

    /// Number in the file of the selected element `i`.
    pub(super) fn number(self, i: usize) -> usize {
        match self {
            Self::All => i,
            Self::Some(numbers) => numbers[i] as usize,
        }
    }

    /// Place among the selected elements of the one of number `number`.
    fn position(self, number: usize) -> Option<usize> {
        match self {
            Self::All => Some(number),
            Self::Some(numbers) => u32::try_from(number).ok().and_then(|n| numbers.binary_search(&n).ok()),
        }
    }
}

impl<'d> Accessor<'d> {
    /// Opens the accessor `number`, which `place` states.
    ///
    /// # Errors
    /// There is none; unknown types; elements beyond their view or its buffer; sparse elements that do not increase.
    pub(super) fn open(
        document: &'d Document<'_>,
        number: u64,
        place: &dyn Fn() -> String,
    ) -> Result<Self, MeshError> {
        let (number, json) = document.object(&document.json.accessors, number, "accessors", place)?;
        let here = |property: &str| format!("accessors[{number}]{property}");
        let component = component(document, json.component_type, &|| here(".componentType"))?;
        let components = components(&json.kind);
        if components == 0 {
            let found = super::super::shown::shown(&json.kind);
            return Err(document.context.invalid(
                here(".type"),
                "SCALAR, VEC2, VEC3, VEC4 or a matrix",
                found,
            ));
        }
        let size = components * component.bytes();
        let offset = json.byte_offset.unwrap_or_default();
        let base = json
            .buffer_view
            .map(|view| elements(document, view, offset, json.count, size, &here))
            .transpose()?;
        // Without a view nothing but the memory limits the count; below 2³² vertices can be numbered.
        let count = usize::try_from(json.count).ok().filter(|&count| count <= u32::MAX as usize).ok_or_else(
            || {
                document.context.invalid(
                    here(".count"),
                    format!("at most {}", u32::MAX),
                    json.count.to_string(),
                )
            },
        )?;
        let sparse =
            json.sparse.as_ref().map(|s| Sparse::open(document, s, count, size, &here)).transpose()?;
        let (is_normalised, has_bounds) = (json.normalized, json.min.is_some() && json.max.is_some());
        Ok(Self { number, component, components, is_normalised, count, has_bounds, base, sparse })
    }

    /// Elements of N components, the first N of each, as f32.
    ///
    /// # Errors
    /// They do not fit into memory; `place` states them.
    pub(super) fn vectors<const N: usize>(
        &self,
        context: &Context<'_>,
        selection: Selection<'_>,
        place: &str,
    ) -> Result<List<[f32; N]>, MeshError> {
        let length = selection.len(self.count);
        let mut out = match self.base {
            None => zeros(context, length, place)?,
            Some(base) => {
                let mut out = grow::list(context, place, length as u64)?;
                let elements = (0..length).map(|i| base.element(selection.number(i)));
                to_f32(self.component, self.is_normalised, elements, &mut out);
                out
            }
        };
        if let Some(sparse) = &self.sparse {
            let mut replaced = Vec::with_capacity(1);
            for i in 0..sparse.count {
                if let Some(at) = selection.position(sparse.number(i)) {
                    replaced.clear();
                    let value = std::iter::once(sparse.values.element(i));
                    to_f32(self.component, self.is_normalised, value, &mut replaced);
                    out[at] = replaced[0];
                }
            }
        }
        Ok(out)
    }

    /// Unsigned integers, the first component of each element.
    ///
    /// # Errors
    /// They do not fit into memory; `place` states them.
    pub(super) fn integers(&self, context: &Context<'_>, place: &str) -> Result<List<u32>, MeshError> {
        let mut out = match self.base {
            None => zeros(context, self.count, place)?,
            Some(base) => {
                let mut out = grow::list(context, place, self.count as u64)?;
                out.extend((0..self.count).map(|i| unsigned(self.component, base.element(i))));
                out
            }
        };
        if let Some(sparse) = &self.sparse {
            for i in 0..sparse.count {
                out[sparse.number(i)] = unsigned(self.component, sparse.values.element(i));
            }
        }
        Ok(out)
    }
}

/// Elements without a view, whose number no bytes of the file confirm: in memory, whose limit they have.
fn zeros<T: Pod>(context: &Context<'_>, count: usize, place: &str) -> Result<List<T>, MeshError> {
    grow::charge_items::<T>(context, place, count as u64)?;
    Ok(vec![T::zeroed(); count].into())
}

impl<'d> Sparse<'d> {
    fn open(
        document: &'d Document<'_>,
        json: &json::Sparse,
        count: usize,
        size: usize,
        here: &dyn Fn(&str) -> String,
    ) -> Result<Self, MeshError> {
        let (indices, values) = (&json.indices, &json.values);
        let indices_here = |property: &str| here(&format!(".sparse.indices{property}"));
        let place = || indices_here(".componentType");
        let component = component(document, indices.component_type, &place)?;
        if !matches!(component, Component::U8 | Component::U16 | Component::U32) {
            return Err(document.context.invalid(place(), "an unsigned integer type", component.name()));
        }
        let (view, offset) = (indices.buffer_view, indices.byte_offset);
        let numbers = elements(document, view, offset, json.count, component.bytes(), &indices_here)?;
        let values_here = |property: &str| here(&format!(".sparse.values{property}"));
        let values =
            elements(document, values.buffer_view, values.byte_offset, json.count, size, &values_here)?;
        // The elements are within their view, so that their number fits.
        let elements = usize::try_from(json.count).unwrap_or_default();
        let sparse = Self { numbers, component, count: elements, values };
        let mut least = 0;
        for i in 0..sparse.count {
            let number = sparse.number(i);
            if number < least || number >= count {
                let place = format!("{}[{i}]", here(".sparse.indices"));
                let expected = format!("numbers that increase, below {count}");
                return Err(document.context.invalid(place, expected, number.to_string()));
            }
            least = number + 1;
        }
        Ok(sparse)
    }
}

fn component(
    document: &Document<'_>,
    number: u64,
    place: &dyn Fn() -> String,
) -> Result<Component, MeshError> {
    Component::from_number(number)
        .ok_or_else(|| document.context.invalid(place(), "5120 to 5123, 5125 or 5126", number.to_string()))
}

/// `count` elements of `size` bytes in a buffer view.
fn elements<'d>(
    document: &'d Document<'_>,
    view: u64,
    offset: u64,
    count: u64,
    size: usize,
    here: &dyn Fn(&str) -> String,
) -> Result<Elements<'d>, MeshError> {
    let view = document.view(view, &|| here(".bufferView"))?;
    let (size_bytes, context) = (size as u64, document.context);
    let stride = view.stride.unwrap_or(size_bytes);
    if stride < size_bytes {
        let expected = format!("a byteStride of at least {size_bytes}");
        return Err(context.invalid(here(".bufferView"), expected, stride.to_string()));
    }
    // The last element has no gap behind it.
    let length = match count {
        0 => Some(0),
        _ => (count - 1).checked_mul(stride).and_then(|n| n.checked_add(size_bytes)),
    };
    let bytes = length.and_then(|length| slice(view.bytes, offset, length)).ok_or_else(|| {
        let expected = format!("elements within the {} bytes of its buffer view", view.bytes.len());
        let found = format!("{count} of {size_bytes} bytes, {stride} apart, from byte {offset} on");
        context.invalid(here(""), expected, found)
    })?;
    // A stride beyond the bytes is of one element, at 0.
    Ok(Elements { bytes, stride: usize::try_from(stride).unwrap_or(usize::MAX), size })
}
