//! Designs: [`palpate_core::lhs`].

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use palpate_core::lhs as core;
use pyo3::conversion::FromPyObjectOwned;
use pyo3::exceptions::{PyOverflowError, PyTypeError};
use pyo3::prelude::*;

use crate::error::{Raised, SamplingError};

/// Draw a Latin hypercube of n sets in the open unit cube of d parameters.
#[pyfunction]
#[pyo3(signature = (n, d, seed, *, centred = false))]
pub(crate) fn latin_hypercube<'py>(
    py: Python<'py>,
    n: &Bound<'py, PyAny>,
    d: &Bound<'py, PyAny>,
    seed: &Bound<'py, PyAny>,
    centred: bool,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (n, d, seed) = (whole("n", n)?, whole("d", d)?, whole("seed", seed)?);
    let design = py.detach(|| core::latin_hypercube(n, d, seed, centred)).map_err(Raised::from)?;
    PyArray1::from_vec(py, design).reshape([n, d])
}

/// A count or seed; Python's integers have neither sign nor size to rely on.
pub(crate) fn whole<'py, T>(name: &str, value: &Bound<'py, PyAny>) -> PyResult<T>
where
    T: FromPyObjectOwned<'py, Error = PyErr>,
{
    value.extract::<T>().map_err(|error| {
        if error.is_instance_of::<PyOverflowError>(value.py()) {
            let message = format!("{name} is {value}: it must lie between 0 and 2^64 - 1");
            SamplingError::new_err(message)
        } else {
            PyTypeError::new_err(format!("{name} is {value}: it must be a whole number"))
        }
    })
}
