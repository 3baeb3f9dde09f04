//! Sparse factors: [`palpate_sparse::solver`].

use numpy::{PyArray1, PyReadonlyArray1};
use palpate_sparse as core;
use pyo3::prelude::*;

use crate::array::values;
use crate::error::Raised;

/// Factors of symmetric matrices whose pattern stays the same.
#[pyclass(module = "palpate._core")]
pub(crate) struct SparseFactor(core::SparseFactor);

#[pymethods]
impl SparseFactor {
    #[new]
    #[pyo3(signature = (indptr, indices, *, precision))]
    fn new(
        py: Python<'_>,
        indptr: PyReadonlyArray1<'_, i32>,
        indices: PyReadonlyArray1<'_, i32>,
        precision: &str,
    ) -> Result<Self, Raised> {
        let (indptr, indices) = (values(&indptr), values(&indices));
        let precision = precision.parse()?;
        Ok(Self(py.detach(|| core::SparseFactor::new(&indptr, &indices, precision))?))
    }

    fn factorise(&mut self, py: Python<'_>, data: PyReadonlyArray1<'_, f64>) -> Result<(), Raised> {
        let data = values(&data);
        Ok(py.detach(|| self.0.factorise(&data))?)
    }

    fn precondition<'py>(
        &self,
        py: Python<'py>,
        rhs: PyReadonlyArray1<'py, f64>,
    ) -> Result<Bound<'py, PyArray1<f64>>, Raised> {
        let rhs = values(&rhs);
        Ok(PyArray1::from_vec(py, py.detach(|| self.0.precondition(&rhs))?))
    }

    fn krylov<'py>(
        &self,
        py: Python<'py>,
        data: PyReadonlyArray1<'py, f64>,
        rhs: PyReadonlyArray1<'py, f64>,
        tolerance: f64,
        most_steps: usize,
    ) -> Result<(Bound<'py, PyArray1<f64>>, usize, bool), Raised> {
        let (data, rhs) = (values(&data), values(&rhs));
        let found = py.detach(|| self.0.krylov(&data, &rhs, tolerance, most_steps))?;
        let converged = found.residual <= tolerance;
        Ok((PyArray1::from_vec(py, found.solution), found.n_steps, converged))
    }

    #[getter]
    fn precision(&self) -> &'static str {
        self.0.precision().name()
    }
}
