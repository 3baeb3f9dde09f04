//! Any design: no panic, drawn points are in the cube, and given points stay.
#![no_main]

use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use palpate_core::lhs::{LARGEST_DESIGN, latin_hypercube};
use palpate_core::nested::extend_latin_hypercube;
use palpate_core::optimise::{Criterion, Search, optimise};
use palpate_core::owen::scramble;
use palpate_core::scale::geometric;

#[derive(Debug, Arbitrary)]
struct Input {
    points: Vec<Value>,
    n: u8,
    d: u8,
    n_total: u16,
    huge: Option<(usize, usize)>,
    seed: u64,
    centred: bool,
    criterion: u8,
    n_fixed: u8,
    n_swaps: u8,
    range: (f64, f64),
}

/// Mostly shares of a range; any bits now and then.
#[derive(Debug, Clone, Copy, Arbitrary)]
enum Value {
    Share(u8),
    Any(f64),
}

fn numbers(values: &[Value]) -> Vec<f64> {
    let number = |value: &Value| match *value {
        Value::Share(share) => f64::from(share) / 255.0,
        Value::Any(value) => value,
    };
    values.iter().map(number).collect()
}

fn check(points: &[f64]) {
    assert!(points.iter().all(|x| (0.0..=1.0).contains(x)), "{points:?}");
}

/// Every function of a design accepts this one, or returns an error.
fn use_design(input: &Input, points: &[f64], d: usize) {
    let criterion = match input.criterion % 3 {
        0 => Criterion::CentredDiscrepancy,
        1 => Criterion::Maximin,
        _ => Criterion::Correlation,
    };
    let n_swaps = Some(u64::from(input.n_swaps));
    let search =
        Search { criterion, seed: input.seed, n_swaps, n_fixed: usize::from(input.n_fixed) };
    if let Ok(better) = optimise(points, d, &search) {
        check(&better);
        assert_eq!(better[..search.n_fixed * d], points[..search.n_fixed * d]);
    }
    let n_total = usize::from(input.n_total % 512);
    if let Ok(more) = extend_latin_hypercube(points, d, n_total, input.seed, input.centred) {
        check(&more);
        assert_eq!((more.len(), &more[..points.len()]), (n_total * d, points));
    }
    if let Ok(scrambled) = scramble(points, d, input.seed) {
        check(&scrambled);
    }
    let (lower, upper) = input.range;
    if let Ok(values) = geometric(points, lower, upper) {
        let (least, most) = (lower.min(upper), lower.max(upper));
        assert!(values.iter().all(|v| (least..=most).contains(v)));
    }
}

fuzz_target!(|input: Input| {
    let d = usize::from(input.d % 8);
    use_design(&input, &numbers(&input.points), d);
    if let Some((n, d)) = input.huge
        && n.saturating_mul(d) > LARGEST_DESIGN
    {
        assert!(latin_hypercube(n, d, input.seed, true).is_err());
    }
    if let Ok(drawn) = latin_hypercube(usize::from(input.n % 32), d, input.seed, input.centred) {
        check(&drawn);
        use_design(&input, &drawn, d);
    }
});
