//! Laws of the kernels, and every message.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::sync::Arc;

use palpate_elements::{Deformation, ElementBlock, Error, Shape};
use proptest::collection::vec;
use proptest::prelude::*;

/// Ψ = Σ_a (μ/m² (λ_a^m − 1)) − μ/m ln J + κ/2 (ln J)².
#[derive(Debug, Clone, Copy)]
struct Law {
    mu: f64,
    m: f64,
    kappa: f64,
}

impl Law {
    fn energy(self, stretches: &[f64]) -> f64 {
        let log: f64 = stretches.iter().map(|s| s.ln()).sum();
        let powers: f64 = stretches.iter().map(|s| s.powf(self.m) - 1.0).sum();
        self.mu / self.m.powi(2) * powers - self.mu / self.m * log + 0.5 * self.kappa * log * log
    }

    fn first(self, stretches: &[f64]) -> [f64; 3] {
        let log: f64 = stretches.iter().map(|s| s.ln()).sum();
        [0, 1, 2].map(|a| {
            let s = stretches[a];
            (self.mu / self.m * (s.powf(self.m) - 1.0) + self.kappa * log) / s
        })
    }

    fn second(self, stretches: &[f64]) -> [f64; 9] {
        let log: f64 = stretches.iter().map(|s| s.ln()).sum();
        let mut result = [0.0; 9];
        for a in 0..3 {
            for b in 0..3 {
                result[3 * a + b] = self.kappa / (stretches[a] * stretches[b]);
            }
            let power = self.mu / self.m * ((self.m - 1.0) * stretches[a].powf(self.m) + 1.0);
            result[4 * a] += (power - self.kappa * log) / stretches[a].powi(2);
        }
        result
    }
}

/// Elements with any gradients that leave a translation without strain.
#[derive(Debug, Clone)]
struct Case {
    shape: Shape,
    nodes: Vec<i64>,
    gradients: Vec<f64>,
    volumes: Vec<f64>,
    displacements: Vec<f64>,
    mean_dilatation: bool,
    law: Law,
}

impl Case {
    fn n_nodes(&self) -> usize {
        self.displacements.len() / 3
    }

    /// Every entry of the stiffness of all nodes, by rows.
    fn places(&self) -> Vec<i64> {
        let n = i64::try_from(3 * self.n_nodes()).unwrap();
        let mut places = Vec::new();
        for own in self.nodes.chunks(self.shape.nodes) {
            let unknowns: Vec<i64> =
                own.iter().flat_map(|&a| [3 * a, 3 * a + 1, 3 * a + 2]).collect();
            for i in &unknowns {
                places.extend(unknowns.iter().map(|j| i * n + j));
            }
        }
        places
    }

    fn block(&self) -> Arc<ElementBlock> {
        let Self { shape, nodes, gradients, volumes, mean_dilatation, .. } = self;
        let places = self.places();
        let block =
            ElementBlock::new(*shape, nodes, gradients, volumes, *mean_dilatation, Some(&places));
        Arc::new(block.unwrap())
    }

    fn deform(&self, displacements: &[f64]) -> Deformation {
        self.block().deform(displacements).unwrap()
    }

    fn energy(&self, displacements: &[f64]) -> f64 {
        let stretches = self.deform(displacements).stretches();
        let energies = stretches.chunks(3).map(|s| self.law.energy(s));
        energies.zip(&self.volumes).map(|(energy, volume)| energy * volume).sum()
    }

    fn force(&self, displacements: &[f64]) -> Vec<f64> {
        let deformed = self.deform(displacements);
        let first: Vec<f64> =
            deformed.stretches().chunks(3).flat_map(|s| self.law.first(s)).collect();
        let mut total = vec![0.0; displacements.len()];
        deformed.add_force(&first, &mut total).unwrap();
        total
    }

    fn stiffness(&self, displacements: &[f64]) -> Vec<f64> {
        let deformed = self.deform(displacements);
        let stretches = deformed.stretches();
        let first: Vec<f64> = stretches.chunks(3).flat_map(|s| self.law.first(s)).collect();
        let second: Vec<f64> = stretches.chunks(3).flat_map(|s| self.law.second(s)).collect();
        let mut values = vec![0.0; displacements.len() * displacements.len()];
        deformed.add_stiffness(&first, &second, &mut values).unwrap();
        values
    }

    /// K d.
    fn pushed(&self, displacements: &[f64], direction: &[f64]) -> Vec<f64> {
        let stiffness = self.stiffness(displacements);
        stiffness.chunks(direction.len()).map(|row| dot(row, direction)).collect()
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most, v| v.abs().max(most))
}

/// Asserts that two arrays agree to `tolerance` of a size.
fn close(a: &[f64], b: &[f64], tolerance: f64, size: f64) -> Result<(), TestCaseError> {
    for (k, (x, y)) in a.iter().zip(b).enumerate() {
        prop_assert!((x - y).abs() <= tolerance * size, "[{k}]: {x} and {y} of {size}");
    }
    Ok(())
}

/// A mean of zero over the nodes.
fn balanced(gradients: &mut [f64], nodes: usize) {
    for point in gradients.chunks_mut(3 * nodes) {
        for i in 0..3 {
            let total: f64 = (0..nodes).map(|a| point[3 * a + i]).sum();
            let mean = total / f64::from(u32::try_from(nodes).unwrap());
            (0..nodes).for_each(|a| point[3 * a + i] -= mean);
        }
    }
}

fn cases(size: f64) -> impl Strategy<Value = Case> {
    let shapes = (1..7_usize, 1..4_usize, 2..5_usize, any::<bool>());
    shapes.prop_flat_map(move |(elements, points, nodes, mean_dilatation)| {
        let n_nodes = nodes + 2;
        let law = (0.1..2.0_f64, 1.0..6.0_f64, 0.1..20.0_f64);
        (
            vec(0..i64::try_from(n_nodes).unwrap(), elements * nodes),
            vec(-1.0..1.0_f64, elements * points * nodes * 3),
            vec(0.1..1.0_f64, elements * points),
            vec(-size..size, n_nodes * 3),
            law,
        )
            .prop_map(move |(nodes_of, mut gradients, volumes, displacements, law)| {
                balanced(&mut gradients, nodes);
                let (mu, m, kappa) = law;
                Case {
                    shape: Shape { elements, points, nodes },
                    nodes: nodes_of,
                    gradients,
                    volumes,
                    displacements,
                    mean_dilatation,
                    law: Law { mu, m, kappa },
                }
            })
    })
}

/// The slope of a function of the displacements along a direction.
fn slope(at: &[f64], direction: &[f64], function: impl Fn(&[f64]) -> Vec<f64>) -> Vec<f64> {
    let h = 1e-6;
    let moved = |step: f64| -> Vec<f64> {
        let u: Vec<f64> = at.iter().zip(direction).map(|(u, d)| u + step * d).collect();
        function(&u)
    };
    let (up, down) = (moved(h), moved(-h));
    up.iter().zip(&down).map(|(a, b)| (a - b) / (2.0 * h)).collect()
}

proptest! {
    #[test]
    fn forces_are_the_slope_of_the_energy(case in cases(0.05), along in vec(-1.0..1.0_f64, 18)) {
        let (u, d) = (&case.displacements, &along[..case.displacements.len()]);
        let force = case.force(u);
        let expected = slope(u, d, |u| vec![case.energy(u)]);
        close(&[dot(&force, d)], &expected, 1e-7, 1.0 + largest(&force))?;
    }

    #[test]
    fn the_stiffness_is_the_slope_of_the_forces(case in cases(0.05), along in vec(-1.0..1.0_f64, 18)) {
        let (u, d) = (&case.displacements, &along[..case.displacements.len()]);
        let pushed = case.pushed(u, d);
        let expected = slope(u, d, |u| case.force(u));
        close(&pushed, &expected, 1e-7, 1.0 + largest(&expected))?;
    }

    #[test]
    fn the_stiffness_at_rest_is_the_slope_of_the_forces(case in cases(0.05), along in vec(-1.0..1.0_f64, 18)) {
        let (u, d) = (vec![0.0; case.displacements.len()], &along[..case.displacements.len()]);
        let expected = slope(&u, d, |u| case.force(u));
        close(&case.pushed(&u, d), &expected, 1e-7, 1.0 + largest(&expected))?;
    }

    #[test]
    fn the_stiffness_is_symmetric_and_a_translation_is_free(case in cases(0.05)) {
        let (u, n) = (&case.displacements, case.displacements.len());
        let stiffness = case.stiffness(u);
        let size = 1.0 + largest(&stiffness);
        for i in 0..n {
            for j in 0..i {
                close(&[stiffness[i * n + j]], &[stiffness[j * n + i]], 1e-14, size)?;
            }
        }
        let shift: Vec<f64> = [0.3, -0.5, 0.7].repeat(case.n_nodes());
        close(&case.pushed(u, &shift), &vec![0.0; n], 1e-13, size)?;
    }

    #[test]
    fn a_turned_body_has_turned_forces(case in cases(0.05), angle in -3.0..3.0_f64) {
        // Turned gradients and displacements: Q F Qᵀ has the same stretches and the force Q f.
        let (c, s) = (angle.cos(), angle.sin());
        let turn = |v: &[f64]| [c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]];
        let stretched = case.deform(&case.displacements);
        let first: Vec<f64> =
            stretched.stretches().chunks(3).flat_map(|s| case.law.first(s)).collect();
        let mut turned = case.clone();
        turned.gradients = case.gradients.chunks(3).flat_map(turn).collect();
        turned.displacements = case.displacements.chunks(3).flat_map(turn).collect();
        let mut total = vec![0.0; case.displacements.len()];
        stretched.add_force(&first, &mut total).unwrap();
        let expected: Vec<f64> = total.chunks(3).flat_map(turn).collect();
        let force = turned.force(&turned.displacements);
        close(&force, &expected, 1e-11, 1.0 + largest(&expected))?;
    }

    #[test]
    fn neighbours_in_a_block_do_not_change_a_bit(case in cases(0.05)) {
        let u = &case.displacements;
        let together = case.deform(u).stretches();
        let Shape { elements, points, nodes } = case.shape;
        for e in 0..elements {
            let alone = Case {
                shape: Shape { elements: 1, ..case.shape },
                nodes: case.nodes[e * nodes..(e + 1) * nodes].to_vec(),
                gradients: case.gradients[e * points * nodes * 3..(e + 1) * points * nodes * 3].to_vec(),
                volumes: case.volumes[e * points..(e + 1) * points].to_vec(),
                ..case.clone()
            };
            let own = &together[e * points * 3..(e + 1) * points * 3];
            prop_assert_eq!(alone.deform(u).stretches(), own);
        }
    }

    #[test]
    fn points_and_nodes_that_only_pad_change_nothing(case in cases(0.05)) {
        let u = &case.displacements;
        let Shape { elements, points, nodes } = case.shape;
        let mut padded = case.clone();
        padded.shape = Shape { elements, points: points + 1, nodes: nodes + 1 };
        padded.nodes = case.nodes.chunks(nodes).flat_map(|own| [own, &[0]].concat()).collect();
        padded.volumes = case.volumes.chunks(points).flat_map(|own| [own, &[0.0]].concat()).collect();
        padded.gradients = case
            .gradients
            .chunks(points * nodes * 3)
            .flat_map(|element| {
                let mut result: Vec<f64> =
                    element.chunks(nodes * 3).flat_map(|own| [own, &[0.0; 3]].concat()).collect();
                result.extend(vec![0.0; (nodes + 1) * 3]);
                result
            })
            .collect();
        close(&padded.force(u), &case.force(u), 1e-13, 1.0 + largest(&case.force(u)))?;
        let stiffness = case.stiffness(u);
        close(&padded.stiffness(u), &stiffness, 1e-13, 1.0 + largest(&stiffness))?;
    }

    #[test]
    fn any_displacement_is_answered(case in cases(5.0)) {
        let deformed = case.deform(&case.displacements);
        let stretches = deformed.stretches();
        let sound = deformed.least_jacobian() > 0.0;
        prop_assert_eq!(sound, stretches.iter().all(|s| s.is_finite()));
        case.force(&case.displacements);
        case.stiffness(&case.displacements);
    }
}

const GRADIENTS: [f64; 12] = [-1., -1., -1., 1., 0., 0., 0., 1., 0., 0., 0., 1.];
const TET: Shape = Shape { elements: 1, points: 1, nodes: 4 };

fn tet(nodes: &[i64], gradients: &[f64], volumes: &[f64]) -> Result<ElementBlock, Error> {
    ElementBlock::new(TET, nodes, gradients, volumes, true, None)
}

#[test]
fn a_known_stretch_comes_back() {
    let block = Arc::new(tet(&[0, 1, 2, 3], &GRADIENTS, &[1.0 / 6.0]).unwrap());
    let moved = [0., 0., 0., 1e-9, 0., 0., 0., -0.5, 0., 0., 0., 1.];
    let deformed = block.deform(&moved).unwrap();
    for (stretch, expected) in deformed.stretches().iter().zip([1.0 + 1e-9, 0.5, 2.0]) {
        assert!((stretch - expected).abs() <= 4e-16 * expected, "{stretch} {expected}");
    }
}

#[test]
fn nothing_stays_hidden_in_a_displacement_that_is_not_a_number() {
    let block = Arc::new(tet(&[0, 1, 2, 3], &GRADIENTS, &[1.0 / 6.0]).unwrap());
    let deformed = block.deform(&[f64::NAN; 12]).unwrap();
    assert!(deformed.least_jacobian().is_nan());
    assert!(deformed.stretches().iter().all(|s| s.is_nan()));
}

#[test]
fn bad_arrays_are_refused_with_the_element() {
    let volume = [1.0 / 6.0];
    let nodes = [0, 1, 2, 3];
    let message = |result: Result<ElementBlock, Error>| result.unwrap_err().to_string();
    let empty = Shape { elements: 0, ..TET };
    let none = ElementBlock::new(empty, &[], &[], &[], true, None);
    assert!(message(none).contains("0 elements with 1 points and 4 nodes"));
    assert!(message(tet(&nodes[1..], &GRADIENTS, &volume)).contains("nodes has 3 values where 4"));
    assert!(message(tet(&nodes, &GRADIENTS[1..], &volume)).contains("gradients has 11 values"));
    assert!(message(tet(&nodes, &GRADIENTS, &[])).contains("volumes has 0 values where 1"));
    assert!(message(tet(&[0, 1, -1, 3], &GRADIENTS, &volume)).contains("element 0 has -1"));
    let mut gradients = GRADIENTS;
    gradients[3] = f64::INFINITY;
    assert!(message(tet(&nodes, &gradients, &volume)).contains("gradients: element 0 has inf"));
    for bad in [0.0, -1.0, f64::NAN] {
        let text = message(tet(&nodes, &GRADIENTS, &[bad]));
        assert!(text.contains(&format!("volumes: element 0 has {bad} mm³")), "{text}");
    }
    let few = ElementBlock::new(TET, &nodes, &GRADIENTS, &volume, true, Some(&[0, 1]));
    assert!(message(few).contains("places has 2 values where 144"));
    let negative = ElementBlock::new(TET, &nodes, &GRADIENTS, &volume, true, Some(&[-1; 144]));
    assert!(message(negative).contains("places: element 0 has -1"));
    let mut places: Vec<i64> = (0..144).collect();
    places.swap(5 * 12 + 7, 5 * 12 + 8);
    let mixed = ElementBlock::new(TET, &nodes, &GRADIENTS, &volume, true, Some(&places));
    assert!(message(mixed).contains("element 0 has entries at row 3, column 6"));
    let one = ElementBlock::new(TET, &nodes, &GRADIENTS, &volume, true, Some(&[3; 144]));
    assert!(one.is_ok());
}

#[test]
fn arrays_that_do_not_fit_the_block_are_refused() {
    let block = Arc::new(tet(&[0, 1, 2, 3], &GRADIENTS, &[1.0 / 6.0]).unwrap());
    let refused =
        |displacements: &[f64]| Arc::clone(&block).deform(displacements).unwrap_err().to_string();
    assert!(refused(&[0.0; 9]).contains("displacements has 3 rows, but the block refers to row 3"));
    assert!(refused(&[0.0; 13]).contains("displacements has 13 values where 12"));
    let deformed = Arc::clone(&block).deform(&[0.0; 12]).unwrap();
    let text = deformed.add_force(&[0.0; 2], &mut [0.0; 12]).unwrap_err().to_string();
    assert!(text.contains("psi_i has 2 values where 3"), "{text}");
    let text = deformed.add_force(&[0.0; 3], &mut [0.0; 3]).unwrap_err().to_string();
    assert!(text.contains("total has 1 rows"), "{text}");
    let text = deformed.add_stiffness(&[0.0; 3], &[0.0; 8], &mut []).unwrap_err().to_string();
    assert!(text.contains("psi_ij has 8 values where 9"), "{text}");
    let placeless = deformed.add_stiffness(&[0.0; 3], &[0.0; 9], &mut []);
    assert_eq!(placeless, Err(Error::NoPlaces));
    let sevens = [7; 144];
    let known =
        ElementBlock::new(TET, &[0, 1, 2, 3], &GRADIENTS, &[1.0 / 6.0], true, Some(&sevens));
    let deformed = Arc::new(known.unwrap()).deform(&[0.0; 12]).unwrap();
    let short = deformed.add_stiffness(&[0.0; 3], &[0.0; 9], &mut [0.0; 7]);
    assert_eq!(short, Err(Error::TooShort { array: "values", length: 7, index: 7 }));
}
