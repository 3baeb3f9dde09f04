//! Curves as paths: cut into monotone branches, interpolated branch by branch.
//!
//! | name here | quantity |
//! |---|---|
//! | `abscissa`, `sim_x`, `at_x` | depth d (mm) or rotation (degrees), in the order travelled |
//! | `sim_y` | normal force (N) or torque (N·mm) there |
//! | branch | longest stretch of a path that runs one way |
//!
//! A twist 0 → −22.5° → +22.5° → 0 passes most angles more than once, each time with another
//! torque. So a path is never sorted by its abscissa: the k-th simulated branch belongs to the
//! k-th measured one.

use std::fmt;
use std::ops::Range;

use crate::error::{CurveError, Error};
use crate::knots::{BLOCK, KnotOrdinates, Segments};

/// Share of the measured abscissa's span by which a point may overshoot a simulated branch.
///
/// It absorbs the round-off of two programs that compute the same path; nothing beyond it is ever
/// extrapolated.
pub const ROUND_OFF: f64 = 1e-9;

/// Largest magnitude of a value of a curve: differences of any two can be taken below it.
pub const LARGEST: f64 = f64::MAX / 8.0;

/// Which way a branch runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// The abscissa grows.
    Rising,
    /// The abscissa shrinks.
    Falling,
}

impl Direction {
    /// `x` measured along the direction of travel: it grows along either kind of branch.
    #[inline]
    pub(crate) fn along(self, x: f64) -> f64 {
        match self {
            Self::Rising => x,
            Self::Falling => -x,
        }
    }

    fn reversed(self) -> Self {
        match self {
            Self::Rising => Self::Falling,
            Self::Falling => Self::Rising,
        }
    }
}

impl fmt::Display for Direction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Rising => "rising",
            Self::Falling => "falling",
        })
    }
}

/// One monotone run of a path: the points `start..stop`, half open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Branch {
    /// First point; on every branch but the first it is also the last point of the one before.
    pub start: usize,
    /// One past the last point.
    pub stop: usize,
    /// Which way the branch runs.
    pub direction: Direction,
}

impl Branch {
    /// Points of the branch, both ends included.
    pub(crate) fn points(self) -> Range<usize> {
        self.start..self.stop
    }

    /// Points of only this branch: a turning point belongs to the earlier branch.
    pub(crate) fn own_points(self) -> Range<usize> {
        self.start + usize::from(self.start > 0)..self.stop
    }
}

/// Ordinates interpolated onto other abscissae, and where there was anything to interpolate.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Interpolated {
    /// Values (n,); NaN where not covered.
    pub values: Vec<f64>,
    /// Whether the simulated path reached the point (n,).
    pub covered: Vec<bool>,
}

/// An abscissa with the name of the argument that it came from.
#[derive(Clone, Copy)]
pub(crate) struct Named<'a> {
    pub(crate) name: &'static str,
    pub(crate) values: &'a [f64],
}

/// Cuts a path into its maximal monotone branches.
///
/// Neighbours share their turning point: `branches[k + 1].start == branches[k].stop - 1`. A plateau
/// (equal abscissae) belongs to the run before it, or to the run after it if it comes first, so the
/// turning point is the last point of a plateau at the extremum.
///
/// # Errors
/// [`CurveError`] if the path has fewer than two points, a value is not finite, or the path never
/// moves.
///
/// # Examples
/// ```
/// use palpate_core::curve::branches;
/// let cuts = branches(&[0.0, -20.0, 0.0, 20.0, 0.0])?;
/// let spans: Vec<_> = cuts.iter().map(|b| (b.start, b.stop)).collect();
/// assert_eq!(spans, [(0, 2), (1, 4), (3, 5)]);
/// # Ok::<(), palpate_core::Error>(())
/// ```
pub fn branches(abscissa: &[f64]) -> Result<Vec<Branch>, Error> {
    cut(Named { name: "abscissa", values: abscissa })
}

/// Interpolates a simulated path onto measured abscissae, branch by branch.
///
/// Both paths are cut with [`branches`]. The k-th simulated branch belongs to the k-th measured
/// branch; a turning point is answered by the earlier of its two branches. Between its points a
/// simulated path is straight. A measured point beyond its simulated branch is not covered (NaN,
/// `false`) unless it overshoots the end by at most [`ROUND_OFF`] of the measured span: then it
/// takes the value at the end. A simulated path that ended early leaves the rest of the measured
/// path uncovered. Where the simulated path holds still, the value with which it moves on counts.
///
/// # Errors
/// [`CurveError`] if either path cannot be cut, lengths differ, the directions of two corresponding
/// branches disagree, or the simulated path has more branches than the measured one.
///
/// # Examples
/// ```
/// use palpate_core::curve::interpolate;
/// // A loop: at 1.0 the way out and the way back differ. The simulation stops half way back.
/// let (sim_x, sim_y) = ([0.0, 2.0, 1.0], [0.0, 4.0, 1.0]);
/// let out = interpolate(&sim_x, &sim_y, &[1.0, 2.0, 1.0, 0.0])?;
/// assert_eq!(out.values[..3], [2.0, 4.0, 1.0]);
/// assert_eq!(out.covered, [true, true, true, false]);
/// # Ok::<(), palpate_core::Error>(())
/// ```
pub fn interpolate(sim_x: &[f64], sim_y: &[f64], at_x: &[f64]) -> Result<Interpolated, Error> {
    usable_path(sim_x, sim_y)?;
    let measured = Segments::new(Named { name: "at_x", values: at_x })?;
    let (mut knots, mut ordinates) = (Vec::new(), KnotOrdinates::default());
    measured.knots_of(sim_x, &mut knots)?;
    let mut values = vec![f64::NAN; measured.n_points() + BLOCK];
    measured.interpolate(&knots, sim_y, &mut ordinates, &mut values);
    values.truncate(measured.n_points());
    let covered = values.iter().map(|v| !v.is_nan()).collect();
    Ok(Interpolated { values, covered })
}

/// Checks everything about a simulated path but its abscissae.
pub(crate) fn usable_path(sim_x: &[f64], sim_y: &[f64]) -> Result<(), CurveError> {
    let x = Named { name: "sim_x", values: sim_x };
    same_length(Named { name: "sim_y", values: sim_y }, x)?;
    finite("sim_y", sim_y)
}

/// Checks a path and cuts it.
pub(crate) fn cut(path: Named<'_>) -> Result<Vec<Branch>, Error> {
    let Named { name: array, values: x } = path;
    match x.len() {
        0 => return Err(CurveError::Empty { array }.into()),
        1 => return Err(CurveError::OnePoint { array }.into()),
        _ => finite(array, x)?,
    }
    let Some(first_move) = x.iter().position(|v| (v - x[0]).abs() > 0.0) else {
        return Err(CurveError::NeverMoves { array, value: x[0] }.into());
    };
    let rises = x[first_move] > x[0];
    let direction = if rises { Direction::Rising } else { Direction::Falling };
    Ok(runs(x, direction, first_move))
}

/// The branches of a path that sets out in `direction` and has got to `first_move`.
fn runs(x: &[f64], mut direction: Direction, first_move: usize) -> Vec<Branch> {
    let mut found = Vec::new();
    let mut start = 0;
    for i in first_move + 1..x.len() {
        if direction.along(x[i]) < direction.along(x[i - 1]) {
            found.push(Branch { start, stop: i, direction });
            start = i - 1;
            direction = direction.reversed();
        }
    }
    found.push(Branch { start, stop: x.len(), direction });
    found
}

/// Checks that every simulated branch has a measured one that runs the same way.
pub(crate) fn correspond(
    array: &'static str,
    simulated: &[Branch],
    measured_array: &'static str,
    measured: &[Branch],
) -> Result<(), CurveError> {
    for (branch, (s, m)) in simulated.iter().zip(measured).enumerate() {
        if s.direction != m.direction {
            let (simulated, measured) = (s.direction, m.direction);
            return Err(CurveError::Direction {
                branch,
                array,
                measured_array,
                simulated,
                measured,
            });
        }
    }
    let (simulated, measured) = (simulated.len(), measured.len());
    if simulated > measured {
        return Err(CurveError::TooManyBranches { array, measured_array, simulated, measured });
    }
    Ok(())
}

pub(crate) fn span(x: &[f64]) -> f64 {
    let most = x.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let least = x.iter().copied().fold(f64::INFINITY, f64::min);
    most - least
}

pub(crate) fn finite(array: &'static str, values: &[f64]) -> Result<(), CurveError> {
    if usable(values) {
        return Ok(());
    }
    match values.iter().position(|v| !v.is_finite()) {
        Some(index) => Err(CurveError::NotFinite { array, index, value: values[index] }),
        None => Err(too_large(array, values)),
    }
}

/// Whether every value is neither NaN nor too large.
#[inline]
pub(crate) fn usable(values: &[f64]) -> bool {
    // Counted, not searched for, so that several values are looked at at once.
    values.iter().filter(|v| v.abs() <= LARGEST).count() == values.len()
}

fn too_large(array: &'static str, values: &[f64]) -> CurveError {
    let index = values.iter().position(|v| v.abs() > LARGEST).unwrap_or_default();
    CurveError::TooLarge { array, index, value: values[index] }
}

pub(crate) fn same_length(a: Named<'_>, b: Named<'_>) -> Result<(), CurveError> {
    if a.values.len() == b.values.len() {
        return Ok(());
    }
    Err(CurveError::LengthMismatch {
        array: a.name,
        length: a.values.len(),
        other: b.name,
        other_length: b.values.len(),
    })
}
