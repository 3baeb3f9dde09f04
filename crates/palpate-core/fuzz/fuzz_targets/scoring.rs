//! Any input whatever: no panic, and every score that is returned is a score.
#![no_main]

use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use palpate_core::Measured;
use palpate_core::curve::Interpolant;
use palpate_core::nmse::{Comparison, Normaliser, Scores, nmse, nmse_batch};
use palpate_core::shared::Form;

#[derive(Debug, Arbitrary)]
struct Input {
    exp: Vec<(Value, Value)>,
    sim: Vec<(Value, Value)>,
    more: Vec<Value>,
    weights: Option<Vec<Value>>,
    tolerance: Value,
    normaliser: u8,
    pchip: bool,
    bounds: (Value, Value),
    starts: Vec<u8>,
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
    let comparison = Comparison {
        normaliser: Normaliser::ALL[usize::from(input.normaliser) % Normaliser::ALL.len()],
        weights: weights.as_deref(),
        tolerance: input.tolerance.number(),
        interpolant: Interpolant::ALL[usize::from(input.pchip)],
    };
    let _ = nmse(&sim, &exp, comparison.normaliser, comparison.weights);
    if let Ok(scores) = nmse_batch(&sim, 1, &exp, comparison.normaliser, comparison.weights, 1) {
        check(&scores);
    }
    let Ok(measured) = Measured::new(&exp_x, &exp, &comparison) else { return };
    let _ = measured.score(&sim_x, &sim);
    let starts: Vec<_> = input.starts.iter().map(|s| usize::from(*s)).collect();
    let _ = measured.score_paths(&sim_x, &sim, &starts, 1);
    let Ok(path) = measured.along(&sim_x) else { return };
    sim.extend(numbers(&input.more));
    let n_sets = sim.len() / sim_x.len();
    sim.truncate(n_sets * sim_x.len());
    let forms = Form::ALL.map(|form| path.score(&sim, n_sets, form, 1));
    forms.iter().flatten().for_each(check);
    assert_eq!(forms[0].is_ok(), forms[1].is_ok());
    if let Ok(out) = path.gradient(&sim, n_sets, 1) {
        check(&out.scores);
    }
    let bounds = (input.bounds.0.number(), input.bounds.1.number());
    if let Ok(out) = path.best_scale(&sim, n_sets, bounds, 1) {
        check(&out.scores);
    }
});
