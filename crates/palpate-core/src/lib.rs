//! Numerical kernels of palpate, free of Python.
//!
//! | module | kernel |
//! |---|---|
//! | [`curve`] | a measured or simulated curve as a path: monotone branches, interpolation along them |
//! | [`nmse`] | normalised mean squared error between a simulated and a measured curve |
//! | [`measured`] | a measured curve prepared for many simulated ones |
//! | [`shared`] | many simulated curves on one path, in O(n) per curve |
//! | [`gradient`] | derivatives of their NMSE in each simulated value |
//! | [`lhs`] | Latin hypercube designs, the same bits on every platform |
//! | [`nested`] | Latin hypercubes that are extended and keep their sets |
//! | [`optimise`] | designs optimised for discrepancy, distance or correlation |
//! | [`owen`] | scrambling of Sobol' points |
//! | [`scale`] | logarithmic ranges |
//! | [`error`] | errors in the input, with their place |
//!
//! The kernels are independent of units: abscissae and ordinates may be mm and N, degrees and N·mm, or any
//! other pair, as long as the simulated and the measured curve share them.

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
mod readme {}

mod batch;
pub mod curve;
mod design;
pub mod error;
pub mod gradient;
mod knots;
pub mod lhs;
pub mod measured;
pub mod nested;
pub mod nmse;
pub mod optimise;
pub mod owen;
mod quadratic_form;
mod rng;
pub mod scale;
pub mod shared;
mod swap;

pub use error::{CurveError, Error, SamplingError, ScoringError};
pub use measured::Measured;
pub use shared::SharedPath;

/// A count as a real number.
#[expect(clippy::cast_precision_loss, reason = "exact up to 2^53, more than memory can hold")]
pub(crate) fn real(count: usize) -> f64 {
    count as f64
}
