//! Many simulated curves on one path, against one measured curve.
//!
//! Each measured point is located on the simulated path once. Interpolation is linear, so
//! the NMSE is a quadratic form of the simulated values, which costs O(n) per curve for any
//! number of measured points.
#![expect(clippy::inline_always, reason = "only what is inlined gets a kernel's instructions")]

use crate::batch::{Scratch, check_shape, reached, vectorised};
use crate::curve::usable;
use crate::error::Error;
use crate::knots::{Position, Positions};
use crate::measured::Measured;
use crate::nmse::{Score, Scores};
use crate::quadratic_form::{Observation, QuadraticForm};

/// A measured curve ready to score simulated curves that share their abscissae.
///
/// A batch holds `n_sets` rows of one value per simulated abscissa, row after row. A row may end
/// in NaNs: the simulation did not get there, and is scored as the path that it reached.
///
/// # Examples
/// ```
/// use palpate_core::{Measured, nmse::Normaliser::MeanAbs};
/// let measured = Measured::new(&[0.0, 1.0, 2.0], &[0.0, 1.0, 4.0], MeanAbs, None)?;
/// let path = measured.along(&[0.0, 2.0])?;
/// let scores = path.score(&[0.0, 4.0, 0.0, 2.0], 2)?;
/// assert!((scores.nmse[0] - 0.12).abs() < 1e-15);
/// # Ok::<(), palpate_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct SharedPath {
    pub(crate) measured: Measured,
    pub(crate) sim_x: Vec<f64>,
    pub(crate) positions: Positions,
    pub(crate) rows: Vec<Row>,
    /// Weight of the points that a whole curve reaches.
    pub(crate) covered: f64,
    pub(crate) quadratic_form: QuadraticForm,
    /// The points of a curve that are knots; `None` where all are.
    pub(crate) knots: Option<Vec<usize>>,
}

/// A measured point with the two simulated values that it is compared with.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    pub(crate) lower: usize,
    pub(crate) upper: usize,
    pub(crate) share: f64,
    pub(crate) exp: f64,
    /// 0 where the point is not reached.
    pub(crate) factor: f64,
}

/// The score of a curve that did not get to any measured point.
pub(crate) const NOTHING_REACHED: Score = Score { nmse: f64::NAN, coverage: 0.0 };

impl SharedPath {
    pub(crate) fn new(measured: &Measured, sim_x: &[f64]) -> Result<Self, Error> {
        let positions = measured.segments.positions(sim_x)?;
        let target = &measured.target;
        let covered = target.covered(positions.points.iter().map(Option::is_some));
        let rows = positions.points.iter().zip(target.exp.iter().zip(&target.factors));
        let rows = rows.map(|(position, (&exp, &factor))| match position {
            Some(position) => {
                let (lower, upper) = positions.neighbours(*position);
                Row { lower, upper, share: position.share, exp, factor }
            }
            None => Row { lower: 0, upper: 0, share: 0.0, exp, factor: 0.0 },
        });
        let rows: Vec<_> = rows.collect();
        let (knots, firsts) = positions.chained();
        let observations = observations(&positions, &rows, &firsts, covered);
        Ok(Self {
            // Points of huge weight or ordinate make a form that is no number, and is never sure.
            quadratic_form: QuadraticForm::new(knots.len(), &observations),
            knots: (knots.len() != sim_x.len()).then_some(knots),
            rows,
            measured: measured.clone(),
            sim_x: sim_x.to_vec(),
            positions,
            covered,
        })
    }

    /// Number of values of a simulated curve.
    pub(crate) fn n_values(&self) -> usize {
        self.sim_x.len()
    }

    /// Scores a batch by the quadratic form, or over the measured points where it would cost digits.
    ///
    /// # Errors
    /// [`CurveError`](crate::CurveError) if `sim` is not `n_sets` rows, holds an infinite value, or
    /// has values after a NaN.
    pub fn score(&self, sim: &[f64], n_sets: usize) -> Result<Scores, Error> {
        let n = self.n_values();
        check_shape(sim, n_sets, n)?;
        let scratch = &mut Scratch::default();
        let (mut nmse, mut coverage) = (vec![0.0; n_sets], vec![self.coverage(); n_sets]);
        vectorised(EvaluateForm { path: self, sim, nmse: &mut nmse, scratch });
        for (set, sim) in sim.chunks_exact(n).enumerate() {
            if nmse[set].is_nan() {
                let score = self.score_row(set, sim, scratch)?;
                (nmse[set], coverage[set]) = (score.nmse, score.coverage);
            }
        }
        Ok(Scores { nmse, coverage })
    }

    /// Coverage of a whole curve.
    pub(crate) fn coverage(&self) -> f64 {
        self.covered / self.measured.target.total
    }

    /// The values of a curve at the knots; `None` if one of the others is unusable.
    #[inline(always)]
    pub(crate) fn at_knots<'a>(
        &self,
        sim: &'a [f64],
        scratch: &'a mut Scratch,
    ) -> Option<&'a [f64]> {
        let Some(knots) = &self.knots else { return Some(sim) };
        if !usable(sim) {
            return None;
        }
        scratch.values.clear();
        scratch.values.extend(knots.iter().map(|&i| sim[i]));
        Some(&scratch.values)
    }

    /// Scores one curve over the measured points.
    fn score_row(&self, set: usize, sim: &[f64], scratch: &mut Scratch) -> Result<Score, Error> {
        let Some(n) = reached(set, sim)? else { return Ok(self.score_whole(sim, scratch)) };
        let Scratch { knots, ordinates, values } = scratch;
        // A path of one point, or one that has not moved yet, has not got anywhere.
        Ok(match self.measured.segments.knots_of(&self.sim_x[..n], knots) {
            Ok(()) => self.measured.score_knots(knots, &sim[..n], ordinates, values),
            Err(_) => NOTHING_REACHED,
        })
    }

    /// Scores a whole curve; leaves it interpolated at the measured points in `scratch.values`.
    pub(crate) fn score_whole(&self, sim: &[f64], scratch: &mut Scratch) -> Score {
        let Scratch { ordinates, values, .. } = scratch;
        self.measured.score_knots(&self.positions.segments, sim, ordinates, values)
    }
}

/// The scaled rows of the interpolant, in order of their knots.
fn observations(
    positions: &Positions,
    rows: &[Row],
    firsts: &[usize],
    covered: f64,
) -> Vec<Observation> {
    let per_weight = covered.sqrt().recip();
    let observed = |(position, row): (&Option<Position>, &Row)| {
        let position = (*position)?;
        let factor = row.factor * per_weight;
        Some(Observation {
            knot: firsts[position.segment] + position.knot,
            at_knot: (1.0 - position.share) * factor,
            at_next: position.share * factor,
            exp: row.exp * factor,
        })
    };
    let mut found: Vec<_> = positions.points.iter().zip(rows).filter_map(observed).collect();
    found.sort_by_key(|o| o.knot);
    found
}

/// NMSE of each curve by the quadratic form; NaN where they would cost digits.
struct EvaluateForm<'a> {
    path: &'a SharedPath,
    sim: &'a [f64],
    nmse: &'a mut [f64],
    scratch: &'a mut Scratch,
}

impl pulp::NullaryFnOnce for EvaluateForm<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { path, sim, nmse, scratch } = self;
        for (nmse, sim) in nmse.iter_mut().zip(sim.chunks_exact(path.n_values())) {
            let y = path.at_knots(sim, scratch);
            *nmse = y.and_then(|y| path.quadratic_form.nmse(y)).unwrap_or(f64::NAN);
        }
    }
}

impl Positions {
    /// The simulated values on both sides of a position.
    fn neighbours(&self, position: Position) -> (usize, usize) {
        let at = &self.segments[position.segment].at;
        let lower = at[position.knot];
        // A point on a knot belongs only to that knot.
        if position.share == 0.0 { (lower, lower) } else { (lower, at[position.knot + 1]) }
    }

    /// The knots of all segments in one row, turning points once, and the first of each segment therein.
    fn chained(&self) -> (Vec<usize>, Vec<usize>) {
        let (mut knots, mut firsts) = (Vec::new(), Vec::new());
        for segment in &self.segments {
            if knots.last() == segment.at.first() {
                knots.pop();
            }
            firsts.push(knots.len());
            knots.extend(&segment.at);
        }
        (knots, firsts)
    }
}
