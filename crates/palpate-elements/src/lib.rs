//! Forces and stiffnesses of hyperelastic finite elements whose material is any isotropic energy.
//!
//! A material is known by ψ_i = ∂Ψ/∂λ_i and ψ_ij = ∂²Ψ/∂λ_i∂λ_j at given principal stretches: a few
//! numbers for each quadrature point, which automatic differentiation supplies. Everything else is
//! here: deformation gradients, principal directions, divided differences, mean dilatation, the
//! element stiffness and its way into the sparse matrix.
//!
//! | name here | quantity |
//! |---|---|
//! | F, J | deformation gradient and its determinant |
//! | λ_a, N_a, e_a | principal stretches and directions: F N_a = λ_a e_a |
//! | F̄, θ, s | F̄ = s F with s = (θ/J)^(1/3), θ the element's mean of J |
//! | P, A | first Piola–Kirchhoff stress \[MPa\] and ∂P/∂F |
//! | K_ab | stiffness between two nodes \[N/mm\] |
//!
//! | module | what |
//! |---|---|
//! | [`block`] | elements of one kind, checked and packed |
//! | [`deformation`] | stretches of every quadrature point; nodal forces |
//! | [`principal`] | principal directions, and the tangent in their frame |
//! | `dilatation` | mean dilatation |
//! | `stiffness` | element stiffnesses into sparse values |
//! | `lanes` | several elements side by side |
//! | [`error`] | what can be wrong with the arrays |
#![expect(
    clippy::inline_always,
    reason = "a function left out of line misses the vector instructions"
)]
#![expect(clippy::needless_range_loop, reason = "the indices are those of the tensors")]

pub mod block;
pub mod deformation;
mod dilatation;
pub mod error;
mod lanes;
pub mod principal;
mod stiffness;

pub use block::{ElementBlock, Shape};
pub use deformation::Deformation;
pub use error::Error;
