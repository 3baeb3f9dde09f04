//! Better designs: [`palpate_core::optimise`].

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use palpate_core::optimise as core;
use pyo3::prelude::*;

use crate::array::values;
use crate::error::Raised;
use crate::lhs::whole;

/// Reorder the values within each column of a design for the better.
#[pyfunction]
#[pyo3(signature = (points, criterion, seed, *, n_swaps = None, n_fixed = None))]
pub(crate) fn optimise_design<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    criterion: &str,
    seed: &Bound<'py, PyAny>,
    n_swaps: Option<&Bound<'py, PyAny>>,
    n_fixed: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let search = core::Search {
        criterion: criterion.parse().map_err(Raised::from)?,
        seed: whole("seed", seed)?,
        n_swaps: n_swaps.map(|n| whole("n_swaps", n)).transpose()?,
        n_fixed: n_fixed.map_or(Ok(0), |n| whole("n_fixed", n))?,
    };
    let ([n, d], points) = ([points.shape()[0], points.shape()[1]], values(&points));
    let better = py.detach(|| core::optimise(&points, d, &search)).map_err(Raised::from)?;
    PyArray1::from_vec(py, better).reshape([n, d])
}
