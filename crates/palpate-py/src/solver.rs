//! Sparse direct solution: [`palpate_sparse::solver`].

use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyReadonlyArrayDyn};
use numpy::{PyUntypedArrayMethods, ndarray::IxDyn};
use palpate_sparse as core;
use pyo3::prelude::*;

use crate::array::values;
use crate::error::Raised;

/// Pointers or indices as scipy gives them.
#[derive(FromPyObject)]
pub(crate) enum Indices<'py> {
    #[pyo3(annotation = "an int32 array of 1 dimension")]
    Narrow(PyReadonlyArray1<'py, i32>),
    #[pyo3(annotation = "an int64 array of 1 dimension")]
    Wide(PyReadonlyArray1<'py, i64>),
}

impl Indices<'_> {
    fn widened(&self) -> Vec<i64> {
        match self {
            Self::Narrow(array) => array.as_array().iter().map(|&i| i64::from(i)).collect(),
            Self::Wide(array) => array.as_array().to_vec(),
        }
    }
}

/// A direct solver of A x = b for a pattern that stays the same.
#[pyclass(module = "palpate._core")]
pub(crate) struct SparseFactor(core::SparseFactor);

#[pymethods]
impl SparseFactor {
    #[new]
    #[pyo3(signature = (indptr, indices, *, kind = "lu", layout = "csc", precision = "double"))]
    fn new(
        py: Python<'_>,
        indptr: Indices<'_>,
        indices: Indices<'_>,
        kind: &str,
        layout: &str,
        precision: &str,
    ) -> Result<Self, Raised> {
        let (indptr, indices) = (indptr.widened(), indices.widened());
        let (kind, layout, precision) = (kind.parse()?, layout.parse()?, precision.parse()?);
        let factor =
            py.detach(|| core::SparseFactor::new(&indptr, &indices, layout, kind, precision))?;
        Ok(Self(factor))
    }

    fn factorise(&mut self, py: Python<'_>, data: PyReadonlyArray1<'_, f64>) -> Result<(), Raised> {
        let data = values(&data);
        Ok(py.detach(|| self.0.factorise(&data))?)
    }

    fn solve<'py>(
        &self,
        py: Python<'py>,
        rhs: PyReadonlyArrayDyn<'py, f64>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let shape = rhs.shape().to_vec();
        let n_columns = if let [_, k] = shape[..] { k } else { 1 };
        let rhs = values(&rhs);
        let x = py.detach(|| self.0.solve(&rhs, n_columns)).map_err(Raised::from)?;
        PyArray1::from_vec(py, x).reshape(IxDyn(&shape))
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
    fn n(&self) -> usize {
        self.0.n()
    }

    #[getter]
    fn n_data(&self) -> usize {
        self.0.n_data()
    }

    #[getter]
    fn kind(&self) -> &'static str {
        self.0.kind().name()
    }

    #[getter]
    fn precision(&self) -> &'static str {
        self.0.precision().name()
    }

    #[getter]
    fn probe_error(&self) -> Option<f64> {
        self.0.probe_error()
    }

    fn __repr__(&self) -> String {
        format!("{:?}", self.0)
    }
}
