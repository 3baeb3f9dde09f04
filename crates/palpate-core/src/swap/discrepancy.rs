//! CD² and its change.

use super::{Room, Swap, Swappable, sum3};
use crate::design::Columns;
use crate::real;

/// The squared centred L2 discrepancy.
pub(crate) struct Discrepancy;

/// 1 + ½|a| + ½|b| − ½|a − b|, which is 1 + min(|a|, |b|) on one side of the centre and 1 across it.
#[derive(Clone, Copy)]
struct Shared {
    sign: f64,
    size: f64,
}

impl Shared {
    fn with(a: f64) -> Self {
        Self { sign: if a < 0.0 { -1.0 } else { 1.0 }, size: a.abs() }
    }

    #[inline]
    fn and(self, b: f64) -> f64 {
        let along = self.sign * b;
        let along = if along > 0.0 { along } else { 0.0 };
        1.0 + if along < self.size { along } else { self.size }
    }
}

/// 1 + ½|a| − ½a²: the term of one value.
fn alone(a: f64) -> f64 {
    1.0 + 0.5 * a.abs() - 0.5 * a * a
}

impl Swappable for Discrepancy {
    fn value(&self, design: &Columns) -> f64 {
        let (n, d) = (design.n, design.d);
        let mut products = vec![0.0; n];
        let (mut of_rows, mut of_pairs, mut whole) = (0.0, 0.0, 1.0);
        for i in 0..n {
            let mut of_row = 1.0;
            products.fill(1.0);
            for k in 0..d {
                let column = design.column(k);
                let shared = Shared::with(column[i]);
                of_row *= alone(column[i]);
                products.iter_mut().zip(column).for_each(|(p, b)| *p *= shared.and(*b));
            }
            of_rows += of_row;
            of_pairs += sum3(&products, &products, &products, |p, _, _| p);
        }
        (0..d).for_each(|_| whole *= 13.0 / 12.0);
        whole - 2.0 / real(n) * of_rows + of_pairs / (real(n) * real(n))
    }

    /// Only products with row i or j change, and in them only the factor of column k. Row l gives
    /// (Q_il − Q_jl)(g_jl − g_il), where g is that factor and Q the product of all others; the
    /// product of i with j stays.
    fn change(&self, design: &Columns, Swap { k, i, j }: Swap, room: &mut Room) -> f64 {
        let (of_i, of_j) = (&mut room.of_i[..], &mut room.of_j[..]);
        let column = design.column(k);
        let (old, new) = (Shared::with(column[i]), Shared::with(column[j]));
        for ((p, q), b) in of_i.iter_mut().zip(&mut *of_j).zip(column) {
            *p = new.and(*b) - old.and(*b);
            *q = *p;
        }
        let (mut alone_i, mut alone_j, mut self_i, mut self_j) = (1.0, 1.0, 1.0, 1.0);
        for m in (0..design.d).filter(|m| *m != k) {
            let column = design.column(m);
            let (a, b) = (Shared::with(column[i]), Shared::with(column[j]));
            for ((p, q), c) in of_i.iter_mut().zip(&mut *of_j).zip(column) {
                *p *= a.and(*c);
                *q *= b.and(*c);
            }
            alone_i *= alone(column[i]);
            alone_j *= alone(column[j]);
            self_i *= 1.0 + a.size;
            self_j *= 1.0 + b.size;
        }
        for l in [i, j] {
            (of_i[l], of_j[l]) = (0.0, 0.0);
        }
        let of_pairs = 2.0 * sum3(of_i, of_j, of_j, |p, q, _| p - q)
            + (self_i - self_j) * (new.size - old.size);
        let of_rows = (alone_i - alone_j) * (alone(column[j]) - alone(column[i]));
        of_pairs / (real(design.n) * real(design.n)) - 2.0 / real(design.n) * of_rows
    }
}
