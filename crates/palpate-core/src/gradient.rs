//! The gradient of the NMSE with respect to the simulated values.

use crate::SharedPath;
use crate::batch::{Scratch, check_shape, reached};
use crate::error::Error;
use crate::nmse::{Score, Scores};
use crate::shared::{NOTHING_REACHED, Row};

/// NMSE of each curve of a batch and its gradient.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Gradients {
    /// NMSE and coverage of each curve.
    pub scores: Scores,
    /// ∂NMSE/∂sim (`n_sets`, n), row after row; NaN at values that the simulation did not get to.
    pub gradient: Vec<f64>,
}

impl SharedPath {
    /// NMSE of each curve of a batch with its gradient with respect to the simulated values.
    ///
    /// # Errors
    /// As for [`SharedPath::score`].
    ///
    /// # Examples
    /// ```
    /// use palpate_core::{Measured, nmse::Normaliser::MeanAbs};
    /// let measured = Measured::new(&[0.0, 2.0], &[0.0, 4.0], MeanAbs, None)?;
    /// let out = measured.along(&[0.0, 2.0])?.gradient(&[0.0, 6.0], 1)?;
    /// assert!((out.scores.nmse[0] - 0.5).abs() < 1e-15 && (out.gradient[1] - 0.5).abs() < 1e-15);
    /// # Ok::<(), palpate_core::Error>(())
    /// ```
    pub fn gradient(&self, sim: &[f64], n_sets: usize) -> Result<Gradients, Error> {
        let n = self.n_values();
        check_shape(sim, n_sets, n)?;
        let scratch = &mut Scratch::default();
        let mut scores = Scores { nmse: vec![0.0; n_sets], coverage: vec![0.0; n_sets] };
        let mut gradient = vec![0.0; sim.len()];
        let rows = sim.chunks_exact(n).zip(gradient.chunks_exact_mut(n));
        for (set, (sim, gradient)) in rows.enumerate() {
            let score = self.gradient_row(set, sim, gradient, scratch)?;
            (scores.nmse[set], scores.coverage[set]) = (score.nmse, score.coverage);
        }
        Ok(Gradients { scores, gradient })
    }

    fn gradient_row(
        &self,
        set: usize,
        sim: &[f64],
        gradient: &mut [f64],
        scratch: &mut Scratch,
    ) -> Result<Score, Error> {
        if self.knots.is_none()
            && let Some(nmse) = self.quadratic_form.gradient(sim, gradient)
        {
            return Ok(Score { nmse, coverage: self.coverage() });
        }
        let Some(n) = reached(set, sim)? else {
            let score = self.score_whole(sim, scratch);
            self.add_gradient(&scratch.values, gradient);
            return Ok(score);
        };
        gradient.fill(f64::NAN);
        let Ok(path) = self.measured.along(&self.sim_x[..n]) else {
            return Ok(NOTHING_REACHED);
        };
        path.gradient_row(set, &sim[..n], &mut gradient[..n], scratch)
    }

    /// Gradient of a curve whose ordinates at the measured points are `values`.
    fn add_gradient(&self, values: &[f64], gradient: &mut [f64]) {
        gradient.fill(0.0);
        let slope = |row: &Row, value: f64| {
            let error = (value - row.exp) * row.factor;
            2.0 * error * row.factor / self.covered
        };
        for (row, &value) in self.rows.iter().zip(values) {
            // A point that is not reached has no value.
            let slope = if row.factor > 0.0 { slope(row, value) } else { 0.0 };
            gradient[row.lower] += (1.0 - row.share) * slope;
            gradient[row.upper] += row.share * slope;
        }
    }
}
