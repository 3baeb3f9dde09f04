//! A factor in double precision, or in single precision of a scaled matrix.

#![expect(
    clippy::inline_always,
    reason = "only what is inlined into a dispatch is compiled for the processor at hand"
)]

use std::str::FromStr;

use pulp::{Arch, NullaryFnOnce};

use crate::error::{Error, InputError};
use crate::factor::Factor;
use crate::krylov::{Cycle, Iterated, iterate};
use crate::pattern::Pattern;
use crate::rows::Rows;
use crate::smoother::{Smoother, Work};
use crate::space::Space;
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
    pub(crate) fn analyse(
        pattern: &Pattern,
        precision: Precision,
        order: Option<&[u32]>,
    ) -> Result<Self, InputError> {
        Ok(match precision {
            Precision::Double => Self::Double(Factor::analyse(pattern, order)?),
            Precision::Single => {
                let factor = Factor::analyse(pattern, order)?;
                Self::Single { factor, scales: vec![1.0; pattern.n()] }
            }
        })
    }

    /// Unknowns in the order of elimination.
    pub(crate) fn order(&self) -> &[u32] {
        match self {
            Self::Double(factor) => factor.order(),
            Self::Single { factor, .. } => factor.order(),
        }
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
        match self {
            Self::Double(factor) => {
                let mut solution = rhs.to_vec();
                factor.solve(&mut solution);
                solution
            }
            Self::Single { factor, scales } => {
                let size = power_of_two(rhs.iter().fold(0.0, |most: f64, v| most.max(v.abs())));
                let mut scaled: Vec<f32> =
                    rhs.iter().zip(scales).map(|(r, s)| f32::rounded(r * s / size)).collect();
                factor.solve(&mut scaled);
                let back = |(x, s): (&f32, &f64)| f64::from(*x) * s * size;
                scaled.iter().zip(scales).map(back).collect()
            }
        }
    }
}

/// How far a cycle in single precision lessens a residual without wasting steps.
const LEAST: f64 = 1e-5;

/// A matrix to solve with: its `data` and those of the `factored` matrix nearby, by the same rows.
#[derive(Clone, Copy)]
pub(crate) struct Nearby<'a> {
    pub(crate) rows: &'a Rows,
    pub(crate) factored: &'a [f64],
    pub(crate) data: &'a [f64],
}

impl Numbers {
    /// Solves by GMRES with this factor as preconditioner.
    pub(crate) fn iterate(
        &self,
        system: Nearby<'_>,
        rhs: &[f64],
        tolerance: f64,
        most_steps: usize,
    ) -> Iterated {
        let Nearby { rows, data, .. } = system;
        match self {
            Self::Double(factor) => {
                let precondition = swept(system, data, in_double(factor, rows.n()));
                let mut cycle = Cycle { rows, values: data, precondition };
                iterate(rows, data, rhs, tolerance, most_steps, 0.0, |r, target, steps| {
                    cycle.run(r, target, steps)
                })
            }
            Self::Single { factor, scales } => {
                let (values, size) = shrunk(data);
                let solve = in_single(factor, scales, size);
                let precondition = swept(system, &values, solve);
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

    /// Solves for right-hand sides (m, n) together, in one space of directions.
    pub(crate) fn iterate_together(
        &self,
        system: Nearby<'_>,
        rhs: &[f64],
        tolerance: f64,
        most_steps: usize,
    ) -> Iterated {
        let Nearby { rows, data, .. } = system;
        match self {
            Self::Double(factor) => {
                let precondition = swept(system, data, in_double(factor, rows.n()));
                Space::new(rows, data, precondition, 0.0).solve(data, rhs, tolerance, most_steps)
            }
            Self::Single { factor, scales } => {
                let (values, size) = shrunk(data);
                let solve = in_single(factor, scales, size);
                let precondition = swept(system, &values, solve);
                let mut space = Space::new(rows, &values, precondition, LEAST).of_part(size);
                space.solve(data, rhs, tolerance, most_steps)
            }
        }
    }
}

/// The data over a power of two near the largest, in single precision, where others could overflow.
fn shrunk(data: &[f64]) -> (Vec<f32>, f64) {
    Arch::new().dispatch(Shrink { data })
}

/// Work of [`shrunk`], compiled for this processor; a closure would not be.
struct Shrink<'a> {
    data: &'a [f64],
}

impl NullaryFnOnce for Shrink<'_> {
    type Output = (Vec<f32>, f64);

    #[inline(always)]
    fn call(self) -> (Vec<f32>, f64) {
        let (chunks, rest) = self.data.as_chunks::<8>();
        let mut most = [0.0_f64; 8];
        for chunk in chunks {
            for (most, value) in most.iter_mut().zip(chunk) {
                *most = most.max(value.abs());
            }
        }
        let size =
            power_of_two(most.iter().chain(rest).fold(0.0, |most: f64, v| most.max(v.abs())));
        let shrink = 1.0 / size;
        (self.data.iter().map(|v| f32::rounded(v * shrink)).collect(), size)
    }
}

/// Solutions (m, n) with a factor.
fn in_double(factor: &Factor<f64>, n: usize) -> impl FnMut(&[f64], &mut [f64]) {
    let mut work = Vec::new();
    move |v, z| {
        factor.apply(v.len() / n, &mut work, |k, i| v[k * n + i], |k, i, x| z[k * n + i] = x);
    }
}

/// Solutions (m, n) with a factor of a scaled matrix, for a matrix over `size`.
fn in_single(factor: &Factor<f32>, scales: &[f64], size: f64) -> impl FnMut(&[f32], &mut [f32]) {
    let n = scales.len();
    let mut work = Vec::new();
    let (before, after): (Vec<f32>, Vec<f32>) =
        scales.iter().map(|s| (f32::rounded(s * size), f32::rounded(*s))).unzip();
    move |v, z| {
        let read = |k: usize, i: usize| v[k * n + i] * before[i];
        factor.apply(v.len() / n, &mut work, read, |k, i, x| z[k * n + i] = x * after[i]);
    }
}

/// Solutions (m, n) with an older factor after a sweep over the rows that changed since.
fn swept<'a, T: Number>(
    system: Nearby<'a>,
    values: &'a [T],
    mut solve: impl FnMut(&[T], &mut [T]) + 'a,
) -> impl FnMut(&[T], &mut [T]) + 'a {
    let rows = system.rows;
    let mut smoother = Smoother::new(rows, system.data, system.factored, values);
    let mut work = Work::new();
    move |v, z| {
        if smoother.sweep(rows, values, v, &mut work) {
            solve(&work.left, z);
            smoother.add(rows.n(), z);
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
