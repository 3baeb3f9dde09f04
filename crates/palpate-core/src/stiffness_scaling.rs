//! Stiffness scaling: the multiple of a simulated curve that scores best.
//!
//! If all moduli are multiplied by s, so is the force. So one simulation scores all its
//! multiples.

use crate::SharedPath;
use crate::batch::{Scratch, check_shape, reached};
use crate::curve::LARGEST;
use crate::error::{Error, ScoringError};
use crate::nmse::{Score, Scores};
use crate::shared::NOTHING_REACHED;

/// The scale of each curve of a batch at which it scores best.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct BestScales {
    /// The factor on the curve; NaN where the curve is zero.
    pub scale: Vec<f64>,
    /// NMSE and coverage at that scale.
    pub scores: Scores,
}

impl SharedPath {
    /// The scale in `bounds` at which each curve of a batch scores best, and its score there.
    ///
    /// The NMSE of s · sim is a parabola in s, with its minimum at ⟨sim, exp⟩/⟨sim, sim⟩ in the
    /// weighted inner product over the covered points; beyond a bound the bound is best.
    ///
    /// # Errors
    /// As for [`SharedPath::score`]; [`ScoringError::ScaleRange`] if the bounds are no range.
    pub fn best_scale(
        &self,
        sim: &[f64],
        n_sets: usize,
        bounds: (f64, f64),
    ) -> Result<BestScales, Error> {
        let (lower, upper) = bounds;
        if !(lower <= upper && lower < f64::INFINITY && upper > f64::NEG_INFINITY) {
            return Err(ScoringError::ScaleRange { lower, upper }.into());
        }
        let n = self.n_values();
        check_shape(sim, n_sets, n)?;
        let scratch = &mut Scratch::default();
        let mut scores = Scores { nmse: vec![0.0; n_sets], coverage: vec![0.0; n_sets] };
        let mut scale = vec![0.0; n_sets];
        for (set, sim) in sim.chunks_exact(n).enumerate() {
            let (best, score) = self.best_scale_row(set, sim, bounds, scratch)?;
            (scale[set], scores.nmse[set], scores.coverage[set]) =
                (best, score.nmse, score.coverage);
        }
        Ok(BestScales { scale, scores })
    }

    fn best_scale_row(
        &self,
        set: usize,
        sim: &[f64],
        bounds: (f64, f64),
        scratch: &mut Scratch,
    ) -> Result<(f64, Score), Error> {
        if let Some(y) = self.at_knots(sim, scratch)
            && let Some((scale, nmse)) = self.quadratic_form.best_scale(y, bounds.0, bounds.1)
        {
            return Ok((scale, Score { nmse, coverage: self.coverage() }));
        }
        if let Some(n) = reached(set, sim)? {
            return match self.measured.along(&self.sim_x[..n]) {
                Ok(path) => path.best_scale_row(set, &sim[..n], bounds, scratch),
                Err(_) => Ok((f64::NAN, NOTHING_REACHED)),
            };
        }
        self.score_whole(sim, scratch);
        let values = &mut scratch.values[..self.measured.n_points()];
        let scale = self.scale_of_values(values, bounds);
        for value in &mut *values {
            let scaled = *value * if scale.is_nan() { 0.0 } else { scale };
            // A bound may overflow; infinity would give NaN with a weight of 0.
            *value = scaled.clamp(-LARGEST, LARGEST);
        }
        Ok((scale, self.measured.target.score(values)))
    }

    fn scale_of_values(&self, values: &[f64], (lower, upper): (f64, f64)) -> f64 {
        let target = &self.measured.target;
        // Dividing by the largest first keeps squares from over- and underflowing.
        let largest_of = |of: &[f64]| of.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let (largest, largest_factor) = (largest_of(values), largest_of(&target.factors));
        let (mut with_exp, mut with_self) = (0.0, 0.0);
        for ((value, exp), factor) in values.iter().zip(&target.exp).zip(&target.factors) {
            if !value.is_nan() {
                let share = value / largest;
                let weight = (factor / largest_factor).powi(2);
                with_exp += weight * share * exp;
                with_self += weight * share * share;
            }
        }
        (with_exp / with_self / largest).clamp(lower, upper)
    }
}
