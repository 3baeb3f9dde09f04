//! Any input: no panic, and every returned score is valid.
#![no_main]

use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use palpate_core::Measured;
use palpate_core::curve::{branches, interpolate};
use palpate_core::nmse::{Normaliser, Scores, nmse};

#[derive(Debug, Arbitrary)]
struct Input {
    exp: Vec<(Value, Value)>,
    sim: Vec<(Value, Value)>,
    more: Vec<Value>,
    weights: Option<Vec<Value>>,
    normaliser: u8,
}

/// Mostly small numbers, so that paths often correspond; any bits now and then.
#[derive(Debug, Clone, Copy, Arbitrary)]
enum Value {
    Small(i8),
    Fine(i16),
    Any(f64),
}

impl Value {
    fn number(self) -> f64 {
        match self {
            Self::Small(v) => f64::from(v / 16),
            Self::Fine(v) => f64::from(v) / 1024.0,
            Self::Any(v) => v,
        }
    }
}

fn numbers(values: &[Value]) -> Vec<f64> {
    values.iter().map(|v| v.number()).collect()
}

fn check(Scores { nmse, coverage, .. }: &Scores) {
    for (nmse, coverage) in nmse.iter().zip(coverage) {
        assert!((0.0..=1.0).contains(coverage), "{coverage}");
        assert!(*nmse >= 0.0 || (nmse.is_nan() && *coverage == 0.0), "{nmse} {coverage}");
    }
}

fuzz_target!(|input: Input| {
    let (exp_x, exp): (Vec<_>, Vec<_>) =
        input.exp.iter().map(|(x, y)| (x.number(), y.number())).unzip();
    let (sim_x, mut sim): (Vec<_>, Vec<_>) =
        input.sim.iter().map(|(x, y)| (x.number(), y.number())).unzip();
    let weights = input.weights.as_deref().map(numbers);
    let weights = weights.as_deref();
    let normaliser = Normaliser::ALL[usize::from(input.normaliser) % Normaliser::ALL.len()];
    let _ = branches(&exp_x);
    let _ = nmse(&sim, &exp, normaliser, weights);
    if let Ok(found) = interpolate(&sim_x, &sim, &exp_x) {
        assert!(found.values.iter().zip(found.covered).all(|(v, covered)| v.is_nan() != covered));
    }
    let Ok(measured) = Measured::new(&exp_x, &exp, normaliser, weights) else { return };
    let Ok(path) = measured.along(&sim_x) else { return };
    sim.extend(numbers(&input.more));
    let n_sets = sim.len() / sim_x.len();
    sim.truncate(n_sets * sim_x.len());
    path.score(&sim, n_sets).iter().for_each(check);
    if let Ok(out) = path.gradient(&sim, n_sets) {
        check(&out.scores);
    }
});
