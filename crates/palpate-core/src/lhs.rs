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
/// same strata as the random one of its seed, and a design of more parameters starts with the same
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
    let mut group = vec![0.0; n * d.min(GROUP)];
    let mut strata: Vec<u32> = (0..n_strata).collect();
    for first in (0..d).step_by(GROUP) {
        let width = GROUP.min(d - first);
        for column in group.chunks_exact_mut(n).take(width) {
            strata.iter_mut().zip(0..).for_each(|(stratum, k)| *stratum = k);
            shuffle(&mut strata, &mut rng);
            for (value, &stratum) in column.iter_mut().zip(&strata) {
                let drawn = rng.unit();
                *value = inside(stratum, if centred { 0.5 } else { drawn }, n);
            }
        }
        for (row, sets) in design.chunks_exact_mut(d).enumerate() {
            for (k, value) in sets[first..first + width].iter_mut().enumerate() {
                *value = group[k * n + row];
            }
        }
    }
    Ok(design)
}

/// Columns drawn before they are put into rows: as many values as fill a line of cache.
const GROUP: usize = 8;

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
    let value = (stratum + place) / real(n);
    if place < SAFE { value } else { value.min(((stratum + 1.0) / real(n)).next_down()) }
}

/// Up to this place no rounding reaches the next stratum, of 2^28 at most.
const SAFE: f64 = 0.999;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_at_the_end_of_a_late_stratum_stays_in_it() {
        assert!(inside((1 << 27) - 1, 1.0 - f64::EPSILON / 2.0, 1 << 27) < 1.0);
    }
}
