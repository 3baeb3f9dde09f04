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
//! | coverage | share of the weight that lies on points which the simulation reached |
//!
//! The normaliser always comes from the whole measured curve, without weights, so that a
//! simulation that ended early is measured with the same yardstick as the others.

use std::fmt;
use std::str::FromStr;

use crate::curve::{self, Named};
use crate::error::{CurveError, Error, ScoringError};
use crate::real;

/// What the error is divided by: a named choice, recorded with every score.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
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
/// mean of about 0.09 rms, left over from its asymmetry, and is caught. A curve of one sign is not:
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
        if share < least || share <= LEAST_SHARE {
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
pub struct Score {
    /// NMSE over the covered points; NaN if there are none.
    pub nmse: f64,
    /// Weight of the covered points over the weight of all points, 0 to 1.
    pub coverage: f64,
}

/// NMSE of a simulated curve against a measured one at the same points.
///
/// # Errors
/// [`CurveError`] if the curves differ in length, are empty, or hold a value that is not finite (a
/// simulation that ended early goes to [`nmse_batch`] or [`score`]). [`ScoringError`] if the
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
    let target = Target::new(exp, normaliser, weights)?;
    curve::finite("sim", sim)?;
    Ok(target.score(sim).nmse)
}

/// NMSE of many simulated curves against one measured curve.
///
/// `sim` holds `n_sets` rows of `exp.len()` values, row after row. A NaN in it marks a point that
/// the simulation did not reach: it does not count, and lowers the coverage of its row.
///
/// # Errors
/// [`CurveError`] if `sim` is not `n_sets` rows or holds an infinite value, or `exp` is empty or
/// not finite; [`ScoringError`] as for [`nmse`].
///
/// # Examples
/// ```
/// use palpate_core::nmse::{Normaliser, nmse_batch};
/// let sims = [1.0, 3.0, f64::NAN, 3.0];
/// let scores = nmse_batch(&sims, 2, &[1.0, 3.0], Normaliser::MeanAbs, None)?;
/// assert_eq!((scores[0].nmse, scores[0].coverage), (0.0, 1.0));
/// assert_eq!((scores[1].nmse, scores[1].coverage), (0.0, 0.5));
/// # Ok::<(), palpate_core::Error>(())
/// ```
pub fn nmse_batch(
    sim: &[f64],
    n_sets: usize,
    exp: &[f64],
    normaliser: Normaliser,
    weights: Option<&[f64]>,
) -> Result<Vec<Score>, Error> {
    let target = Target::new(exp, normaliser, weights)?;
    let (length, n_points) = (sim.len(), exp.len());
    if n_sets.checked_mul(n_points) != Some(length) {
        return Err(CurveError::BatchShape { length, n_sets, n_points }.into());
    }
    if let Some(i) = sim.iter().position(|v| v.is_infinite()) {
        let (row, index, value) = (i / n_points, i % n_points, sim[i]);
        return Err(CurveError::InfiniteInBatch { array: "sim", row, index, value }.into());
    }
    Ok(sim.chunks_exact(n_points).map(|row| target.score(row)).collect())
}

/// NMSE of a simulated path against a measured one, each with its own points.
///
/// The simulated path is interpolated onto the measured points with
/// [`curve::interpolate`]; points that it does not reach lower the coverage.
///
/// # Errors
/// [`CurveError`] as for [`curve::interpolate`] and [`ScoringError`] as for [`nmse`].
///
/// # Examples
/// ```
/// use palpate_core::nmse::{Normaliser, score};
/// let measured = ([0.0, 1.0, 2.0, 1.0], [0.0, 1.0, 4.0, 0.5]);
/// let simulated = ([0.0, 2.0], [0.0, 4.0]);
/// let out = score(
///     (&simulated.0, &simulated.1), (&measured.0, &measured.1), Normaliser::Range, 0.0, None,
/// )?;
/// assert_eq!(out.coverage, 0.75);
/// assert!((out.nmse - 1.0 / 3.0 / 16.0).abs() < 1e-15);
/// # Ok::<(), palpate_core::Error>(())
/// ```
pub fn score(
    sim: (&[f64], &[f64]),
    exp: (&[f64], &[f64]),
    normaliser: Normaliser,
    tolerance: f64,
    weights: Option<&[f64]>,
) -> Result<Score, Error> {
    let at = Named { name: "exp_x", values: exp.0 };
    curve::same_length(Named { name: "exp_y", values: exp.1 }, at)?;
    curve::finite("exp_y", exp.1)?;
    let reached = curve::interpolate_at(sim.0, sim.1, at, tolerance)?;
    let target = Target::new(exp.1, normaliser, weights)?;
    Ok(target.score(&reached.values))
}

/// A measured curve with everything that does not depend on the simulation.
struct Target<'a> {
    exp: &'a [f64],
    normaliser: f64,
    /// Largest is 1; `None` means that all are.
    weights: Option<Vec<f64>>,
}

impl<'a> Target<'a> {
    fn new(exp: &'a [f64], normaliser: Normaliser, weights: Option<&[f64]>) -> Result<Self, Error> {
        let normaliser = normaliser.value(exp)?;
        let weights = weights.map(|w| scaled_weights(w, exp.len())).transpose()?;
        Ok(Self { exp, normaliser, weights })
    }

    /// Scores one curve whose NaNs are points not reached.
    fn score(&self, sim: &[f64]) -> Score {
        let (mut sum, mut covered, mut total) = (0.0, 0.0, 0.0);
        for (i, (s, e)) in sim.iter().zip(self.exp).enumerate() {
            let weight = self.weights.as_ref().map_or(1.0, |w| w[i]);
            total += weight;
            if !s.is_nan() {
                let relative = (s - e) / self.normaliser;
                sum += weight * relative * relative;
                covered += weight;
            }
        }
        // 0/0 is the NaN that a row without any covered point is to have.
        Score { nmse: sum / covered, coverage: covered / total }
    }
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
