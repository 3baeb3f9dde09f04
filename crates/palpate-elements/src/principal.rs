//! Principal directions and stretches, and the tangent in their frame.
//!
//! F = Σ_a λ_a e_a ⊗ N_a. In that frame the tangent ∂P/∂F of an isotropic material is sparse: only
//! A_aabb, A_abab and A_abba differ from zero.

use crate::lanes::{IDENTITY, Lanes, ONE, Square, Triple, ZERO, determinant, dot, scaled};

/// Where |c_a − c_b| ≤ EQUAL (c_a + c_b), c = λ², a divided difference gives way to its limit.
///
/// Cancellation grows as ε / EQUAL and truncation as m² EQUAL² / 12 for a stress ~ c^(m/2): here
/// both are below 1e-10 for exponents m up to 16.
pub const EQUAL: f64 = 3e-6;

/// One-sided Jacobi converges quadratically: the fourth sweep reaches rounding, the fifth is margin.
const SWEEPS: usize = 5;

/// The pairs of principal directions.
pub(crate) const PAIRS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];

/// The frame of F: e_a, N_a and λ_a.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    /// `spatial[a]` is e_a.
    pub(crate) spatial: Square,
    /// `material[a]` is N_a.
    pub(crate) material: Square,
    /// λ_a; NaN where the volume is not positive, since no energy is defined there.
    pub(crate) stretches: Triple,
}

impl Frame {
    /// The frame of the deformation gradient whose columns are given, and its determinant.
    ///
    /// FᵀF is never formed, so small stretches keep their relative accuracy.
    #[inline(always)]
    pub(crate) fn new(columns: &Square) -> (Self, Lanes) {
        let volume = determinant(columns);
        let (mut g, mut n) = (*columns, IDENTITY);
        for _ in 0..SWEEPS {
            for (a, b) in PAIRS {
                let (cosine, sine) = angle(&g[a], &g[b]);
                (g[a], g[b]) = rotated(&g[a], &g[b], cosine, sine);
                (n[a], n[b]) = rotated(&n[a], &n[b], cosine, sine);
            }
        }
        let stretches = g.each_ref().map(|column| {
            let length = dot(column, column).sqrt();
            volume.choose(ZERO, |v, zero| v > zero, length, Lanes::all(f64::NAN))
        });
        let spatial = [0, 1, 2].map(|a| scaled(&g[a], ONE / stretches[a]));
        (Self { spatial, material: n, stretches }, volume)
    }
}

/// Cosine and sine of the rotation that makes two columns orthogonal.
#[inline(always)]
fn angle(left: &Triple, right: &Triple) -> (Lanes, Lanes) {
    let product = dot(left, right);
    let difference = dot(right, right) - dot(left, left);
    let orthogonal = |x: f64, zero: f64| x.abs() <= zero;
    let cotangent = difference / product.choose(ZERO, orthogonal, ONE, product + product);
    let sign = cotangent.choose(ZERO, |x, zero| x < zero, Lanes::all(-1.0), ONE);
    let tangent = sign / (cotangent.abs() + (ONE + cotangent * cotangent).sqrt());
    let tangent = product.choose(ZERO, orthogonal, ZERO, tangent);
    let cosine = ONE / (ONE + tangent * tangent).sqrt();
    (cosine, cosine * tangent)
}

#[inline(always)]
fn rotated(left: &Triple, right: &Triple, cosine: Lanes, sine: Lanes) -> (Triple, Triple) {
    (
        [0, 1, 2].map(|i| cosine * left[i] - sine * right[i]),
        [0, 1, 2].map(|i| sine * left[i] + cosine * right[i]),
    )
}

/// ∂P/∂F in the principal frame, pairs in the order of [`PAIRS`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tangent {
    /// A_aabb.
    pub(crate) direct: Square,
    /// A_abab = A_baba.
    pub(crate) shear: Triple,
    /// A_abba.
    pub(crate) swap: Triple,
}

impl Tangent {
    /// From the energy's derivatives in the stretches.
    ///
    /// With S_a = ψ_a / λ_a and s = (S_a − S_b) / (c_a − c_b): A_abab = S_b + c_a s and A_abba =
    /// λ_a λ_b s. At equal stretches s is the mean over both ends of ½ (∂/∂c_a − ∂/∂c_b)(S_a − S_b):
    /// symmetric in the pair, so its error is of second order.
    #[inline(always)]
    pub(crate) fn new(stretches: &Triple, psi_i: &Triple, psi_ij: &Square) -> Self {
        let inverse = stretches.map(|s| ONE / s);
        let c = stretches.map(|s| s * s);
        let second = [0, 1, 2].map(|a| psi_i[a] * inverse[a]);
        // 2 ∂S_a/∂c_b
        let slope = |a: usize, b: usize| {
            let mixed = psi_ij[a][b] * inverse[a] * inverse[b];
            if a == b { mixed - second[a] * inverse[a] * inverse[a] } else { mixed }
        };
        let differences = PAIRS.map(|(a, b)| {
            let gap = c[a] - c[b];
            let equal = |gap: f64, small: f64| gap <= small;
            let small = Lanes::all(EQUAL) * (c[a] + c[b]);
            let limit = slope(a, a) + slope(b, b) - (slope(a, b) + slope(a, b));
            let divisor = gap.abs().choose(small, equal, ONE, gap);
            let ratio = (second[a] - second[b]) / divisor;
            gap.abs().choose(small, equal, Lanes::all(0.25) * limit, ratio)
        });
        let shear = [0, 1, 2].map(|k| second[PAIRS[k].1] + c[PAIRS[k].0] * differences[k]);
        let swap =
            [0, 1, 2].map(|k| stretches[PAIRS[k].0] * stretches[PAIRS[k].1] * differences[k]);
        Self { direct: *psi_ij, shear, swap }
    }
}
