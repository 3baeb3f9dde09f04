//! Element stiffnesses, summed straight into the values of a sparse matrix.
//!
//! With gradients d_a in the directions N_J and A_JL (i, k) = A_iJkL, a block of two nodes is
//! K_ab = Σ_q w Σ_JL d_aJ A_JL d_bL. It is computed for a ≤ b, and mirrored.

use std::array::from_fn;

use pulp::NullaryFnOnce;

use crate::block::{ElementBlock, Place};
use crate::deformation::{Deformation, Point};
use crate::dilatation::{Coupled, Dilatation};
use crate::lanes::{
    Lanes, NOTHING, Square, Triple, WIDTH, ZERO, add_outer, add_scaled, product, scaled,
};
use crate::principal::{Frame, PAIRS, Tangent};

/// A_JL (i, k), directions J and L principal, i and k Cartesian.
type Mixed = [[Square; 3]; 3];

/// The work space of one group.
struct Stiffness {
    /// K_ab for a ≤ b, at b (b + 1) / 2 + a.
    blocks: Vec<Square>,
    /// Gradients in the principal directions.
    turned: Vec<Triple>,
    /// Σ_q w ∂²Ψ/∂F∂θ ∇N_a.
    mixed: Vec<Triple>,
    /// ∂θ/∂u_a.
    dilation: Vec<Triple>,
    psi_i: Vec<Triple>,
}

/// Adds the stiffness of every element to sparse values.
pub(crate) struct Scatter<'a> {
    pub(crate) deformed: &'a Deformation,
    pub(crate) psi_i: &'a [f64],
    pub(crate) psi_ij: &'a [f64],
    pub(crate) values: &'a mut [f64],
}

impl NullaryFnOnce for Scatter<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        scatter(self.deformed, self.psi_i, self.psi_ij, self.values);
    }
}

#[inline(always)]
fn scatter(deformed: &Deformation, psi_i: &[f64], psi_ij: &[f64], values: &mut [f64]) {
    let (block, shape) = (&deformed.block, deformed.block.shape);
    let mut work = Stiffness {
        blocks: vec![NOTHING; shape.nodes * (shape.nodes + 1) / 2],
        turned: vec![[ZERO; 3]; shape.nodes],
        mixed: vec![[ZERO; 3]; shape.nodes],
        dilation: vec![[ZERO; 3]; shape.nodes],
        psi_i: vec![[ZERO; 3]; shape.points],
    };
    for group in 0..shape.groups() {
        work.blocks.fill(NOTHING);
        for (point, psi) in work.psi_i.iter_mut().enumerate() {
            *psi = deformed.at(psi_i, group, point);
        }
        if block.mean_dilatation {
            work.sum_coupled(deformed, group, psi_ij);
        } else {
            work.sum(deformed, group, psi_ij);
        }
        for lane in 0..shape.width(group) {
            work.mirror(lane, shape.nodes, block.places_of(group * WIDTH + lane), values);
        }
    }
}

impl Stiffness {
    /// The plain displacement element.
    #[inline(always)]
    fn sum(&mut self, deformed: &Deformation, group: usize, psi_ij: &[f64]) {
        for (q, point) in deformed.points_of(group).iter().enumerate() {
            let second = symmetric(deformed.at::<9>(psi_ij, group, q));
            let tangent = Tangent::new(&point.frame.stretches, &self.psi_i[q], &second);
            self.add(&deformed.block, group, q, &point.frame, &tangent);
        }
    }

    /// With θ the mean of J.
    #[inline(always)]
    fn sum_coupled(&mut self, deformed: &Deformation, group: usize, psi_ij: &[f64]) {
        let (block, points) = (&deformed.block, deformed.points_of(group));
        let volumes = block.volumes_of(group);
        let shared = Dilatation::new(points, volumes, &self.psi_i);
        self.mixed.fill([ZERO; 3]);
        self.dilation.fill([ZERO; 3]);
        let mut curvature = ZERO;
        for (q, point) in points.iter().enumerate() {
            let psi = self.psi_i[q];
            let second = symmetric(deformed.at::<9>(psi_ij, group, q));
            let stretches = scaled(&point.frame.stretches, point.scale);
            let plain = Tangent::new(&stretches, &psi, &second);
            let coupled = shared.couple(point, &psi, &second, &plain);
            self.add(block, group, q, &point.frame, &coupled.tangent);
            self.add_dilation(point, &coupled, volumes[q], shared.volume);
            curvature += volumes[q] * coupled.curvature;
        }
        self.couple(curvature);
    }

    /// Adds one point, at fixed θ.
    #[inline(always)]
    fn add(
        &mut self,
        block: &ElementBlock,
        group: usize,
        q: usize,
        frame: &Frame,
        tangent: &Tangent,
    ) {
        let moduli = moduli(frame, tangent, block.volumes_of(group)[q]);
        for (turned, gradient) in self.turned.iter_mut().zip(block.gradients_at(group, q)) {
            *turned = product(&frame.material, gradient);
        }
        let mut start = 0;
        for (b, own) in self.turned.iter().enumerate() {
            let blocks = &mut self.blocks[start..=start + b];
            // Row by row, so that the inner loop fits in registers.
            for i in 0..3 {
                let row = contracted(&moduli, own, i);
                for (sum, d) in blocks.iter_mut().zip(&self.turned) {
                    for k in 0..3 {
                        sum[i][k] += d[0] * row[0][k] + d[1] * row[1][k] + d[2] * row[2][k];
                    }
                }
            }
            start += b + 1;
        }
    }

    /// Adds one point's share of ∂θ/∂u and of the coupling with it.
    #[inline(always)]
    fn add_dilation(&mut self, point: &Point, coupled: &Coupled, weight: Lanes, volume: Lanes) {
        let share = weight * point.jacobian / volume;
        for a in 0..3 {
            let mixed = scaled(&point.frame.spatial[a], weight * coupled.mixed[a]);
            let dilation = scaled(&point.frame.spatial[a], share / point.frame.stretches[a]);
            for (node, turned) in self.turned.iter().enumerate() {
                add_scaled(&mut self.mixed[node], &mixed, turned[a]);
                add_scaled(&mut self.dilation[node], &dilation, turned[a]);
            }
        }
    }

    /// Adds b ⊗ g + g ⊗ b + c g ⊗ g with b the mixed derivative and g = ∂θ/∂u.
    #[inline(always)]
    fn couple(&mut self, curvature: Lanes) {
        let mut start = 0;
        for (b, (mixed, dilation)) in self.mixed.iter().zip(&self.dilation).enumerate() {
            let mut right = *mixed;
            add_scaled(&mut right, dilation, curvature);
            for (a, sum) in self.blocks[start..=start + b].iter_mut().enumerate() {
                add_outer(sum, &self.dilation[a], &right);
                add_outer(sum, &self.mixed[a], dilation);
            }
            start += b + 1;
        }
    }

    /// Adds one element's stiffness, both triangles, to the sparse values.
    #[inline(always)]
    fn mirror(&self, lane: usize, n: usize, places: &[Place], values: &mut [f64]) {
        let mut start = 0;
        for b in 0..n {
            for (a, block) in self.blocks[start..=start + b].iter().enumerate() {
                let entries = block.map(|row| row.map(|entry| entry.0[lane]));
                places[a * n + b].add(&entries, values);
                if a != b {
                    let mirrored = from_fn(|k| from_fn(|i| entries[i][k]));
                    places[b * n + a].add(&mirrored, values);
                }
            }
            start += b + 1;
        }
    }
}

/// ψ_ij from its upper triangle.
#[inline(always)]
fn symmetric(m: [Lanes; 9]) -> Square {
    [[m[0], m[1], m[2]], [m[1], m[4], m[5]], [m[2], m[5], m[8]]]
}

/// The tangent times a weight, with its second and fourth index in the principal directions.
#[inline(always)]
fn moduli(frame: &Frame, tangent: &Tangent, weight: Lanes) -> Mixed {
    let e = &frame.spatial;
    let mut result = [[NOTHING; 3]; 3];
    for a in 0..3 {
        add_outer(&mut result[a][a], &scaled(&e[a], weight * tangent.direct[a][a]), &e[a]);
    }
    for (k, (a, b)) in PAIRS.into_iter().enumerate() {
        let shear = weight * tangent.shear[k];
        add_outer(&mut result[a][a], &scaled(&e[b], shear), &e[b]);
        add_outer(&mut result[b][b], &scaled(&e[a], shear), &e[a]);
        let (direct, swap) = (weight * tangent.direct[a][b], weight * tangent.swap[k]);
        add_outer(&mut result[a][b], &scaled(&e[a], direct), &e[b]);
        add_outer(&mut result[a][b], &scaled(&e[b], swap), &e[a]);
        for i in 0..3 {
            for j in 0..3 {
                result[b][a][i][j] = result[a][b][j][i];
            }
        }
    }
    result
}

/// Row i of Σ_L A_JL d_L for each J.
#[inline(always)]
fn contracted(moduli: &Mixed, d: &Triple, i: usize) -> Square {
    let mut result = NOTHING;
    for (sum, of) in result.iter_mut().zip(moduli) {
        for k in 0..3 {
            sum[k] = of[0][i][k] * d[0] + of[1][i][k] * d[1] + of[2][i][k] * d[2];
        }
    }
    result
}
