//! One space of directions for several right-hand sides of the same matrix.
//!
//! Generalised conjugate residuals (Eisenstat, Elman & Schultz 1983) by blocks: every solution is a
//! combination of the preconditioned residuals of all right-hand sides so far. What the preconditioner
//! leaves is the same for each, so they share directions, and it is applied to all residuals at once.
//! With Z the directions, A Z = C R and Cᵀ C = 1, the residual is least for x = Z R⁻¹ Cᵀ b. Directions
//! and images are kept in the precision of the factor; residuals are taken in double precision between
//! cycles, which go on in the same space.

use crate::krylov::{Iterated, SAFETY, add, dot, norm};
use crate::rows::Rows;
use crate::triangular_solve::Number;

/// Part of an image outside of those before it, below which rounding is most of it.
const DEPENDENT: f64 = 1e-5;

/// Residuals that give a direction at once: the factor comes out of memory once for all. With four,
/// directions are twice as many: a residual that comes after others finds what slows all of them, of which
/// the space has little before it is large.
const AT_ONCE: usize = 2;

/// Directions Z, orthonormal images C, and the triangle R by columns.
pub(crate) struct Space<'a, T, P> {
    rows: &'a Rows,
    values: &'a [T],
    /// Z = M⁻¹ V for vectors (m, n).
    precondition: P,
    /// How far a cycle lessens a residual.
    least: f64,
    /// The matrix is `size` times the values.
    size: f64,
    directions: Vec<Vec<T>>,
    images: Vec<Vec<T>>,
    /// Images that have given a direction.
    continued: usize,
    triangle: Vec<Vec<f64>>,
}

/// A right-hand side on its way.
struct Side {
    solution: Vec<f64>,
    residual: Vec<f64>,
    /// ‖b‖, and the residual over it.
    size: f64,
    left: f64,
    stalled: bool,
}

impl<'a, T: Number, P: FnMut(&[T], &mut [T])> Space<'a, T, P> {
    pub(crate) fn new(rows: &'a Rows, values: &'a [T], precondition: P, least: f64) -> Self {
        let (directions, images, triangle) = (Vec::new(), Vec::new(), Vec::new());
        let (size, continued) = (1.0, 0);
        Self { rows, values, precondition, least, size, directions, images, continued, triangle }
    }

    /// The same for `size` times the values.
    pub(crate) fn of_part(mut self, size: f64) -> Self {
        self.size = size;
        self
    }

    /// Solutions (m, n) of A x = b with the matrix of these `data` for all `rhs` (m, n), until every
    /// residual is `tolerance` of its b, none falls any more or there are `most_steps` directions.
    pub(crate) fn solve(
        &mut self,
        data: &[f64],
        rhs: &[f64],
        tolerance: f64,
        most_steps: usize,
    ) -> Iterated {
        let n = self.rows.n();
        let mut sides: Vec<Side> = rhs.chunks_exact(n).map(Side::new).collect();
        loop {
            let open = |side: &&mut Side| side.left > tolerance && !side.stalled;
            let mut active: Vec<&mut Side> = sides.iter_mut().filter(open).collect();
            if active.is_empty() {
                break;
            }
            let corrections = self.cycle(&active, tolerance, most_steps);
            for (side, correction) in active.iter_mut().zip(corrections) {
                side.correct(self.rows, data, &correction);
            }
        }
        Iterated {
            residual: sides.iter().fold(0.0, |most, side| most.max(side.left)),
            n_steps: self.directions.len(),
            solution: sides.into_iter().flat_map(|side| side.solution).collect(),
        }
    }

    /// A correction for each residual, up to rounding in the images.
    fn cycle(&mut self, sides: &[&mut Side], tolerance: f64, most_steps: usize) -> Vec<Vec<f64>> {
        let lengths: Vec<f64> = sides.iter().map(|side| norm(&side.residual)).collect();
        let mut left: Vec<Vec<T>> = sides
            .iter()
            .zip(&lengths)
            .map(|(side, length)| side.residual.iter().map(|r| T::rounded(r / length)).collect())
            .collect();
        let mut shares = vec![Vec::new(); sides.len()];
        self.images.iter().for_each(|image| project(image, &mut left, &mut shares));
        let target = |side: &Side| (SAFETY * tolerance / side.left).max(self.least);
        let targets: Vec<f64> = sides.iter().map(|side| target(side)).collect();
        loop {
            let open: Vec<&Vec<T>> = left
                .iter()
                .zip(&targets)
                .filter(|(left, target)| dot(left, left).widened().sqrt() > **target)
                .map(|(left, _)| left)
                .take(AT_ONCE)
                .collect();
            if open.is_empty() || self.directions.len() + open.len() > most_steps {
                break;
            }
            let before = self.images.len();
            self.extend(&open.into_iter().flatten().copied().collect::<Vec<T>>());
            // A residual that its own direction did not lessen gives that once more: on as GMRES does, from
            // the images.
            while self.images.len() == before && self.continued < before {
                let image = self.images[self.continued].clone();
                self.continued += 1;
                self.extend(&image);
            }
            if self.images.len() == before {
                break;
            }
            for image in &self.images[before..] {
                project(image, &mut left, &mut shares);
            }
        }
        let corrections = shares.into_iter().zip(&lengths);
        corrections.map(|(own, length)| self.combined(own, length / self.size)).collect()
    }

    /// Adds the preconditioned residuals (m, n) to the directions, but for those that are dependent.
    fn extend(&mut self, residuals: &[T]) {
        let n = self.rows.n();
        let mut directions = vec![T::default(); residuals.len()];
        (self.precondition)(residuals, &mut directions);
        let mut images = vec![T::default(); residuals.len()];
        self.rows.multiply(self.values, &directions, &mut images);
        for (direction, image) in directions.chunks_exact(n).zip(images.chunks_exact_mut(n)) {
            let size = dot(image, image).widened().sqrt();
            let mut column = Vec::with_capacity(self.images.len() + 1);
            for other in &self.images {
                let part = dot(other, image);
                add(T::default() - part, other, image);
                column.push(part.widened());
            }
            let length = dot(image, image).widened().sqrt();
            // NaN is dependent too.
            if length > DEPENDENT * size && length.is_finite() {
                let scale = T::rounded(1.0 / length);
                column.push(length);
                self.images.push(image.iter().map(|c| *c * scale).collect());
                self.directions.push(direction.to_vec());
                self.triangle.push(column);
            }
        }
    }

    /// `factor` Z R⁻¹ y.
    fn combined(&self, mut y: Vec<f64>, factor: f64) -> Vec<f64> {
        let mut sum = vec![T::default(); self.rows.n()];
        for k in (0..y.len()).rev() {
            let column = &self.triangle[k];
            y[k] /= column[k];
            let own = y[k];
            y.iter_mut().zip(&column[..k]).for_each(|(y, r)| *y -= own * r);
            add(T::rounded(own), &self.directions[k], &mut sum);
        }
        sum.into_iter().map(|x| x.widened() * factor).collect()
    }
}

impl Side {
    fn new(rhs: &[f64]) -> Self {
        let size = norm(rhs);
        let left = if size > 0.0 { 1.0 } else { 0.0 };
        let solution = vec![0.0; rhs.len()];
        Self { solution, residual: rhs.to_vec(), size, left, stalled: false }
    }

    /// Adds a correction if it lessens the residual; stalled if that is not by half.
    fn correct(&mut self, rows: &Rows, data: &[f64], correction: &[f64]) {
        let mut image = vec![0.0; correction.len()];
        rows.multiply(data, correction, &mut image);
        let residual: Vec<f64> = self.residual.iter().zip(image).map(|(r, i)| r - i).collect();
        let left = norm(&residual) / self.size;
        // NaN is no progress either.
        self.stalled = left > 0.5 * self.left || left.is_nan();
        if left < self.left {
            self.solution.iter_mut().zip(correction).for_each(|(x, d)| *x += d);
            (self.residual, self.left) = (residual, left);
        }
    }
}

/// Takes from each vector its part along a unit vector, and keeps how long that was.
fn project<T: Number>(unit: &[T], vectors: &mut [Vec<T>], shares: &mut [Vec<f64>]) {
    for (vector, shares) in vectors.iter_mut().zip(shares) {
        let part = dot(unit, vector);
        add(T::default() - part, unit, vector);
        shares.push(part.widened());
    }
}
