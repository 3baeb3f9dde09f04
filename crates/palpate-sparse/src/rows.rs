//! The whole matrix by compressed rows, for products with it.
#![expect(
    clippy::inline_always,
    reason = "only what is inlined into a dispatch is compiled for the processor at hand"
)]

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use crate::error::InputError;
use crate::panels::{LANES, summed};
use crate::triangular_solve::Number;

/// Rows that share their columns are multiplied together.
pub(crate) const PANEL: usize = 3;

/// Every entry of a square matrix, in the order of the caller's data.
pub(crate) struct Rows {
    starts: Vec<usize>,
    columns: Vec<u32>,
    /// Rows from here on that have the same columns: 3, or 1.
    panels: Vec<(usize, usize)>,
    /// First of three columns in sequence, if all are such in panels of three rows.
    triples: Option<Vec<u32>>,
    /// Place of the entry on the diagonal of each row.
    diagonals: Vec<Option<usize>>,
}

impl Rows {
    pub(crate) fn new(indptr: &[i32], indices: &[i32]) -> Result<Self, InputError> {
        let starts = pointers(indptr, indices.len())?;
        let n = starts.len() - 1;
        let columns = columns(&starts, indices)?;
        let of = |row: usize| &columns[starts[row]..starts[row + 1]];
        let mut panels = Vec::new();
        let mut row = 0;
        while row < n {
            let same = row + PANEL <= n && (row + 1..row + PANEL).all(|next| of(next) == of(row));
            let height = if same { PANEL } else { 1 };
            panels.push((row, height));
            row += height;
        }
        let whole = panels.iter().all(|&(_, height)| height == PANEL);
        let triples = if whole { triples(&starts, &columns) } else { None };
        let mut rows = Self { starts, columns, panels, triples, diagonals: Vec::new() };
        rows.diagonals = (0..n).map(|row| rows.place(row, row)).collect();
        Ok(rows)
    }

    pub(crate) fn n(&self) -> usize {
        self.starts.len() - 1
    }

    pub(crate) fn n_data(&self) -> usize {
        self.columns.len()
    }

    /// Places of a row.
    pub(crate) fn range(&self, row: usize) -> Range<usize> {
        self.starts[row]..self.starts[row + 1]
    }

    /// Column of an entry.
    pub(crate) fn column(&self, place: usize) -> usize {
        self.columns[place] as usize
    }

    /// Place of an entry, if there is one.
    pub(crate) fn place(&self, row: usize, column: usize) -> Option<usize> {
        let found = self.columns[self.range(row)].binary_search_by_key(&column, |&c| c as usize);
        found.ok().map(|k| self.starts[row] + k)
    }

    /// Place of the entry on the diagonal of a row, if there is one.
    pub(crate) fn diagonal(&self, row: usize) -> Option<usize> {
        self.diagonals[row]
    }

    /// First row and height of all panels.
    pub(crate) fn panels(&self) -> &[(usize, usize)] {
        &self.panels
    }

    /// Panels with an entry in a column of some panels' rows, of a symmetric pattern.
    pub(crate) fn panels_around(&self, panels: &[(usize, usize)]) -> Vec<(usize, usize)> {
        let mut reached = vec![false; self.n()];
        for &(row, height) in panels {
            let places = self.starts[row]..self.starts[row + height];
            self.columns[places].iter().for_each(|&column| reached[column as usize] = true);
        }
        let is_reached =
            |&&(row, height): &&(usize, usize)| reached[row..row + height].contains(&true);
        self.panels.iter().filter(is_reached).copied().collect()
    }

    /// A x for vectors (m, n).
    pub(crate) fn multiply<T: Number>(&self, values: &[T], x: &[T], out: &mut [T]) {
        self.multiply_panels(&self.panels, values, x, out);
    }

    /// A x for vectors (m, n) in the rows of some panels; the others stay as they are.
    pub(crate) fn multiply_panels<T: Number>(
        &self,
        panels: &[(usize, usize)],
        values: &[T],
        x: &[T],
        out: &mut [T],
    ) {
        Arch::new().dispatch(Products { rows: self, panels, values, x, out });
    }
}

/// Products of panels with vectors (m, n), compiled for this processor.
struct Products<'a, T> {
    rows: &'a Rows,
    panels: &'a [(usize, usize)],
    values: &'a [T],
    x: &'a [T],
    out: &'a mut [T],
}

impl<T: Number> WithSimd for Products<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { rows, panels, values, x, out } = self;
        let n = rows.n();
        let mut taken = Vec::new();
        for &(row, height) in panels {
            let range = rows.range(row);
            let (values, length) = (&values[range.start..], range.len());
            taken.resize(length.next_multiple_of(LANES), T::default());
            for (x, out) in x.chunks_exact(n).zip(out.chunks_exact_mut(n)) {
                // One after the other first, so that the products below are of whole vectors.
                if let Some(triples) = &rows.triples {
                    let triples = &triples[range.start / (PANEL * PANEL)..];
                    for (taken, &first) in taken[..length].chunks_exact_mut(PANEL).zip(triples) {
                        taken.copy_from_slice(&x[first as usize..first as usize + PANEL]);
                    }
                } else {
                    for (taken, &column) in taken.iter_mut().zip(&rows.columns[range.clone()]) {
                        *taken = x[column as usize];
                    }
                }
                taken[length..].fill(T::default());
                if height == PANEL {
                    let products = dots::<T, S, PANEL>(simd, values, length, &taken);
                    out[row..row + PANEL].copy_from_slice(&products);
                } else {
                    out[row] = dots::<T, S, 1>(simd, values, length, &taken)[0];
                }
            }
        }
    }
}

/// Products of `N` rows of values, each of a `length` and right after the one before it, with a vector
/// that zeros extend to whole tiles.
#[inline(always)]
fn dots<T: Number, S: Simd, const N: usize>(
    simd: S,
    values: &[T],
    length: usize,
    x: &[T],
) -> [T; N] {
    let mut sums = [[T::splat(simd, T::default()); LANES]; N];
    let mut padded = [T::default(); LANES];
    for (k, x) in x.chunks_exact(LANES).enumerate() {
        let x = T::vectors::<S>(x);
        for (i, sums) in sums.iter_mut().enumerate() {
            let row = &values[i * length + k * LANES..];
            // Beyond its end are the numbers of the next row, times zero, or nothing.
            let tile = row.get(..LANES).unwrap_or_else(|| {
                padded[..row.len()].copy_from_slice(row);
                &padded
            });
            for ((sum, value), x) in sums.iter_mut().zip(T::vectors::<S>(tile)).zip(x) {
                *sum = T::plus_product(simd, *sum, *value, *x);
            }
        }
    }
    sums.map(|sums| summed::<T, S>(&sums))
}

/// The pointers, checked to delimit `n_indices` indices.
fn pointers(indptr: &[i32], n_indices: usize) -> Result<Vec<usize>, InputError> {
    if indptr.len() < 2 {
        return Err(InputError::NoRows { length: indptr.len() });
    }
    let mut starts = Vec::with_capacity(indptr.len());
    let mut least = 0;
    for (index, &value) in indptr.iter().enumerate() {
        let most = if index == 0 { 0 } else { n_indices };
        least = if index + 1 == indptr.len() { n_indices } else { least };
        let start = usize::try_from(value)
            .ok()
            .filter(|start| (least..=most).contains(start))
            .ok_or(InputError::Pointer { index, value, n_indices })?;
        starts.push(start);
        least = start;
    }
    Ok(starts)
}

/// The first of every three columns of every third row, if three are in sequence everywhere.
fn triples(starts: &[usize], columns: &[u32]) -> Option<Vec<u32>> {
    let panels = starts.windows(2).step_by(PANEL).map(|pair| &columns[pair[0]..pair[1]]);
    let mut firsts = Vec::with_capacity(columns.len() / (PANEL * PANEL));
    for columns in panels {
        for triple in columns.chunks(PANEL) {
            if triple.len() < PANEL || triple[2] != triple[0] + 2 {
                return None;
            }
            firsts.push(triple[0]);
        }
    }
    Some(firsts)
}

/// The columns, checked to be in the matrix and to increase within a row.
fn columns(starts: &[usize], indices: &[i32]) -> Result<Vec<u32>, InputError> {
    let n = starts.len() - 1;
    let column = |(index, &value): (usize, &i32)| {
        let inside = u32::try_from(value).ok().filter(|&column| (column as usize) < n);
        inside.ok_or(InputError::Index { index, value, n })
    };
    let columns: Vec<u32> = indices.iter().enumerate().map(column).collect::<Result<_, _>>()?;
    for (row, range) in starts.windows(2).map(|pair| pair[0]..pair[1]).enumerate() {
        if let Some(k) = columns[range.clone()].windows(2).position(|pair| pair[0] >= pair[1]) {
            return Err(InputError::Unsorted { row, index: range.start + k + 1 });
        }
    }
    Ok(columns)
}
