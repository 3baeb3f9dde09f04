//! Scores: [`palpate_core::nmse`].

use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
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
type Scores<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

/// NMSE and coverage of many simulated curves against one measured curve.
#[pyfunction]
#[pyo3(signature = (sim, exp, normaliser = "mean_abs", weights = None))]
pub(crate) fn nmse_batch<'py>(
    py: Python<'py>,
    sim: PyReadonlyArray2<'py, f64>,
    exp: PyReadonlyArray1<'py, f64>,
    normaliser: &str,
    weights: Option<PyReadonlyArray1<'py, f64>>,
) -> Result<Scores<'py>, Raised> {
    let n_sets = sim.shape()[0];
    let (sim, exp, weights) = (values(&sim), values(&exp), weights.as_ref().map(values));
    let normaliser = normaliser.parse()?;
    let scores =
        py.detach(|| core::nmse_batch(&sim, n_sets, &exp, normaliser, weights.as_deref()))?;
    Ok((
        PyArray1::from_iter(py, scores.iter().map(|s| s.nmse)),
        PyArray1::from_iter(py, scores.iter().map(|s| s.coverage)),
    ))
}

/// NMSE and coverage of a simulated path against a measured one, each with its own points.
#[pyfunction]
#[pyo3(signature = (
    sim_x, sim_y, exp_x, exp_y, normaliser = "mean_abs", tolerance = 0.0, weights = None
))]
#[expect(clippy::too_many_arguments, reason = "two curves and three options, by keyword")]
pub(crate) fn score(
    py: Python<'_>,
    sim_x: PyReadonlyArray1<'_, f64>,
    sim_y: PyReadonlyArray1<'_, f64>,
    exp_x: PyReadonlyArray1<'_, f64>,
    exp_y: PyReadonlyArray1<'_, f64>,
    normaliser: &str,
    tolerance: f64,
    weights: Option<PyReadonlyArray1<'_, f64>>,
) -> Result<(f64, f64), Raised> {
    let (sim_x, sim_y) = (values(&sim_x), values(&sim_y));
    let (exp_x, exp_y) = (values(&exp_x), values(&exp_y));
    let (normaliser, weights) = (normaliser.parse()?, weights.as_ref().map(values));
    let (sim, exp) = ((&*sim_x, &*sim_y), (&*exp_x, &*exp_y));
    let out = py.detach(|| core::score(sim, exp, normaliser, tolerance, weights.as_deref()))?;
    Ok((out.nmse, out.coverage))
}
