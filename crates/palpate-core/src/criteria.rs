//! How well the sets of a design fill the unit cube.
//!
//! | name here | quantity |
//! |---|---|
//! | `points` | the design, row after row: n sets of d parameters |
//! | [`centred_discrepancy`] | CD², the squared centred L2 discrepancy of Hickernell (1998) |
//! | [`least_distance`] | Euclidean distance of the two closest sets |
//! | [`largest_correlation`] | largest absolute correlation of two parameters |

use crate::design::Columns;
use crate::error::{Error, SamplingError};
use crate::swap::{Correlation, Discrepancy, Distance, Swappable};

/// What an optimised design is optimised for.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Criterion {
    /// Least [`centred_discrepancy`]: every box holds its share of the sets.
    CentredDiscrepancy,
    /// Largest [`least_distance`], by way of φp = (Σ distance^−p)^(1/p) with p = 20.
    Maximin,
    /// Correlations closest to these (d, d), row after row, in the sum of squares; to none if left
    /// out.
    Correlation(Option<Vec<f64>>),
}

impl Criterion {
    /// The criterion called `cd`, `maximin` or `correlation`.
    ///
    /// # Errors
    /// [`SamplingError::UnknownCriterion`] for any other name.
    pub fn named(name: &str) -> Result<Self, Error> {
        match name {
            "cd" => Ok(Self::CentredDiscrepancy),
            "maximin" => Ok(Self::Maximin),
            "correlation" => Ok(Self::Correlation(None)),
            _ => Err(SamplingError::UnknownCriterion { name: name.to_owned() }.into()),
        }
    }
}

/// CD², the squared centred L2 discrepancy; less is more uniform. O(n² d).
///
/// With z = x − ½, of n sets in d parameters,
///
/// (13/12)^d − 2/n Σ_i Π_k (1 + ½|z_ik| − ½ z_ik²)
/// \+ 1/n² Σ_ij Π_k (1 + ½|z_ik| + ½|z_jk| − ½|z_ik − z_jk|).
///
/// # Errors
/// [`SamplingError`] if `points` is not one or more rows of `d` values between 0 and 1.
///
/// # Examples
/// ```
/// use palpate_core::criteria::centred_discrepancy;
/// let centre = centred_discrepancy(&[0.5], 1)?;
/// assert!((centre - 1.0 / 12.0).abs() < 1e-15);
/// # Ok::<(), palpate_core::Error>(())
/// ```
pub fn centred_discrepancy(points: &[f64], d: usize) -> Result<f64, Error> {
    Ok(Discrepancy.value(&Columns::of(points, d)?))
}

/// Euclidean distance of the two closest sets; infinite for a single set. O(n² d).
///
/// # Errors
/// As for [`centred_discrepancy`].
///
/// # Examples
/// ```
/// use palpate_core::criteria::least_distance;
/// assert_eq!(least_distance(&[0.0, 0.0, 0.3, 0.4, 1.0, 1.0], 2)?, 0.5);
/// # Ok::<(), palpate_core::Error>(())
/// ```
pub fn least_distance(points: &[f64], d: usize) -> Result<f64, Error> {
    Ok(Distance::least(&Columns::of(points, d)?))
}

/// Largest absolute correlation of two different parameters; 0 for a single one. O(n d²).
///
/// A parameter that does not vary counts as uncorrelated.
///
/// # Errors
/// As for [`centred_discrepancy`].
///
/// # Examples
/// ```
/// use palpate_core::criteria::largest_correlation;
/// let falling = largest_correlation(&[0.1, 0.9, 0.5, 0.5, 0.9, 0.1], 2)?;
/// assert!((falling - 1.0).abs() < 1e-15);
/// # Ok::<(), palpate_core::Error>(())
/// ```
pub fn largest_correlation(points: &[f64], d: usize) -> Result<f64, Error> {
    let columns = Columns::of(points, d)?;
    let correlation = Correlation::new(&columns, None)?;
    Ok(correlation.matrix(&columns).into_iter().fold(0.0, |most, r| most.max(r.abs())))
}
