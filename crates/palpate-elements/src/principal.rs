//! Principal directions and stretches, and the tangent in their frame.
//!
//! F = Σ_a λ_a e_a ⊗ N_a. In that frame the tangent ∂P/∂F of an isotropic material is sparse: only
//! A_aabb, A_abab and A_abba differ from zero.

use crate::lanes::{IDENTITY, Lanes, ONE, Square, Triple, ZERO, determinant, dot, inverse, scaled};

/// Where |c_a − c_b| ≤ EQUAL (c_a + c_b), c = λ², a divided difference gives way to its limit.
///
/// Cancellation grows as ε / EQUAL and truncation as m² EQUAL² / 12 for a stress ~ c^(m/2): here
/// both are below 1e-10 for exponents m up to 16.
pub const EQUAL: f64 = 3e-6;

/// One-sided Jacobi converges quadratically: the fourth sweep reaches rounding, the fifth is margin.
const SWEEPS: usize = 5;

/// Columns this close to orthogonal are not rotated: rounding has the same effect.
const RIGHT: f64 = 4.0 * f64::EPSILON;

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
            let mut done = true;
            for (a, b) in PAIRS {
                if let Some((cosine, sine)) = angle(&g[a], &g[b]) {
                    rotate(&mut g, a, b, cosine, sine);
                    rotate(&mut n, a, b, cosine, sine);
                    done = false;
                }
            }
            if done {
                break;
            }
        }
        let mut stretches = [ZERO; 3];
        for a in 0..3 {
            let length = dot(&g[a], &g[a]).sqrt();
            stretches[a] = volume.at_most(ZERO, Lanes::all(f64::NAN), length);
            g[a] = scaled(&g[a], ONE / stretches[a]);
        }
        (Self { spatial: g, material: n, stretches }, volume)
    }
}

/// Cosine and sine of the rotation that makes two columns orthogonal, unless all are.
///
/// With p twice their product, d the difference of their squares and h² = d² + p²: cos² = ½ (1 +
/// |d|/h) and sin = ± p / (2 h cos). Where columns are orthogonal already, the rotation is exactly
/// none, so that further sweeps for other lanes change nothing.
#[inline(always)]
fn angle(left: &Triple, right: &Triple) -> Option<(Lanes, Lanes)> {
    let (product, before, after) = (dot(left, right), dot(left, left), dot(right, right));
    let tilt = product * product;
    let small = Lanes::all(RIGHT * RIGHT) * before * after;
    if tilt.all_at_most(small) {
        return None;
    }
    let (difference, twice) = (after - before, product + product);
    let length = (difference * difference + twice * twice).sqrt();
    let reciprocal = ONE / length;
    let cosine = (Lanes::all(0.5) * (ONE + difference.abs() * reciprocal)).sqrt();
    let half = ZERO.at_most(difference, Lanes::all(0.5), Lanes::all(-0.5));
    let sine = half * twice * reciprocal / cosine;
    Some((tilt.at_most(small, ONE, cosine), tilt.at_most(small, ZERO, sine)))
}

#[inline(always)]
fn rotate(columns: &mut Square, a: usize, b: usize, cosine: Lanes, sine: Lanes) {
    for i in 0..3 {
        let (left, right) = (columns[a][i], columns[b][i]);
        columns[a][i] = cosine * left - sine * right;
        columns[b][i] = sine * left + cosine * right;
    }
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
        let inverse = inverse(stretches);
        let mut squares = [ZERO; 3];
        let mut second = [ZERO; 3];
        // 2 ∂S_a/∂c_b
        let mut slopes = *psi_ij;
        for a in 0..3 {
            squares[a] = stretches[a] * stretches[a];
            second[a] = psi_i[a] * inverse[a];
            for b in 0..3 {
                slopes[a][b] = psi_ij[a][b] * inverse[a] * inverse[b];
            }
            slopes[a][a] = slopes[a][a] - second[a] * inverse[a] * inverse[a];
        }
        let (mut shear, mut swap) = ([ZERO; 3], [ZERO; 3]);
        for (k, (a, b)) in PAIRS.into_iter().enumerate() {
            let gap = squares[a] - squares[b];
            let small = Lanes::all(EQUAL) * (squares[a] + squares[b]);
            let limit = slopes[a][a] + slopes[b][b] - (slopes[a][b] + slopes[a][b]);
            let divisor = gap.abs().at_most(small, ONE, gap);
            let ratio = (second[a] - second[b]) / divisor;
            let difference = gap.abs().at_most(small, Lanes::all(0.25) * limit, ratio);
            shear[k] = second[b] + squares[a] * difference;
            swap[k] = stretches[a] * stretches[b] * difference;
        }
        Self { direct: *psi_ij, shear, swap }
    }
}
