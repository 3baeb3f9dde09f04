//! Where the entries of a symmetric matrix are, and their values.

use std::ops::Range;

use faer::sparse::{SymbolicSparseColMat, SymbolicSparseColMatRef};

use crate::error::InputError;
use crate::graph::narrow;
use crate::precision::power_of_two;
use crate::rows::Rows;
use crate::triangular_solve::Number;

/// Largest difference between an entry and its counterpart, as a share of the largest entry, that
/// counts as the round-off of an assembly.
const SYMMETRIC: f64 = 1e-9;

/// A square pattern by compressed rows, of which a factor takes the lower triangle by columns.
pub(crate) struct Pattern {
    columns: SymbolicSparseColMat<u32>,
    /// Place in the caller's data of every entry of the triangle, and of its counterpart.
    places: Vec<(usize, usize)>,
    rows: Rows,
}

impl Pattern {
    /// Reads the whole of a symmetric pattern, with indices that rise within a row.
    pub(crate) fn new(indptr: &[i32], indices: &[i32]) -> Result<Self, InputError> {
        let rows = Rows::new(indptr, indices)?;
        let n = rows.n();
        let (mut starts, mut below, mut places) = (vec![0], Vec::new(), Vec::new());
        for row in 0..n {
            for place in rows.range(row) {
                let column = rows.column(place);
                let counterpart =
                    rows.place(column, row).ok_or(InputError::OneSided { row, column })?;
                if column >= row {
                    below.push(narrow(column));
                    places.push((counterpart, place));
                }
            }
            starts.push(narrow(below.len()));
        }
        let columns = SymbolicSparseColMat::new_checked(n, n, starts, None, below);
        Ok(Self { columns, places, rows })
    }

    /// Rows of the matrix.
    pub(crate) fn n(&self) -> usize {
        self.rows.n()
    }

    /// Length of the caller's data.
    pub(crate) fn n_data(&self) -> usize {
        self.rows.n_data()
    }

    /// The whole matrix by rows.
    pub(crate) fn rows(&self) -> &Rows {
        &self.rows
    }

    /// The lower triangle as faer takes it.
    pub(crate) fn columns(&self) -> SymbolicSparseColMatRef<'_, u32> {
        self.columns.as_ref()
    }

    /// Row and column of every entry of the lower triangle.
    pub(crate) fn entries(&self) -> impl Iterator<Item = (usize, usize)> + Clone + '_ {
        let row = |k: usize| self.columns.row_idx()[k] as usize;
        (0..self.n()).flat_map(move |j| self.column(j).map(move |k| (row(k), j)))
    }

    /// Values of the lower triangle.
    pub(crate) fn gather(&self, data: &[f64]) -> Result<Vec<f64>, InputError> {
        finite("data", data, self.n_data())?;
        let values: Vec<f64> = self.places.iter().map(|&(place, _)| data[place]).collect();
        let largest = values.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let differs = |&&(place, counterpart): &&(usize, usize)| {
            let difference: f64 = data[place] - data[counterpart];
            difference.abs() > SYMMETRIC * largest
        };
        if let Some(&(place, counterpart)) = self.places.iter().find(differs) {
            let (row, column) = (self.rows.column(counterpart), self.rows.column(place));
            let (value, counterpart) = (data[place], data[counterpart]);
            return Err(InputError::Unsymmetric { row, column, value, counterpart });
        }
        Ok(values)
    }

    /// A x, with values from [`Self::gather`].
    pub(crate) fn multiply(&self, values: &[f64], x: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.n()];
        for j in 0..self.n() {
            let mut sum = 0.0;
            for k in self.column(j) {
                let i = self.columns.row_idx()[k] as usize;
                out[i] += values[k] * x[j];
                if i != j {
                    sum += values[k] * x[i];
                }
            }
            out[j] += sum;
        }
        out
    }

    /// Factors s by which sᵢ aᵢⱼ sⱼ has a diagonal near 1: powers of two. A row without a diagonal
    /// is scaled by its largest entry.
    pub(crate) fn scales(&self, values: &[f64]) -> Vec<f64> {
        let mut diagonal = vec![0.0; self.n()];
        let mut largest = vec![0.0_f64; self.n()];
        for ((i, j), value) in self.entries().zip(values) {
            let size = value.abs();
            largest[i] = largest[i].max(size);
            largest[j] = largest[j].max(size);
            if i == j {
                diagonal[j] = size;
            }
        }
        let weak = f64::from(f32::EPSILON);
        let sizes = diagonal.into_iter().zip(largest);
        sizes.map(|(d, most)| 1.0 / power_of_two(d.max(weak * most).sqrt())).collect()
    }

    /// The values sᵢ aᵢⱼ sⱼ in single precision.
    pub(crate) fn scaled(&self, values: &[f64], scales: &[f64]) -> Vec<f32> {
        let entries = self.entries().zip(values);
        entries.map(|((i, j), value)| f32::rounded(value * scales[i] * scales[j])).collect()
    }

    fn column(&self, j: usize) -> Range<usize> {
        self.columns.col_range(j)
    }
}

/// Checks that `values` are finite and as many as `expected`.
pub(crate) fn finite(
    array: &'static str,
    values: &[f64],
    expected: usize,
) -> Result<(), InputError> {
    as_many(array, values, expected)?;
    // All of them first: without a way out the loop takes several at a time.
    if values.iter().fold(true, |finite, v| finite & v.is_finite()) {
        return Ok(());
    }
    match values.iter().position(|v| !v.is_finite()) {
        Some(index) => Err(InputError::NotFinite { array, index, value: values[index] }),
        None => Ok(()),
    }
}

/// Checks that there are as many `values` as `expected`.
pub(crate) fn as_many(
    array: &'static str,
    values: &[f64],
    expected: usize,
) -> Result<(), InputError> {
    if values.len() == expected {
        return Ok(());
    }
    Err(InputError::Length { array, length: values.len(), expected })
}
