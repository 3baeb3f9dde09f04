//! Logarithmic ranges: [`palpate_core::scale`].

use numpy::{PyArray1, PyReadonlyArray1};
use palpate_core::scale as core;
use pyo3::prelude::*;

use crate::array::values;
use crate::error::Raised;

/// Return lower · (upper / lower)^share for each share of a range.
#[pyfunction]
pub(crate) fn geometric<'py>(
    py: Python<'py>,
    shares: PyReadonlyArray1<'py, f64>,
    lower: f64,
    upper: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let shares = values(&shares);
    let found = py.detach(|| core::geometric(&shares, lower, upper)).map_err(Raised::from)?;
    Ok(PyArray1::from_vec(py, found))
}
