//! What every batch of simulated curves needs.
#![expect(clippy::inline_always, reason = "only what is inlined gets a kernel's instructions")]

use crate::curve::LARGEST;
use crate::error::CurveError;
use crate::knots::{KnotOrdinates, Knots};

/// Room that is reused from curve to curve.
#[derive(Default)]
pub(crate) struct Scratch {
    pub(crate) knots: Vec<Knots>,
    pub(crate) ordinates: KnotOrdinates,
    /// Interpolated ordinates.
    pub(crate) values: Vec<f64>,
}

/// Checks that `sim` is `n_sets` rows of `n_points` values.
pub(crate) fn check_shape(sim: &[f64], n_sets: usize, n_points: usize) -> Result<(), CurveError> {
    let length = sim.len();
    if n_sets.checked_mul(n_points) == Some(length) {
        return Ok(());
    }
    Err(CurveError::BatchShape { length, n_sets, n_points })
}

/// How many values of a curve are there; `None` if all.
pub(crate) fn reached(set: usize, sim: &[f64]) -> Result<Option<usize>, CurveError> {
    if let Some(index) = sim.iter().position(|v| v.abs() > LARGEST) {
        return Err(CurveError::InfiniteInBatch { row: set, index, value: sim[index] });
    }
    let Some(index) = sim.iter().position(|v| v.is_nan()) else { return Ok(None) };
    if sim[index..].iter().any(|v| !v.is_nan()) {
        return Err(CurveError::GapInBatch { row: set, index });
    }
    Ok(Some(index))
}

/// Runs `kernel` with the widest vector instructions of this processor.
///
/// No product is fused with a sum and no sum is reordered by that, so the bits stay the same. A
/// large kernel is a type whose `call` is always inlined, because a large closure may not be.
#[inline(always)]
pub(crate) fn vectorised<K: pulp::NullaryFnOnce>(kernel: K) -> K::Output {
    pulp::Arch::new().dispatch(kernel)
}
