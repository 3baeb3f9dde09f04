//! The Python module `palpate._core`: borrows arrays, releases the GIL, maps errors.
//!
//! Each file here wraps the file of the same name in a crate without Python.
#![expect(clippy::needless_pass_by_value, reason = "PyO3 hands borrowed arrays over by value")]

mod array;
mod curve;
mod elements;
mod error;
mod lhs;
mod measured;
mod nested;
mod nmse;
mod optimise;
mod owen;
mod scale;
mod shared;
mod solver;

/// Numerical kernels of palpate.
#[pyo3::pymodule(gil_used = false)]
mod _core {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::curve::{branches, interpolate};
    #[pymodule_export]
    use crate::elements::{Deformation, ElementBlock};
    #[pymodule_export]
    use crate::lhs::latin_hypercube;
    #[pymodule_export]
    use crate::measured::Measured;
    #[pymodule_export]
    use crate::nested::extend_latin_hypercube;
    #[pymodule_export]
    use crate::nmse::{nmse, normaliser};
    #[pymodule_export]
    use crate::optimise::optimise_design;
    #[pymodule_export]
    use crate::owen::owen_scramble;
    #[pymodule_export]
    use crate::scale::geometric;
    #[pymodule_export]
    use crate::shared::SharedPath;
    #[pymodule_export]
    use crate::solver::SparseFactor;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        warn_of_debug_build(module.py())
    }

    /// A debug build is many times slower; a user should notice one.
    fn warn_of_debug_build(py: Python<'_>) -> PyResult<()> {
        if cfg!(debug_assertions) {
            let category = py.get_type::<pyo3::exceptions::PyRuntimeWarning>();
            let message = c"palpate._core is a debug build and slow: build it with --release";
            PyErr::warn(py, &category, message, 1)?;
        }
        Ok(())
    }
}
