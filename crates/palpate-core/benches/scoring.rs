//! Times of the scoring kernels per curve: `cargo bench -p palpate-core --bench scoring`.
#![expect(clippy::unwrap_used, reason = "a benchmark fails by panicking")]
#![expect(clippy::cast_precision_loss, reason = "counts here are small")]

use divan::{Bencher, counter::ItemsCount};
use palpate_core::curve::Interpolant;
use palpate_core::nmse::Comparison;
use palpate_core::shared::Form;
use palpate_core::{Measured, SharedPath};

const N_SETS: usize = 1000;

fn main() {
    divan::main();
}

/// Depths and forces of a ramp of `n` points.
fn ramp(n: usize) -> (Vec<f64>, Vec<f64>) {
    let x: Vec<f64> = (0..n).map(|i| 15.0 * i as f64 / (n - 1) as f64).collect();
    let y = x.iter().map(|x| 0.03 * x * x).collect();
    (x, y)
}

/// A thousand measured points, a path of a hundred simulated ones, and a batch on it.
fn case(interpolant: Interpolant) -> (Measured, SharedPath, Vec<f64>, Vec<f64>) {
    let ((sim_x, sim_y), (exp_x, exp)) = (ramp(100), ramp(1000));
    let comparison = Comparison { interpolant, ..Comparison::default() };
    let measured = Measured::new(&exp_x, &exp, &comparison).unwrap();
    let path = measured.along(&sim_x).unwrap();
    let factors = (0..N_SETS).map(|k| 0.5 + k as f64 / N_SETS as f64);
    let sim = factors.flat_map(|f| sim_y.iter().map(move |y| f * y.sqrt())).collect();
    (measured, path, sim_x, sim)
}

#[divan::bench(args = [Form::Moments, Form::Direct])]
fn shared(bencher: Bencher<'_, '_>, form: Form) {
    let (_, path, _, sim) = case(Interpolant::Linear);
    bencher.counter(ItemsCount::new(N_SETS)).bench(|| path.score(&sim, N_SETS, form, 1).unwrap());
}

#[divan::bench(args = Interpolant::ALL)]
fn merge(bencher: Bencher<'_, '_>, interpolant: Interpolant) {
    let (measured, _, sim_x, sim) = case(interpolant);
    let (x, n) = (sim_x.repeat(N_SETS), sim_x.len());
    let starts: Vec<_> = (0..=N_SETS).map(|k| k * n).collect();
    bencher
        .counter(ItemsCount::new(N_SETS))
        .bench(|| measured.score_paths(&x, &sim, &starts, 1).unwrap());
}

#[divan::bench(args = Interpolant::ALL)]
fn gradient(bencher: Bencher<'_, '_>, interpolant: Interpolant) {
    let (_, path, _, sim) = case(interpolant);
    bencher.counter(ItemsCount::new(N_SETS)).bench(|| path.gradient(&sim, N_SETS, 1).unwrap());
}

#[divan::bench]
fn best_scale(bencher: Bencher<'_, '_>) {
    let (_, path, _, sim) = case(Interpolant::Linear);
    let bounds = (0.0, f64::INFINITY);
    bencher
        .counter(ItemsCount::new(N_SETS))
        .bench(|| path.best_scale(&sim, N_SETS, bounds, 1).unwrap());
}
