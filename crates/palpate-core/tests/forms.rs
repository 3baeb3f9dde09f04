//! Scores of a batch against plain sums: by the quadratic form, scaled, differentiated.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
#![allow(clippy::float_cmp, reason = "where a test says equal it means every bit")]
#![allow(clippy::cast_precision_loss, reason = "counts here are small")]

use palpate_core::curve::interpolate;
use palpate_core::nmse::{Normaliser, Normaliser::MeanAbs};
use palpate_core::{Measured, SharedPath};
use proptest::collection::vec;
use proptest::prelude::*;

/// A batch on one simulated path, and the measured curve, of one to three branches.
#[derive(Debug, Clone)]
struct Case {
    sim_x: Vec<f64>,
    sim: Vec<f64>,
    n_sets: usize,
    exp_x: Vec<f64>,
    exp: Vec<f64>,
    weights: Vec<f64>,
    normaliser: Normaliser,
}

impl Case {
    fn path(&self) -> SharedPath {
        self.path_of(self.sim_x.len())
    }

    /// The path of the first `n` points.
    fn path_of(&self, n: usize) -> SharedPath {
        let weights = Some(&*self.weights);
        let measured = Measured::new(&self.exp_x, &self.exp, self.normaliser, weights).unwrap();
        measured.along(&self.sim_x[..n]).unwrap()
    }

    fn rows(&self) -> impl Iterator<Item = &[f64]> {
        self.sim.chunks_exact(self.sim_x.len())
    }

    /// Σ w ((sim − exp)/normaliser)² / Σ w over the covered points, and Σ w of those over all.
    fn plain(&self, row: &[f64]) -> (f64, f64) {
        let at = interpolate(&self.sim_x[..row.len()], row, &self.exp_x).unwrap();
        let normaliser = self.normaliser.value(&self.exp).unwrap();
        let (mut sum, mut covered) = (0.0, 0.0);
        for i in 0..self.exp.len() {
            if at.covered[i] {
                sum += self.weights[i] * ((at.values[i] - self.exp[i]) / normaliser).powi(2);
                covered += self.weights[i];
            }
        }
        (sum / covered, covered / self.weights.iter().sum::<f64>())
    }
}

/// `n` to `n + 20` irregular points through the turning points.
fn walk(turns: Vec<f64>, n: usize) -> impl Strategy<Value = Vec<f64>> {
    vec(0.02..1.0_f64, n..n + 20).prop_map(move |steps| {
        let mut path = vec![turns[0]];
        for leg in turns.windows(2) {
            let whole: f64 = steps.iter().sum();
            let mut gone = 0.0;
            for step in &steps[..steps.len() - 1] {
                gone += step / whole;
                path.push(leg[0] + gone * (leg[1] - leg[0]));
            }
            path.push(leg[1]);
        }
        path
    })
}

fn case() -> impl Strategy<Value = Case> {
    let turns = prop_oneof![
        Just(vec![0.0, 15.0]),
        Just(vec![0.0, -22.5, 22.5, 0.0]),
        Just(vec![3.0, -1.0]),
    ];
    // The simulation may stop short or go on beyond the measured path.
    let paths = (turns, 0.6..1.3_f64, 1..4_usize).prop_flat_map(|(turns, reach, n_sets)| {
        let mut simulated = turns.clone();
        let last = simulated.len() - 1;
        simulated[last] = turns[last - 1] + reach * (turns[last] - turns[last - 1]);
        (walk(simulated, 2), walk(turns, 2), Just(n_sets))
    });
    paths.prop_flat_map(|(sim_x, exp_x, n_sets)| {
        let (n, n_points) = (sim_x.len(), exp_x.len());
        let closeness = prop_oneof![Just(1.0), Just(1e-2), Just(1e-5), Just(0.0)];
        (
            (Just(sim_x), Just(exp_x), Just(n_sets), closeness),
            vec(-1.0..1.0_f64, n * n_sets),
            (vec(0.1..5.0_f64, n_points), vec(0.01..10.0_f64, n_points)),
            proptest::sample::select(Normaliser::ALL.to_vec()),
        )
            .prop_map(
                |((sim_x, exp_x, n_sets, closeness), noise, (steps, weights), normaliser)| {
                    let measure = |x: &f64| 2.0 + 0.3 * x + 0.05 * x * x;
                    // A simulation close to the measured curve is where digits cancel.
                    let exp = exp_x.iter().zip(&steps).map(|(x, s)| measure(x) + closeness * s);
                    let ideal = sim_x.iter().map(measure).cycle();
                    let sim =
                        noise.iter().zip(ideal).map(|(noise, y)| y + 10.0 * closeness * noise);
                    Case {
                        sim: sim.collect(),
                        exp: exp.collect(),
                        sim_x,
                        n_sets,
                        exp_x,
                        weights,
                        normaliser,
                    }
                },
            )
    })
}

fn agree(a: f64, b: f64, tolerance: f64) -> bool {
    a == b || (a.is_nan() && b.is_nan()) || (a - b).abs() <= tolerance * a.abs().max(b.abs())
}

fn usable(case: &Case) -> bool {
    case.normaliser.value(&case.exp).is_ok()
}

proptest! {
    #[test]
    fn a_batch_agrees_with_plain_sums(case in case()) {
        prop_assume!(usable(&case));
        let scores = case.path().score(&case.sim, case.n_sets).unwrap();
        for (set, row) in case.rows().enumerate() {
            let (nmse, coverage) = case.plain(row);
            prop_assert!(agree(scores.nmse[set], nmse, 1e-12), "{} {}", scores.nmse[set], nmse);
            prop_assert!(agree(scores.coverage[set], coverage, 1e-12));
        }
    }

    #[test]
    fn a_row_that_ends_early_is_the_path_that_it_reached(case in case(), share in 0.0..1.0_f64) {
        prop_assume!(usable(&case));
        let n = case.sim_x.len();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let reached = (share * n as f64) as usize;
        let mut row = case.sim[..n].to_vec();
        row[reached..].fill(f64::NAN);
        let path = case.path();
        let scores = path.score(&row, 1).unwrap();
        let gradient = path.gradient(&row, 1).unwrap();
        prop_assert!(gradient.gradient[reached..].iter().all(|g| g.is_nan()));
        if reached < 2 {
            prop_assert!(scores.nmse[0].is_nan() && scores.coverage[0] == 0.0);
            return Ok(());
        }
        let (nmse, coverage) = case.plain(&row[..reached]);
        prop_assert!(agree(scores.nmse[0], nmse, 1e-12), "{} {}", scores.nmse[0], nmse);
        prop_assert!(agree(scores.coverage[0], coverage, 1e-12));
        let own = case.path_of(reached).gradient(&row[..reached], 1).unwrap();
        prop_assert!(agree(gradient.scores.nmse[0], nmse, 1e-12));
        for (a, b) in gradient.gradient.iter().zip(&own.gradient) {
            prop_assert!(agree(*a, *b, 0.0));
        }
    }

    #[test]
    fn the_gradient_agrees_with_plain_sums(case in case()) {
        prop_assume!(usable(&case));
        let n = case.sim_x.len();
        let found = case.path().gradient(&case.sim, case.n_sets).unwrap();
        let normaliser = case.normaliser.value(&case.exp).unwrap();
        for (row, gradient) in case.rows().zip(found.gradient.chunks_exact(n)) {
            // The plain gradient: interpolation is linear, so unit curves give its matrix.
            let at = interpolate(&case.sim_x, row, &case.exp_x).unwrap();
            let covered: f64 =
                case.weights.iter().zip(&at.covered).filter(|(_, c)| **c).map(|(w, _)| w).sum();
            let mut plain = vec![0.0; n];
            let mut sizes = vec![0.0; n];
            for k in 0..n {
                let mut unit = vec![0.0; n];
                unit[k] = 1.0;
                let column = interpolate(&case.sim_x, &unit, &case.exp_x).unwrap();
                for i in 0..case.exp.len() {
                    if at.covered[i] {
                        let term = 2.0 * case.weights[i] * column.values[i] / covered / normaliser.powi(2);
                        plain[k] += term * (at.values[i] - case.exp[i]);
                        sizes[k] += term * (at.values[i].abs() + case.exp[i].abs());
                    }
                }
            }
            for k in 0..n {
                prop_assert!((gradient[k] - plain[k]).abs() <= 1e-12 * sizes[k].max(1e-300),
                    "{} {}", gradient[k], plain[k]);
            }
        }
    }
}

fn path(exp_x: &[f64], exp: &[f64], sim_x: &[f64]) -> SharedPath {
    Measured::new(exp_x, exp, MeanAbs, None).unwrap().along(sim_x).unwrap()
}

#[test]
fn a_batch_is_refused_with_the_place_of_the_fault() {
    let path = path(&[0.0, 1.0, 2.0], &[0.0, 1.0, 4.0], &[0.0, 1.0, 2.0]);
    let says = |sim: &[f64], n_sets: usize, part: &str| {
        for error in [path.score(sim, n_sets).unwrap_err(), path.gradient(sim, n_sets).unwrap_err()]
        {
            assert!(error.to_string().contains(part), "{error}");
        }
    };
    says(&[0.0; 5], 2, "2 sets of 3");
    says(&[0.0, 1.0, 2.0, 0.0, f64::INFINITY, 1.0], 2, "sim[1, 1] is inf");
    says(&[0.0, f64::NAN, 2.0], 1, "sim[0, 1] is NaN but later values are not");
    says(&[0.0, 1e308, 2.0], 1, "sim[0, 1] is 1");
}

#[test]
fn a_path_that_moves_by_less_than_a_normal_number_is_one_knot() {
    let path = path(&[-1e-12, 1.0], &[2.0, 2.0], &[0.0, f64::from_bits(1)]);
    let scores = path.score(&[1.0, 1.0], 1).unwrap();
    assert_eq!((scores.nmse[0], scores.coverage[0]), (0.25, 0.5));
    assert_eq!(path.gradient(&[1.0, 1.0], 1).unwrap().gradient, [0.0, -0.5]);
}
