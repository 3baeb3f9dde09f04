//! Errors of the core as the exceptions of `palpate.errors`.

use palpate_core::Error;
use pyo3::{PyErr, import_exception};

import_exception!(palpate.errors, CurveError);
import_exception!(palpate.errors, SamplingError);
import_exception!(palpate.errors, ScoringError);

/// An error of the core on its way to Python.
pub(crate) struct Raised(Error);

impl<E: Into<Error>> From<E> for Raised {
    fn from(error: E) -> Self {
        Self(error.into())
    }
}

impl From<Raised> for PyErr {
    fn from(Raised(error): Raised) -> Self {
        let message = error.to_string();
        match error {
            Error::Curve(_) => CurveError::new_err(message),
            Error::Scoring(_) => ScoringError::new_err(message),
            Error::Sampling(_) => SamplingError::new_err(message),
        }
    }
}
