//! Errors of the kernels as Python exceptions.

use pyo3::exceptions::PyValueError;
use pyo3::{PyErr, import_exception};

import_exception!(numpy.linalg, LinAlgError);
import_exception!(palpate.errors, CurveError);
import_exception!(palpate.errors, SamplingError);
import_exception!(palpate.errors, ScoringError);

/// An error of a kernel on its way to Python.
pub(crate) enum Raised {
    Core(palpate_core::Error),
    Elements(palpate_elements::Error),
    Sparse(palpate_sparse::Error),
}

impl From<palpate_core::Error> for Raised {
    fn from(error: palpate_core::Error) -> Self {
        Self::Core(error)
    }
}

impl From<palpate_elements::Error> for Raised {
    fn from(error: palpate_elements::Error) -> Self {
        Self::Elements(error)
    }
}

impl From<palpate_sparse::Error> for Raised {
    fn from(error: palpate_sparse::Error) -> Self {
        Self::Sparse(error)
    }
}

impl From<Raised> for PyErr {
    fn from(raised: Raised) -> Self {
        match raised {
            Raised::Core(error) => {
                let message = error.to_string();
                match error {
                    palpate_core::Error::Curve(_) => CurveError::new_err(message),
                    palpate_core::Error::Scoring(_) => ScoringError::new_err(message),
                    palpate_core::Error::Sampling(_) => SamplingError::new_err(message),
                    // An error that a later core may add is a mistake in the input too.
                    _ => PyValueError::new_err(message),
                }
            }
            Raised::Elements(error) => PyValueError::new_err(error.to_string()),
            Raised::Sparse(error @ palpate_sparse::Error::Input(_)) => {
                PyValueError::new_err(error.to_string())
            }
            Raised::Sparse(error) => LinAlgError::new_err(error.to_string()),
        }
    }
}
