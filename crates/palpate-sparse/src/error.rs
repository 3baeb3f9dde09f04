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
pub enum InputError {
    /// The name of a precision is not known.
    #[error("precision {name:?} is unknown: choose double or single")]
    UnknownPrecision {
        /// The name given.
        name: String,
    },
    /// The pointers do not delimit the indices.
    #[error(
        "indptr[{index}] is {value}: pointers must start at 0, never fall and end at the number of \
         indices ({n_indices})"
    )]
    Pointer {
        /// Position of the first offender.
        index: usize,
        /// The value itself.
        value: i32,
        /// Number of indices.
        n_indices: usize,
    },
    /// The matrix has no rows.
    #[error("indptr has {length} values: a matrix of n rows needs n + 1, and n at least 1")]
    NoRows {
        /// Number of pointers.
        length: usize,
    },
    /// An index lies outside the matrix.
    #[error("indices[{index}] is {value}: it must lie between 0 and {n} - 1")]
    Index {
        /// Position of the first offender.
        index: usize,
        /// The value itself.
        value: i32,
        /// Rows of the matrix.
        n: usize,
    },
    /// The indices of a row do not rise.
    #[error(
        "indices[{index}], in row {row}, does not exceed the one before it: sort indices, sum \
         duplicates"
    )]
    Unsorted {
        /// The row.
        row: usize,
        /// Position of the first offender.
        index: usize,
    },
    /// The pattern has an entry on one side only.
    #[error(
        "entry ({row}, {column}) has no counterpart ({column}, {row}): give a symmetric pattern"
    )]
    OneSided {
        /// Row of the entry.
        row: usize,
        /// Its column.
        column: usize,
    },
    /// The values to factorise are not symmetric.
    #[error(
        "entry ({row}, {column}) is {value} but its counterpart is {counterpart}: give the symmetric \
         part"
    )]
    Unsymmetric {
        /// Row of the entry in the lower triangle.
        row: usize,
        /// Its column.
        column: usize,
        /// Its value.
        value: f64,
        /// Value on the other side.
        counterpart: f64,
    },
    /// There is not one value for every entry or row.
    #[error("{array} has {length} values where {expected} were expected")]
    Length {
        /// The argument.
        array: &'static str,
        /// Its length.
        length: usize,
        /// What it should be.
        expected: usize,
    },
    /// A value is NaN or infinite.
    #[error("{array}[{index}] is {value}: every value must be finite")]
    NotFinite {
        /// The argument.
        array: &'static str,
        /// Position of the first offender.
        index: usize,
        /// The value itself.
        value: f64,
    },
    /// A solution was asked for before a factorisation succeeded.
    #[error("there is no factor to solve with: call factorise first, and mind its error")]
    NotFactorised,
    /// The factor exceeds memory.
    #[error("the factor of {n} unknowns with {n_entries} entries exceeds memory: coarsen the mesh")]
    TooLarge {
        /// Rows of the matrix.
        n: usize,
        /// Entries of its pattern.
        n_entries: usize,
    },
}

/// Why the matrix cannot be factorised.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NumericalError {
    /// The matrix is singular to working precision.
    #[error(
        "the matrix is singular to working precision: a known solution came back with a relative \
         error of {probe_error:e}; is every part of the body held?"
    )]
    Singular {
        /// Relative error of a known solution; NaN if there was none at all.
        probe_error: f64,
    },
    /// The matrix is singular, or too near it for single precision.
    #[error(
        "the matrix is singular or too ill-conditioned for a factor in single precision: a known \
         solution came back with a relative error of {probe_error:e}; choose precision \"double\" \
         to tell"
    )]
    SingularInSingle {
        /// Relative error of a known solution; NaN if there was none at all.
        probe_error: f64,
    },
}
