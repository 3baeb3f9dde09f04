//! A measured curve made ready to score many simulated ones.
#![expect(clippy::inline_always, reason = "only what is inlined gets a kernel's instructions")]

use crate::batch::{self, Scratch, vectorised};
use crate::curve::{self, Interpolant, Named};
use crate::error::{CurveError, Error};
use crate::knots::{BLOCK, Knots, Legs, Pieces};
use crate::nmse::{Comparison, Score, Scores, Target};
use crate::shared::SharedPath;

/// A measured curve, cut and weighted once for all that it is compared with.
///
/// # Examples
/// ```
/// use palpate_core::{Measured, nmse::Comparison};
/// let measured = Measured::new(&[0.0, 1.0, 2.0], &[0.0, 1.0, 4.0], &Comparison::default())?;
/// // A coarser simulation that stopped half way.
/// let out = measured.score(&[0.0, 1.0], &[0.0, 1.0])?;
/// assert_eq!(out.nmse, 0.0);
/// assert!((out.coverage - 2.0 / 3.0).abs() < 1e-15);
/// # Ok::<(), palpate_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Measured {
    pub(crate) legs: Legs,
    pub(crate) target: Target,
    pub(crate) interpolant: Interpolant,
}

impl Measured {
    /// Makes a measured curve ready: ordinates `y` over the abscissae `x` in the order travelled.
    ///
    /// # Errors
    /// [`CurveError`] if the path cannot be cut, a value is not finite or the lengths differ;
    /// [`ScoringError`](crate::ScoringError) if the normaliser is degenerate or the weights are
    /// unusable.
    pub fn new(x: &[f64], y: &[f64], comparison: &Comparison<'_>) -> Result<Self, Error> {
        let path = Named { name: "exp_x", values: x };
        curve::same_length(Named { name: "exp_y", values: y }, path)?;
        curve::finite("exp_y", y)?;
        Ok(Self {
            legs: Legs::new(path, comparison.tolerance)?,
            target: Target::new(y, comparison.normaliser, comparison.weights)?,
            interpolant: comparison.interpolant,
        })
    }

    /// Number of measured points.
    #[must_use]
    pub fn n_points(&self) -> usize {
        self.legs.n_points()
    }

    /// Scores a simulated path with points of its own.
    ///
    /// Points that it does not reach lower the coverage.
    ///
    /// # Errors
    /// [`CurveError`] as for [`curve::interpolate`].
    pub fn score(&self, sim_x: &[f64], sim_y: &[f64]) -> Result<Score, Error> {
        self.score_path(sim_x, sim_y, &mut Scratch::default())
    }

    /// Scores many simulated paths, each with points of its own.
    ///
    /// Path k is made of the points `starts[k]..starts[k + 1]` of `sim_x` and `sim_y`. `threads`
    /// (0: as many as there are cores) changes no bit of the result.
    ///
    /// # Errors
    /// [`CurveError::Starts`] if `starts` does not divide the points; [`CurveError::InPath`], naming
    /// the first path that cannot be used, for anything that [`Measured::score`] refuses.
    ///
    /// # Examples
    /// ```
    /// use palpate_core::{Measured, nmse::Comparison};
    /// let measured = Measured::new(&[0.0, 1.0, 2.0], &[0.0, 1.0, 4.0], &Comparison::default())?;
    /// let (x, y) = ([0.0, 2.0, 0.0, 1.0, 2.0], [0.0, 4.0, 0.0, 1.0, 4.0]);
    /// let scores = measured.score_paths(&x, &y, &[0, 2, 5], 1)?;
    /// assert_eq!(scores.nmse[1], 0.0);
    /// # Ok::<(), palpate_core::Error>(())
    /// ```
    pub fn score_paths(
        &self,
        sim_x: &[f64],
        sim_y: &[f64],
        starts: &[usize],
        threads: usize,
    ) -> Result<Scores, Error> {
        let x = Named { name: "sim_x", values: sim_x };
        curve::same_length(Named { name: "sim_y", values: sim_y }, x)?;
        check_starts(starts, sim_x.len())?;
        let n_paths = starts.len() - 1;
        let [nmse, coverage] = batch::rows([1, 1], n_paths, threads, |path, out, scratch| {
            let points = starts[path]..starts[path + 1];
            let score = self
                .score_path(&sim_x[points.clone()], &sim_y[points], scratch)
                .map_err(|error| in_path(path, error))?;
            (out[0][0], out[1][0]) = (score.nmse, score.coverage);
            Ok(())
        })?;
        Ok(Scores { nmse, coverage })
    }

    /// Makes the measured curve ready for curves that share the simulated abscissae `sim_x`.
    ///
    /// # Errors
    /// [`CurveError`] as for [`curve::interpolate`].
    pub fn along(&self, sim_x: &[f64]) -> Result<SharedPath, Error> {
        SharedPath::new(self, sim_x)
    }

    pub(crate) fn score_path(
        &self,
        sim_x: &[f64],
        sim_y: &[f64],
        scratch: &mut Scratch,
    ) -> Result<Score, Error> {
        curve::usable_path(sim_x, sim_y)?;
        self.legs.knots_of(sim_x, &mut scratch.knots)?;
        let Scratch { knots, pieces, values, .. } = scratch;
        Ok(self.score_knots(knots, sim_y, pieces, values))
    }

    /// Scores ordinates at the points of a path whose knots are known; leaves them interpolated at
    /// the first [`Measured::n_points`] of `values`.
    pub(crate) fn score_knots(
        &self,
        knots: &[Knots],
        sim_y: &[f64],
        pieces: &mut Pieces,
        values: &mut Vec<f64>,
    ) -> Score {
        values.resize(self.n_points() + BLOCK, 0.0);
        vectorised(WalkAndScore { measured: self, knots, sim_y, pieces, values })
    }
}

/// Interpolation along a path, then the score.
struct WalkAndScore<'a> {
    measured: &'a Measured,
    knots: &'a [Knots],
    sim_y: &'a [f64],
    pieces: &'a mut Pieces,
    values: &'a mut [f64],
}

impl pulp::NullaryFnOnce for WalkAndScore<'_> {
    type Output = Score;

    #[inline(always)]
    fn call(self) -> Score {
        let Measured { legs, target, interpolant } = self.measured;
        legs.interpolate(self.knots, self.sim_y, *interpolant, self.pieces, self.values);
        target.score(&self.values[..legs.n_points()])
    }
}

fn in_path(path: usize, error: Error) -> Error {
    match error {
        Error::Curve(source) => CurveError::InPath { path, source: Box::new(source) }.into(),
        other => other,
    }
}

fn check_starts(starts: &[usize], n_points: usize) -> Result<(), CurveError> {
    let wrong = |index: usize| CurveError::Starts { index, value: starts[index], n_points };
    let (Some(&first), Some(&last)) = (starts.first(), starts.last()) else {
        return Err(CurveError::Empty { array: "starts" });
    };
    if first != 0 {
        return Err(wrong(0));
    }
    if let Some(k) = starts.windows(2).position(|pair| pair[1] < pair[0]) {
        return Err(wrong(k + 1));
    }
    if last == n_points { Ok(()) } else { Err(wrong(starts.len() - 1)) }
}
