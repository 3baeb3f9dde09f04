//! Normalised mean squared error (NMSE) of simulated against measured curves.
//!
//! NMSE = Σ wᵢ (simᵢ − expᵢ)² / (Σ wᵢ · normaliser²); with equal weights (1/N) Σ (sim − exp)² /
//! normaliser².
//!
//! | name here | quantity |
//! |---|---|
//! | `exp` | measured forces F (N) or torques T (N·mm) |
//! | `sim` | simulated ones at the same points |
//! | `normaliser` | positive number with the unit of `exp`, from the whole measured curve |
//! | coverage | share of the weight of the points that the simulation reached |
//!
//! The normaliser always comes from the whole measured curve, without weights, so that a
//! simulation that ended early is measured with the same yardstick as the others.
#![expect(clippy::inline_always, reason = "only what is inlined gets a kernel's instructions")]

use std::fmt;
use std::str::FromStr;

use crate::curve::{self, Named};
use crate::error::{CurveError, Error, ScoringError};
use crate::real;

/// Divisor of the error, recorded with every score.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Normaliser {
    /// mean(|exp|): the default.
    #[default]
    MeanAbs,
    /// |mean(exp)|: the letter of the paper. It cancels on a symmetric twist.
    Mean,
    /// √mean(exp²).
    Rms,
    /// max(exp) − min(exp).
    Range,
    /// Population standard deviation of exp.
    Std,
    /// One unit of exp, which makes the NMSE a plain mean squared error.
    Unit,
}

/// Least admissible |mean(exp)| as a share of the rms.
///
/// A uniform error of 10 % scores 0.01 · (rms/normaliser)², so below this share it would score more
/// than 1, as much as predicting nothing at all scores with the rms. A twist loop of ±28 N·mm has a
/// mean of about 0.09 rms, from its asymmetry, and is detected. A curve of one sign is not:
/// force ∝ depth^p has mean/rms = √(2p + 1)/(p + 1), still 0.4 at p = 10.
pub const LEAST_MEAN: f64 = 0.1;

/// Least admissible value of any other normaliser as a share of max|exp|: above round-off.
pub const LEAST_SHARE: f64 = 1e-9;

impl Normaliser {
    /// Every normaliser, in the order of the documentation.
    pub const ALL: [Self; 6] =
        [Self::MeanAbs, Self::Mean, Self::Rms, Self::Range, Self::Std, Self::Unit];

    /// The name in study files.
    ///
    /// ```
    /// use palpate_core::nmse::Normaliser;
    /// assert_eq!(Normaliser::MeanAbs.name(), "mean_abs");
    /// ```
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::MeanAbs => "mean_abs",
            Self::Mean => "mean",
            Self::Rms => "rms",
            Self::Range => "range",
            Self::Std => "std",
            Self::Unit => "unit",
        }
    }

    /// Value of the normaliser on a measured curve, in the unit of `exp`.
    ///
    /// # Errors
    /// [`CurveError`] if `exp` is empty or not finite. [`ScoringError::Degenerate`] if the value is
    /// too small to divide by: `Mean` below [`LEAST_MEAN`] of the rms, any other but `Unit` at most
    /// [`LEAST_SHARE`] of max|exp|.
    ///
    /// # Examples
    /// ```
    /// use palpate_core::nmse::Normaliser;
    /// let twist = [0.0, -28.0, 0.0, 28.0];
    /// assert_eq!(Normaliser::MeanAbs.value(&twist)?, 14.0);
    /// assert!(Normaliser::Mean.value(&twist).is_err());
    /// # Ok::<(), palpate_core::Error>(())
    /// ```
    pub fn value(self, exp: &[f64]) -> Result<f64, Error> {
        if exp.is_empty() {
            return Err(CurveError::Empty { array: "exp" }.into());
        }
        curve::finite("exp", exp)?;
        if self == Self::Unit {
            return Ok(1.0);
        }
        // Dividing by the largest value first keeps squares from over- and underflowing.
        let largest = exp.iter().fold(0.0_f64, |most, e| most.max(e.abs()));
        let unit = |e: &f64| if largest > 0.0 { e / largest } else { 0.0 };
        let average =
            |f: &dyn Fn(f64) -> f64| exp.iter().map(|e| f(unit(e))).sum::<f64>() / real(exp.len());
        let rms = average(&|e| e * e).sqrt();
        let share = match self {
            Self::MeanAbs => average(&f64::abs),
            Self::Mean => average(&|e| e).abs(),
            Self::Rms => rms,
            Self::Range => {
                let most = exp.iter().map(unit).fold(f64::NEG_INFINITY, f64::max);
                most - exp.iter().map(unit).fold(f64::INFINITY, f64::min)
            }
            Self::Std => {
                let mean = average(&|e| e);
                average(&|e| (e - mean) * (e - mean)).sqrt()
            }
            Self::Unit => 1.0,
        };
        let least = if self == Self::Mean { LEAST_MEAN * rms } else { 0.0 };
        // The inverse of a subnormal number may overflow.
        let too_small = share * largest < f64::MIN_POSITIVE;
        if share < least || share <= LEAST_SHARE || too_small {
            let (value, rms) = (share * largest, rms * largest);
            return Err(ScoringError::Degenerate { normaliser: self, value, rms }.into());
        }
        Ok(share * largest)
    }

    /// The names of the other normalisers, for a message.
    pub(crate) fn others(self) -> String {
        let names: Vec<_> = Self::ALL.into_iter().filter(|&n| n != self).map(Self::name).collect();
        names.join(", ")
    }
}

impl fmt::Display for Normaliser {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Normaliser {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        Self::ALL
            .into_iter()
            .find(|n| n.name() == name)
            .ok_or_else(|| ScoringError::UnknownNormaliser { name: name.to_owned() }.into())
    }
}

/// An NMSE and the share of the measured curve that it rests on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Score {
    /// NMSE over the covered points; NaN if there are none.
    pub(crate) nmse: f64,
    /// Weight of the covered points over the weight of all points, 0 to 1.
    pub(crate) coverage: f64,
}

/// NMSE of a simulated curve against a measured one at the same points.
///
/// # Errors
/// [`CurveError`] if the curves differ in length, are empty, or hold a value that is not finite (a
/// simulation that ended early goes to [`SharedPath`](crate::SharedPath)). [`ScoringError`] if the
/// normaliser is degenerate, or a weight is negative, or all are zero.
///
/// # Examples
/// ```
/// use palpate_core::nmse::{Normaliser, nmse};
/// let error = nmse(&[1.1, 2.2, 3.3], &[1.0, 2.0, 3.0], Normaliser::Rms, None)?;
/// assert!((error - 0.01).abs() < 1e-12);
/// # Ok::<(), palpate_core::Error>(())
/// ```
pub fn nmse(
    sim: &[f64],
    exp: &[f64],
    normaliser: Normaliser,
    weights: Option<&[f64]>,
) -> Result<f64, Error> {
    curve::same_length(Named { name: "sim", values: sim }, Named { name: "exp", values: exp })?;
    curve::finite("sim", sim)?;
    Ok(Target::new(exp, normaliser, weights)?.score(sim).nmse)
}

/// NMSE and coverage of many simulated curves.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Scores {
    /// NMSE of each curve over its covered points; NaN where there are none.
    pub nmse: Vec<f64>,
    /// Share of each curve's weight that is covered, 0 to 1.
    pub coverage: Vec<f64>,
}

/// A measured curve with everything that does not depend on the simulation.
#[derive(Debug, Clone)]
pub(crate) struct Target {
    pub(crate) exp: Vec<f64>,
    /// √weight/normaliser of each point: the squares of scaled errors are summed.
    pub(crate) factors: Vec<f64>,
    /// Largest is 1; `None` means that all are.
    weights: Option<Vec<f64>>,
    /// Sum of the weights.
    pub(crate) total: f64,
}

impl Target {
    pub(crate) fn new(
        exp: &[f64],
        normaliser: Normaliser,
        weights: Option<&[f64]>,
    ) -> Result<Self, Error> {
        let per_unit = 1.0 / normaliser.value(exp)?;
        let weights = weights.map(|w| scaled_weights(w, exp.len())).transpose()?;
        let (factors, total) = match &weights {
            None => (vec![per_unit; exp.len()], real(exp.len())),
            Some(w) => (w.iter().map(|w| w.sqrt() * per_unit).collect(), w.iter().sum()),
        };
        Ok(Self { exp: exp.to_vec(), factors, weights, total })
    }

    /// Scores one curve whose NaNs are points not reached.
    #[inline(always)]
    pub(crate) fn score(&self, sim: &[f64]) -> Score {
        let sum = sum_of_squares(sim, &self.exp, &self.factors);
        if sum.is_nan() {
            return self.score_covered(sim);
        }
        Score { nmse: sum / self.total, coverage: 1.0 }
    }

    #[cold]
    fn score_covered(&self, sim: &[f64]) -> Score {
        let known = |(s, e): (&f64, &f64)| if s.is_nan() { *e } else { *s };
        let filled: Vec<f64> = sim.iter().zip(&self.exp).map(known).collect();
        let sum = sum_of_squares(&filled, &self.exp, &self.factors);
        let covered = self.covered(sim.iter().map(|s| !s.is_nan()));
        // 0/0 is the NaN that a row without any covered point is to have.
        Score { nmse: sum / covered, coverage: covered / self.total }
    }

    /// Weight of the points that are covered.
    pub(crate) fn covered(&self, covered: impl Iterator<Item = bool>) -> f64 {
        match &self.weights {
            None => real(covered.filter(|c| *c).count()),
            Some(weights) => weights.iter().zip(covered).filter(|(_, c)| *c).map(|(w, _)| w).sum(),
        }
    }
}

/// Partial sums that are kept side by side, point i in the one of i modulo their number.
pub(crate) const PARTS: usize = 8;

/// Σ (factor (sim − exp))², in the order that every form of the score keeps to.
#[inline(always)]
fn sum_of_squares(sim: &[f64], exp: &[f64], factors: &[f64]) -> f64 {
    let mut parts = [0.0; PARTS];
    let (sims, sim_rest) = sim.as_chunks::<PARTS>();
    let (exps, exp_rest) = exp.as_chunks::<PARTS>();
    let (scales, scale_rest) = factors.as_chunks::<PARTS>();
    for ((sim, exp), scale) in sims.iter().zip(exps).zip(scales) {
        for j in 0..PARTS {
            let error = (sim[j] - exp[j]) * scale[j];
            parts[j] += error * error;
        }
    }
    for (j, ((sim, exp), scale)) in sim_rest.iter().zip(exp_rest).zip(scale_rest).enumerate() {
        let error = (sim - exp) * scale;
        parts[j] += error * error;
    }
    sum_of_parts(parts)
}

/// The sum of the partial sums.
#[inline(always)]
pub(crate) fn sum_of_parts(p: [f64; PARTS]) -> f64 {
    ((p[0] + p[4]) + (p[2] + p[6])) + ((p[1] + p[5]) + (p[3] + p[7]))
}

/// Weights over their maximum, so that equal weights of any size are exactly no weights.
fn scaled_weights(weights: &[f64], n_points: usize) -> Result<Vec<f64>, ScoringError> {
    let length = weights.len();
    if length != n_points {
        return Err(ScoringError::WeightsLength { length, n_points });
    }
    if let Some(index) = weights.iter().position(|w| !(w.is_finite() && *w >= 0.0)) {
        return Err(ScoringError::Weight { index, value: weights[index] });
    }
    let most = weights.iter().copied().fold(0.0, f64::max);
    if most == 0.0 {
        return Err(ScoringError::ZeroWeights);
    }
    Ok(weights.iter().map(|w| w / most).collect())
}
