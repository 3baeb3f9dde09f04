//! Scores: [`palpate_core::nmse`].

use numpy::{PyArray1, PyReadonlyArray1};
use palpate_core::nmse as core;
use pyo3::prelude::*;

use crate::array::values;
use crate::error::Raised;

/// NMSE of a simulated curve against a measured one at the same points.
#[pyfunction]
#[pyo3(signature = (sim, exp, normaliser = "mean_abs", weights = None))]
pub(crate) fn nmse(
    py: Python<'_>,
    sim: PyReadonlyArray1<'_, f64>,
    exp: PyReadonlyArray1<'_, f64>,
    normaliser: &str,
    weights: Option<PyReadonlyArray1<'_, f64>>,
) -> Result<f64, Raised> {
    let (sim, exp, weights) = (values(&sim), values(&exp), weights.as_ref().map(values));
    let normaliser = normaliser.parse()?;
    Ok(py.detach(|| core::nmse(&sim, &exp, normaliser, weights.as_deref()))?)
}

/// Scores as two arrays: NMSE (n_sets,) and coverage (n_sets,).
pub(crate) type Scores<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

/// Moves the scores to Python without a copy.
pub(crate) fn handed_over(py: Python<'_>, scores: core::Scores) -> Scores<'_> {
    (PyArray1::from_vec(py, scores.nmse), PyArray1::from_vec(py, scores.coverage))
}

/// The normaliser of a measured curve, in the unit of its ordinate.
#[pyfunction]
#[pyo3(signature = (exp, normaliser = "mean_abs"))]
pub(crate) fn normaliser(exp: PyReadonlyArray1<'_, f64>, normaliser: &str) -> Result<f64, Raised> {
    Ok(normaliser.parse::<core::Normaliser>()?.value(&values(&exp))?)
}
