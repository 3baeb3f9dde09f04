//! Direct solution of sparse systems A x = b whose pattern stays the same.
//!
//! A finite element tangent is assembled into one pattern many times. [`SparseFactor`] orders and
//! analyses the pattern once, factorises values as often as asked, and solves with the last factor.
//! The factorisations are faer's; what is added here is the pattern's validation, any layout of
//! it, and the refusal to return a solution that does not solve the system.
//!
//! | module | what |
//! |---|---|
//! | [`pattern`] | where the entries are; values gathered into it; A x |
//! | `graph`, `separator`, `ordering` | nested dissection of the graph of nodes |
//! | `factor` | faer's LU, L B Lᵀ and L Lᵀ behind one enum, in any precision |
//! | `precision` | a factor in double precision, or in single precision of a scaled matrix |
//! | `sweep` | the triangular solutions of a symmetric factor |
//! | `rows`, `krylov` | products with the whole matrix; GMRES with an older factor |
//! | [`solver`] | [`SparseFactor`]: analyse, factorise, probe, solve, refine |
//! | [`error`] | what can be wrong with the input, and with the matrix |

pub mod error;
mod factor;
mod graph;
mod krylov;
mod ordering;
pub mod pattern;
mod precision;
mod rows;
mod separator;
pub mod solver;
mod sweep;

pub use error::{Error, InputError, NumericalError};
pub use krylov::Iterated;
pub use pattern::Layout;
pub use precision::Precision;
pub use solver::{Kind, SparseFactor};
