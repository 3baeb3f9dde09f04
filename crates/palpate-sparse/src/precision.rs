//! A factor in double precision, or in single precision of a scaled matrix.

use std::str::FromStr;

use crate::error::{Error, InputError};
use crate::factor::Factor;
use crate::pattern::Pattern;
use crate::solver::Kind;

/// Numbers that a factor is kept in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Precision {
    /// 64 bits.
    #[default]
    Double,
    /// 32 bits: half the memory and time of a factor, for a preconditioner.
    Single,
}

impl Precision {
    /// The name in Python.
    ///
    /// ```
    /// assert_eq!(palpate_sparse::Precision::Single.name(), "single");
    /// ```
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Double => "double",
            Self::Single => "single",
        }
    }

    /// Refinements of a solution at most; each is worth two digits or more in single precision.
    pub(crate) fn most_refinements(self) -> usize {
        match self {
            Self::Double => 1,
            Self::Single => 10,
        }
    }

    /// Largest relative error with which a known solution may come back from a fresh factor.
    ///
    /// It is about the condition number times the rounding unit, so these admit condition numbers
    /// up to about 10¹¹ and 10⁵; a body that is not held comes back with errors of order 1.
    #[must_use]
    pub fn largest_probe_error(self) -> f64 {
        match self {
            Self::Double => 1e-5,
            Self::Single => 1e-2,
        }
    }
}

impl FromStr for Precision {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        [Self::Double, Self::Single].into_iter().find(|p| p.name() == name).ok_or_else(|| {
            let (name, choices) = (name.to_owned(), "double or single");
            InputError::Unknown { what: "precision", name, choices }.into()
        })
    }
}

/// A factorisation that takes and gives double precision, whatever it is kept in.
pub(crate) enum Numbers {
    Double(Factor<f64>),
    Single { factor: Factor<f32>, scales: Vec<f64> },
}

impl Numbers {
    pub(crate) fn analyse(
        pattern: &Pattern,
        kind: Kind,
        precision: Precision,
    ) -> Result<Self, Error> {
        Ok(match precision {
            Precision::Double => Self::Double(Factor::analyse(pattern, kind)?),
            Precision::Single => {
                let factor = Factor::analyse(pattern, kind)?;
                Self::Single { factor, scales: vec![1.0; pattern.n()] }
            }
        })
    }

    pub(crate) fn precision(&self) -> Precision {
        match self {
            Self::Double(_) => Precision::Double,
            Self::Single { .. } => Precision::Single,
        }
    }

    /// The natural size of an unknown: 1 where the matrix is not scaled.
    pub(crate) fn scale(&self, unknown: usize) -> f64 {
        match self {
            Self::Double(_) => 1.0,
            Self::Single { scales, .. } => scales[unknown],
        }
    }

    pub(crate) fn factorise(&mut self, pattern: &Pattern, values: &[f64]) -> Result<(), Error> {
        match self {
            Self::Double(factor) => factor.factorise(pattern, values),
            Self::Single { factor, scales } => {
                *scales = pattern.scales(values);
                factor.factorise(pattern, &pattern.scaled(values, scales))
            }
        }
    }

    /// Replaces every column of `rhs` (n, k), row after row, by its solution.
    pub(crate) fn solve(&self, pattern: &Pattern, rhs: &mut [f64]) -> Result<(), Error> {
        match self {
            Self::Double(factor) => factor.solve(pattern, rhs),
            Self::Single { factor, scales } => {
                let k = rhs.len() / pattern.n();
                let size = power_of_two(rhs.iter().fold(0.0, |most: f64, v| most.max(v.abs())));
                let scale = |i: usize| scales[i / k];
                let mut narrow: Vec<f32> =
                    rhs.iter().enumerate().map(|(i, v)| narrowed(v * scale(i) / size)).collect();
                factor.solve(pattern, &mut narrow)?;
                for (i, (wide, narrow)) in rhs.iter_mut().zip(narrow).enumerate() {
                    *wide = f64::from(narrow) * scale(i) * size;
                }
                Ok(())
            }
        }
    }
}

/// The nearest number in single precision.
#[expect(clippy::cast_possible_truncation, reason = "rounding is what single precision means")]
pub(crate) fn narrowed(value: f64) -> f32 {
    value as f32
}

/// A power of two near `size`, by which scaling is exact; 1 for 0 and what is not finite.
pub(crate) fn power_of_two(size: f64) -> f64 {
    let power = size.log2().round().exp2();
    if power.is_normal() { power } else { 1.0 }
}
