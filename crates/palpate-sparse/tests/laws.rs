//! Laws of the factors, and every message.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use palpate_sparse::{Error, NumericalError, Precision, SparseFactor};
use proptest::collection::vec;
use proptest::prelude::*;

/// A dense matrix whose exact zeros are left out of the pattern.
#[derive(Debug, Clone)]
struct Dense(Vec<Vec<f64>>);

impl Dense {
    fn n(&self) -> usize {
        self.0.len()
    }

    /// Pointers, indices and data by rows; the diagonal is always listed.
    fn compressed(&self) -> (Vec<i32>, Vec<i32>, Vec<f64>) {
        let (mut indptr, mut indices, mut data) = (vec![0], Vec::new(), Vec::new());
        for (i, row) in self.0.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                if *value != 0.0 || i == j {
                    indices.push(i32::try_from(j).unwrap());
                    data.push(*value);
                }
            }
            indptr.push(i32::try_from(indices.len()).unwrap());
        }
        (indptr, indices, data)
    }

    fn times(&self, x: &[f64]) -> Vec<f64> {
        self.0.iter().map(|row| row.iter().zip(x).map(|(a, x)| a * x).sum()).collect()
    }
}

/// Sparse and symmetric, with a diagonal that dominates and has any sign.
fn well_posed() -> impl Strategy<Value = Dense> {
    (1..25_usize).prop_flat_map(move |n| {
        let entries = vec((0..n, 0..n, -1.0..1.0_f64), 0..3 * n);
        (entries, vec(any::<bool>(), n)).prop_map(move |(triples, flips)| {
            let mut a = vec![vec![0.0; n]; n];
            for (i, j, v) in triples {
                (a[i][j], a[j][i]) = (v, v);
            }
            for (i, row) in a.iter_mut().enumerate() {
                row[i] = 0.5 + row.iter().map(|v| v.abs()).sum::<f64>();
                row[i] = if flips[i] { -row[i] } else { row[i] };
            }
            Dense(a)
        })
    })
}

fn factorised(a: &Dense, precision: Precision) -> Result<SparseFactor, Error> {
    let (indptr, indices, data) = a.compressed();
    let mut factor = SparseFactor::new(&indptr, &indices, precision)?;
    factor.factorise(&data)?;
    Ok(factor)
}

fn waves(n: usize) -> Vec<f64> {
    (0..n).map(|i| f64::from(u32::try_from(i).unwrap()).sin()).collect()
}

/// One application in double precision, and GMRES in either, solve the system.
fn assert_solves(a: &Dense, factor: &SparseFactor) {
    let x = waves(a.n());
    let rhs = a.times(&x);
    let near = |found: &[f64], tolerance: f64| {
        for (f, x) in found.iter().zip(&x) {
            assert!((f - x).abs() < tolerance, "{f} {x}");
        }
    };
    let once = if factor.precision() == Precision::Double { 1e-10 } else { 1e-3 };
    near(&factor.precondition(&rhs).unwrap(), once);
    let found = factor.krylov(&a.compressed().2, &rhs, 1e-12, 100, true).unwrap();
    assert!(found.residual <= 1e-12, "{}", found.residual);
    near(&found.solution, 1e-9);
}

proptest! {
    #[test]
    fn symmetric_matrices_are_solved(a in well_posed(), single in any::<bool>()) {
        let precision = if single { Precision::Single } else { Precision::Double };
        assert_solves(&a, &factorised(&a, precision).unwrap());
    }

    #[test]
    fn right_hand_sides_are_solved_together(
        a in well_posed(), single in any::<bool>(), m in 1..6_usize, repeated in any::<bool>(),
    ) {
        let precision = if single { Precision::Single } else { Precision::Double };
        let factor = factorised(&a, precision).unwrap();
        let wave = |k: usize| waves(a.n() + k)[if repeated { 0 } else { k }..][..a.n()].to_vec();
        let known: Vec<f64> = (0..m).flat_map(wave).collect();
        let rhs: Vec<f64> = known.chunks(a.n()).flat_map(|x| a.times(x)).collect();
        let found = factor.krylov_together(&a.compressed().2, &rhs, 1e-11, 100, true).unwrap();
        prop_assert!(found.residual <= 1e-11, "{}", found.residual);
        for (f, x) in found.solution.iter().zip(&known) {
            prop_assert!((f - x).abs() < 1e-8, "{f} {x}");
        }
    }

    #[test]
    fn a_factor_follows_its_newest_values(a in well_posed(), scale in 0.1..10.0_f64) {
        let mut factor = factorised(&a, Precision::Double).unwrap();
        let b = Dense(a.0.iter().map(|r| r.iter().map(|v| v * scale).collect()).collect());
        factor.factorise(&b.compressed().2).unwrap();
        assert_solves(&b, &factor);
    }

    #[test]
    fn a_matrix_with_two_equal_rows_is_singular(
        a in well_posed(), from in 0..25_usize, to in 0..25_usize,
    ) {
        let (from, to) = (from % a.n(), to % a.n());
        let mut singular = a.clone();
        for k in 0..a.n() {
            let value = if from == to { 0.0 } else { singular.0[from][k] };
            (singular.0[to][k], singular.0[k][to]) = (value, value);
        }
        singular.0[to][to] = if from == to { 0.0 } else { singular.0[from][from] };
        if from != to {
            (singular.0[to][from], singular.0[from][to]) =
                (singular.0[from][from], singular.0[from][from]);
        }
        let error = factorised(&singular, Precision::Double).map(|_| ()).unwrap_err();
        let is_singular = matches!(error, Error::Numerical(NumericalError::Singular { .. }));
        prop_assert!(is_singular, "{}", error);
    }

    #[test]
    fn a_body_that_is_not_held_is_singular(n in 2..40_usize, stiffness in 1e-6..1e6_f64) {
        let mut a = vec![vec![0.0; n]; n];
        for i in 1..n {
            a[i][i] += stiffness;
            a[i - 1][i - 1] += stiffness;
            a[i][i - 1] -= stiffness;
            a[i - 1][i] -= stiffness;
        }
        let error = factorised(&Dense(a.clone()), Precision::Double).map(|_| ()).unwrap_err();
        prop_assert!(matches!(error, Error::Numerical(_)), "{}", error);
        a[0][0] += stiffness;
        for precision in [Precision::Double, Precision::Single] {
            factorised(&Dense(a.clone()), precision).unwrap();
        }
    }
}

#[test]
fn a_saddle_point_needs_pivots_of_two_rows() {
    let a = Dense(vec![vec![0.0, 1.0, 0.0], vec![1.0, 0.0, 2.0], vec![0.0, 2.0, 1.0]]);
    assert_solves(&a, &factorised(&a, Precision::Double).unwrap());
}

#[test]
fn small_pivots_outside_the_reach_of_pivoting_are_iterated_away() {
    // Leaves with a tiny diagonal hang on a dense hub; each is a pivot before its neighbour is seen.
    let (leaves, hub) = (40, 40);
    let mut a = vec![vec![0.0; leaves + hub]; leaves + hub];
    for i in 0..leaves {
        a[i][i] = 1e-7;
        a[i][leaves + i * 7 % hub] = 1.0;
        a[leaves + i * 7 % hub][i] = 1.0;
    }
    for i in 0..hub {
        for j in 0..hub {
            a[leaves + i][leaves + j] =
                f64::from(u32::try_from(3 * (i + j) + i * j).unwrap()).sin();
        }
    }
    let a = Dense(a);
    let factor = factorised(&a, Precision::Double).unwrap();
    let rhs = waves(a.n());
    let left = |x: &[f64]| {
        let off = a.times(x).into_iter().zip(&rhs).map(|(found, b)| (found - b).powi(2));
        off.sum::<f64>().sqrt()
    };
    let once = left(&factor.precondition(&rhs).unwrap());
    assert!(once > 1e-10, "the factor alone is good enough: {once}");
    let found = factor.krylov(&a.compressed().2, &rhs, 1e-12, 100, true).unwrap();
    assert!(left(&found.solution) < 1e-11);
}

/// A chain of springs with stiff ones, coupled and unsymmetric, on every other five rows.
fn chain(stiffness: impl Fn(usize) -> f64) -> Dense {
    let n = 90;
    let mut a = vec![vec![0.0; n]; n];
    for i in 0..n {
        a[i][i] = 2.05 + stiffness(i);
        if i > 0 {
            let both = stiffness(i).min(stiffness(i - 1));
            (a[i][i - 1], a[i - 1][i]) = (-1.0 + 0.35 * both, -1.0 + 0.15 * both);
        }
    }
    Dense(a)
}

#[test]
fn rows_that_change_by_much_cost_few_steps() {
    let stiff = |i: usize| if i % 10 < 5 { f64::from(u32::try_from(i + 1).unwrap()) } else { 0.0 };
    let after = chain(stiff);
    let rhs = waves(after.n());
    for precision in [Precision::Double, Precision::Single] {
        let factor = factorised(&chain(|_| 0.0), precision).unwrap();
        let found = factor.krylov(&after.compressed().2, &rhs, 1e-4, 100, true).unwrap();
        assert!(found.residual <= 1e-4, "{}", found.residual);
        let without = factor.krylov(&after.compressed().2, &rhs, 1e-4, 100, false).unwrap();
        assert!(4 * found.n_steps <= 3 * without.n_steps, "{} steps", found.n_steps);
    }
}

#[test]
fn without_a_sweep_rows_may_be_far_from_symmetric() {
    let (before, mut after) = (chain(|_| 0.0), chain(|_| 0.0));
    let n = before.n();
    for i in (0..n - 1).filter(|i| i % 10 < 9) {
        after.0[i][i + 1] += 3.0;
        after.0[i + 1][i] -= 3.0;
    }
    let (data, rhs) = (after.compressed().2, waves(n));
    for precision in [Precision::Double, Precision::Single] {
        let factor = factorised(&before, precision).unwrap();
        let residual = |sweep| factor.krylov(&data, &rhs, 1e-2, 60, sweep).unwrap().residual;
        assert!(residual(false) <= 1e-2 && residual(true) > 0.5);
    }
}

#[test]
fn right_hand_sides_share_directions() {
    let stiff = |i: usize| if i % 10 < 5 { f64::from(u32::try_from(i + 1).unwrap()) } else { 0.0 };
    let (before, after) = (chain(|_| 0.0), chain(stiff));
    let data = after.compressed().2;
    for precision in [Precision::Double, Precision::Single] {
        let factor = factorised(&before, precision).unwrap();
        let mut rhs = waves(2 * after.n());
        rhs.extend(vec![0.0; after.n()]);
        let together = factor.krylov_together(&data, &rhs, 1e-8, 200, true).unwrap();
        assert!(together.residual <= 1e-8, "{}", together.residual);
        let alone = |b: &[f64]| factor.krylov_together(&data, b, 1e-8, 200, true).unwrap().n_steps;
        let n_alone: usize = rhs.chunks(after.n()).map(alone).sum();
        assert!(together.n_steps < n_alone, "{} of {n_alone}", together.n_steps);
        assert_eq!(together.solution[2 * after.n()..], vec![0.0; after.n()]);
        let few = factor.krylov_together(&data, &rhs, 1e-8, 4, true).unwrap();
        assert!(few.n_steps <= 4 && few.residual > 1e-8 && few.residual < 1.0);
    }
}

#[test]
fn a_residual_that_its_own_direction_does_not_lessen_is_no_end() {
    // A shift behind a factor of ones: A b is orthogonal to b until the last of n directions.
    let (n, faint) = (7, 1e-12);
    let (mut ones, mut shift) = (vec![vec![0.0; n]; n], vec![vec![0.0; n]; n]);
    for i in 0..n {
        let (before, after) = ((i + n - 1) % n, (i + 1) % n);
        (ones[i][before], ones[i][i], ones[i][after]) = (faint, 1.0, faint);
        (shift[i][before], shift[i][after]) = (faint, 1.0);
    }
    let (data, mut rhs) = (Dense(shift).compressed().2, vec![0.0; 2 * n]);
    (rhs[0], rhs[n + 2]) = (1.0, 1.0);
    for precision in [Precision::Double, Precision::Single] {
        let factor = factorised(&Dense(ones.clone()), precision).unwrap();
        let found = factor.krylov_together(&data, &rhs, 1e-10, 30, true).unwrap();
        assert!(found.residual <= 1e-10, "{}", found.residual);
    }
}

fn says<T>(result: Result<T, Error>, parts: &[&str]) {
    let message = result.map(|_| ()).unwrap_err().to_string();
    for part in parts {
        assert!(message.contains(part), "{message:?} lacks {part:?}");
    }
}

#[test]
fn bad_patterns_are_named() {
    let of =
        |indptr: &[i32], indices: &[i32]| SparseFactor::new(indptr, indices, Precision::Double);
    says(of(&[], &[]), &["indptr has 0 values"]);
    says(of(&[0], &[]), &["at least 1"]);
    says(of(&[1, 1], &[0]), &["indptr[0] is 1"]);
    says(of(&[0, 2, 1, 2], &[0, 1]), &["indptr[2] is 1"]);
    says(of(&[0, -1, 1], &[0]), &["indptr[1] is -1"]);
    says(of(&[0, 1, 1], &[0, 1]), &["indptr[2] is 1", "number of indices (2)"]);
    says(of(&[0, 1, 9], &[0, 1]), &["indptr[2] is 9"]);
    says(of(&[0, 1, 2], &[0, 2]), &["indices[1] is 2"]);
    says(of(&[0, 1, 2], &[0, -1]), &["indices[1] is -1"]);
    says(of(&[0, 2, 3], &[1, 1, 0]), &["indices[1], in row 0", "sum duplicates"]);
    says(of(&[0, 1, 3], &[0, 1, 0]), &["indices[2], in row 1", "sort indices"]);
    says(of(&[0, 1, 3], &[0, 0, 1]), &["(1, 0) has no counterpart (0, 1)"]);
    says(of(&[0, 2, 3], &[0, 1, 1]), &["(0, 1) has no counterpart (1, 0)"]);
    let ordered =
        |order: &[u32]| SparseFactor::ordered(&[0, 1, 2], &[0, 1], Precision::Double, Some(order));
    for wrong in [&[0][..], &[0, 0], &[0, 2], &[0, 1, 1]] {
        says(ordered(wrong), &["order does not have each of 2 unknowns once"]);
    }
    says("half".parse::<Precision>(), &["precision \"half\" is unknown"]);
}

#[test]
fn bad_values_are_named_and_leave_no_factor() {
    let mut factor = SparseFactor::new(&[0, 2, 4], &[0, 1, 0, 1], Precision::Double).unwrap();
    says(factor.precondition(&[1.0, 1.0]), &["call factorise first"]);
    factor.factorise(&[2.0, 1.0, 1.0, 2.0]).unwrap();
    says(factor.precondition(&[1.0]), &["rhs has 1 values where 2"]);
    says(factor.krylov(&[2.0], &[1.0, 1.0], 1e-6, 9, true), &["data has 1 values where 4"]);
    says(factor.krylov(&[2.0; 4], &[1.0, f64::NAN], 1e-6, 9, true), &["rhs[1] is NaN"]);
    says(
        factor.krylov_together(&[2.0; 4], &[1.0; 3], 1e-6, 9, true),
        &["rhs has 3 values where 4"],
    );
    says(factor.factorise(&[2.0]), &["data has 1 values where 4"]);
    says(factor.precondition(&[1.0, 1.0]), &["call factorise first"]);
    says(factor.krylov(&[2.0; 4], &[1.0, 1.0], 1e-6, 9, true), &["call factorise first"]);
    says(factor.factorise(&[2.0, 1.0, f64::INFINITY, 2.0]), &["data[2] is inf"]);
    says(
        factor.factorise(&[2.0, 1.0, 1.1, 2.0]),
        &["entry (1, 0) is 1.1 but its counterpart is 1:", "symmetric part"],
    );
    says(factor.factorise(&[1.0, 1.0, 1.0, 1.0]), &["singular", "held?"]);
    says(factor.precondition(&[1.0, 1.0]), &["call factorise first"]);
}
