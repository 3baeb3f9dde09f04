//! Restarted GMRES with the factor of a nearby matrix as right preconditioner (Saad & Schultz 1986).
//!
//! A cycle runs in the precision of the factor; the residual between cycles is taken in double
//! precision, so that a cycle in single precision is one step of iterative refinement.
#![expect(
    clippy::inline_always,
    reason = "only what is inlined into a dispatch is compiled for the processor at hand"
)]

use pulp::{Arch, NullaryFnOnce};

use crate::panels::{LANES, total};
use crate::rows::Rows;
use crate::triangular_solve::Number;

/// Steps of a cycle, which sets how many vectors are kept.
const CYCLE: usize = 30;

/// Part of the tolerance at which a cycle ends, since its recursive residual drifts.
pub(crate) const SAFETY: f64 = 0.9;

/// Where an iteration ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Iterated {
    /// Solution (n,).
    pub solution: Vec<f64>,
    /// Times that the factor was applied.
    pub n_steps: usize,
    /// ‖b − A x‖ / ‖b‖, measured in double precision.
    pub residual: f64,
}

/// Work arrays of a cycle of one precision.
pub(crate) struct Cycle<'a, T, P> {
    pub(crate) rows: &'a Rows,
    pub(crate) values: &'a [T],
    /// z = M⁻¹ v.
    pub(crate) precondition: P,
}

/// Solves A x = b until the residual is `tolerance` of b, a cycle stalls or the steps are used up.
///
/// `cycle(residual, target, steps)` gives a correction and the steps that it took; it can lessen
/// a residual to `least` of it.
pub(crate) fn iterate(
    rows: &Rows,
    values: &[f64],
    rhs: &[f64],
    tolerance: f64,
    most_steps: usize,
    least: f64,
    mut cycle: impl FnMut(&[f64], f64, usize) -> (Vec<f64>, usize),
) -> Iterated {
    let size = norm(rhs);
    let mut best = Iterated { solution: vec![0.0; rhs.len()], n_steps: 0, residual: 1.0 };
    if size == 0.0 {
        best.residual = 0.0;
        return best;
    }
    let mut residual = rhs.to_vec();
    while best.residual > tolerance && best.n_steps < most_steps {
        let target = (SAFETY * tolerance / best.residual).max(least);
        let (change, n_steps) = cycle(&residual, target, most_steps - best.n_steps);
        best.n_steps += n_steps;
        let solution: Vec<f64> = best.solution.iter().zip(change).map(|(x, d)| x + d).collect();
        rows.multiply(values, &solution, &mut residual);
        for (r, b) in residual.iter_mut().zip(rhs) {
            *r = b - *r;
        }
        let left = norm(&residual) / size;
        let stalled = left > 0.5 * best.residual;
        // NaN is no progress either.
        if left < best.residual {
            (best.solution, best.residual) = (solution, left);
        }
        if stalled || left.is_nan() {
            break;
        }
    }
    best
}

impl<T: Number, P: FnMut(&[T], &mut [T])> Cycle<'_, T, P> {
    /// A correction x with ‖r − A x‖ ≤ target ‖r‖ as far as `most_steps` lead, and the steps taken.
    pub(crate) fn run(
        &mut self,
        residual: &[f64],
        target: f64,
        most_steps: usize,
    ) -> (Vec<f64>, usize) {
        let n = residual.len();
        let size = norm(residual);
        let mut basis: Vec<Vec<T>> = vec![residual.iter().map(|r| T::rounded(r / size)).collect()];
        let mut squares = LeastSquares::new();
        // Kept, so that the factor need not be applied once more to put the correction together.
        let mut preconditioned: Vec<Vec<T>> = Vec::new();
        while preconditioned.len() < most_steps.min(CYCLE) && squares.left() > target {
            let mut z = vec![T::default(); n];
            (self.precondition)(&basis[preconditioned.len()], &mut z);
            let mut next = vec![T::default(); n];
            self.rows.multiply(self.values, &z, &mut next);
            preconditioned.push(z);
            let column = orthogonalised(&basis, &mut next);
            if !squares.push(column) {
                break;
            }
            basis.push(next);
        }
        let mut combined = vec![T::default(); n];
        for (weight, z) in squares.solution().into_iter().zip(&preconditioned) {
            add(T::rounded(weight), z, &mut combined);
        }
        let solution = combined.into_iter().map(|x| x.widened() * size).collect();
        (solution, preconditioned.len())
    }
}

/// Takes from `next` its parts along the basis and makes it a unit vector; its parts and length.
fn orthogonalised<T: Number>(basis: &[Vec<T>], next: &mut [T]) -> Vec<f64> {
    let mut column = Vec::with_capacity(basis.len() + 1);
    for vector in basis {
        let part = dot(vector, next);
        add(T::default() - part, vector, next);
        column.push(part.widened());
    }
    let length = dot(next, next).widened().sqrt();
    let scale = T::rounded(1.0 / length);
    for x in next.iter_mut() {
        *x *= scale;
    }
    column.push(length);
    column
}

/// min ‖e₁ − H y‖ for a Hessenberg matrix that grows by columns, by Givens rotations.
struct LeastSquares {
    /// Columns of the triangle.
    triangle: Vec<Vec<f64>>,
    rotations: Vec<(f64, f64)>,
    rhs: Vec<f64>,
}

impl LeastSquares {
    fn new() -> Self {
        Self { triangle: Vec::new(), rotations: Vec::new(), rhs: vec![1.0] }
    }

    /// Residual of the columns so far.
    fn left(&self) -> f64 {
        self.rhs.last().map_or(0.0, |r| r.abs())
    }

    /// Takes a column with one entry below the triangle; whether another one may follow.
    fn push(&mut self, mut column: Vec<f64>) -> bool {
        let k = self.rotations.len();
        for (i, (cos, sin)) in self.rotations.iter().enumerate() {
            let (upper, lower) = (column[i], column[i + 1]);
            column[i] = cos * upper + sin * lower;
            column[i + 1] = cos * lower - sin * upper;
        }
        let radius = column[k].hypot(column[k + 1]);
        if radius == 0.0 || !radius.is_finite() {
            return false;
        }
        let (cos, sin) = (column[k] / radius, column[k + 1] / radius);
        let follows = column[k + 1] > 0.0;
        column.truncate(k);
        column.push(radius);
        self.triangle.push(column);
        self.rotations.push((cos, sin));
        let last = self.rhs[k];
        self.rhs[k] = cos * last;
        self.rhs.push(-sin * last);
        follows
    }

    fn solution(&self) -> Vec<f64> {
        let n = self.triangle.len();
        let mut y = self.rhs[..n].to_vec();
        for k in (0..n).rev() {
            y[k] /= self.triangle[k][k];
            for i in 0..k {
                y[i] -= self.triangle[k][i] * y[k];
            }
        }
        y
    }
}

pub(crate) fn norm(vector: &[f64]) -> f64 {
    dot(vector, vector).sqrt()
}

pub(crate) fn dot<T: Number>(a: &[T], b: &[T]) -> T {
    Arch::new().dispatch(Dot { a, b })
}

pub(crate) fn add<T: Number>(factor: T, vector: &[T], to: &mut [T]) {
    Arch::new().dispatch(Add { factor, vector, to });
}

/// a · b, compiled for this processor; a closure would not be.
struct Dot<'a, T> {
    a: &'a [T],
    b: &'a [T],
}

impl<T: Number> NullaryFnOnce for Dot<'_, T> {
    type Output = T;

    #[inline(always)]
    fn call(self) -> T {
        let (whole, rest) = self.a.as_chunks::<LANES>();
        let (whole_b, rest_b) = self.b.as_chunks::<LANES>();
        let mut partial = [T::default(); LANES];
        for (a, b) in whole.iter().zip(whole_b) {
            for ((sum, a), b) in partial.iter_mut().zip(a).zip(b) {
                *sum += *a * *b;
            }
        }
        let mut sum = total(partial);
        for (a, b) in rest.iter().zip(rest_b) {
            sum += *a * *b;
        }
        sum
    }
}

struct Add<'a, T> {
    factor: T,
    vector: &'a [T],
    to: &'a mut [T],
}

impl<T: Number> NullaryFnOnce for Add<'_, T> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (to, v) in self.to.iter_mut().zip(self.vector) {
            *to += self.factor * *v;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn least_squares_leave_what_they_say() {
        // H of three columns; `left` is the residual of the solution.
        let columns = [vec![2.0, 1.0], vec![-1.0, 3.0, 0.5], vec![0.25, 1.0, -2.0, 0.75]];
        let mut squares = LeastSquares::new();
        for (k, column) in columns.iter().enumerate() {
            assert!(squares.push(column.clone()));
            let y = squares.solution();
            let mut residual = vec![0.0; k + 2];
            residual[0] = 1.0;
            for (y, column) in y.iter().zip(&columns) {
                column.iter().zip(&mut residual).for_each(|(h, r)| *r -= h * y);
            }
            assert!((norm(&residual) - squares.left()).abs() < 1e-14);
        }
    }
}
