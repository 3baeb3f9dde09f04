//! Correlations of the parameters, and their change.

use super::{Room, Swap, Swappable, sum3};
use crate::design::Columns;

/// Σ over pairs of parameters of correlation².
pub(crate) struct Correlation {
    d: usize,
    mean: Vec<f64>,
    /// 1 / √Σ(x − mean)² of each column, 0 for one that does not vary.
    inverse_spread: Vec<f64>,
    /// Correlations (d, d) as they are, with 0 on the diagonal.
    now: Vec<f64>,
}

impl Correlation {
    pub(crate) fn new(design: &Columns) -> Self {
        let d = design.d;
        let moments = (0..d).map(|k| {
            let column = design.column(k);
            let mean = sum3(column, column, column, |x, _, _| x) / crate::real(design.n);
            let spread = sum3(column, column, column, |x, _, _| (x - mean) * (x - mean)).sqrt();
            // Rounding leaves a trace of spread in a column of equal values.
            (mean, if spread > 1e-12 { 1.0 / spread } else { 0.0 })
        });
        let (mean, inverse_spread) = moments.unzip();
        let mut made = Self { d, mean, inverse_spread, now: Vec::new() };
        made.now = made.matrix(design);
        made
    }

    /// Correlations (d, d) with 0 on the diagonal.
    fn matrix(&self, design: &Columns) -> Vec<f64> {
        let d = self.d;
        let mut matrix = vec![0.0; d * d];
        for a in 0..d {
            for b in 0..a {
                let (x, y) = (design.column(a), design.column(b));
                let (mean_x, mean_y) = (self.mean[a], self.mean[b]);
                let product = sum3(x, y, y, |x, y, _| (x - mean_x) * (y - mean_y));
                matrix[a * d + b] = product * self.inverse_spread[a] * self.inverse_spread[b];
                matrix[b * d + a] = matrix[a * d + b];
            }
        }
        matrix
    }

    /// Change by the swap of the correlation of its column with column `m`.
    fn shift(&self, design: &Columns, Swap { k, i, j }: Swap, m: usize) -> f64 {
        let (x, y) = (design.column(k), design.column(m));
        (x[j] - x[i]) * (y[i] - y[j]) * self.inverse_spread[k] * self.inverse_spread[m]
    }
}

impl Swappable for Correlation {
    fn value(&self, design: &Columns) -> f64 {
        let matrix = self.matrix(design);
        let mut sum = 0.0;
        for a in 0..self.d {
            for b in 0..a {
                let r = matrix[a * self.d + b];
                sum += r * r;
            }
        }
        sum
    }

    /// O(d): (r + δ)² − r² = δ (2 r + δ).
    fn change(&self, design: &Columns, swap: Swap, _room: &mut Room) -> f64 {
        let mut sum = 0.0;
        for m in (0..self.d).filter(|m| *m != swap.k) {
            let shift = self.shift(design, swap, m);
            sum += shift * (2.0 * self.now[swap.k * self.d + m] + shift);
        }
        sum
    }

    /// Called with the design as it was before the swap.
    fn made(&mut self, design: &Columns, swap: Swap) {
        for m in (0..self.d).filter(|m| *m != swap.k) {
            let shift = self.shift(design, swap, m);
            self.now[swap.k * self.d + m] += shift;
            self.now[m * self.d + swap.k] += shift;
        }
    }
}
