//! A measured curve made ready: [`palpate_core::measured`].

use numpy::PyReadonlyArray1;
use palpate_core::measured as core;
use pyo3::prelude::*;

use crate::array::values;
use crate::error::Raised;
use crate::shared::SharedPath;

/// A measured curve, cut and weighted once for all that it is compared with.
#[pyclass(module = "palpate._core", frozen)]
pub(crate) struct Measured(core::Measured);

#[pymethods]
impl Measured {
    #[new]
    #[pyo3(signature = (x, y, normaliser = "mean_abs", *, weights = None))]
    fn new(
        py: Python<'_>,
        x: PyReadonlyArray1<'_, f64>,
        y: PyReadonlyArray1<'_, f64>,
        normaliser: &str,
        weights: Option<PyReadonlyArray1<'_, f64>>,
    ) -> Result<Self, Raised> {
        let (x, y, weights) = (values(&x), values(&y), weights.as_ref().map(values));
        let normaliser = normaliser.parse()?;
        Ok(Self(py.detach(|| core::Measured::new(&x, &y, normaliser, weights.as_deref()))?))
    }

    fn along(
        &self,
        py: Python<'_>,
        sim_x: PyReadonlyArray1<'_, f64>,
    ) -> Result<SharedPath, Raised> {
        let sim_x = values(&sim_x);
        Ok(SharedPath(py.detach(|| self.0.along(&sim_x))?))
    }
}
