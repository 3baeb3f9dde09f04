//! A measured curve made ready: [`palpate_core::measured`].

use numpy::PyReadonlyArray1;
use palpate_core::measured as core;
use palpate_core::nmse::Comparison;
use pyo3::prelude::*;

use crate::array::values;
use crate::error::Raised;
use crate::nmse::{Scores, handed_over};
use crate::shared::SharedPath;

/// A measured curve, cut and weighted once for all that it is compared with.
#[pyclass(module = "palpate._core", frozen)]
pub(crate) struct Measured(core::Measured);

#[pymethods]
impl Measured {
    #[new]
    #[pyo3(signature = (
        x, y, normaliser = "mean_abs", tolerance = 0.0, weights = None, interpolant = "linear"
    ))]
    fn new(
        py: Python<'_>,
        x: PyReadonlyArray1<'_, f64>,
        y: PyReadonlyArray1<'_, f64>,
        normaliser: &str,
        tolerance: f64,
        weights: Option<PyReadonlyArray1<'_, f64>>,
        interpolant: &str,
    ) -> Result<Self, Raised> {
        let (x, y, weights) = (values(&x), values(&y), weights.as_ref().map(values));
        let (normaliser, interpolant) = (normaliser.parse()?, interpolant.parse()?);
        let weights = weights.as_deref();
        let comparison = Comparison { normaliser, weights, tolerance, interpolant };
        Ok(Self(py.detach(|| core::Measured::new(&x, &y, &comparison))?))
    }

    fn score(
        &self,
        py: Python<'_>,
        sim_x: PyReadonlyArray1<'_, f64>,
        sim_y: PyReadonlyArray1<'_, f64>,
    ) -> Result<(f64, f64), Raised> {
        let (sim_x, sim_y) = (values(&sim_x), values(&sim_y));
        let out = py.detach(|| self.0.score(&sim_x, &sim_y))?;
        Ok((out.nmse, out.coverage))
    }

    #[pyo3(signature = (sim_x, sim_y, starts, *, threads = 1))]
    fn score_paths<'py>(
        &self,
        py: Python<'py>,
        sim_x: PyReadonlyArray1<'py, f64>,
        sim_y: PyReadonlyArray1<'py, f64>,
        starts: PyReadonlyArray1<'py, i64>,
        threads: usize,
    ) -> Result<Scores<'py>, Raised> {
        let (sim_x, sim_y, starts) = (values(&sim_x), values(&sim_y), values(&starts));
        // A negative start becomes one beyond every array, and an error that names it.
        let starts: Vec<_> =
            starts.iter().map(|&start| usize::try_from(start).unwrap_or(usize::MAX)).collect();
        let scores = py.detach(|| self.0.score_paths(&sim_x, &sim_y, &starts, threads))?;
        Ok(handed_over(py, scores))
    }

    fn along(
        &self,
        py: Python<'_>,
        sim_x: PyReadonlyArray1<'_, f64>,
    ) -> Result<SharedPath, Raised> {
        let sim_x = values(&sim_x);
        Ok(SharedPath(py.detach(|| self.0.along(&sim_x))?))
    }

    #[getter]
    fn n_points(&self) -> usize {
        self.0.n_points()
    }
}
