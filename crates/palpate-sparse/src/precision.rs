//! A factor in double precision, or in single precision of a scaled matrix.

use std::str::FromStr;

use crate::error::{Error, InputError};
use crate::factor::Factor;
use crate::krylov::{Cycle, Iterated, iterate};
use crate::pattern::Pattern;
use crate::rows::Rows;
use crate::smoother::{Smoother, Work};
use crate::triangular_solve::Number;

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

    /// Largest relative error with which a known solution may come back from a fresh factor.
    ///
    /// It is about the condition number times the rounding unit, so these admit condition numbers
    /// up to about 10¹¹ and 10⁵; a body that is not held comes back with errors of order 1.
    pub(crate) fn largest_probe_error(self) -> f64 {
        match self {
            Self::Double => 1e-5,
            Self::Single => 1e-2,
        }
    }
}

impl FromStr for Precision {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        [Self::Double, Self::Single]
            .into_iter()
            .find(|p| p.name() == name)
            .ok_or_else(|| InputError::UnknownPrecision { name: name.to_owned() }.into())
    }
}

/// A factorisation with double precision input and output, stored in any precision.
pub(crate) enum Numbers {
    Double(Factor<f64>),
    Single { factor: Factor<f32>, scales: Vec<f64> },
}

impl Numbers {
    pub(crate) fn analyse(pattern: &Pattern, precision: Precision) -> Result<Self, InputError> {
        Ok(match precision {
            Precision::Double => Self::Double(Factor::analyse(pattern)?),
            Precision::Single => {
                let factor = Factor::analyse(pattern)?;
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

    pub(crate) fn factorise(
        &mut self,
        pattern: &Pattern,
        values: &[f64],
    ) -> Result<(), InputError> {
        match self {
            Self::Double(factor) => factor.factorise(pattern, values),
            Self::Single { factor, scales } => {
                *scales = pattern.scales(values);
                factor.factorise(pattern, &pattern.scaled(values, scales))
            }
        }
    }

    /// The solution for one right-hand side.
    pub(crate) fn apply(&self, rhs: &[f64]) -> Vec<f64> {
        let mut solution = vec![0.0; rhs.len()];
        match self {
            Self::Double(factor) => {
                let mut work = vec![0.0; factor.n_work()];
                factor.apply(&mut work, |i| rhs[i], |i, x| solution[i] = x);
            }
            Self::Single { factor, scales } => {
                let mut work = vec![0.0; factor.n_work()];
                let size = power_of_two(rhs.iter().fold(0.0, |most: f64, v| most.max(v.abs())));
                let read = |i: usize| f32::rounded(rhs[i] * scales[i] / size);
                factor.apply(&mut work, read, |i, x| {
                    solution[i] = f64::from(x) * scales[i] * size;
                });
            }
        }
        solution
    }
}

/// How far a cycle in single precision lessens a residual without wasting steps.
const LEAST: f64 = 1e-5;

impl Numbers {
    /// Solves with another matrix, of these `data`, by GMRES with this factor, of the matrix
    /// `factored`, as preconditioner.
    pub(crate) fn iterate(
        &self,
        rows: &Rows,
        factored: &[f64],
        data: &[f64],
        rhs: &[f64],
        tolerance: f64,
        most_steps: usize,
    ) -> Iterated {
        match self {
            Self::Double(factor) => {
                let mut work = vec![0.0; factor.n_work()];
                let solve =
                    |v: &[f64], z: &mut [f64]| factor.apply(&mut work, |i| v[i], |i, x| z[i] = x);
                let precondition = swept(rows, data, factored, data, solve);
                let mut cycle = Cycle { rows, values: data, precondition };
                iterate(rows, data, rhs, tolerance, most_steps, 0.0, |r, target, steps| {
                    cycle.run(r, target, steps)
                })
            }
            Self::Single { factor, scales } => {
                // In single precision, numbers far from 1 could overflow.
                let size = power_of_two(data.iter().fold(0.0, |most: f64, v| most.max(v.abs())));
                let shrink = 1.0 / size;
                let values: Vec<f32> = data.iter().map(|v| f32::rounded(v * shrink)).collect();
                let mut work = vec![0.0; factor.n_work()];
                let (before, after): (Vec<f32>, Vec<f32>) =
                    scales.iter().map(|s| (f32::rounded(s * size), f32::rounded(*s))).unzip();
                let solve = |v: &[f32], z: &mut [f32]| {
                    factor.apply(&mut work, |i| v[i] * before[i], |i, x| z[i] = x * after[i]);
                };
                let precondition = swept(rows, data, factored, &values, solve);
                let mut cycle = Cycle { rows, values: &values, precondition };
                iterate(rows, data, rhs, tolerance, most_steps, LEAST, |r, target, steps| {
                    let (mut x, n_steps) = cycle.run(r, target, steps);
                    for x in &mut x {
                        *x /= size;
                    }
                    (x, n_steps)
                })
            }
        }
    }
}

/// A solution with an older factor after a sweep over the rows that changed since.
fn swept<'a, T: Number>(
    rows: &'a Rows,
    data: &[f64],
    factored: &[f64],
    values: &'a [T],
    mut solve: impl FnMut(&[T], &mut [T]) + 'a,
) -> impl FnMut(&[T], &mut [T]) + 'a {
    let mut smoother = Smoother::new(rows, data, factored, values);
    let mut work = Work::new(rows.n());
    move |v, z| {
        if smoother.sweep(rows, values, v, &mut work) {
            solve(&work.left, z);
            smoother.add(z);
        } else {
            solve(v, z);
        }
    }
}

/// A power of two near `size`, by which scaling is exact; 1 for 0 and what is not finite.
pub(crate) fn power_of_two(size: f64) -> f64 {
    let power = size.log2().round().exp2();
    if power.is_normal() { power } else { 1.0 }
}
