//! The deformation of a block, and the nodal forces of its stresses.

use std::sync::Arc;

use pulp::{Arch, NullaryFnOnce};

use crate::block::{ElementBlock, Shape, gathered, length};
use crate::dilatation::Dilatation;
use crate::error::Error;
use crate::lanes::{
    IDENTITY, Lanes, NOTHING, ONE, Square, Triple, WIDTH, ZERO, add_outer, add_scaled, product,
    scaled,
};
use crate::principal::Frame;
use crate::stiffness;

/// One quadrature point of a group.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Point {
    pub(crate) frame: Frame,
    /// J.
    pub(crate) jacobian: Lanes,
    /// s with F̄ = s F: (θ/J)^(1/3), or 1 without mean dilatation.
    pub(crate) scale: Lanes,
}

/// Where the material of a block is stretched to, and in which directions.
///
/// The material is asked for ψ_i = ∂Ψ/∂λ_i and ψ_ij = ∂²Ψ/∂λ_i∂λ_j at [`Self::stretches`]; from
/// these follow forces and stiffness.
///
/// # Examples
/// A tetrahedron of Ψ = ½ Σ (λ_a − 1)², pulled along x: ψ_i = λ_i − 1, ψ_ij = δ_ij.
/// ```
/// use std::sync::Arc;
/// use palpate_elements::{ElementBlock, Shape};
/// let gradients = [-1., -1., -1., 1., 0., 0., 0., 1., 0., 0., 0., 1.];
/// let shape = Shape { elements: 1, points: 1, nodes: 4 };
/// let places: Vec<i64> = (0..144).collect();
/// let block =
///     ElementBlock::new(shape, &[0, 1, 2, 3], &gradients, &[1. / 6.], false, Some(&places))?;
/// let pulled = [0., 0., 0., 0.1, 0., 0., 0., 0., 0., 0., 0., 0.];
/// let deformation = Arc::new(block).deform(&pulled)?;
/// let psi_i: Vec<f64> = deformation.stretches().iter().map(|s| s - 1.0).collect();
/// let psi_ij = [1., 0., 0., 0., 1., 0., 0., 0., 1.];
/// let (mut forces, mut stiffness) = ([0.0; 12], [0.0; 144]);
/// deformation.add_force(&psi_i, &mut forces)?;
/// deformation.add_stiffness(&psi_i, &psi_ij, &mut stiffness)?;
/// assert!((forces[3] - 0.1 / 6.0).abs() < 1e-15);
/// assert!((stiffness[3 * 12 + 3] - 1.0 / 6.0).abs() < 1e-15);
/// # Ok::<(), palpate_elements::Error>(())
/// ```
#[derive(Debug)]
pub struct Deformation {
    pub(crate) block: Arc<ElementBlock>,
    /// By group and point.
    points: Vec<Point>,
    least_jacobian: f64,
}

/// Makes a [`Deformation`].
pub(crate) struct Deform<'a> {
    pub(crate) block: Arc<ElementBlock>,
    pub(crate) displacements: &'a [f64],
}

impl NullaryFnOnce for Deform<'_> {
    type Output = Deformation;

    #[inline(always)]
    fn call(self) -> Deformation {
        Deformation::new(self.block, self.displacements)
    }
}

/// Adds the forces of every element to those of the nodes.
struct Scatter<'a> {
    deformed: &'a Deformation,
    psi_i: &'a [f64],
    total: &'a mut [f64],
}

impl NullaryFnOnce for Scatter<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.deformed.scatter_force(self.psi_i, self.total);
    }
}

impl Deformation {
    #[inline(always)]
    fn new(block: Arc<ElementBlock>, displacements: &[f64]) -> Self {
        let shape = block.shape;
        let mut points = Vec::with_capacity(shape.groups() * shape.points);
        let mut least = Lanes::all(f64::INFINITY);
        let mut own = vec![[ZERO; 3]; shape.nodes];
        for group in 0..shape.groups() {
            let members = shape.members(group).map(|element| block.nodes_of(element));
            for (a, moved) in own.iter_mut().enumerate() {
                *moved = gathered(displacements, members.map(|nodes| nodes[a] as usize));
            }
            for point in 0..shape.points {
                let columns = gradient_columns(&own, block.gradients_at(group, point));
                let (frame, jacobian) = Frame::new(&columns);
                least = least.at_most(jacobian, least, jacobian);
                points.push(Point { frame, jacobian, scale: ONE });
            }
            if block.mean_dilatation {
                let start = group * shape.points;
                Dilatation::impose(&mut points[start..], block.volumes_of(group));
            }
        }
        // Once NaN, always NaN: a displacement was not a number.
        let least_jacobian = least.0.into_iter().fold(f64::INFINITY, |least, j| {
            if least.is_nan() || j.is_nan() { f64::NAN } else { least.min(j) }
        });
        Self { block, points, least_jacobian }
    }

    /// How many elements, points and nodes the block has.
    #[must_use]
    pub fn shape(&self) -> Shape {
        self.block.shape
    }

    /// Least J of any quadrature point; NaN if a displacement is not a number.
    #[must_use]
    pub fn least_jacobian(&self) -> f64 {
        self.least_jacobian
    }

    /// Principal stretches (e, q, 3) of F̄, in no particular order; NaN where the volume is not
    /// positive.
    #[must_use]
    pub fn stretches(&self) -> Vec<f64> {
        let shape = self.block.shape;
        let mut result = vec![0.0; shape.elements * shape.points * 3];
        for (k, point) in self.points.iter().enumerate() {
            let stretches = scaled(&point.frame.stretches, point.scale);
            let (group, own) = (k / shape.points, k % shape.points);
            for lane in 0..shape.width(group) {
                let start = ((group * WIDTH + lane) * shape.points + own) * 3;
                for (value, stretch) in result[start..start + 3].iter_mut().zip(stretches) {
                    *value = stretch.0[lane];
                }
            }
        }
        result
    }

    /// Adds the nodal forces \[N\] of `psi_i` (e, q, 3) \[MPa\] to `total` (`n_nodes`, 3).
    ///
    /// Forces are linear in `psi_i`: its derivative in a parameter gives theirs.
    ///
    /// # Errors
    /// [`Error`] if an array does not fit the block.
    pub fn add_force(&self, psi_i: &[f64], total: &mut [f64]) -> Result<(), Error> {
        self.check_first(psi_i)?;
        self.block.check_nodes("total", total)?;
        Arch::new().dispatch(Scatter { deformed: self, psi_i, total });
        Ok(())
    }

    /// Adds the stiffness \[N/mm\] of `psi_i` (e, q, 3) and `psi_ij` (e, q, 3, 3) \[MPa\] to
    /// `values` at the block's places.
    ///
    /// Of `psi_ij`, symmetric, the upper triangle is read.
    ///
    /// # Errors
    /// [`Error`] if an array does not fit the block, or the block has no places.
    pub fn add_stiffness(
        &self,
        psi_i: &[f64],
        psi_ij: &[f64],
        values: &mut [f64],
    ) -> Result<(), Error> {
        self.check_first(psi_i)?;
        let shape = self.block.shape;
        length("psi_ij", psi_ij, shape.elements * shape.points * 9)?;
        self.block.check_entries("values", values)?;
        Arch::new().dispatch(stiffness::Scatter { deformed: self, psi_i, psi_ij, values });
        Ok(())
    }

    fn check_first(&self, psi_i: &[f64]) -> Result<(), Error> {
        length("psi_i", psi_i, self.block.shape.elements * self.block.shape.points * 3)
    }

    pub(crate) fn points_of(&self, group: usize) -> &[Point] {
        let points = self.block.shape.points;
        &self.points[group * points..(group + 1) * points]
    }

    /// Values (e, q, N) at one point of a group.
    #[inline(always)]
    pub(crate) fn at<const N: usize>(
        &self,
        values: &[f64],
        group: usize,
        point: usize,
    ) -> [Lanes; N] {
        let shape = self.block.shape;
        gathered(values, shape.members(group).map(|e| e * shape.points + point))
    }

    #[inline(always)]
    fn scatter_force(&self, psi_i: &[f64], total: &mut [f64]) {
        let (block, shape) = (&self.block, self.block.shape);
        let mut forces = vec![[ZERO; 3]; shape.nodes];
        let mut stresses = vec![[ZERO; 3]; shape.points];
        for group in 0..shape.groups() {
            let (points, volumes) = (self.points_of(group), block.volumes_of(group));
            for (point, stress) in stresses.iter_mut().enumerate() {
                *stress = self.at(psi_i, group, point);
            }
            if block.mean_dilatation {
                Dilatation::new(points, volumes, &stresses).stress(points, &mut stresses);
            }
            forces.fill([ZERO; 3]);
            for (q, (point, stress)) in points.iter().zip(&stresses).enumerate() {
                let weighted = cartesian(&point.frame, &scaled(stress, volumes[q]));
                for (force, gradient) in forces.iter_mut().zip(block.gradients_at(group, q)) {
                    add_scaled(force, &product(&weighted, gradient), ONE);
                }
            }
            for lane in 0..shape.width(group) {
                let nodes = block.nodes_of(group * WIDTH + lane);
                for (&node, force) in nodes.iter().zip(&forces) {
                    let start = node as usize * 3;
                    for (sum, f) in total[start..start + 3].iter_mut().zip(force) {
                        *sum += f.0[lane];
                    }
                }
            }
        }
    }
}

/// Columns of F = I + Σ_a u_a ⊗ ∇N_a.
#[inline(always)]
fn gradient_columns(displacements: &[Triple], gradients: &[Triple]) -> Square {
    let mut columns = IDENTITY;
    for (moved, gradient) in displacements.iter().zip(gradients) {
        add_outer(&mut columns, gradient, moved);
    }
    columns
}

/// Σ_a P_a e_a ⊗ N_a.
#[inline(always)]
fn cartesian(frame: &Frame, principal: &Triple) -> Square {
    let mut sum = NOTHING;
    for ((e, n), p) in frame.spatial.iter().zip(&frame.material).zip(principal) {
        add_outer(&mut sum, &scaled(e, *p), n);
    }
    sum
}
