//! Arrays in and out.

use std::borrow::Cow;

use numpy::{
    Element, PyReadonlyArray, PyReadwriteArray, PyUntypedArrayMethods, ndarray::Dimension,
};
use pyo3::PyResult;
use pyo3::exceptions::{PyTypeError, PyValueError};

/// The values in C order: borrowed if they are in that order, else copied.
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

/// Checks the shape: the number of values would not detect another order of axes.
pub(crate) fn shaped<T, D>(
    name: &str,
    array: &PyReadonlyArray<'_, T, D>,
    expected: &[usize],
) -> PyResult<()>
where
    T: Element,
    D: Dimension,
{
    let found = array.shape();
    if found == expected {
        return Ok(());
    }
    let message = format!("{name} has shape {found:?} where {expected:?} was expected");
    Err(PyValueError::new_err(message))
}

/// The values in C order, to be changed in place.
pub(crate) fn writable<'a, T, D>(
    name: &str,
    array: &'a mut PyReadwriteArray<'_, T, D>,
) -> PyResult<&'a mut [T]>
where
    T: Element,
    D: Dimension,
{
    if !array.as_array().is_standard_layout() {
        let message = format!("{name} is changed in place: it must be contiguous, in C order");
        return Err(PyTypeError::new_err(message));
    }
    Ok(array.as_slice_mut()?)
}
