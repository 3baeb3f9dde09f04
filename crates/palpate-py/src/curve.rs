//! Paths: [`palpate_core::curve`].

use numpy::{PyArray1, PyReadonlyArray1};
use palpate_core::curve as core;
use pyo3::prelude::*;

use crate::array::values;
use crate::error::Raised;

/// Cut a path into maximal monotone branches.
#[pyfunction]
pub(crate) fn branches(
    py: Python<'_>,
    abscissa: PyReadonlyArray1<'_, f64>,
) -> Result<Vec<(usize, usize)>, Raised> {
    let abscissa = values(&abscissa);
    let found = py.detach(|| core::branches(&abscissa))?;
    Ok(found.iter().map(|b| (b.start, b.stop)).collect())
}

/// Interpolated ordinates as two arrays: values (n,) and covered (n,).
type Reached<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>);

/// Interpolate a simulated path onto measured abscissae, branch by branch.
#[pyfunction]
pub(crate) fn interpolate<'py>(
    py: Python<'py>,
    sim_x: PyReadonlyArray1<'py, f64>,
    sim_y: PyReadonlyArray1<'py, f64>,
    at_x: PyReadonlyArray1<'py, f64>,
) -> Result<Reached<'py>, Raised> {
    let (sim_x, sim_y, at_x) = (values(&sim_x), values(&sim_y), values(&at_x));
    let out = py.detach(|| core::interpolate(&sim_x, &sim_y, &at_x))?;
    Ok((PyArray1::from_vec(py, out.values), PyArray1::from_vec(py, out.covered)))
}
