//! Mean dilatation: one volume change θ for each element.
//!
//! The energy of an element is E = Σ_q w_q Ψ(F̄_q) with F̄ = s F, s = (θ/J)^(1/3) and θ the mean of
//! J: three-field with constant pressure and dilatation (Simo, Taylor & Pister 1985). Its
//! derivatives are exact. All tensors here are diagonal in the principal frame.
//!
//! | name here | quantity |
//! |---|---|
//! | `trace` | P̄ : F |
//! | `pressure` | π, Σ_q w ∂Ψ/∂θ over the element's volume |
//! | `along` | M = Ā : F |
//! | `mixed` | ∂²Ψ/∂F∂θ |
//! | `curvature` | Σ_q w ∂²Ψ/∂θ² |

use crate::deformation::Point;
use crate::lanes::{Lanes, Square, Triple, ZERO, dot, inverse, product};
use crate::principal::{PAIRS, Tangent};

/// Common values of the points of a group.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Dilatation {
    /// θ.
    pub(crate) mean: Lanes,
    pub(crate) pressure: Lanes,
    /// Reference volume of the element.
    pub(crate) volume: Lanes,
}

/// The tangent at one point: at fixed θ, and its coupling with θ.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Coupled {
    pub(crate) tangent: Tangent,
    pub(crate) mixed: Triple,
    pub(crate) curvature: Lanes,
}

impl Dilatation {
    /// Sets the scale of each point from the mean of J.
    #[inline(always)]
    pub(crate) fn impose(points: &mut [Point], volumes: &[Lanes]) {
        let (mean, _) = mean_jacobian(points, volumes);
        for point in points {
            let ratio = mean / point.jacobian;
            point.scale = ratio.at_most(ZERO, Lanes::all(f64::NAN), ratio.cbrt());
        }
    }

    #[inline(always)]
    pub(crate) fn new(points: &[Point], volumes: &[Lanes], psi_i: &[Triple]) -> Self {
        let (mean, volume) = mean_jacobian(points, volumes);
        let mut work = ZERO;
        for ((point, psi), weight) in points.iter().zip(psi_i).zip(volumes) {
            work += *weight * point.scale * dot(psi, &point.frame.stretches);
        }
        Self { mean, pressure: work / (Lanes::all(3.0) * mean * volume), volume }
    }

    /// Turns ψ_i into the stresses conjugate to F: s (P̄ − ⅓ (P̄:F) F^−T) + π J F^−T.
    #[inline(always)]
    pub(crate) fn stress(&self, points: &[Point], stresses: &mut [Triple]) {
        for (point, stress) in points.iter().zip(stresses) {
            let stretches = &point.frame.stretches;
            let third = dot(stress, stretches) * Lanes::all(1.0 / 3.0);
            let push = self.pressure * point.jacobian - point.scale * third;
            for (p, stretch) in stress.iter_mut().zip(stretches) {
                *p = point.scale * *p + push / *stretch;
            }
        }
    }

    /// From ψ_i, ψ_ij and the tangent at F̄.
    #[inline(always)]
    pub(crate) fn couple(
        &self,
        point: &Point,
        psi_i: &Triple,
        psi_ij: &Square,
        tangent: &Tangent,
    ) -> Coupled {
        let (stretches, s) = (&point.frame.stretches, point.scale);
        let third = Lanes::all(1.0 / 3.0);
        let inverse = inverse(stretches);
        let (trace, along) = (dot(psi_i, stretches), product(psi_ij, stretches));
        let m = dot(&along, stretches);
        let volumetric = self.pressure * point.jacobian;
        let square = s * s;
        let both = (square * m + s * trace) * Lanes::all(1.0 / 9.0) + volumetric;
        let swap = s * trace * third - volumetric;
        let (mut half, mut mixed) = ([ZERO; 3], [ZERO; 3]);
        for a in 0..3 {
            half[a] = (square * along[a] + s * psi_i[a]) * third;
            let deviator = psi_i[a] + s * along[a] - (trace + s * m) * third * inverse[a];
            mixed[a] = s * third / self.mean * deviator;
        }
        let mut result = *tangent;
        for a in 0..3 {
            for b in 0..3 {
                let inner = half[a] * inverse[b] + half[b] * inverse[a];
                let outer = both * inverse[a] * inverse[b];
                result.direct[a][b] = square * psi_ij[a][b] - inner + outer;
            }
            result.direct[a][a] += swap * inverse[a] * inverse[a];
        }
        for (k, (a, b)) in PAIRS.into_iter().enumerate() {
            result.shear[k] = square * tangent.shear[k];
            result.swap[k] = square * tangent.swap[k] + swap * inverse[a] * inverse[b];
        }
        let bend = (m * s - trace - trace) * s * Lanes::all(1.0 / 9.0);
        Coupled { tangent: result, mixed, curvature: bend / (self.mean * self.mean) }
    }
}

/// θ and the volume over which it is the mean.
#[inline(always)]
fn mean_jacobian(points: &[Point], volumes: &[Lanes]) -> (Lanes, Lanes) {
    let (mut sum, mut volume) = (ZERO, ZERO);
    for (point, weight) in points.iter().zip(volumes) {
        sum += *weight * point.jacobian;
        volume += *weight;
    }
    (sum / volume, volume)
}
