//! Laws of the kernels: what holds for every curve, weight and seed.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
#![allow(clippy::float_cmp, reason = "where a test says equal it means every bit")]

use palpate_core::curve::{Direction, branches, interpolate};
use palpate_core::lhs::latin_hypercube;
use palpate_core::nmse::{Normaliser, nmse};
use proptest::collection::vec;
use proptest::prelude::*;

/// Turning points of a path of one to four branches, and the sign of its first branch.
fn turns() -> impl Strategy<Value = Vec<f64>> {
    (vec(1.0..20.0_f64, 1..5), any::<bool>(), -5.0..5.0_f64).prop_map(|(legs, rising, start)| {
        let mut sign = if rising { 1.0 } else { -1.0 };
        let mut at = start;
        let mut turns = vec![at];
        for leg in legs {
            at += sign * leg;
            sign = -sign;
            turns.push(at);
        }
        turns
    })
}

/// A path through all turning points with `shares` of every branch in between; strictly monotone.
fn walk(turns: &[f64], shares: &[f64]) -> Vec<f64> {
    let mut path = vec![turns[0]];
    for leg in turns.windows(2) {
        path.extend(shares.iter().map(|s| leg[0] + s * (leg[1] - leg[0])));
        path.push(leg[1]);
    }
    path
}

/// Ascending shares of a branch, far enough apart to stay distinct.
fn shares() -> impl Strategy<Value = Vec<f64>> {
    proptest::sample::subsequence((1..50).collect::<Vec<i32>>(), 0..12)
        .prop_map(|chosen| chosen.into_iter().map(|c| f64::from(c) / 50.0).collect())
}

/// A path with an ordinate per point.
fn curve() -> impl Strategy<Value = (Vec<f64>, Vec<f64>)> {
    (turns(), shares()).prop_flat_map(|(turns, shares)| {
        let x = walk(&turns, &shares);
        let y = vec(-100.0..100.0_f64, x.len());
        (Just(x), y)
    })
}

/// A small whole-number path, with plateaus, that moves.
fn stepped() -> impl Strategy<Value = Vec<f64>> {
    vec(-3..4_i32, 2..30)
        .prop_filter("moves", |x| x.iter().any(|v| *v != x[0]))
        .prop_map(|x| x.into_iter().map(f64::from).collect())
}

/// A measured curve of positive values with a simulated counterpart.
fn pair() -> impl Strategy<Value = (Vec<f64>, Vec<f64>)> {
    vec((0.5..20.0_f64, -20.0..20.0_f64), 2..40).prop_map(|points| points.into_iter().unzip())
}

fn normaliser() -> impl Strategy<Value = Normaliser> {
    proptest::sample::select(Normaliser::ALL.to_vec())
}

fn close(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance * (1.0 + a.abs().max(b.abs()))
}

proptest! {
    #[test]
    fn branches_tile_the_path_and_alternate(x in stepped()) {
        let cuts = branches(&x).unwrap();
        prop_assert_eq!(cuts[0].start, 0);
        prop_assert_eq!(cuts.last().unwrap().stop, x.len());
        for pair in cuts.windows(2) {
            prop_assert_eq!(pair[1].start, pair[0].stop - 1);
            prop_assert_ne!(pair[1].direction, pair[0].direction);
        }
        for cut in &cuts {
            let run = &x[cut.start..cut.stop];
            let rising = cut.direction == Direction::Rising;
            let monotone = run.windows(2).all(|w| if rising { w[1] >= w[0] } else { w[1] <= w[0] });
            prop_assert!(monotone);
            prop_assert_ne!(run[0], run[run.len() - 1]);
        }
        // A plateau at a turning point stays with the run before it.
        for cut in &cuts[1..] {
            prop_assert_ne!(x[cut.start], x[cut.start + 1]);
        }
    }

    #[test]
    fn every_turn_is_found((turns, shares) in (turns(), shares())) {
        prop_assert_eq!(branches(&walk(&turns, &shares)).unwrap().len(), turns.len() - 1);
    }

    #[test]
    fn a_curve_interpolated_onto_itself_is_itself((x, y) in curve()) {
        let out = interpolate(&x, &y, &x).unwrap();
        prop_assert_eq!(out.values, y);
        prop_assert!(out.covered.iter().all(|c| *c));
    }

    #[test]
    fn plateaus_stay_finite(x in stepped(), at in stepped()) {
        let y: Vec<f64> = x.iter().map(|v| v * v).collect();
        let own = interpolate(&x, &y, &x).unwrap();
        prop_assert_eq!(&own.values, &y);
        if let Ok(out) = interpolate(&x, &y, &at) {
            for (v, c) in out.values.iter().zip(&out.covered) {
                prop_assert_eq!(v.is_finite(), *c);
            }
        }
    }

    #[test]
    fn a_line_per_leg_is_reproduced(
        (turns, dense, at) in (turns(), shares(), shares()),
        (slope, step) in (-5.0..5.0_f64, -5.0..5.0_f64),
    ) {
        // Hysteresis: each branch is another line that starts where the last one ended.
        let line = |path: &[f64], per_leg: usize| -> Vec<f64> {
            let (mut y, mut x) = (0.0, path[0]);
            path.iter().enumerate().map(|(i, &v)| {
                let leg = i.saturating_sub(1) / per_leg;
                y += (slope + step * [0.0, 1.0, -1.0, 2.0][leg]) * (v - x);
                x = v;
                y
            }).collect()
        };
        let (sim_x, at_x) = (walk(&turns, &dense), walk(&turns, &at));
        let sim_y = line(&sim_x, dense.len() + 1);
        let expected = line(&at_x, at.len() + 1);
        let out = interpolate(&sim_x, &sim_y, &at_x).unwrap();
        for (v, e) in out.values.iter().zip(expected) {
            prop_assert!(close(*v, e, 1e-10), "{} {}", v, e);
        }
    }

    #[test]
    fn travelling_backwards_or_mirrored_changes_nothing(
        (turns, dense, at) in (turns(), shares(), shares()), seed in any::<u64>(),
    ) {
        let (x, at_x) = (walk(&turns, &dense), walk(&turns, &at));
        let y = latin_hypercube(x.len(), 1, seed, false).unwrap();
        let forward = interpolate(&x, &y, &at_x).unwrap();
        let back = |v: &[f64]| v.iter().rev().copied().collect::<Vec<_>>();
        let backward = interpolate(&back(&x), &back(&y), &back(&at_x)).unwrap();
        for (f, b) in forward.values.iter().zip(back(&backward.values)) {
            prop_assert!(close(*f, b, 1e-9), "{} {}", f, b);
        }
        let minus = |v: &[f64]| v.iter().map(|v| -v).collect::<Vec<_>>();
        prop_assert_eq!(forward, interpolate(&minus(&x), &y, &minus(&at_x)).unwrap());
    }

    #[test]
    fn a_path_that_ends_early_covers_what_it_reached((x, y) in curve(), share in 0.0..1.0_f64) {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss)]
        let reached = (share * x.len() as f64) as usize;
        prop_assume!(reached >= 2);
        let out = interpolate(&x[..reached], &y[..reached], &x).unwrap();
        prop_assert_eq!(&out.values[..reached], &y[..reached]);
        prop_assert!(out.values[reached..].iter().all(|v| v.is_nan()));
        prop_assert!(out.covered.iter().enumerate().all(|(i, c)| *c == (i < reached)));
    }

    #[test]
    fn nmse_is_zero_for_equal_curves_only((exp, sim) in pair(), normaliser in normaliser()) {
        prop_assume!(normaliser.value(&exp).is_ok());
        prop_assert_eq!(nmse(&exp, &exp, normaliser, None).unwrap(), 0.0);
        let error = nmse(&sim, &exp, normaliser, None).unwrap();
        prop_assert_eq!(error > 0.0, sim != exp);
    }

    #[test]
    fn one_scale_for_both_curves_changes_nothing(
        (exp, sim) in pair(), normaliser in normaliser(), exponent in -200..200_i32,
    ) {
        prop_assume!(normaliser != Normaliser::Unit && normaliser.value(&exp).is_ok());
        let scale = 10.0_f64.powi(exponent);
        let times = |v: &[f64]| v.iter().map(|v| v * scale).collect::<Vec<_>>();
        let before = nmse(&sim, &exp, normaliser, None).unwrap();
        let after = nmse(&times(&sim), &times(&exp), normaliser, None).unwrap();
        prop_assert!((before - after).abs() <= 1e-9 * before, "{} {}", before, after);
    }

    #[test]
    fn a_uniform_error_scores_its_square_with_rms((exp, _) in pair(), error in -1.0..1.0_f64) {
        let sim: Vec<f64> = exp.iter().map(|e| e * (1.0 + error)).collect();
        let scored = nmse(&sim, &exp, Normaliser::Rms, None).unwrap();
        prop_assert!(close(scored, error * error, 1e-12));
    }

    #[test]
    fn equal_weights_are_no_weights((exp, sim) in pair(), weight in 1e-300..1e300_f64) {
        let weights = vec![weight; exp.len()];
        let plain = nmse(&sim, &exp, Normaliser::MeanAbs, None).unwrap();
        prop_assert_eq!(nmse(&sim, &exp, Normaliser::MeanAbs, Some(&weights)).unwrap(), plain);
    }

    #[test]
    fn a_whole_weight_repeats_a_point((exp, sim) in pair(), repeats in vec(1..4_usize, 40)) {
        let n = exp.len();
        let repeat = |v: &[f64]| -> Vec<f64> {
            v.iter().zip(&repeats).flat_map(|(v, r)| vec![*v; *r]).collect()
        };
        #[expect(clippy::cast_precision_loss)]
        let weights: Vec<f64> = repeats[..n].iter().map(|r| *r as f64).collect();
        let weighted = nmse(&sim, &exp, Normaliser::MeanAbs, Some(&weights)).unwrap()
            * Normaliser::MeanAbs.value(&exp).unwrap().powi(2);
        let (sim, exp) = (repeat(&sim), repeat(&exp));
        let repeated = nmse(&sim, &exp, Normaliser::MeanAbs, None).unwrap()
            * Normaliser::MeanAbs.value(&exp).unwrap().powi(2);
        prop_assert!(close(weighted, repeated, 1e-12));
    }

    #[test]
    fn a_force_curve_is_never_degenerate(power in 1.0..10.0_f64, peak in 1e-6..1e6_f64) {
        let force: Vec<f64> = (0..500).map(|i| peak * (f64::from(i) / 499.0).powf(power)).collect();
        for normaliser in Normaliser::ALL {
            prop_assert!(normaliser.value(&force).is_ok());
        }
    }

    #[test]
    fn every_stratum_of_every_column_holds_one_set(
        n in 1..400_usize, d in 1..6_usize, seed in any::<u64>(), centred in any::<bool>(),
    ) {
        let design = latin_hypercube(n, d, seed, centred).unwrap();
        prop_assert_eq!(design.len(), n * d);
        for column in 0..d {
            let mut values: Vec<f64> = design.iter().skip(column).step_by(d).copied().collect();
            values.sort_by(f64::total_cmp);
            for (k, v) in values.iter().enumerate() {
                #[expect(clippy::cast_precision_loss)]
                let (low, high) = (k as f64 / n as f64, (k + 1) as f64 / n as f64);
                prop_assert!(*v > low && *v < high, "{} not in ({}, {})", v, low, high);
                if centred {
                    prop_assert!(close(*v, f64::midpoint(low, high), 1e-15));
                }
            }
        }
    }

    #[test]
    fn a_seed_decides_every_bit(n in 8..60_usize, d in 1..5_usize, seed in any::<u64>()) {
        let design = latin_hypercube(n, d, seed, false).unwrap();
        prop_assert_eq!(&design, &latin_hypercube(n, d, seed, false).unwrap());
        prop_assert_ne!(&design, &latin_hypercube(n, d, seed ^ 1, false).unwrap());
        let centred = latin_hypercube(n, d, seed, true).unwrap();
        #[expect(clippy::cast_precision_loss)]
        let stratum = |v: &f64| (v * n as f64).floor();
        prop_assert!(design.iter().map(stratum).eq(centred.iter().map(stratum)));
        let wider = latin_hypercube(n, d + 1, seed, false).unwrap();
        for (narrow, wide) in design.chunks_exact(d).zip(wider.chunks_exact(d + 1)) {
            prop_assert_eq!(narrow, &wide[..d]);
        }
    }
}
