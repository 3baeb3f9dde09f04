//! A measured curve made ready to score many simulated ones.
#![expect(clippy::inline_always, reason = "only what is inlined gets a kernel's instructions")]

use crate::batch::vectorised;
use crate::curve::{self, Named};
use crate::error::Error;
use crate::knots::{BLOCK, KnotOrdinates, Knots, Segments};
use crate::nmse::{Normaliser, Score, Target};
use crate::shared::SharedPath;

/// A measured curve, cut and weighted once for all that it is compared with.
///
/// # Examples
/// ```
/// use palpate_core::{Measured, nmse::Normaliser};
/// let (depth, force) = ([0.0, 1.0, 2.0], [0.0, 1.0, 4.0]);
/// let measured = Measured::new(&depth, &force, Normaliser::MeanAbs, None)?;
/// // A coarser simulation that stopped half way.
/// let scores = measured.along(&[0.0, 1.0])?.score(&[0.0, 1.0], 1)?;
/// assert_eq!(scores.nmse, [0.0]);
/// assert!((scores.coverage[0] - 2.0 / 3.0).abs() < 1e-15);
/// # Ok::<(), palpate_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Measured {
    pub(crate) segments: Segments,
    pub(crate) target: Target,
}

impl Measured {
    /// Makes a measured curve ready: ordinates `y` over the abscissae `x` in the order travelled, and
    /// a weight for each point; equal ones without.
    ///
    /// # Errors
    /// [`CurveError`](crate::CurveError) if the path cannot be cut, a value is not finite or the lengths differ;
    /// [`ScoringError`](crate::ScoringError) if the normaliser is degenerate or the weights are
    /// unusable.
    pub fn new(
        x: &[f64],
        y: &[f64],
        normaliser: Normaliser,
        weights: Option<&[f64]>,
    ) -> Result<Self, Error> {
        let path = Named { name: "exp_x", values: x };
        curve::same_length(Named { name: "exp_y", values: y }, path)?;
        curve::finite("exp_y", y)?;
        Ok(Self { segments: Segments::new(path)?, target: Target::new(y, normaliser, weights)? })
    }

    /// Number of measured points.
    pub(crate) fn n_points(&self) -> usize {
        self.segments.n_points()
    }

    /// Makes the measured curve ready for curves that share the simulated abscissae `sim_x`.
    ///
    /// # Errors
    /// [`CurveError`](crate::CurveError) as for [`curve::interpolate`].
    pub fn along(&self, sim_x: &[f64]) -> Result<SharedPath, Error> {
        SharedPath::new(self, sim_x)
    }

    /// Scores ordinates at the points of a path whose knots are known; leaves them interpolated at
    /// the first [`Measured::n_points`] of `values`.
    pub(crate) fn score_knots(
        &self,
        knots: &[Knots],
        sim_y: &[f64],
        ordinates: &mut KnotOrdinates,
        values: &mut Vec<f64>,
    ) -> Score {
        values.resize(self.n_points() + BLOCK, 0.0);
        vectorised(WalkAndScore { measured: self, knots, sim_y, ordinates, values })
    }
}

/// Interpolation along a path, then the score.
struct WalkAndScore<'a> {
    measured: &'a Measured,
    knots: &'a [Knots],
    sim_y: &'a [f64],
    ordinates: &'a mut KnotOrdinates,
    values: &'a mut [f64],
}

impl pulp::NullaryFnOnce for WalkAndScore<'_> {
    type Output = Score;

    #[inline(always)]
    fn call(self) -> Score {
        let Measured { segments, target } = self.measured;
        segments.interpolate(self.knots, self.sim_y, self.ordinates, self.values);
        target.score(&self.values[..segments.n_points()])
    }
}
