//! Many curves on one path: [`palpate_core::shared`].

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use palpate_core::shared as core;
use pyo3::prelude::*;

use crate::array::values;
use crate::error::Raised;
use crate::nmse::{Scores, handed_over};

/// A measured curve ready to score simulated curves that share their abscissae.
#[pyclass(module = "palpate._core", frozen)]
pub(crate) struct SharedPath(pub(crate) core::SharedPath);

/// Scores and their gradient (n_sets, n).
type Gradients<'py> = (Scores<'py>, Bound<'py, PyArray2<f64>>);

#[pymethods]
impl SharedPath {
    fn score<'py>(
        &self,
        py: Python<'py>,
        sim: PyReadonlyArray2<'py, f64>,
    ) -> Result<Scores<'py>, Raised> {
        let (n_sets, sim) = (sim.shape()[0], values(&sim));
        let scores = py.detach(|| self.0.score(&sim, n_sets))?;
        Ok(handed_over(py, scores))
    }

    fn gradient<'py>(
        &self,
        py: Python<'py>,
        sim: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Gradients<'py>> {
        let shape = [sim.shape()[0], sim.shape()[1]];
        let sim = values(&sim);
        let out = py.detach(|| self.0.gradient(&sim, shape[0])).map_err(Raised::from)?;
        let gradient = PyArray1::from_vec(py, out.gradient).reshape(shape)?;
        Ok((handed_over(py, out.scores), gradient))
    }
}
