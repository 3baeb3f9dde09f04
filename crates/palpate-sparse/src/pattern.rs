//! Where the entries of a matrix are, whatever the order in which their values arrive.

use std::ops::Range;
use std::str::FromStr;

use faer::sparse::{SymbolicSparseColMat, SymbolicSparseColMatRef};

use crate::error::{Error, InputError};
use crate::precision::power_of_two;
use crate::rows::Rows;
use crate::sweep::Number;

/// Largest difference between an entry and its counterpart, as a share of the largest entry, that
/// counts as the round-off of an assembly.
pub const SYMMETRIC: f64 = 1e-9;

/// What `indptr` counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Layout {
    /// Compressed columns: `indices` are rows.
    #[default]
    Csc,
    /// Compressed rows: `indices` are columns.
    Csr,
}

impl FromStr for Layout {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        match name {
            "csc" => Ok(Self::Csc),
            "csr" => Ok(Self::Csr),
            _ => {
                let (name, choices) = (name.to_owned(), "csc or csr");
                Err(InputError::Unknown { what: "layout", name, choices }.into())
            }
        }
    }
}

/// One entry of the pattern: sorted by column, then row.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    column: usize,
    row: usize,
    /// Place of its value in the caller's data.
    place: usize,
}

/// A square pattern in compressed columns, with the way there from the caller's layout.
#[derive(Debug)]
pub struct Pattern {
    columns: SymbolicSparseColMat<u32>,
    /// Place in the caller's data of every entry kept.
    places: Vec<usize>,
    /// The whole matrix, whatever is kept of it.
    rows: Rows,
    /// Entries kept whose counterpart was given too: (entry, place of the counterpart).
    counterparts: Vec<(usize, usize)>,
    n_data: usize,
    symmetric: bool,
}

impl Pattern {
    /// Reads a pattern; for a `symmetric` matrix only its lower triangle is kept.
    ///
    /// # Errors
    /// [`InputError`] if pointers or indices do not describe a square matrix, an entry is listed
    /// twice, or a symmetric pattern has entries above the diagonal without a counterpart below.
    ///
    /// # Examples
    /// ```
    /// use palpate_sparse::pattern::{Layout, Pattern};
    /// let pattern = Pattern::new(&[0, 1, 3], &[0, 0, 1], Layout::Csr, false)?;
    /// let values = pattern.gather(&[2.0, 5.0, 3.0])?;
    /// let mut product = [0.0; 2];
    /// pattern.multiply(&values, &[1.0, 10.0], &mut product);
    /// assert_eq!(product, [2.0, 35.0]);
    /// # Ok::<(), palpate_sparse::Error>(())
    /// ```
    pub fn new<I: Copy + Into<i64>>(
        indptr: &[I],
        indices: &[I],
        layout: Layout,
        symmetric: bool,
    ) -> Result<Self, InputError> {
        let mut entries = entries(indptr, indices, layout)?;
        let (n, n_data) = (indptr.len() - 1, entries.len());
        if u32::try_from(n).is_err() || u32::try_from(n_data).is_err() {
            return Err(InputError::TooLarge { n, n_entries: n_data });
        }
        entries.sort_unstable();
        if let Some(twice) = entries.windows(2).find(|e| same_place(e[0], e[1])) {
            return Err(InputError::Duplicate { row: twice[0].row, column: twice[0].column });
        }
        let alone = symmetric && entries.iter().all(|e| e.row >= e.column);
        let rows = Rows::new(n, entries.iter().flat_map(|e| whole(*e, alone)));
        let mut counterparts = Vec::new();
        if symmetric {
            let (lower, upper): (Vec<_>, Vec<_>) = entries.iter().partition(|e| e.row >= e.column);
            counterparts = pair_up(&lower, &upper)?;
            entries = lower;
        }
        let places: Vec<usize> = entries.iter().map(|e| e.place).collect();
        let columns = compress(n, &entries);
        Ok(Self { columns, places, rows, counterparts, n_data, symmetric })
    }

    /// Rows of the matrix.
    #[must_use]
    pub fn n(&self) -> usize {
        self.columns.ncols()
    }

    /// Length of the caller's data.
    #[must_use]
    pub fn n_data(&self) -> usize {
        self.n_data
    }

    /// The whole matrix by rows.
    pub(crate) fn rows(&self) -> &Rows {
        &self.rows
    }

    /// The pattern as faer takes it.
    pub(crate) fn columns(&self) -> SymbolicSparseColMatRef<'_, u32> {
        self.columns.as_ref()
    }

    /// Row and column of every entry kept.
    pub(crate) fn entries(&self) -> impl Iterator<Item = (usize, usize)> + Clone + '_ {
        let row = |k: usize| self.columns.row_idx()[k] as usize;
        (0..self.n()).flat_map(move |j| self.column(j).map(move |k| (row(k), j)))
    }

    /// Values in the order of the pattern.
    ///
    /// # Errors
    /// [`InputError`] if there is not one finite value for every entry, or a symmetric pattern gets
    /// values that differ from their counterpart by more than [`SYMMETRIC`] of the largest.
    pub fn gather(&self, data: &[f64]) -> Result<Vec<f64>, InputError> {
        finite("data", data, self.n_data)?;
        let values: Vec<f64> = self.places.iter().map(|&place| data[place]).collect();
        let largest = values.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let differs = |&&(entry, place): &&(usize, usize)| {
            let difference: f64 = values[entry] - data[place];
            difference.abs() > SYMMETRIC * largest
        };
        if let Some(&(entry, place)) = self.counterparts.iter().find(differs) {
            let (row, column) = self.position(entry);
            let (value, counterpart) = (values[entry], data[place]);
            return Err(InputError::Unsymmetric { row, column, value, counterpart });
        }
        Ok(values)
    }

    /// Adds A x to `out`, for one column x of the same length.
    pub fn multiply(&self, values: &[f64], x: &[f64], out: &mut [f64]) {
        for j in 0..self.n() {
            let mut sum = 0.0;
            for k in self.column(j) {
                let i = self.columns.row_idx()[k] as usize;
                out[i] += values[k] * x[j];
                if self.symmetric && i != j {
                    sum += values[k] * x[i];
                }
            }
            out[j] += sum;
        }
    }

    /// Factors s by which sᵢ aᵢⱼ sⱼ has a diagonal near 1: powers of two. A row without a diagonal
    /// is scaled by its largest entry.
    pub(crate) fn scales(&self, values: &[f64]) -> Vec<f64> {
        let mut diagonal = vec![0.0; self.n()];
        let mut largest = vec![0.0_f64; self.n()];
        for j in 0..self.n() {
            for k in self.column(j) {
                let (i, size) = (self.columns.row_idx()[k] as usize, values[k].abs());
                largest[i] = largest[i].max(size);
                largest[j] = largest[j].max(size);
                if i == j {
                    diagonal[j] = size;
                }
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

    /// Largest sum of magnitudes over a row of sᵢ aᵢⱼ sⱼ: its maximum norm.
    pub(crate) fn norm(&self, values: &[f64], scale: impl Fn(usize) -> f64) -> f64 {
        let scales: Vec<f64> = (0..self.n()).map(scale).collect();
        let magnitudes: Vec<f64> = values.iter().map(|v| v.abs()).collect();
        let mut sums = vec![0.0; self.n()];
        self.multiply(&magnitudes, &scales, &mut sums);
        sums.iter().zip(&scales).fold(0.0, |most, (sum, scale)| most.max(sum * scale))
    }

    fn column(&self, j: usize) -> Range<usize> {
        self.columns.col_range(j)
    }

    fn position(&self, entry: usize) -> (usize, usize) {
        let after = self.columns.col_ptr().partition_point(|&start| start as usize <= entry);
        (self.columns.row_idx()[entry] as usize, after - 1)
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

fn same_place(a: Entry, b: Entry) -> bool {
    (a.row, a.column) == (b.row, b.column)
}

/// An entry by rows, and its counterpart where a triangle stands `alone` for the whole.
fn whole(entry: Entry, alone: bool) -> impl Iterator<Item = (usize, usize, usize)> {
    let Entry { column, row, place } = entry;
    let counterpart = (alone && row != column).then_some((column, row, place));
    std::iter::once((row, column, place)).chain(counterpart)
}

/// Every entry with its place, in the caller's order.
fn entries<I: Copy + Into<i64>>(
    indptr: &[I],
    indices: &[I],
    layout: Layout,
) -> Result<Vec<Entry>, InputError> {
    let starts = pointers(indptr, indices.len())?;
    let n = starts.len() - 1;
    let mut entries = Vec::with_capacity(indices.len());
    for major in 0..n {
        let minors = starts[major]..starts[major + 1];
        for (place, &minor) in minors.clone().zip(&indices[minors]) {
            let value: i64 = minor.into();
            let minor = usize::try_from(value)
                .ok()
                .filter(|&m| m < n)
                .ok_or(InputError::Index { index: place, value, n })?;
            entries.push(match layout {
                Layout::Csc => Entry { column: major, row: minor, place },
                Layout::Csr => Entry { column: minor, row: major, place },
            });
        }
    }
    Ok(entries)
}

/// The pointers, checked to delimit `n_indices` indices.
fn pointers<I: Copy + Into<i64>>(indptr: &[I], n_indices: usize) -> Result<Vec<usize>, InputError> {
    if indptr.len() < 2 {
        return Err(InputError::NoRows { length: indptr.len() });
    }
    let mut starts = Vec::with_capacity(indptr.len());
    let mut least = 0;
    for (index, &pointer) in indptr.iter().enumerate() {
        let value: i64 = pointer.into();
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

/// Counterparts of the entries above the diagonal, which must then have one below for each.
fn pair_up(lower: &[Entry], upper: &[Entry]) -> Result<Vec<(usize, usize)>, InputError> {
    if upper.is_empty() {
        return Ok(Vec::new());
    }
    let mut paired = vec![false; lower.len()];
    let mut pairs = Vec::with_capacity(upper.len());
    for entry in upper {
        let (row, column) = (entry.row, entry.column);
        let found = lower.binary_search_by_key(&(row, column), |e| (e.column, e.row));
        let Ok(k) = found else {
            return Err(InputError::OneSided { row, column });
        };
        paired[k] = true;
        pairs.push((k, entry.place));
    }
    let alone = lower.iter().zip(&paired).find(|(e, paired)| e.row > e.column && !**paired);
    match alone {
        Some((e, _)) => Err(InputError::OneSided { row: e.row, column: e.column }),
        None => Ok(pairs),
    }
}

/// Compressed columns of sorted entries whose number fits 32 bits.
#[expect(clippy::cast_possible_truncation, reason = "rows and entries are checked to fit 32 bits")]
fn compress(n: usize, entries: &[Entry]) -> SymbolicSparseColMat<u32> {
    let starts = (0..=n).map(|j| entries.partition_point(|e| e.column < j) as u32).collect();
    let rows = entries.iter().map(|e| e.row as u32).collect();
    SymbolicSparseColMat::new_checked(n, n, starts, None, rows)
}
