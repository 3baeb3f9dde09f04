//! Errors of the kernels: each names the array, the index and the value, with a remedy.

use crate::curve::Direction;
use crate::nmse::Normaliser;

/// Any failure of a kernel, grouped by who can fix it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A curve cannot be used.
    #[error(transparent)]
    Curve(#[from] CurveError),
    /// Curves cannot be compared.
    #[error(transparent)]
    Scoring(#[from] ScoringError),
    /// A design cannot be drawn.
    #[error(transparent)]
    Sampling(#[from] SamplingError),
}

/// Why a curve cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages name the fields")]
pub enum CurveError {
    /// A value is NaN or infinite.
    #[error("{array}[{index}] is {value}: every value must be finite; drop or repair that sample")]
    NotFinite { array: &'static str, index: usize, value: f64 },
    /// A value is so large that differences overflow.
    #[error("{array}[{index}] is {value}: a value must stay below 2.2e307; check its unit")]
    TooLarge { array: &'static str, index: usize, value: f64 },
    /// A simulated value in a batch is infinite (NaN marks an uncovered point there).
    #[error(
        "sim[{row}, {index}] is {value}: a simulated value must be finite, or NaN where the \
         simulation did not get to"
    )]
    InfiniteInBatch { row: usize, index: usize, value: f64 },
    /// A row of a batch on a shared path has values after a NaN.
    #[error(
        "sim[{row}, {index}] is NaN but later values are not: on a shared path NaN may only mark \
         the end that a simulation did not get to"
    )]
    GapInBatch { row: usize, index: usize },
    /// An array has no values.
    #[error("{array} is empty: a curve needs at least one value")]
    Empty { array: &'static str },
    /// A path has a single point.
    #[error("{array} has one point: a path needs at least two")]
    OnePoint { array: &'static str },
    /// Two arrays that belong together differ in length.
    #[error(
        "{array} has {length} values but {other} has {other_length}: they must be equally long"
    )]
    LengthMismatch { array: &'static str, length: usize, other: &'static str, other_length: usize },
    /// A batch does not divide into rows of the measured curve's length.
    #[error("sim has {length} values: {n_sets} sets of {n_points} measured points were expected")]
    BatchShape { length: usize, n_sets: usize, n_points: usize },
    /// The abscissa stays where it is.
    #[error("{array} never moves: every value is {value}; give a path that moves")]
    NeverMoves { array: &'static str, value: f64 },
    /// A simulated branch runs against its measured counterpart.
    #[error(
        "branch {branch} of the simulated path {array} is {simulated} where that of {measured_array} \
         is {measured}: simulate the path that was travelled, or remove noise from the abscissa"
    )]
    Direction {
        branch: usize,
        array: &'static str,
        measured_array: &'static str,
        simulated: Direction,
        measured: Direction,
    },
    /// The simulated path turns more often than the measured one.
    #[error(
        "the simulated path {array} has {simulated} branches but {measured_array} has only \
         {measured}: simulate the path that was travelled, or remove noise from the abscissa"
    )]
    TooManyBranches {
        array: &'static str,
        measured_array: &'static str,
        simulated: usize,
        measured: usize,
    },
}

/// Why curves cannot be compared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages name the fields")]
pub enum ScoringError {
    /// The normaliser is too close to zero to divide by.
    #[error(
        "normaliser \"{normaliser}\" is degenerate: it is {value} on a measured curve whose rms is \
         {rms}; {advice}",
        advice = if *rms == 0.0 {
            "all its ordinates are 0: check its column and what the sensor recorded".to_owned()
        } else {
            format!("choose another ({})", normaliser.others())
        }
    )]
    Degenerate { normaliser: Normaliser, value: f64, rms: f64 },
    /// The name of a normaliser is not known.
    #[error("normaliser {name:?} is unknown: choose mean_abs, mean, rms, range, std or unit")]
    UnknownNormaliser { name: String },
    /// A weight is negative, NaN or infinite.
    #[error("weights[{index}] is {value}: a weight must be finite and not negative")]
    Weight { index: usize, value: f64 },
    /// Every weight is zero.
    #[error("every weight is zero: give at least one measured point a positive weight")]
    ZeroWeights,
    /// There is not one weight for every measured point.
    #[error("weights has {length} values but the measured curve has {n_points} points")]
    WeightsLength { length: usize, n_points: usize },
}

/// Why a design cannot be drawn.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages name the fields")]
pub enum SamplingError {
    /// The design has no rows or no columns.
    #[error("a design of n = {n} sets and d = {d} parameters is empty: both must be at least 1")]
    EmptyDesign { n: usize, d: usize },
    /// The design has more values than the limit.
    #[error(
        "a design of n = {n} sets and d = {d} parameters exceeds {limit} values: ask for fewer"
    )]
    DesignTooLarge { n: usize, d: usize, limit: usize },
    /// The values do not make rows of d parameters.
    #[error("points has {length} values: one or more rows of d = {d} parameters were expected")]
    PointsShape { length: usize, d: usize },
    /// A value is outside the unit cube.
    #[error("points[{row}, {column}] is {value}: a design in the unit cube keeps between 0 and 1")]
    OutsideCube { row: usize, column: usize, value: f64 },
    /// More rows are to stay than there are.
    #[error("n_fixed is {n_fixed}, but points has only {n} rows: keep at most as many")]
    FixedRows { n_fixed: usize, n: usize },
    /// The name of a criterion is not known.
    #[error("criterion {name:?} is unknown: choose cd, maximin or correlation")]
    UnknownCriterion { name: String },
    /// An extension that adds nothing.
    #[error("n_total is {n_total}, but points has {n} rows already: ask for more")]
    NothingToAdd { n_total: usize, n: usize },
    /// Two sets fall into one of the finer strata.
    #[error(
        "points[{first}, {column}] and points[{row}, {column}] share one of n_total = {n_total} \
         strata, so no Latin hypercube of n_total sets holds both; extend a Latin hypercube, to a \
         multiple of its number of sets"
    )]
    SharedStratum { column: usize, first: usize, row: usize, n_total: usize },
    /// The range of a parameter has no logarithm.
    #[error(
        "the range {lower} to {upper} has no logarithmic scale: both ends must be finite, of one \
         sign and not 0"
    )]
    NoLogarithm { lower: f64, upper: f64 },
}
