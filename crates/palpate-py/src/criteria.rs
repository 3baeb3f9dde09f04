//! How well a design fills the cube: [`palpate_core::criteria`].

use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use palpate_core::{Error, criteria as core};
use pyo3::prelude::*;

use crate::array::values;
use crate::error::Raised;

/// Return CD², the squared centred L2 discrepancy of a design in the unit cube.
#[pyfunction]
pub(crate) fn centred_discrepancy(
    py: Python<'_>,
    points: PyReadonlyArray2<'_, f64>,
) -> PyResult<f64> {
    of(py, &points, core::centred_discrepancy)
}

/// Return the Euclidean distance of the two closest sets.
#[pyfunction]
pub(crate) fn least_distance(py: Python<'_>, points: PyReadonlyArray2<'_, f64>) -> PyResult<f64> {
    of(py, &points, core::least_distance)
}

/// Return the largest absolute correlation of two different parameters.
#[pyfunction]
pub(crate) fn largest_correlation(
    py: Python<'_>,
    points: PyReadonlyArray2<'_, f64>,
) -> PyResult<f64> {
    of(py, &points, core::largest_correlation)
}

fn of(
    py: Python<'_>,
    points: &PyReadonlyArray2<'_, f64>,
    criterion: fn(&[f64], usize) -> Result<f64, Error>,
) -> PyResult<f64> {
    let (d, points) = (points.shape()[1], values(points));
    Ok(py.detach(|| criterion(&points, d)).map_err(Raised::from)?)
}
