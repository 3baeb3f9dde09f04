//! Latin hypercubes that grow: the sets already there stay, bit for bit.

use crate::design::checked_rows;
use crate::error::{Error, SamplingError};
use crate::lhs::{LARGEST_DESIGN, inside, shuffle};
use crate::real;
use crate::rng::Rng;

const SALT: u64 = 0x6578_7465_6e64_6564;

/// A Latin hypercube of `n_total` sets of `d` parameters whose first rows are `points`.
///
/// In every column each of the n_total strata holds one value in the end: the new sets take the
/// strata that `points` leaves empty, in random order, at a random place in each or, if `centred`,
/// at its centre. A Latin hypercube can grow to any multiple of its sets; another number will do if
/// no two of its values share one of the finer strata. A seed gives the same bits on every platform.
///
/// # Errors
/// [`SamplingError`] if `points` is not one or more rows of `d` values between 0 and 1, `n_total`
/// is not larger than their number, or two of them share a stratum.
///
/// # Examples
/// ```
/// use palpate_core::lhs::latin_hypercube;
/// use palpate_core::nested::extend_latin_hypercube;
/// let four = latin_hypercube(4, 2, 2024, false)?;
/// let eight = extend_latin_hypercube(&four, 2, 8, 2024, false)?;
/// assert_eq!(eight[..8], four);
/// # Ok::<(), palpate_core::Error>(())
/// ```
pub fn extend_latin_hypercube(
    points: &[f64],
    d: usize,
    n_total: usize,
    seed: u64,
    centred: bool,
) -> Result<Vec<f64>, Error> {
    let n = checked_rows(points, d)?;
    if n_total <= n {
        return Err(SamplingError::NothingToAdd { n_total, n }.into());
    }
    let too_large = SamplingError::DesignTooLarge { n: n_total, d, limit: LARGEST_DESIGN };
    let n_values = n_total.checked_mul(d).filter(|&m| m <= LARGEST_DESIGN).ok_or(too_large)?;

    let mut rng = Rng::salted(seed, SALT ^ real(n_total).to_bits());
    let mut design = points.to_vec();
    design.resize(n_values, 0.0);
    for column in 0..d {
        let mut empty = empty_strata(&points[column..], d, n_total)
            .map_err(|(first, row)| SamplingError::SharedStratum { column, first, row, n_total })?;
        shuffle(&mut empty, &mut rng);
        for (row, stratum) in (n..).zip(empty) {
            let drawn = rng.unit();
            let place = if centred { 0.5 } else { drawn };
            design[row * d + column] = inside(stratum, place, n_total);
        }
    }
    Ok(design)
}

/// Strata that hold no value of the column, or two rows that share one.
fn empty_strata(column: &[f64], d: usize, n_total: usize) -> Result<Vec<u32>, (usize, usize)> {
    let mut holder = vec![None; n_total];
    for (row, &value) in column.iter().step_by(d).enumerate() {
        let at = stratum(value, n_total);
        if let Some(first) = holder[at].replace(row) {
            return Err((first, row));
        }
    }
    let empty = (0..).zip(&holder).filter(|(_, row)| row.is_none());
    Ok(empty.map(|(stratum, _)| stratum).collect())
}

/// The stratum [k/n, (k + 1)/n) that holds `value`; 1 belongs to the last.
fn stratum(value: f64, n: usize) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 2^28")]
    let near = ((value * real(n)) as usize).min(n - 1);
    // Rounding may carry the product across a border.
    if real(near) / real(n) > value {
        near - 1
    } else if real(near + 1) / real(n) <= value && near + 1 < n {
        near + 1
    } else {
        near
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn borders_belong_to_the_stratum_above() {
        for n in 1..200_usize {
            for k in 0..n {
                let border = real(k) / real(n);
                assert_eq!(stratum(border, n), k);
                assert_eq!(stratum(border.next_up(), n), k);
                assert_eq!(stratum((real(k + 1) / real(n)).next_down(), n), k);
            }
            assert_eq!(stratum(1.0, n), n - 1);
        }
    }
}
