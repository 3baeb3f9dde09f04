//! Arrays in and out.

use std::borrow::Cow;

use numpy::{Element, PyReadonlyArray, ndarray::Dimension};

/// The values in C order: borrowed where they lie that way, copied where they do not.
pub(crate) fn values<'a, T, D>(array: &'a PyReadonlyArray<'_, T, D>) -> Cow<'a, [T]>
where
    T: Element + Copy,
    D: Dimension,
{
    let view = array.as_array();
    match array.as_slice() {
        Ok(slice) if view.is_standard_layout() => Cow::Borrowed(slice),
        _ => Cow::Owned(view.iter().copied().collect()),
    }
}
