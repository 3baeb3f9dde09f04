//! Designs: [`palpate_core::lhs`].

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use palpate_core::lhs as core;
use pyo3::prelude::*;

use crate::error::{Raised, SamplingError};

/// Draw a Latin hypercube of n sets in the open unit cube of d parameters.
#[pyfunction]
#[pyo3(signature = (n, d, seed, *, centred = false))]
pub(crate) fn latin_hypercube(
    py: Python<'_>,
    n: i128,
    d: i128,
    seed: i128,
    centred: bool,
) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let (n, d, seed) = (whole("n", n)?, whole("d", d)?, whole("seed", seed)?);
    let design = py.detach(|| core::latin_hypercube(n, d, seed, centred)).map_err(Raised::from)?;
    PyArray1::from_vec(py, design).reshape([n, d])
}

/// A count or seed in its own type; Python's integers have neither sign nor size to rely on.
fn whole<T: TryFrom<i128>>(name: &str, value: i128) -> PyResult<T> {
    T::try_from(value).map_err(|_| {
        SamplingError::new_err(format!("{name} is {value}: it must lie between 0 and 2^64 - 1"))
    })
}
