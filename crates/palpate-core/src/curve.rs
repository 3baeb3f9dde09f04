//! Curves as paths: cut into monotone branches, interpolated branch by branch.
//!
//! | name here | quantity |
//! |---|---|
//! | `abscissa`, `sim_x`, `at_x` | depth d (mm) or rotation (degrees), in the order travelled |
//! | `sim_y` | normal force (N) or torque (N·mm) there |
//! | branch | longest stretch of a path that runs one way |
//! | `tolerance` | movement that counts as noise, in units of the abscissa |
//!
//! A twist 0 → −22.5° → +22.5° → 0 passes most angles more than once, each time with another
//! torque. So a path is never sorted by its abscissa: the k-th simulated branch answers for the
//! k-th measured one.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use crate::error::{CurveError, Error};
use crate::knots::{BLOCK, Legs, Pieces};

/// Share of the measured abscissa's span by which a point may overshoot a simulated branch.
///
/// It absorbs the round-off of two programs that compute the same path; nothing beyond it is ever
/// extrapolated.
pub const ROUND_OFF: f64 = 1e-9;

/// Largest magnitude of a value of a curve: differences of any two can be taken below it.
pub const LARGEST: f64 = f64::MAX / 8.0;

/// How a simulated curve runs between its points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Interpolant {
    /// Straight from point to point.
    #[default]
    Linear,
    /// Piecewise cubic without overshoot: monotone wherever the points are.
    ///
    /// Slopes are the weighted harmonic means of Fritsch and Butland (SIAM J. Sci. Stat. Comput. 5,
    /// 300, 1984), with three-point slopes at both ends of a branch.
    Pchip,
}

impl Interpolant {
    /// Every interpolant, in the order of the documentation.
    pub const ALL: [Self; 2] = [Self::Linear, Self::Pchip];

    /// The name in Python.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Pchip => "pchip",
        }
    }
}

impl FromStr for Interpolant {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        Self::ALL
            .into_iter()
            .find(|i| i.name() == name)
            .ok_or_else(|| CurveError::UnknownInterpolant { name: name.to_owned() }.into())
    }
}

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

    /// Points that only this branch answers for: a turning point belongs to the earlier branch.
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
/// turning point is the last point of a plateau at the extremum. A reversal of at most `tolerance`
/// is noise and does not cut; the points in it belong to the running branch.
///
/// # Errors
/// [`CurveError`] if the path has fewer than two points, a value is not finite, the path never
/// moves by more than `tolerance`, or `tolerance` is negative.
///
/// # Examples
/// ```
/// use palpate_core::curve::branches;
/// let cuts = branches(&[0.0, -20.0, 0.0, 20.0, 0.0], 0.0)?;
/// let spans: Vec<_> = cuts.iter().map(|b| (b.start, b.stop)).collect();
/// assert_eq!(spans, [(0, 2), (1, 4), (3, 5)]);
/// # Ok::<(), palpate_core::Error>(())
/// ```
pub fn branches(abscissa: &[f64], tolerance: f64) -> Result<Vec<Branch>, Error> {
    cut(Named { name: "abscissa", values: abscissa }, tolerance)
}

/// Interpolates a simulated path onto measured abscissae, branch by branch.
///
/// Both paths are cut with [`branches`] and `tolerance`. The k-th simulated branch answers for the
/// k-th measured branch; a turning point is answered by the earlier of its two branches. A measured
/// point beyond its simulated branch is not covered (NaN, `false`) unless it overshoots the end by
/// at most `tolerance` plus [`ROUND_OFF`] of the measured span: then it takes the value at the end.
/// A simulated path that ended early leaves the rest of the measured path uncovered.
///
/// Where the simulated path holds still, the value with which it moves on counts. Simulated points
/// inside a reversal below the tolerance are passed over. Every branch is interpolated on its own.
///
/// # Errors
/// [`CurveError`] if either path cannot be cut, lengths differ, the directions of two corresponding
/// branches disagree, or the simulated path has more branches than the measured one.
///
/// # Examples
/// ```
/// use palpate_core::curve::{Interpolant, interpolate};
/// // A loop: at 1.0 the way out and the way back differ. The simulation stops half way back.
/// let (sim_x, sim_y) = ([0.0, 2.0, 1.0], [0.0, 4.0, 1.0]);
/// let out = interpolate(&sim_x, &sim_y, &[1.0, 2.0, 1.0, 0.0], 0.0, Interpolant::Linear)?;
/// assert_eq!(out.values[..3], [2.0, 4.0, 1.0]);
/// assert_eq!(out.covered, [true, true, true, false]);
/// # Ok::<(), palpate_core::Error>(())
/// ```
pub fn interpolate(
    sim_x: &[f64],
    sim_y: &[f64],
    at_x: &[f64],
    tolerance: f64,
    interpolant: Interpolant,
) -> Result<Interpolated, Error> {
    usable_path(sim_x, sim_y)?;
    let measured = Legs::new(Named { name: "at_x", values: at_x }, tolerance)?;
    let (mut knots, mut pieces) = (Vec::new(), Pieces::default());
    measured.knots_of(sim_x, &mut knots)?;
    let mut values = vec![f64::NAN; measured.n_points() + BLOCK];
    measured.interpolate(&knots, sim_y, interpolant, &mut pieces, &mut values);
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
pub(crate) fn cut(path: Named<'_>, tolerance: f64) -> Result<Vec<Branch>, Error> {
    if !(tolerance.is_finite() && tolerance >= 0.0) {
        return Err(CurveError::Tolerance { value: tolerance }.into());
    }
    let Named { name: array, values: x } = path;
    match x.len() {
        0 => return Err(CurveError::Empty { array }.into()),
        1 => return Err(CurveError::OnePoint { array }.into()),
        _ => finite(array, x)?,
    }
    let Some((direction, first_move)) = first_direction(x, tolerance) else {
        return Err(CurveError::NeverMoves { array, span: span(x), tolerance }.into());
    };
    Ok(runs(x, tolerance, direction, first_move))
}

/// Which way the path sets out, and the point at which that is certain.
fn first_direction(x: &[f64], tolerance: f64) -> Option<(Direction, usize)> {
    let (mut least, mut most) = (x[0], x[0]);
    for (i, &v) in x.iter().enumerate() {
        if v - least > tolerance {
            return Some((Direction::Rising, i));
        }
        if most - v > tolerance {
            return Some((Direction::Falling, i));
        }
        least = least.min(v);
        most = most.max(v);
    }
    None
}

/// The branches of a path that sets out in `direction` and has got to `first_move`.
fn runs(x: &[f64], tolerance: f64, mut direction: Direction, first_move: usize) -> Vec<Branch> {
    let mut found = Vec::new();
    let mut start = 0;
    let mut furthest = first_move;
    for i in first_move + 1..x.len() {
        let ahead = direction.along(x[i]) - direction.along(x[furthest]);
        if ahead >= 0.0 {
            furthest = i;
        } else if -ahead > tolerance {
            found.push(Branch { start, stop: furthest + 1, direction });
            start = furthest;
            direction = direction.reversed();
            furthest = i;
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
