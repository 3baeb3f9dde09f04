//! Factors of sparse symmetric matrices whose pattern stays the same, to precondition with.
//!
//! A finite element tangent is assembled into one pattern many times. [`SparseFactor`] orders and
//! analyses the pattern once, factorises values any number of times, and solves nearby systems by
//! GMRES with the last factor. The factorisation is faer's; this crate adds the pattern's
//! validation, the order of elimination, and the refusal to keep a factor of a singular matrix.
//!
//! | module | what |
//! |---|---|
//! | `pattern` | where the entries are; values gathered into it; A x |
//! | `graph`, `separator`, `ordering` | nested dissection of the graph of nodes |
//! | `factor` | faer's L B Lᵀ, in any precision |
//! | `precision` | a factor in double precision, or in single precision of a scaled matrix |
//! | `panels`, `triangular_solve` | the factor packed; the triangular solutions |
//! | `rows`, `krylov` | products with the whole matrix; GMRES with an older factor |
//! | `space` | one space of directions for several right-hand sides |
//! | `smoother` | a sweep over the rows that changed since that factor |
//! | [`solver`] | [`SparseFactor`]: analyse, factorise, probe, precondition |
//! | [`error`] | what can be wrong with the input, and with the matrix |

pub mod error;
mod factor;
mod graph;
mod krylov;
mod ordering;
mod panels;
mod pattern;
mod precision;
mod rows;
mod separator;
mod smoother;
pub mod solver;
mod space;
mod triangular_solve;

pub use error::{Error, InputError, NumericalError};
pub use krylov::Iterated;
pub use precision::Precision;
pub use solver::SparseFactor;
