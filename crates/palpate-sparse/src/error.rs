//! Errors of the solver: mistakes in the input, and matrices that cannot be factorised.

/// Any failure of the solver.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// The arguments do not describe a system.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The matrix cannot be factorised.
    #[error(transparent)]
    Numerical(#[from] NumericalError),
}

/// Why the arguments do not describe a system.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the messages name the fields")]
pub enum InputError {
    /// The name of a precision is not known.
    #[error("precision {name:?} is unknown: choose double or single")]
    UnknownPrecision { name: String },
    /// The pointers do not delimit the indices.
    #[error(
        "indptr[{index}] is {value}: pointers must start at 0, never fall and end at the number of \
         indices ({n_indices})"
    )]
    Pointer { index: usize, value: i32, n_indices: usize },
    /// The matrix has no rows.
    #[error("indptr has {length} values: a matrix of n rows needs n + 1, and n at least 1")]
    NoRows { length: usize },
    /// An index is outside the matrix.
    #[error("indices[{index}] is {value}: it must lie between 0 and {n} - 1")]
    Index { index: usize, value: i32, n: usize },
    /// The indices of a row do not rise.
    #[error(
        "indices[{index}], in row {row}, does not exceed the one before it: sort indices, sum \
         duplicates"
    )]
    Unsorted { row: usize, index: usize },
    /// The pattern has an entry on one side only.
    #[error(
        "entry ({row}, {column}) has no counterpart ({column}, {row}): give a symmetric pattern"
    )]
    OneSided { row: usize, column: usize },
    /// The order of elimination does not have every unknown once.
    #[error("order does not have each of {n} unknowns once: leave it out to have them ordered")]
    Order { n: usize },
    /// The values to factorise are not symmetric.
    #[error(
        "entry ({row}, {column}) is {value} but its counterpart is {counterpart}: give the symmetric \
         part"
    )]
    Unsymmetric { row: usize, column: usize, value: f64, counterpart: f64 },
    /// There is not one value for every entry or row.
    #[error("{array} has {length} values where {expected} were expected")]
    Length { array: &'static str, length: usize, expected: usize },
    /// A value is NaN or infinite.
    #[error("{array}[{index}] is {value}: every value must be finite")]
    NotFinite { array: &'static str, index: usize, value: f64 },
    /// A solution was requested before a factorisation succeeded.
    #[error("there is no factor to solve with: call factorise first, and mind its error")]
    NotFactorised,
    /// The factor exceeds memory.
    #[error("the factor of {n} unknowns with {n_entries} entries exceeds memory: coarsen the mesh")]
    TooLarge { n: usize, n_entries: usize },
}

/// Why the matrix cannot be factorised.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the messages name the fields")]
pub enum NumericalError {
    /// The matrix is singular to working precision.
    #[error(
        "the matrix is singular to working precision: a known solution came back with a relative \
         error of {probe_error:e}; is every part of the body held?"
    )]
    Singular { probe_error: f64 },
    /// The matrix is singular, or too near it for single precision.
    #[error(
        "the matrix is singular or too ill-conditioned for a factor in single precision: a known \
         solution came back with a relative error of {probe_error:e}; choose precision \"double\" \
         to tell"
    )]
    SingularInSingle { probe_error: f64 },
}
