//! Owen's scrambling of a digital net such as Sobol's.

use crate::design::checked_rows;
use crate::error::Error;
use crate::rng::mixed;

const SALT: u64 = 0x7363_7261_6d62_6c65;
/// Binary digits scrambled.
const DIGITS: u32 = 32;
/// 2^32.
const CELLS: f64 = 4_294_967_296.0;

/// The points of a digital net in base 2, `d` parameters a row, scrambled as Owen (1995) does.
///
/// Each binary digit of a value is flipped or not, as decided at random, once for the column, the
/// digit and all digits before it (nested uniform scrambling). So the net stays a net, each point
/// is uniform in the cube, and a longer net of the same seed starts with the shorter one's points.
/// 32 digits count; a value ends in the centre of its cell of width 2^−32, inside (0, 1). The
/// decisions are hashes of whole numbers: a seed gives the same bits on every platform.
///
/// # Errors
/// [`SamplingError`](crate::SamplingError) if `points` is not one or more rows of `d` values
/// between 0 and 1.
///
/// # Examples
/// ```
/// use palpate_core::owen::scramble;
/// let mut column = scramble(&[0.0, 0.5, 0.75, 0.25], 1, 2024)?;
/// column.sort_by(f64::total_cmp);
/// let quarters: Vec<f64> = column.iter().map(|x| (4.0 * x).floor()).collect();
/// assert_eq!(quarters, [0.0, 1.0, 2.0, 3.0]);
/// # Ok::<(), palpate_core::Error>(())
/// ```
pub fn scramble(points: &[f64], d: usize, seed: u64) -> Result<Vec<f64>, Error> {
    checked_rows(points, d)?;
    let keys: Vec<u64> = (0..d as u64).map(|k| mixed(mixed(seed ^ mixed(SALT)) ^ k)).collect();
    Ok(points.iter().zip(keys.iter().cycle()).map(|(x, key)| scrambled(*x, *key)).collect())
}

fn scrambled(value: f64, key: u64) -> f64 {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 2^32 - 1")]
    let digits = (value * CELLS).min(CELLS - 1.0) as u64;
    let mut flips = 0;
    for digit in (0..DIGITS).rev() {
        // A leading one keeps a prefix of zeros apart from a shorter one.
        let prefix = (digits | (1 << DIGITS)) >> (digit + 1);
        flips |= (mixed(key ^ prefix) >> 63) << digit;
    }
    #[expect(clippy::cast_precision_loss, reason = "33 bits fit the mantissa")]
    let centre = (digits ^ flips) as f64 + 0.5;
    centre / CELLS
}
