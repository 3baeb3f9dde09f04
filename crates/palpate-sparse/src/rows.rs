//! The whole matrix by rows, for products with it.
#![expect(
    clippy::inline_always,
    reason = "only what is inlined into a dispatch is compiled for the processor at hand"
)]

use std::borrow::Cow;

use pulp::Arch;

use crate::graph::narrow;
use crate::sweep::Number;

/// Rows that share their columns are multiplied together.
const PANEL: usize = 3;

/// Every entry of a square matrix by rows, whatever the caller's layout.
#[derive(Debug)]
pub(crate) struct Rows {
    starts: Vec<usize>,
    columns: Vec<u32>,
    /// Place of every value in the caller's data; `None` where they are in this order already.
    places: Option<Vec<u32>>,
    /// Rows from here on that have the same columns: 3, or 1.
    panels: Vec<(usize, usize)>,
}

impl Rows {
    /// Takes entries (row, column, place) in any order.
    pub(crate) fn new(n: usize, entries: impl Iterator<Item = (usize, usize, usize)>) -> Self {
        let mut sorted: Vec<(usize, usize, usize)> = entries.collect();
        sorted.sort_unstable();
        let starts: Vec<usize> = (0..=n).map(|row| sorted.partition_point(|e| e.0 < row)).collect();
        let columns: Vec<u32> = sorted.iter().map(|e| narrow(e.1)).collect();
        let in_order = sorted.iter().enumerate().all(|(k, e)| k == e.2);
        let places = (!in_order).then(|| sorted.iter().map(|e| narrow(e.2)).collect());
        let of = |row: usize| &columns[starts[row]..starts[row + 1]];
        let mut panels = Vec::new();
        let mut row = 0;
        while row < n {
            let same = row + PANEL <= n && (row + 1..row + PANEL).all(|next| of(next) == of(row));
            let height = if same { PANEL } else { 1 };
            panels.push((row, height));
            row += height;
        }
        Self { starts, columns, places, panels }
    }

    /// Values in the order of the rows.
    pub(crate) fn gather<'a>(&self, data: &'a [f64]) -> Cow<'a, [f64]> {
        match &self.places {
            None => Cow::Borrowed(data),
            Some(places) => places.iter().map(|&place| data[place as usize]).collect(),
        }
    }

    /// A x, with values from [`Self::gather`].
    pub(crate) fn multiply<T: Number>(&self, values: &[T], x: &[T], out: &mut [T]) {
        Arch::new().dispatch(|| {
            for &(row, height) in &self.panels {
                let range = self.starts[row]..self.starts[row + 1];
                let (columns, values) = (&self.columns[range.clone()], &values[range.start..]);
                let out = &mut out[row..row + height];
                if height == PANEL {
                    out.copy_from_slice(&three(columns, values, x));
                } else {
                    out[0] = one(columns, values, x);
                }
            }
        });
    }
}

/// Products of three rows of values, one after the other, that share their columns.
#[inline(always)]
fn three<T: Number>(columns: &[u32], values: &[T], x: &[T]) -> [T; PANEL] {
    let (first, rest) = values.split_at(columns.len());
    let (second, rest) = rest.split_at(columns.len());
    let mut sums = [T::default(); PANEL];
    for (((&column, a), b), c) in columns.iter().zip(first).zip(second).zip(rest) {
        let x = x[column as usize];
        sums[0] += *a * x;
        sums[1] += *b * x;
        sums[2] += *c * x;
    }
    sums
}

#[inline(always)]
fn one<T: Number>(columns: &[u32], values: &[T], x: &[T]) -> T {
    let mut sum = T::default();
    for (&column, a) in columns.iter().zip(values) {
        sum += *a * x[column as usize];
    }
    sum
}
