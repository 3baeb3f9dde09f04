//! Sparse factors: [`palpate_sparse::solver`].

use numpy::PyUntypedArrayMethods;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
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
    #[pyo3(signature = (indptr, indices, *, precision, order = None))]
    fn new(
        py: Python<'_>,
        indptr: PyReadonlyArray1<'_, i32>,
        indices: PyReadonlyArray1<'_, i32>,
        precision: &str,
        order: Option<PyReadonlyArray1<'_, u32>>,
    ) -> Result<Self, Raised> {
        let (indptr, indices) = (values(&indptr), values(&indices));
        let (precision, order) = (precision.parse()?, order.as_ref().map(values));
        let order = order.as_deref();
        let made = py.detach(|| core::SparseFactor::ordered(&indptr, &indices, precision, order));
        Ok(Self(made?))
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

    #[pyo3(signature = (data, rhs, tolerance, most_steps, *, sweep = true))]
    fn krylov<'py>(
        &self,
        py: Python<'py>,
        data: PyReadonlyArray1<'py, f64>,
        rhs: PyReadonlyArray1<'py, f64>,
        tolerance: f64,
        most_steps: usize,
        sweep: bool,
    ) -> Result<(Bound<'py, PyArray1<f64>>, usize, bool), Raised> {
        let (data, rhs) = (values(&data), values(&rhs));
        let found = py.detach(|| self.0.krylov(&data, &rhs, tolerance, most_steps, sweep))?;
        let converged = found.residual <= tolerance;
        Ok((PyArray1::from_vec(py, found.solution), found.n_steps, converged))
    }

    #[pyo3(signature = (data, rhs, tolerance, most_steps, *, sweep = true))]
    fn krylov_together<'py>(
        &self,
        py: Python<'py>,
        data: PyReadonlyArray1<'py, f64>,
        rhs: PyReadonlyArray2<'py, f64>,
        tolerance: f64,
        most_steps: usize,
        sweep: bool,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, usize, f64)> {
        let shape = [rhs.shape()[0], rhs.shape()[1]];
        let (data, rhs) = (values(&data), values(&rhs));
        let solve = || self.0.krylov_together(&data, &rhs, tolerance, most_steps, sweep);
        let found = py.detach(solve).map_err(Raised::from)?;
        let solution = PyArray1::from_vec(py, found.solution).reshape(shape)?;
        Ok((solution, found.n_steps, found.residual))
    }

    #[getter]
    fn order<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, self.0.order())
    }

    #[getter]
    fn precision(&self) -> &'static str {
        self.0.precision().name()
    }
}
