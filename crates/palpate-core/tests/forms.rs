//! Every form of a score against a plain one: shared, moments, merged, scaled, differentiated.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
#![allow(clippy::float_cmp, reason = "where a test says equal it means every bit")]
#![allow(clippy::cast_precision_loss, reason = "counts here are small")]

use palpate_core::curve::{Interpolant, branches, interpolate};
use palpate_core::nmse::{Comparison, Normaliser, Scores};
use palpate_core::shared::Form;
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
    fn comparison(&self, interpolant: Interpolant) -> Comparison<'_> {
        let (normaliser, weights) = (self.normaliser, Some(&*self.weights));
        Comparison { normaliser, weights, tolerance: 0.0, interpolant }
    }

    fn measured(&self, interpolant: Interpolant) -> Measured {
        Measured::new(&self.exp_x, &self.exp, &self.comparison(interpolant)).unwrap()
    }

    fn path(&self, interpolant: Interpolant) -> SharedPath {
        self.measured(interpolant).along(&self.sim_x).unwrap()
    }

    fn rows(&self) -> impl Iterator<Item = &[f64]> {
        self.sim.chunks_exact(self.sim_x.len())
    }

    /// Σ w ((sim − exp)/normaliser)² / Σ w over the covered points, and Σ w of those over all.
    fn plain(&self, row: &[f64], interpolant: Interpolant) -> (f64, f64) {
        let at = interpolate(&self.sim_x, row, &self.exp_x, 0.0, interpolant).unwrap();
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

/// A path of `n` to `n + 20` irregular points through the turning points.
fn path(turns: Vec<f64>, n: usize) -> impl Strategy<Value = Vec<f64>> {
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
        (path(simulated, 2), path(turns, 2), Just(n_sets))
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
    fn every_form_agrees_with_the_plain_one(case in case()) {
        prop_assume!(usable(&case));
        let path = case.path(Interpolant::Linear);
        let [moments, direct] =
            [Form::Moments, Form::Direct].map(|form| path.score(&case.sim, case.n_sets, form, 1).unwrap());
        let measured = case.measured(Interpolant::Linear);
        for (set, row) in case.rows().enumerate() {
            let (nmse, coverage) = case.plain(row, Interpolant::Linear);
            let merged = measured.score(&case.sim_x, row).unwrap();
            prop_assert_eq!((merged.nmse, merged.coverage), (direct.nmse[set], direct.coverage[set]));
            prop_assert!(agree(direct.nmse[set], nmse, 1e-12), "{} {}", direct.nmse[set], nmse);
            prop_assert!(agree(moments.nmse[set], nmse, 1e-12), "{} {}", moments.nmse[set], nmse);
            prop_assert!(agree(direct.coverage[set], coverage, 1e-12));
            prop_assert_eq!(moments.coverage[set], direct.coverage[set]);
        }
    }

    #[test]
    fn many_paths_are_a_loop_with_pchip_too(case in case(), pchip in any::<bool>()) {
        prop_assume!(usable(&case));
        let interpolant = if pchip { Interpolant::Pchip } else { Interpolant::Linear };
        let (measured, n) = (case.measured(interpolant), case.sim_x.len());
        let starts: Vec<_> = (0..=case.n_sets).map(|k| k * n).collect();
        let many = measured
            .score_paths(&case.sim_x.repeat(case.n_sets), &case.sim, &starts, 1)
            .unwrap();
        let shared = case.path(interpolant).score(&case.sim, case.n_sets, Form::Direct, 1).unwrap();
        prop_assert_eq!(&many.nmse, &shared.nmse);
        for (row, nmse) in case.rows().zip(many.nmse) {
            prop_assert!(agree(nmse, case.plain(row, interpolant).0, 1e-12));
        }
    }

    #[test]
    fn threads_change_no_bit(case in case(), repeats in 70..200_usize) {
        prop_assume!(usable(&case));
        let (sim, n_sets) = (case.sim.repeat(repeats), case.n_sets * repeats);
        for interpolant in Interpolant::ALL {
            let path = case.path(interpolant);
            let run = |threads| path.gradient(&sim, n_sets, threads).unwrap();
            prop_assert_eq!(run(1), run(3));
            let run = |threads| path.score(&sim, n_sets, Form::Moments, threads).unwrap();
            prop_assert_eq!(run(1), run(0));
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
        for interpolant in Interpolant::ALL {
            let path = case.path(interpolant);
            let own = case.measured(interpolant).score(&case.sim_x[..reached], &row[..reached]);
            for form in Form::ALL {
                let Scores { nmse, coverage, .. } = path.score(&row, 1, form, 1).unwrap();
                match &own {
                    Ok(own) => {
                        prop_assert!(agree(nmse[0], own.nmse, 1e-15));
                        prop_assert_eq!(coverage[0], own.coverage);
                    }
                    Err(_) => prop_assert!(nmse[0].is_nan() && coverage[0] == 0.0),
                }
            }
            let gradient = path.gradient(&row, 1, 1).unwrap().gradient;
            if own.is_ok() {
                prop_assert!(gradient[..reached].iter().all(|g| g.is_finite() || own.as_ref().unwrap().nmse.is_nan()));
            }
            prop_assert!(gradient[reached..].iter().all(|g| g.is_nan()));
        }
    }

    #[test]
    fn the_gradient_is_the_slope(case in case(), pchip in any::<bool>(), seed in 0..1000_usize) {
        prop_assume!(usable(&case));
        let interpolant = if pchip { Interpolant::Pchip } else { Interpolant::Linear };
        let (path, n) = (case.path(interpolant), case.sim_x.len());
        let row = &case.sim[..n];
        let gradient = path.gradient(row, 1, 1).unwrap();
        let score = |y: &[f64]| path.score(y, 1, Form::Direct, 1).unwrap().nmse[0];
        prop_assert!(agree(gradient.scores.nmse[0], score(row), 1e-12));
        // Along one value; a kink of PCHIP's slopes within the step spoils the difference.
        let (at, step) = (seed % n, 1e-6);
        let moved = |by: f64| {
            let mut y = row.to_vec();
            y[at] += by;
            score(&y)
        };
        let (up, down) = ((moved(step) - score(row)) / step, (score(row) - moved(-step)) / step);
        let second = if pchip { 1e-3 } else { 1e-4 };
        if (up - down).abs() <= second * (up.abs() + down.abs()) {
            let slope = f64::midpoint(up, down);
            let size: f64 = gradient.gradient.iter().map(|g| g.abs()).sum();
            let noise = 1e-9 * score(row) / step;
            prop_assert!((gradient.gradient[at] - slope).abs() <= 1e-3 * size + noise,
                "{} {}", gradient.gradient[at], slope);
        }
    }

    #[test]
    fn both_gradients_agree(case in case()) {
        prop_assume!(usable(&case));
        let n = case.sim_x.len();
        let by_moments = case.path(Interpolant::Linear).gradient(&case.sim, case.n_sets, 1).unwrap();
        let normaliser = case.normaliser.value(&case.exp).unwrap();
        for (row, gradient) in case.rows().zip(by_moments.gradient.chunks_exact(n)) {
            // The plain gradient: interpolation is linear, so unit curves give its matrix.
            let at = interpolate(&case.sim_x, row, &case.exp_x, 0.0, Interpolant::Linear).unwrap();
            let covered: f64 =
                case.weights.iter().zip(&at.covered).filter(|(_, c)| **c).map(|(w, _)| w).sum();
            let mut plain = vec![0.0; n];
            let mut sizes = vec![0.0; n];
            for k in 0..n {
                let mut unit = vec![0.0; n];
                unit[k] = 1.0;
                let column = interpolate(&case.sim_x, &unit, &case.exp_x, 0.0, Interpolant::Linear).unwrap();
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

    #[test]
    fn the_best_scale_is_best(case in case(), pchip in any::<bool>(), bound in 0.2..3.0_f64) {
        prop_assume!(usable(&case));
        let interpolant = if pchip { Interpolant::Pchip } else { Interpolant::Linear };
        let path = case.path(interpolant);
        let best = path.best_scale(&case.sim, case.n_sets, (0.1, bound), 1).unwrap();
        for (set, row) in case.rows().enumerate() {
            let at = |scale: f64| {
                let scaled: Vec<_> = row.iter().map(|y| scale * y).collect();
                case.plain(&scaled, interpolant).0
            };
            let scale = best.scale[set];
            prop_assert!((0.1..=bound).contains(&scale));
            // Scaling before or after interpolation rounds the curve differently by 1e-15.
            let rounding = 1e-12 * at(scale) + 1e-14 * at(scale).sqrt() + 1e-28;
            prop_assert!((at(scale) - best.scores.nmse[set]).abs() <= rounding);
            for other in [0.1, bound, scale * 0.999, scale * 1.001] {
                let other = other.clamp(0.1, bound);
                prop_assert!(at(scale) <= at(other) + rounding);
            }
        }
    }

    #[test]
    fn pchip_keeps_to_its_knots_and_never_overshoots(case in case()) {
        let row = &case.sim[..case.sim_x.len()];
        let own = interpolate(&case.sim_x, row, &case.sim_x, 0.0, Interpolant::Pchip).unwrap();
        prop_assert_eq!(&own.values, row);
        for leg in branches(&case.sim_x, 0.0).unwrap() {
            let (x, y) = (&case.sim_x[leg.start..leg.stop], &row[leg.start..leg.stop]);
            for k in 0..x.len() - 1 {
                let between: Vec<_> = (0..=8)
                    .map(|i| x[k] + f64::from(i) / 8.0 * (x[k + 1] - x[k]))
                    .collect();
                let at = interpolate(x, y, &between, 0.0, Interpolant::Pchip).unwrap();
                let (least, most) = (y[k].min(y[k + 1]), y[k].max(y[k + 1]));
                let slack = 1e-12 * (1.0 + least.abs().max(most.abs()));
                prop_assert!(at.values.iter().all(|v| (least - slack..=most + slack).contains(v)));
            }
        }
    }
}

#[test]
fn a_batch_is_refused_with_the_place_of_the_fault() {
    let measured =
        Measured::new(&[0.0, 1.0, 2.0], &[0.0, 1.0, 4.0], &Comparison::default()).unwrap();
    let path = measured.along(&[0.0, 1.0, 2.0]).unwrap();
    let says = |sim: &[f64], n_sets: usize, part: &str| {
        for form in Form::ALL {
            let message = path.score(sim, n_sets, form, 1).unwrap_err().to_string();
            assert!(message.contains(part), "{message}");
        }
        assert!(
            path.gradient(sim, n_sets, 1).is_err()
                && path.best_scale(sim, n_sets, (0.0, 1.0), 1).is_err()
        );
    };
    says(&[0.0; 5], 2, "2 sets of 3");
    says(&[0.0, 1.0, 2.0, 0.0, f64::INFINITY, 1.0], 2, "sim[1, 1] is inf");
    says(&[0.0, f64::NAN, 2.0], 1, "sim[0, 1] is NaN but later values are not");
    says(&[0.0, 1e308, 2.0], 1, "sim[0, 1] is 1");
    let range = path.best_scale(&[0.0; 3], 1, (2.0, 1.0), 1).unwrap_err().to_string();
    assert!(range.contains("from 2 to 1"), "{range}");
    let starts = |starts: &[usize]| measured.score_paths(&[0.0, 1.0], &[0.0, 1.0], starts, 1);
    for (wrong, part) in [
        (&[1, 2][..], "starts[0] is 1"),
        (&[0, 2, 1], "starts[2] is 1"),
        (&[0, 1], "starts[1] is 1"),
        (&[], "starts is empty"),
    ] {
        let message = starts(wrong).unwrap_err().to_string();
        assert!(message.contains(part), "{message}");
    }
    let message = starts(&[0, 2, 2]).unwrap_err().to_string();
    assert!(message.contains("simulated path 1: sim_x is empty"), "{message}");
}

/// The multiple overflows, also at a point without weight.
#[test]
fn a_bound_that_demands_the_impossible_scores_and_is_a_number() {
    let weights = [0.0, 1.0, 1.0];
    let comparison = Comparison { weights: Some(&weights), ..Comparison::default() };
    let measured = Measured::new(&[0.0, 1.0, 2.0], &[1.0, 1.0, 1.0], &comparison).unwrap();
    let path = measured.along(&[0.0, 2.0]).unwrap();
    let best = path.best_scale(&[1e9, 1e9], 1, (1e300, f64::INFINITY), 1).unwrap();
    assert_eq!((best.scale[0], best.scores.nmse[0]), (1e300, f64::INFINITY));
}

#[test]
fn a_curve_of_zeros_has_no_best_scale() {
    let measured = Measured::new(&[0.0, 2.0], &[2.0, 2.0], &Comparison::default()).unwrap();
    let out =
        measured.along(&[0.0, 2.0]).unwrap().best_scale(&[0.0, 0.0], 1, (0.0, 9.0), 1).unwrap();
    assert!(out.scale[0].is_nan());
    assert_eq!(out.scores.nmse[0], 1.0);
}

#[test]
fn a_path_that_moves_by_less_than_a_normal_number_is_one_knot() {
    let step = f64::from_bits(1);
    for interpolant in Interpolant::ALL {
        let comparison = Comparison { interpolant, ..Comparison::default() };
        let measured = Measured::new(&[-1e-12, 1.0], &[2.0, 2.0], &comparison).unwrap();
        let path = measured.along(&[0.0, step]).unwrap();
        let scores = path.score(&[1.0, 1.0], 1, Form::Direct, 1).unwrap();
        assert_eq!((scores.nmse[0], scores.coverage[0]), (0.25, 0.5));
        assert_eq!(path.gradient(&[1.0, 1.0], 1, 1).unwrap().gradient, [0.0, -0.5]);
    }
}
