//! The gradient of the NMSE with respect to the simulated values.

use crate::SharedPath;
use crate::batch::{self, Scratch};
use crate::curve::Interpolant;
use crate::error::Error;
use crate::knots::Place;
use crate::nmse::{Score, Scores};
use crate::pchip;
use crate::shared::{NOTHING_REACHED, Row, reached};

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
    /// use palpate_core::{Measured, nmse::Comparison};
    /// let measured = Measured::new(&[0.0, 2.0], &[0.0, 4.0], &Comparison::default())?;
    /// let out = measured.along(&[0.0, 2.0])?.gradient(&[0.0, 6.0], 1, 1)?;
    /// assert!((out.scores.nmse[0] - 0.5).abs() < 1e-15 && (out.gradient[1] - 0.5).abs() < 1e-15);
    /// # Ok::<(), palpate_core::Error>(())
    /// ```
    pub fn gradient(&self, sim: &[f64], n_sets: usize, threads: usize) -> Result<Gradients, Error> {
        let n = self.n_values();
        batch::check_shape(sim, n_sets, n)?;
        let [nmse, coverage, gradient] =
            batch::rows([1, 1, n], n_sets, threads, |set, [nmse, coverage, gradient], scratch| {
                let score = self.gradient_row(set, &sim[set * n..][..n], gradient, scratch)?;
                (nmse[0], coverage[0]) = (score.nmse, score.coverage);
                Ok(())
            })?;
        Ok(Gradients { scores: Scores { nmse, coverage }, gradient })
    }

    fn gradient_row(
        &self,
        set: usize,
        sim: &[f64],
        gradient: &mut [f64],
        scratch: &mut Scratch,
    ) -> Result<Score, Error> {
        if let (Some(moments), None) = (&self.moments, &self.knots)
            && let Some(nmse) = moments.gradient(sim, gradient)
        {
            return Ok(Score { nmse, coverage: self.coverage() });
        }
        let Some(n) = reached(set, sim)? else {
            let score = self.score_whole(sim, scratch);
            self.add_gradient(sim, &scratch.values, gradient);
            return Ok(score);
        };
        gradient.fill(f64::NAN);
        let Ok(path) = self.measured.along(&self.sim_x[..n]) else {
            return Ok(NOTHING_REACHED);
        };
        path.gradient_row(set, &sim[..n], &mut gradient[..n], scratch)
    }

    /// Gradient of the curve `sim` whose ordinates at the measured points are `values`.
    fn add_gradient(&self, sim: &[f64], values: &[f64], gradient: &mut [f64]) {
        gradient.fill(0.0);
        let slope = |row: &Row, value: f64| {
            let error = (value - row.exp) * row.factor;
            2.0 * error * row.factor / self.covered
        };
        let slopes = self.rows.iter().zip(values).map(|(row, &value)| {
            // A point that is not reached has no value.
            if row.factor > 0.0 { slope(row, value) } else { 0.0 }
        });
        match self.measured.interpolant {
            Interpolant::Linear => {
                for (row, slope) in self.rows.iter().zip(slopes) {
                    gradient[row.lower] += (1.0 - row.share) * slope;
                    gradient[row.upper] += row.share * slope;
                }
            }
            Interpolant::Pchip => {
                let mut backward = pchip::Backward::new(&self.places.legs, sim);
                for (place, slope) in self.places.points.iter().zip(slopes) {
                    if let Some(Place { leg, knot, share }) = *place {
                        backward.add(leg, knot, share, slope);
                    }
                }
                backward.into_gradient(gradient);
            }
        }
    }
}
