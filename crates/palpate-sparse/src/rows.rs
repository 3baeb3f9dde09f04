//! The whole matrix by compressed rows, for products with it.
#![expect(
    clippy::inline_always,
    reason = "only what is inlined into a dispatch is compiled for the processor at hand"
)]

use std::ops::Range;

use pulp::Arch;

use crate::error::InputError;
use crate::triangular_solve::Number;

/// Rows that share their columns are multiplied together.
pub(crate) const PANEL: usize = 3;

/// Every entry of a square matrix, in the order of the caller's data.
pub(crate) struct Rows {
    starts: Vec<usize>,
    columns: Vec<u32>,
    /// Rows from here on that have the same columns: 3, or 1.
    panels: Vec<(usize, usize)>,
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
        Ok(Self { starts, columns, panels })
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

    /// First row and height of all panels.
    pub(crate) fn panels(&self) -> &[(usize, usize)] {
        &self.panels
    }

    /// Panels with an entry in one of some columns.
    pub(crate) fn panels_at(&self, wanted: impl Fn(usize) -> bool) -> Vec<(usize, usize)> {
        let reaches = |&&(row, _): &&(usize, usize)| {
            self.columns[self.range(row)].iter().any(|&column| wanted(column as usize))
        };
        self.panels.iter().filter(reaches).copied().collect()
    }

    /// A x.
    pub(crate) fn multiply<T: Number>(&self, values: &[T], x: &[T], out: &mut [T]) {
        self.multiply_panels(&self.panels, values, x, out);
    }

    /// A x in the rows of some panels; the others stay as they are.
    pub(crate) fn multiply_panels<T: Number>(
        &self,
        panels: &[(usize, usize)],
        values: &[T],
        x: &[T],
        out: &mut [T],
    ) {
        Arch::new().dispatch(|| {
            for &(row, height) in panels {
                let range = self.range(row);
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
