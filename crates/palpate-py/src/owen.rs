//! Scrambled nets: [`palpate_core::owen`].

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use palpate_core::owen as core;
use pyo3::prelude::*;

use crate::array::values;
use crate::error::Raised;
use crate::lhs::whole;

/// Scramble the points of a digital net in base 2, such as Sobol's, as Owen does.
#[pyfunction]
pub(crate) fn owen_scramble<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    seed: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let seed = whole("seed", seed)?;
    let ([n, d], points) = ([points.shape()[0], points.shape()[1]], values(&points));
    let scrambled = py.detach(|| core::scramble(&points, d, seed)).map_err(Raised::from)?;
    PyArray1::from_vec(py, scrambled).reshape([n, d])
}
