//! Many simulated curves on one path, against one measured curve.
//!
//! Where each measured point lies on the simulated path is found once. Linear interpolation makes
//! the NMSE a quadratic form of the simulated values ([`Form::Moments`]), which costs O(n) per curve
//! whatever the number of measured points.
#![expect(clippy::inline_always, reason = "only what is inlined gets a kernel's instructions")]

use std::str::FromStr;

use crate::batch::{self, Scratch, vectorised};
use crate::curve::{Interpolant, LARGEST, usable};
use crate::error::{CurveError, Error, ScoringError};
use crate::knots::{Place, Places};
use crate::measured::Measured;
use crate::moments::{Moments, Observation};
use crate::nmse::{PARTS, Score, Scores, sum_of_parts};

/// How the NMSE of a batch is summed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Form {
    /// As a quadratic form of the simulated values, O(n); where that would cost digits, directly.
    ///
    /// It agrees with [`Form::Direct`] to 1e-12. It exists for linear interpolation only; with
    /// another interpolant this is the direct form.
    #[default]
    Moments,
    /// Over the measured points, O(N); the bits are those of [`Measured::score`].
    Direct,
}

impl Form {
    /// Every form, in the order of the documentation.
    pub const ALL: [Self; 2] = [Self::Moments, Self::Direct];

    /// The name in Python.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Moments => "moments",
            Self::Direct => "direct",
        }
    }
}

impl FromStr for Form {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        Self::ALL
            .into_iter()
            .find(|f| f.name() == name)
            .ok_or_else(|| ScoringError::UnknownForm { name: name.to_owned() }.into())
    }
}

/// A measured curve ready to score simulated curves that share their abscissae.
///
/// A batch holds `n_sets` rows of one value per simulated abscissa, row after row. A row may end
/// in NaNs: the simulation did not get there, and is scored as the path that it reached.
/// `threads` (0: as many as there are cores) changes no bit of any result.
///
/// # Examples
/// ```
/// use palpate_core::{Measured, nmse::Comparison, shared::Form};
/// let measured = Measured::new(&[0.0, 1.0, 2.0], &[0.0, 1.0, 4.0], &Comparison::default())?;
/// let path = measured.along(&[0.0, 2.0])?;
/// let scores = path.score(&[0.0, 4.0, 0.0, 2.0], 2, Form::Moments, 1)?;
/// assert!((scores.nmse[0] - 0.12).abs() < 1e-15);
/// let best = path.best_scale(&[0.0, 2.0], 1, (0.0, 10.0), 1)?;
/// assert!((best.scale[0] - 1.8).abs() < 1e-15);
/// # Ok::<(), palpate_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct SharedPath {
    pub(crate) measured: Measured,
    pub(crate) sim_x: Vec<f64>,
    pub(crate) places: Places,
    pub(crate) rows: Vec<Row>,
    /// Weight of the points that a whole curve reaches.
    pub(crate) covered: f64,
    pub(crate) moments: Option<Moments>,
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

/// Curves that are scored side by side.
const LANES: usize = 4;

impl SharedPath {
    pub(crate) fn new(measured: &Measured, sim_x: &[f64]) -> Result<Self, Error> {
        let places = measured.legs.places(sim_x)?;
        let target = &measured.target;
        let covered = target.covered(places.points.iter().map(Option::is_some));
        let rows = places.points.iter().zip(target.exp.iter().zip(&target.factors));
        let rows = rows.map(|(place, (&exp, &factor))| match place {
            Some(place) => {
                let (lower, upper) = places.neighbours(*place);
                Row { lower, upper, share: place.share, exp, factor }
            }
            None => Row { lower: 0, upper: 0, share: 0.0, exp, factor: 0.0 },
        });
        let mut path = Self {
            rows: rows.collect(),
            measured: measured.clone(),
            sim_x: sim_x.to_vec(),
            places,
            covered,
            moments: None,
            knots: None,
        };
        if measured.interpolant == Interpolant::Linear {
            path.find_moments();
        }
        Ok(path)
    }

    fn find_moments(&mut self) {
        let (knots, firsts) = self.places.chained();
        let per_weight = self.covered.sqrt().recip();
        let observed = self.places.points.iter().zip(&self.rows);
        let mut observations: Vec<_> = observed
            .filter_map(|(place, row)| {
                let place = (*place)?;
                let factor = row.factor * per_weight;
                Some(Observation {
                    knot: firsts[place.leg] + place.knot,
                    at_knot: (1.0 - place.share) * factor,
                    at_next: place.share * factor,
                    exp: row.exp * factor,
                })
            })
            .collect();
        observations.sort_by_key(|o| o.knot);
        // Points of huge weight or ordinate make a form that is no number, and is never sure.
        self.moments = Some(Moments::new(knots.len(), &observations));
        let all = knots.len() == self.sim_x.len();
        self.knots = (!all).then_some(knots);
    }

    /// Number of values of a simulated curve.
    #[must_use]
    pub fn n_values(&self) -> usize {
        self.sim_x.len()
    }

    /// Scores a batch.
    ///
    /// # Errors
    /// [`CurveError`] if `sim` is not `n_sets` rows, holds an infinite value, or goes on after a NaN.
    pub fn score(
        &self,
        sim: &[f64],
        n_sets: usize,
        form: Form,
        threads: usize,
    ) -> Result<Scores, Error> {
        let n = self.n_values();
        batch::check_shape(sim, n_sets, n)?;
        let moments = self.moments.as_ref().filter(|_| form == Form::Moments);
        let by_lanes = self.measured.interpolant == Interpolant::Linear;
        let [nmse, coverage] = batch::chunks([1, 1], n_sets, threads, |sets, out, scratch| {
            let [nmse, coverage] = out;
            let sims = &sim[sets.start * n..sets.end * n];
            match moments {
                Some(moments) => {
                    self.score_by_moments(moments, sets.start, sims, (nmse, coverage), scratch)
                }
                None if by_lanes => self.score_lanes(sets.start, sims, (nmse, coverage), scratch),
                None => self.score_rows(sets.start, sims, (nmse, coverage), scratch),
            }
        })?;
        Ok(Scores { nmse, coverage })
    }

    /// Coverage of a whole curve.
    pub(crate) fn coverage(&self) -> f64 {
        self.covered / self.measured.target.total
    }

    fn score_by_moments(
        &self,
        moments: &Moments,
        first: usize,
        sims: &[f64],
        (nmse, coverage): (&mut [f64], &mut [f64]),
        scratch: &mut Scratch,
    ) -> Result<(), Error> {
        coverage.fill(self.coverage());
        vectorised(SumMoments { path: self, moments, sims, nmse: &mut *nmse, scratch });
        for (i, sim) in sims.chunks_exact(self.n_values()).enumerate() {
            if nmse[i].is_nan() {
                let score = self.score_row(first + i, sim, scratch)?;
                (nmse[i], coverage[i]) = (score.nmse, score.coverage);
            }
        }
        Ok(())
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

    /// Scores curves four by four, and one by one what is left over or unusable.
    fn score_lanes(
        &self,
        first: usize,
        sims: &[f64],
        (nmse, coverage): (&mut [f64], &mut [f64]),
        scratch: &mut Scratch,
    ) -> Result<(), Error> {
        let n = self.n_values();
        let whole = self.coverage();
        for (k, sims) in sims.chunks(LANES * n).enumerate() {
            let sets = k * LANES..k * LANES + sims.len() / n;
            let out = (&mut nmse[sets.clone()], &mut coverage[sets.clone()]);
            match vectorised(SumLanes { path: self, sims, lanes: &mut scratch.lanes }) {
                Some(totals) => {
                    out.1.fill(whole);
                    for (nmse, sum) in out.0.iter_mut().zip(totals) {
                        *nmse = sum / self.covered;
                    }
                }
                None => self.score_rows(first + sets.start, sims, out, scratch)?,
            }
        }
        Ok(())
    }

    fn score_rows(
        &self,
        first: usize,
        sims: &[f64],
        (nmse, coverage): (&mut [f64], &mut [f64]),
        scratch: &mut Scratch,
    ) -> Result<(), Error> {
        for (i, sim) in sims.chunks_exact(self.n_values()).enumerate() {
            let score = self.score_row(first + i, sim, scratch)?;
            (nmse[i], coverage[i]) = (score.nmse, score.coverage);
        }
        Ok(())
    }

    /// Scores one curve over the measured points.
    fn score_row(&self, set: usize, sim: &[f64], scratch: &mut Scratch) -> Result<Score, Error> {
        match reached(set, sim)? {
            Some(n) => Ok(self
                .measured
                .score_path(&self.sim_x[..n], &sim[..n], scratch)
                // A path of one point, or one that has not moved yet, has not got anywhere.
                .unwrap_or(NOTHING_REACHED)),
            None => Ok(self.score_whole(sim, scratch)),
        }
    }

    /// Scores a whole curve; leaves it interpolated at the measured points in `scratch.values`.
    pub(crate) fn score_whole(&self, sim: &[f64], scratch: &mut Scratch) -> Score {
        let Scratch { pieces, values, .. } = scratch;
        self.measured.score_knots(&self.places.legs, sim, pieces, values)
    }
}

/// NMSE of each curve by the moments; NaN where they would cost digits.
struct SumMoments<'a> {
    path: &'a SharedPath,
    moments: &'a Moments,
    sims: &'a [f64],
    nmse: &'a mut [f64],
    scratch: &'a mut Scratch,
}

impl pulp::NullaryFnOnce for SumMoments<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { path, moments, sims, nmse, scratch } = self;
        for (nmse, sim) in nmse.iter_mut().zip(sims.chunks_exact(path.n_values())) {
            let y = path.at_knots(sim, scratch);
            *nmse = y.and_then(|y| moments.nmse(y)).unwrap_or(f64::NAN);
        }
    }
}

/// Sums of squares of four curves; `None` if they are fewer or one has an unusable value.
struct SumLanes<'a> {
    path: &'a SharedPath,
    sims: &'a [f64],
    lanes: &'a mut Vec<f64>,
}

impl pulp::NullaryFnOnce for SumLanes<'_> {
    type Output = Option<[f64; LANES]>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Self { path, sims, lanes } = self;
        let n = path.n_values();
        if sims.len() != LANES * n || !usable(sims) {
            return None;
        }
        lanes.resize(LANES * n, 0.0);
        let (lanes, _) = lanes.as_chunks_mut::<LANES>();
        for (i, lane) in lanes.iter_mut().enumerate() {
            *lane = std::array::from_fn(|l| sims[l * n + i]);
        }
        let mut parts = [[0.0; LANES]; PARTS];
        for rows in path.rows.chunks(PARTS) {
            for (row, part) in rows.iter().zip(&mut parts) {
                let (lower, upper) = (lanes[row.lower], lanes[row.upper]);
                for l in 0..LANES {
                    let value = lower[l] + row.share * (upper[l] - lower[l]);
                    let error = (value - row.exp) * row.factor;
                    part[l] += error * error;
                }
            }
        }
        Some(std::array::from_fn(|l| sum_of_parts(parts.map(|part| part[l]))))
    }
}

impl Places {
    /// The simulated values on both sides of a place.
    fn neighbours(&self, place: Place) -> (usize, usize) {
        let at = &self.legs[place.leg].at;
        let lower = at[place.knot];
        // A point on a knot is that knot's alone.
        if place.share == 0.0 { (lower, lower) } else { (lower, at[place.knot + 1]) }
    }

    /// The knots of all legs in one row, turning points once, and the first of each leg therein.
    fn chained(&self) -> (Vec<usize>, Vec<usize>) {
        let (mut knots, mut firsts) = (Vec::new(), Vec::new());
        for leg in &self.legs {
            if knots.last() == leg.at.first() {
                knots.pop();
            }
            firsts.push(knots.len());
            knots.extend(&leg.at);
        }
        (knots, firsts)
    }
}

/// How many values a row reached; `None` if all.
pub(crate) fn reached(set: usize, sim: &[f64]) -> Result<Option<usize>, CurveError> {
    if let Some(index) = sim.iter().position(|v| v.abs() > LARGEST) {
        return Err(batch::unusable(set, index, sim[index]));
    }
    let Some(index) = sim.iter().position(|v| v.is_nan()) else { return Ok(None) };
    if sim[index..].iter().any(|v| !v.is_nan()) {
        return Err(CurveError::GapInBatch { row: set, index });
    }
    Ok(Some(index))
}
