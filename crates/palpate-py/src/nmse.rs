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
pub(crate) type Scores<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

/// Hands the scores over without a copy.
pub(crate) fn handed_over(py: Python<'_>, scores: core::Scores) -> Scores<'_> {
    (PyArray1::from_vec(py, scores.nmse), PyArray1::from_vec(py, scores.coverage))
}

/// NMSE and coverage of many simulated curves against one measured curve.
#[pyfunction]
#[pyo3(signature = (sim, exp, normaliser = "mean_abs", weights = None, *, threads = 1))]
pub(crate) fn nmse_batch<'py>(
    py: Python<'py>,
    sim: PyReadonlyArray2<'py, f64>,
    exp: PyReadonlyArray1<'py, f64>,
    normaliser: &str,
    weights: Option<PyReadonlyArray1<'py, f64>>,
    threads: usize,
) -> Result<Scores<'py>, Raised> {
    let n_sets = sim.shape()[0];
    let (sim, exp, weights) = (values(&sim), values(&exp), weights.as_ref().map(values));
    let normaliser = normaliser.parse()?;
    let scores = py
        .detach(|| core::nmse_batch(&sim, n_sets, &exp, normaliser, weights.as_deref(), threads))?;
    Ok(handed_over(py, scores))
}

/// NMSE and coverage of a simulated path against a measured one, each with its own points.
#[pyfunction]
#[pyo3(signature = (
    sim_x, sim_y, exp_x, exp_y, normaliser = "mean_abs", tolerance = 0.0, weights = None,
    interpolant = "linear"
))]
#[expect(clippy::too_many_arguments, reason = "two curves and four options, by keyword")]
pub(crate) fn score(
    py: Python<'_>,
    sim_x: PyReadonlyArray1<'_, f64>,
    sim_y: PyReadonlyArray1<'_, f64>,
    exp_x: PyReadonlyArray1<'_, f64>,
    exp_y: PyReadonlyArray1<'_, f64>,
    normaliser: &str,
    tolerance: f64,
    weights: Option<PyReadonlyArray1<'_, f64>>,
    interpolant: &str,
) -> Result<(f64, f64), Raised> {
    let (sim_x, sim_y) = (values(&sim_x), values(&sim_y));
    let (exp_x, exp_y) = (values(&exp_x), values(&exp_y));
    let (normaliser, weights) = (normaliser.parse()?, weights.as_ref().map(values));
    let interpolant = interpolant.parse()?;
    let comparison =
        core::Comparison { normaliser, weights: weights.as_deref(), tolerance, interpolant };
    let out = py.detach(|| core::score((&sim_x, &sim_y), (&exp_x, &exp_y), &comparison))?;
    Ok((out.nmse, out.coverage))
}

/// The normaliser of a measured curve, in the unit of its ordinate.
#[pyfunction]
#[pyo3(signature = (exp, normaliser = "mean_abs"))]
pub(crate) fn normaliser(exp: PyReadonlyArray1<'_, f64>, normaliser: &str) -> Result<f64, Raised> {
    Ok(normaliser.parse::<core::Normaliser>()?.value(&values(&exp))?)
}
