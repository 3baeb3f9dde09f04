//! What can be wrong with the arrays.

/// Why arrays do not describe elements, or do not fit them.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the messages name the fields")]
pub enum Error {
    /// There are no elements, points or nodes.
    #[error(
        "a block of {elements} elements with {points} points and {nodes} nodes each is empty: \
         leave it out"
    )]
    Empty { elements: usize, points: usize, nodes: usize },
    /// An array has the wrong number of values.
    #[error("{array} has {length} values where {expected} were expected")]
    Length { array: &'static str, length: usize, expected: usize },
    /// An index is negative or beyond 32 bits.
    #[error("{array}: element {element} has {value}: it must lie between 0 and 2^32 - 1")]
    Index { array: &'static str, element: usize, value: i64 },
    /// Places of two nodes are not three rows of three.
    #[error(
        "places: element {element} has entries at row {row}, column {column} that are neither three rows \
         of three in sequence, at one distance, nor all in one place"
    )]
    Places { element: usize, row: usize, column: usize },
    /// A gradient is NaN or infinite.
    #[error("gradients: element {element} has {value}: every gradient must be finite")]
    Gradient { element: usize, value: f64 },
    /// A volume is negative or not finite, or an element has none.
    #[error(
        "volumes: element {element} has {value} mm³: volumes must be finite and not negative, and \
         some volume of each element positive; is its node order right?"
    )]
    Volume { element: usize, value: f64 },
    /// An array over nodes or entries is too short for an index of the block.
    #[error("{array} has {length} rows, but the block refers to row {index}")]
    TooShort { array: &'static str, length: usize, index: usize },
    /// A stiffness was requested from a block without places of its entries.
    #[error("the block has no places to put stiffness entries in: give `places` when making it")]
    NoPlaces,
}
