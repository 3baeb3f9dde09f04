//! From a share of a range to a value in it.

use crate::error::{Error, SamplingError};

/// lower · (upper / lower)^share: equal shares are equal factors.
///
/// The value is between the two ends and is exactly `lower` at 0 and `upper` at 1. The power comes
/// from a pure Rust `libm`, so its bits are the same on every platform.
///
/// # Errors
/// [`SamplingError::NoLogarithm`] if an end is 0, NaN or infinite or they differ in sign, or their
/// quotient is beyond the range of numbers; [`SamplingError::OutsideCube`] if a share is outside 0 to 1.
///
/// # Examples
/// ```
/// use palpate_core::scale::geometric;
/// assert_eq!(geometric(&[0.0, 0.5, 1.0], 1.0, 100.0)?, [1.0, 10.0, 100.0]);
/// assert_eq!(geometric(&[0.5], -4.0, -1.0)?, [-2.0]);
/// # Ok::<(), palpate_core::Error>(())
/// ```
pub fn geometric(shares: &[f64], lower: f64, upper: f64) -> Result<Vec<f64>, Error> {
    let factor = upper / lower;
    if !(factor > 0.0 && factor.is_finite() && lower.is_finite()) {
        return Err(SamplingError::NoLogarithm { lower, upper }.into());
    }
    if let Some(row) = shares.iter().position(|x| !(0.0..=1.0).contains(x)) {
        return Err(SamplingError::OutsideCube { row, column: 0, value: shares[row] }.into());
    }
    let (least, most) = if lower < upper { (lower, upper) } else { (upper, lower) };
    let value = |share: f64| {
        if share >= 1.0 { upper } else { (lower * libm::pow(factor, share)).clamp(least, most) }
    };
    Ok(shares.iter().map(|share| value(*share)).collect())
}
