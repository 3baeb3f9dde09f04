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
//! | `factor` | faer's LU, L B Lᵀ and L Lᵀ behind one enum |
//! | `precision` | a factor in double precision, or in single precision of a scaled matrix |
//! | [`solver`] | [`SparseFactor`]: analyse, factorise, probe, solve, refine |
//! | [`error`] | what can be wrong with the input, and with the matrix |

pub mod error;
mod factor;
pub mod pattern;
mod precision;
pub mod solver;

pub use error::{Error, InputError, NumericalError};
pub use pattern::Layout;
pub use precision::Precision;
pub use solver::{Kind, SparseFactor};
