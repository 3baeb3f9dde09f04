//! Latin hypercube designs.
//!
//! | name here | quantity |
//! |---|---|
//! | `n` | number of parameter sets |
//! | `d` | number of parameters |
//! | stratum | one of the n equal parts of (0, 1) |

use crate::error::{Error, SamplingError};
use crate::real;
use crate::rng::Rng;

/// Most values that a design may have: 2 GiB of them.
pub const LARGEST_DESIGN: usize = 1 << 28;

/// Draws a Latin hypercube of `n` sets in the open unit cube of `d` parameters, row after row.
///
/// In every column each of the n strata (k/n, (k + 1)/n) holds exactly one value: at a random place
/// in the stratum, or at its centre if `centred`. The strata are shuffled independently for each
/// column (Fisher–Yates). A seed gives the same bits on every platform; a centred design has the
/// same strata as the other one of its seed, and a wider design begins with the narrower one's
/// columns.
///
/// # Errors
/// [`SamplingError`] if `n` or `d` is 0, or `n · d` exceeds [`LARGEST_DESIGN`].
///
/// # Examples
/// ```
/// use palpate_core::lhs::latin_hypercube;
/// let mut column = latin_hypercube(4, 1, 2024, true)?;
/// column.sort_by(f64::total_cmp);
/// assert_eq!(column, [0.125, 0.375, 0.625, 0.875]);
/// # Ok::<(), palpate_core::Error>(())
/// ```
pub fn latin_hypercube(n: usize, d: usize, seed: u64, centred: bool) -> Result<Vec<f64>, Error> {
    if n == 0 || d == 0 {
        return Err(SamplingError::EmptyDesign { n, d }.into());
    }
    let too_large = SamplingError::DesignTooLarge { n, d, limit: LARGEST_DESIGN };
    let n_values = n.checked_mul(d).filter(|&m| m <= LARGEST_DESIGN).ok_or(too_large.clone())?;
    let n_strata = u32::try_from(n).map_err(|_| too_large)?;

    let mut rng = Rng::new(seed);
    let mut design = vec![0.0; n_values];
    for column in 0..d {
        let strata = shuffled(n_strata, &mut rng);
        for (row, &stratum) in strata.iter().enumerate() {
            let drawn = rng.unit();
            let place = if centred { 0.5 } else { drawn };
            design[row * d + column] = inside(stratum, place, n);
        }
    }
    Ok(design)
}

/// The numbers 0 … n−1 in random order, every order equally likely.
fn shuffled(n: u32, rng: &mut Rng) -> Vec<u32> {
    let mut order: Vec<u32> = (0..n).collect();
    shuffle(&mut order, rng);
    order
}

/// Puts `order`, of at most 2^28 numbers, into random order (Fisher–Yates).
pub(crate) fn shuffle(order: &mut [u32], rng: &mut Rng) {
    let mut bound = u32::try_from(order.len()).unwrap_or(u32::MAX);
    while bound > 1 {
        let chosen = rng.below(bound);
        bound -= 1;
        order.swap(bound as usize, chosen as usize);
    }
}

/// The point at share `place` of a stratum. Rounding may carry a place near the upper end into the
/// next stratum, so it is held below that.
pub(crate) fn inside(stratum: u32, place: f64, n: usize) -> f64 {
    let stratum = f64::from(stratum);
    let end = (stratum + 1.0) / real(n);
    ((stratum + place) / real(n)).min(end.next_down())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_at_the_end_of_a_late_stratum_stays_in_it() {
        assert!(inside((1 << 27) - 1, 1.0 - f64::EPSILON / 2.0, 1 << 27) < 1.0);
    }
}
