//! NMSE as a quadratic form of the simulated values.
//!
//! | name here | quantity |
//! |---|---|
//! | H | N × n, the linear interpolant: row i holds 1 − share and share at two neighbouring knots |
//! | H, e | both with row i scaled by √weight/(normaliser · √Σ weight), so that NMSE = ‖H y − e‖² |
//! | A = HᵀH | the matrix of second moments: tridiagonal |
//! | R | upper bidiagonal factor of A = RᵀR, found by rotating the rows of H |
//! | f, rest | rotated e: NMSE = ‖R y − f‖² + rest |
//!
//! A and the moments Hᵀe would give yᵀA y − 2 yᵀHᵀe + eᵀe, in which terms of the size of eᵀe cancel
//! when the curves agree. The factor keeps a sum of squares at the same cost, O(n) per curve, and
//! loses no more digits than subtracting the curves point by point does, but for those that
//! [`QuadraticForm::nmse`] watches.
#![expect(clippy::inline_always, reason = "only what is inlined gets a kernel's instructions")]

use crate::nmse::{PARTS, sum_of_parts};

/// The quadratic form of one measured curve on one simulated path.
#[derive(Debug, Clone)]
pub(crate) struct QuadraticForm {
    /// Diagonal of R (n,).
    diagonal: Vec<f64>,
    /// Off-diagonal entries (n − 1,).
    above: Vec<f64>,
    /// f (n,).
    rotated: Vec<f64>,
    /// Squared norms of the columns of H (n,).
    norms: Vec<f64>,
    rest: f64,
    /// ‖e‖².
    of_zeros: f64,
}

/// A scaled row of H and e.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Observation {
    /// Number of the knot before the point.
    pub(crate) knot: usize,
    pub(crate) at_knot: f64,
    pub(crate) at_next: f64,
    pub(crate) exp: f64,
}

/// (S² + ‖e‖²)/NMSE up to which twelve digits are sure, with S² = Σ ‖column of H‖² y².
///
/// To first order the sum of squares is off by a share of 2 c u (S + ‖e‖)/√NMSE, with u = 1.1e-16 and
/// c the few roundings of a rotation and a product. c = 6 makes that 1e-12 at this quotient.
const LARGEST_LOSS: f64 = 3e5;

impl QuadraticForm {
    /// The form of observations in order of their knots.
    pub(crate) fn new(n_knots: usize, observations: &[Observation]) -> Self {
        let mut form = Self {
            diagonal: vec![0.0; n_knots],
            above: vec![0.0; n_knots],
            rotated: vec![0.0; n_knots],
            norms: vec![0.0; n_knots],
            rest: 0.0,
            of_zeros: observations.iter().map(|o| o.exp * o.exp).sum(),
        };
        let mut left_over = [0.0; 2];
        let mut rows = observations.chunk_by(|a, b| a.knot == b.knot).peekable();
        for k in 0..n_knots {
            let own = rows.next_if(|rows| rows[0].knot == k).unwrap_or_default();
            left_over = form.rotate(k, left_over, own);
            let above = if k == 0 { 0.0 } else { form.above[k - 1] };
            form.norms[k] = above * above + form.diagonal[k] * form.diagonal[k];
        }
        form.above.pop();
        form
    }

    /// Rotates the rows that start at knot `k` into R; returns the row left for the next knot.
    fn rotate(&mut self, k: usize, [at_knot, exp]: [f64; 2], rows: &[Observation]) -> [f64; 2] {
        let mut first = [at_knot, 0.0, exp];
        let mut second = [0.0, 0.0];
        for row in rows {
            let mut row = [row.at_knot, row.at_next, row.exp];
            let (c, s) = rotation(first[0], row[0]);
            for (a, b) in first.iter_mut().zip(&mut row) {
                (*a, *b) = (c * *a + s * *b, c * *b - s * *a);
            }
            let (c, s) = rotation(second[0], row[1]);
            second[0] = c * second[0] + s * row[1];
            let exp = c * row[2] - s * second[1];
            second[1] = c * second[1] + s * row[2];
            self.rest += exp * exp;
        }
        [self.diagonal[k], self.above[k], self.rotated[k]] = first;
        second
    }

    /// NMSE of the ordinates `y` at the knots, where the form gives all its digits.
    #[inline(always)]
    pub(crate) fn nmse(&self, y: &[f64]) -> Option<f64> {
        let (sum, size) = self.sums_of_squares(y);
        self.sure(sum + self.rest, size)
    }

    /// `nmse` unless digits of it are lost, or it is no number; `size` is S².
    #[inline(always)]
    fn sure(&self, nmse: f64, size: f64) -> Option<f64> {
        (nmse * LARGEST_LOSS >= size + self.of_zeros && nmse.is_normal()).then_some(nmse)
    }

    /// ‖R y − f‖² and S².
    #[inline(always)]
    fn sums_of_squares(&self, y: &[f64]) -> (f64, f64) {
        let last = self.above.len();
        let (mut sums, mut sizes) = ([0.0; PARTS], [0.0; PARTS]);
        let (diagonals, _) = self.diagonal[..last].as_chunks::<PARTS>();
        let (aboves, _) = self.above.as_chunks::<PARTS>();
        let (rotateds, _) = self.rotated[..last].as_chunks::<PARTS>();
        let (norms, _) = self.norms[..last].as_chunks::<PARTS>();
        let (ys, _) = y[..last].as_chunks::<PARTS>();
        let (nexts, _) = y[1..=last].as_chunks::<PARTS>();
        let rows = diagonals.iter().zip(aboves).zip(rotateds);
        for (((diagonal, above), rotated), ((y, next), norm)) in
            rows.zip(ys.iter().zip(nexts).zip(norms))
        {
            for j in 0..PARTS {
                let error = diagonal[j] * y[j] + above[j] * next[j] - rotated[j];
                sums[j] += error * error;
                sizes[j] += norm[j] * (y[j] * y[j]);
            }
        }
        for (j, k) in (last - last % PARTS..=last).enumerate() {
            let error = self.residual(y, k);
            sums[j] += error * error;
            sizes[j] += self.norms[k] * (y[k] * y[k]);
        }
        (sum_of_parts(sums), sum_of_parts(sizes))
    }

    /// Element `k` of R y − f.
    #[inline(always)]
    fn residual(&self, y: &[f64], k: usize) -> f64 {
        let above = if k < self.above.len() { self.above[k] * y[k + 1] } else { 0.0 };
        self.diagonal[k] * y[k] + above - self.rotated[k]
    }

    /// NMSE as [`QuadraticForm::nmse`], and its gradient 2 Rᵀ(R y − f).
    pub(crate) fn gradient(&self, y: &[f64], gradient: &mut [f64]) -> Option<f64> {
        let nmse = self.nmse(y)?;
        let mut from_before = 0.0;
        for (k, slope) in gradient.iter_mut().enumerate() {
            let residual = 2.0 * self.residual(y, k);
            *slope = self.diagonal[k] * residual + from_before;
            from_before = self.above.get(k).map_or(0.0, |above| above * residual);
        }
        Some(nmse)
    }
}

/// Cosine and sine of the rotation that turns (a, b) into (√(a² + b²), 0).
fn rotation(a: f64, b: f64) -> (f64, f64) {
    if b == 0.0 {
        return (1.0, 0.0);
    }
    let length = (a * a + b * b).sqrt();
    if length > 0.0 { (a / length, b / length) } else { (1.0, 0.0) }
}
