//! Latin hypercubes that grow: [`palpate_core::nested`].

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use palpate_core::nested as core;
use pyo3::prelude::*;

use crate::array::values;
use crate::error::Raised;
use crate::lhs::whole;

/// Extend a Latin hypercube, whose sets stay as they are.
#[pyfunction]
#[pyo3(signature = (points, n_total, seed, *, centred = false))]
pub(crate) fn extend_latin_hypercube<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    n_total: &Bound<'py, PyAny>,
    seed: &Bound<'py, PyAny>,
    centred: bool,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (n_total, seed) = (whole("n_total", n_total)?, whole("seed", seed)?);
    let (d, points) = (points.shape()[1], values(&points));
    let design = py
        .detach(|| core::extend_latin_hypercube(&points, d, n_total, seed, centred))
        .map_err(Raised::from)?;
    PyArray1::from_vec(py, design).reshape([n_total, d])
}
