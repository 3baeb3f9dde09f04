//! Element forces and stiffnesses: [`palpate_elements`].

use std::sync::Arc;

use numpy::{PyArray1, PyArray3, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3};
use numpy::{PyReadonlyArray4, PyReadwriteArray1, PyReadwriteArray2, PyUntypedArrayMethods};
use palpate_elements as core;
use pyo3::prelude::*;

use crate::array::{shaped, values, writable};
use crate::error::Raised;

/// Elements of one kind with their reference geometry.
#[pyclass(module = "palpate._core", frozen)]
pub(crate) struct ElementBlock(Arc<core::ElementBlock>);

#[pymethods]
impl ElementBlock {
    #[new]
    #[pyo3(signature = (nodes, gradients, volumes, *, mean_dilatation = true, places = None))]
    fn new(
        py: Python<'_>,
        nodes: PyReadonlyArray2<'_, i64>,
        gradients: PyReadonlyArray4<'_, f64>,
        volumes: PyReadonlyArray2<'_, f64>,
        mean_dilatation: bool,
        places: Option<PyReadonlyArray3<'_, i64>>,
    ) -> PyResult<Self> {
        let shape = core::Shape {
            elements: nodes.shape()[0],
            points: volumes.shape()[1],
            nodes: nodes.shape()[1],
        };
        let core::Shape { elements: e, points: q, nodes: n } = shape;
        shaped("gradients", &gradients, &[e, q, n, 3])?;
        shaped("volumes", &volumes, &[e, q])?;
        if let Some(places) = &places {
            shaped("places", places, &[e, shape.freedoms(), shape.freedoms()])?;
        }
        let (nodes, gradients, volumes) = (values(&nodes), values(&gradients), values(&volumes));
        let places = places.as_ref().map(values);
        let block = py.detach(|| {
            let places = places.as_deref();
            core::ElementBlock::new(shape, &nodes, &gradients, &volumes, mean_dilatation, places)
        });
        Ok(Self(Arc::new(block.map_err(Raised::from)?)))
    }

    fn deform(
        &self,
        py: Python<'_>,
        displacements: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Deformation> {
        shaped("displacements", &displacements, &[displacements.shape()[0], 3])?;
        let (displacements, block) = (values(&displacements), Arc::clone(&self.0));
        Ok(Deformation(py.detach(|| block.deform(&displacements)).map_err(Raised::from)?))
    }

    fn __repr__(&self) -> String {
        let core::Shape { elements, points, nodes } = self.0.shape();
        format!("ElementBlock({elements} elements, {points} points, {nodes} nodes)")
    }
}

/// Where the material of a block is stretched to, and in which directions.
#[pyclass(module = "palpate._core", frozen)]
pub(crate) struct Deformation(core::Deformation);

#[pymethods]
impl Deformation {
    #[getter]
    fn stretches<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let core::Shape { elements, points, .. } = self.0.shape();
        PyArray1::from_vec(py, self.0.stretches()).reshape([elements, points, 3])
    }

    #[getter]
    fn least_jacobian(&self) -> f64 {
        self.0.least_jacobian()
    }

    fn add_force(
        &self,
        py: Python<'_>,
        psi_i: PyReadonlyArray3<'_, f64>,
        mut total: PyReadwriteArray2<'_, f64>,
    ) -> PyResult<()> {
        let core::Shape { elements, points, .. } = self.0.shape();
        shaped("psi_i", &psi_i, &[elements, points, 3])?;
        shaped("total", &total, &[total.shape()[0], 3])?;
        let (psi_i, total) = (values(&psi_i), writable("total", &mut total)?);
        Ok(py.detach(|| self.0.add_force(&psi_i, total)).map_err(Raised::from)?)
    }

    fn add_stiffness(
        &self,
        py: Python<'_>,
        psi_i: PyReadonlyArray3<'_, f64>,
        psi_ij: PyReadonlyArray4<'_, f64>,
        mut values: PyReadwriteArray1<'_, f64>,
    ) -> PyResult<()> {
        let core::Shape { elements, points, .. } = self.0.shape();
        shaped("psi_i", &psi_i, &[elements, points, 3])?;
        shaped("psi_ij", &psi_ij, &[elements, points, 3, 3])?;
        let sums = writable("values", &mut values)?;
        let (psi_i, psi_ij) = (crate::array::values(&psi_i), crate::array::values(&psi_ij));
        Ok(py.detach(|| self.0.add_stiffness(&psi_i, &psi_ij, sums)).map_err(Raised::from)?)
    }

    fn __repr__(&self) -> String {
        format!("Deformation(least_jacobian={})", self.0.least_jacobian())
    }
}
