//! Laws of the solver, and every message.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use palpate_sparse::pattern::Pattern;
use palpate_sparse::{Error, Kind, Layout, NumericalError, Precision, SparseFactor};
use proptest::collection::vec;
use proptest::prelude::*;

/// A dense matrix whose exact zeros are left out of the pattern.
#[derive(Debug, Clone)]
struct Dense(Vec<Vec<f64>>);

impl Dense {
    fn n(&self) -> usize {
        self.0.len()
    }

    /// Pointers, indices and data by columns or rows; the diagonal is always listed.
    fn compressed(&self, layout: Layout, lower: bool) -> (Vec<i64>, Vec<i64>, Vec<f64>) {
        let (mut indptr, mut indices, mut data) = (vec![0], Vec::new(), Vec::new());
        for major in 0..self.n() {
            for minor in 0..self.n() {
                let (i, j) = match layout {
                    Layout::Csc => (minor, major),
                    Layout::Csr => (major, minor),
                };
                if (self.0[i][j] != 0.0 || i == j) && (!lower || i >= j) {
                    indices.push(i64::try_from(minor).unwrap());
                    data.push(self.0[i][j]);
                }
            }
            indptr.push(i64::try_from(indices.len()).unwrap());
        }
        (indptr, indices, data)
    }

    fn times(&self, x: &[f64], k: usize) -> Vec<f64> {
        let mut out = vec![0.0; x.len()];
        for (i, row) in self.0.iter().enumerate() {
            for (j, a) in row.iter().enumerate() {
                (0..k).for_each(|c| out[i * k + c] += a * x[j * k + c]);
            }
        }
        out
    }
}

/// Sparse, with a diagonal that dominates; symmetric and positive definite, or neither.
fn well_posed(symmetric: bool) -> impl Strategy<Value = Dense> {
    (1..25_usize).prop_flat_map(move |n| {
        vec((0..n, 0..n, -1.0..1.0_f64), 0..3 * n).prop_map(move |triples| {
            let mut a = vec![vec![0.0; n]; n];
            for (i, j, v) in triples {
                a[i][j] = v;
                if symmetric {
                    a[j][i] = v;
                }
            }
            for (i, row) in a.iter_mut().enumerate() {
                row[i] = 0.5 + row.iter().map(|v| v.abs()).sum::<f64>();
            }
            Dense(a)
        })
    })
}

fn factorised(a: &Dense, layout: Layout, kind: Kind, lower: bool) -> Result<SparseFactor, Error> {
    let (indptr, indices, data) = a.compressed(layout, lower);
    let mut factor = SparseFactor::new(&indptr, &indices, layout, kind, Precision::Double)?;
    factor.factorise(&data)?;
    Ok(factor)
}

fn assert_solves(a: &Dense, factor: &SparseFactor, k: usize) {
    let x: Vec<f64> = (0..a.n() * k).map(|i| f64::from(u32::try_from(i).unwrap()).sin()).collect();
    let found = factor.solve(&a.times(&x, k), k).unwrap();
    for (f, x) in found.iter().zip(&x) {
        assert!((f - x).abs() < 1e-10, "{f} {x}");
    }
}

proptest! {
    #[test]
    fn lu_solves_whatever_the_layout(a in well_posed(false), csr in any::<bool>(), k in 1..4_usize) {
        let layout = if csr { Layout::Csr } else { Layout::Csc };
        assert_solves(&a, &factorised(&a, layout, Kind::Lu, false).unwrap(), k);
    }

    #[test]
    fn symmetric_kinds_solve_from_the_lower_triangle_or_all(
        a in well_posed(true), lower in any::<bool>(), csr in any::<bool>(),
    ) {
        let layout = if csr { Layout::Csr } else { Layout::Csc };
        for kind in [Kind::Ldlt, Kind::Llt] {
            assert_solves(&a, &factorised(&a, layout, kind, lower).unwrap(), 2);
        }
    }

    #[test]
    fn ldlt_and_lu_solve_indefinite_matrices(
        mut a in well_posed(true), flips in vec(any::<bool>(), 25),
    ) {
        prop_assume!(flips[..a.n()].iter().any(|f| *f));
        for (i, row) in a.0.iter_mut().enumerate() {
            if flips[i] {
                row[i] = -row[i];
            }
        }
        assert_solves(&a, &factorised(&a, Layout::Csc, Kind::Ldlt, false).unwrap(), 1);
        assert_solves(&a, &factorised(&a, Layout::Csc, Kind::Lu, false).unwrap(), 1);
        let llt = factorised(&a, Layout::Csc, Kind::Llt, false).unwrap_err();
        prop_assert_eq!(llt, NumericalError::NotPositiveDefinite.into());
    }

    #[test]
    fn a_factor_follows_its_newest_values(a in well_posed(false), scale in 0.1..10.0_f64) {
        let (indptr, indices, data) = a.compressed(Layout::Csc, false);
        let mut factor = SparseFactor::new(&indptr, &indices, Layout::Csc, Kind::Lu, Precision::Double).unwrap();
        factor.factorise(&data).unwrap();
        let scaled: Vec<f64> = data.iter().map(|v| v * scale).collect();
        factor.factorise(&scaled).unwrap();
        let b = Dense(a.0.iter().map(|r| r.iter().map(|v| v * scale).collect()).collect());
        assert_solves(&b, &factor, 1);
    }

    #[test]
    fn a_matrix_with_a_zero_row_or_a_repeated_one_is_singular(
        a in well_posed(false), from in 0..25_usize, to in 0..25_usize,
    ) {
        let (from, to) = (from % a.n(), to % a.n());
        let mut singular = a.clone();
        singular.0[to] = if from == to { vec![0.0; a.n()] } else { a.0[from].clone() };
        let error = factorised(&singular, Layout::Csr, Kind::Lu, false).unwrap_err();
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
        for kind in [Kind::Lu, Kind::Ldlt, Kind::Llt] {
            let error = factorised(&Dense(a.clone()), Layout::Csc, kind, false).unwrap_err();
            prop_assert!(matches!(error, Error::Numerical(_)), "{:?} {}", kind, error);
        }
        a[0][0] += stiffness;
        for kind in [Kind::Lu, Kind::Ldlt, Kind::Llt] {
            factorised(&Dense(a.clone()), Layout::Csc, kind, false).unwrap();
        }
    }

    #[test]
    fn a_product_is_the_dense_product(a in well_posed(true), symmetric in any::<bool>()) {
        let (indptr, indices, data) = a.compressed(Layout::Csr, false);
        let pattern = Pattern::new(&indptr, &indices, Layout::Csr, symmetric).unwrap();
        let x: Vec<f64> = (0..a.n()).map(|i| f64::from(u32::try_from(i).unwrap()).cos()).collect();
        let mut product = vec![0.0; a.n()];
        pattern.multiply(&pattern.gather(&data).unwrap(), &x, &mut product);
        for (p, q) in product.iter().zip(a.times(&x, 1)) {
            prop_assert!((p - q).abs() < 1e-12);
        }
    }
}

proptest! {
    #[test]
    fn krylov_takes_the_lower_triangle_for_the_whole(a in well_posed(true)) {
        let (indptr, indices, data) = a.compressed(Layout::Csc, true);
        let mut factor =
            SparseFactor::new(&indptr, &indices, Layout::Csc, Kind::Ldlt, Precision::Single).unwrap();
        factor.factorise(&data).unwrap();
        let x = vec![1.0; a.n()];
        let found = factor.krylov(&data, &a.times(&x, 1), 1e-11, 100).unwrap();
        prop_assert!(found.residual <= 1e-11, "{}", found.residual);
        for found in found.solution {
            prop_assert!((found - 1.0).abs() < 1e-8);
        }
    }

    #[test]
    fn a_single_factor_with_refinement_solves_whatever_the_kind(a in well_posed(true), k in 1..3_usize) {
        for kind in [Kind::Lu, Kind::Ldlt, Kind::Llt] {
            let (indptr, indices, data) = a.compressed(Layout::Csr, false);
            let mut factor =
                SparseFactor::new(&indptr, &indices, Layout::Csr, kind, Precision::Single).unwrap();
            factor.factorise(&data).unwrap();
            assert_solves(&a, &factor, k);
        }
    }
}

#[test]
fn a_saddle_point_needs_pivots_of_two_rows() {
    let a = Dense(vec![vec![0.0, 1.0, 0.0], vec![1.0, 0.0, 2.0], vec![0.0, 2.0, 1.0]]);
    assert_solves(&a, &factorised(&a, Layout::Csc, Kind::Ldlt, true).unwrap(), 1);
}

#[test]
fn small_pivots_outside_the_reach_of_pivoting_are_refined_away() {
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
    let factor = factorised(&a, Layout::Csc, Kind::Ldlt, false).unwrap();
    assert!(factor.probe_error().unwrap() > 1e-10, "the factor alone is good enough");
    let rhs: Vec<f64> = (0..a.n()).map(|i| f64::from(u32::try_from(i).unwrap()).cos()).collect();
    let x = factor.solve(&rhs, 1).unwrap();
    let scale = x.iter().fold(1.0_f64, |most, x| most.max(x.abs()));
    for (found, wanted) in a.times(&x, 1).iter().zip(&rhs) {
        assert!((found - wanted).abs() < 1e-13 * scale, "{found} {wanted}");
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
    let lu = |indptr: &[i64], indices: &[i64]| {
        SparseFactor::new(indptr, indices, Layout::Csc, Kind::Lu, Precision::Double)
    };
    says(lu(&[], &[]), &["indptr has 0 values"]);
    says(lu(&[0], &[]), &["at least 1"]);
    says(lu(&[1, 1], &[0]), &["indptr[0] is 1"]);
    says(lu(&[0, 2, 1, 2], &[0, 1]), &["indptr[2] is 1"]);
    says(lu(&[0, -1, 1], &[0]), &["indptr[1] is -1"]);
    says(lu(&[0, 1, 1], &[0, 1]), &["indptr[2] is 1", "number of indices (2)"]);
    says(lu(&[0, 1, 9], &[0, 1]), &["indptr[2] is 9"]);
    says(lu(&[0, 1, 2], &[0, 2]), &["indices[1] is 2"]);
    says(lu(&[0, 1, 2], &[0, -1]), &["indices[1] is -1"]);
    says(lu(&[0, 2, 3], &[1, 1, 0]), &["(1, 0) is listed twice"]);
    let ldlt =
        SparseFactor::new(&[0, 1, 3], &[0, 0, 1], Layout::Csc, Kind::Ldlt, Precision::Double);
    says(ldlt, &["(0, 1) has no counterpart (1, 0)", "\"lu\""]);
    let ldlt = SparseFactor::new(
        &[0, 3, 5, 6],
        &[0, 1, 2, 0, 1, 2],
        Layout::Csc,
        Kind::Ldlt,
        Precision::Double,
    );
    says(ldlt, &["(2, 0) has no counterpart (0, 2)"]);
    says("qr".parse::<Kind>(), &["kind \"qr\" is unknown", "lu, ldlt or llt"]);
    says("coo".parse::<Layout>(), &["layout \"coo\" is unknown", "csc or csr"]);
}

#[test]
fn bad_values_are_named_and_leave_no_factor() {
    let mut factor =
        SparseFactor::new(&[0, 2, 4], &[0, 1, 0, 1], Layout::Csc, Kind::Ldlt, Precision::Double)
            .unwrap();
    says(factor.solve(&[1.0, 1.0], 1), &["call factorise first"]);
    factor.factorise(&[2.0, 1.0, 1.0, 2.0]).unwrap();
    assert!(factor.probe_error().unwrap() < 1e-14);
    says(factor.solve(&[1.0], 1), &["rhs has 1 values where 2"]);
    says(factor.solve(&[1.0, f64::NAN], 1), &["rhs[1] is NaN"]);
    says(factor.factorise(&[2.0]), &["data has 1 values where 4"]);
    says(factor.solve(&[1.0, 1.0], 1), &["call factorise first"]);
    says(factor.factorise(&[2.0, 1.0, f64::INFINITY, 2.0]), &["data[2] is inf"]);
    says(
        factor.factorise(&[2.0, 1.0, 1.1, 2.0]),
        &["entry (1, 0) is 1 but its counterpart is 1.1", "symmetric part"],
    );
    says(factor.factorise(&[1.0, 1.0, 1.0, 1.0]), &["singular", "held?"]);
    assert!(factor.probe_error().is_none());
}
