//! A sweep over the rows that changed since the factor was made, ahead of the factor.
//!
//! Between two tangents most rows stay nearly as they are; where points begin or cease to touch or to
//! slide, a few change by the stiffness of the contact. One symmetric Gauss–Seidel sweep over these,
//! with the matrix at hand, and the factor for the rest: z = y + M⁻¹ (v − A y), y from the sweep. A third
//! of the steps of GMRES is left of those with an older factor alone.
#![expect(
    clippy::inline_always,
    reason = "only what is inlined into a dispatch is compiled for the processor at hand"
)]

use pulp::Arch;

use crate::graph::narrow;
use crate::rows::{PANEL, Rows};
use crate::triangular_solve::Number;

/// Change of a row's largest entry, as a share of its diagonal, from which it takes part.
const CHANGED: f64 = 0.1;

/// Columns of up to three rows, or as many numbers.
type Column<T> = [T; PANEL];

/// Rows that changed, with the entries between them.
pub(crate) struct Smoother<T> {
    blocks: Vec<Block<T>>,
    /// Entries between the rows, by column: its place among the rows, and its numbers.
    entries: Vec<(u32, Column<T>)>,
    /// Unknown of every row.
    unknowns: Vec<u32>,
    /// Panels of the whole matrix with an entry in these columns.
    reach: Vec<(usize, usize)>,
    swept: Vec<T>,
}

/// Rows that share their columns.
struct Block<T> {
    /// First of its rows among those that changed.
    first: usize,
    height: usize,
    /// Where the entries before, and those after, the diagonal block are.
    before: (usize, usize),
    after: (usize, usize),
    inverse: [Column<T>; PANEL],
}

impl<T: Number> Smoother<T> {
    /// The rows in which `data` differs from the `factored` matrix; `values` are `data` as the cycle
    /// has them.
    pub(crate) fn new(rows: &Rows, data: &[f64], factored: &[f64], values: &[T]) -> Self {
        let changed = changed(rows, data, factored);
        let mut places = vec![u32::MAX; rows.n()];
        let mut unknowns = Vec::new();
        for &(row, height) in &changed {
            for (unknown, place) in places.iter_mut().enumerate().skip(row).take(height) {
                *place = narrow(unknowns.len());
                unknowns.push(narrow(unknown));
            }
        }
        let mut smoother = Self {
            blocks: Vec::with_capacity(changed.len()),
            entries: Vec::new(),
            swept: vec![T::default(); unknowns.len()],
            reach: Vec::new(),
            unknowns,
        };
        if changed.is_empty() {
            return smoother;
        }
        smoother.reach = rows.panels_at(|column| places[column] != u32::MAX);
        let mut first = 0;
        for (row, height) in changed {
            smoother.take(rows, &places, values, row, first, height);
            first += height;
        }
        smoother
    }

    fn take(
        &mut self,
        rows: &Rows,
        places: &[u32],
        values: &[T],
        row: usize,
        first: usize,
        height: usize,
    ) {
        let range = rows.range(row);
        let width = range.len();
        let mut own = [[T::default(); PANEL]; PANEL];
        (height..PANEL).for_each(|k| own[k][k] = T::ONE);
        let start = self.entries.len();
        let mut middle = start;
        for k in 0..width {
            let place = places[rows.column(range.start + k)];
            if place == u32::MAX {
                continue;
            }
            let mut column = [T::default(); PANEL];
            for (i, entry) in column.iter_mut().enumerate().take(height) {
                *entry = values[range.start + i * width + k];
            }
            match (place as usize).checked_sub(first) {
                Some(inside) if inside < height => {
                    column.iter().zip(&mut own).take(height).for_each(|(c, o)| o[inside] = *c);
                }
                before => {
                    self.entries.push((place, column));
                    middle += usize::from(before.is_none());
                }
            }
        }
        self.blocks.push(Block {
            first,
            height,
            before: (start, middle),
            after: (middle, self.entries.len()),
            inverse: inverse(&own),
        });
    }

    /// Replaces v by v − A y, and returns whether there is a y, which [`Self::add`] gives.
    pub(crate) fn sweep(&mut self, rows: &Rows, values: &[T], v: &[T], work: &mut Work<T>) -> bool {
        if self.blocks.is_empty() {
            return false;
        }
        for (y, &unknown) in self.swept.iter_mut().zip(&self.unknowns) {
            *y = v[unknown as usize];
        }
        let Self { blocks, entries, swept, .. } = self;
        Arch::new().dispatch(|| gauss_seidel(blocks, entries, swept));
        for (y, &unknown) in self.swept.iter().zip(&self.unknowns) {
            work.swept[unknown as usize] = *y;
        }
        rows.multiply_panels(&self.reach, values, &work.swept, &mut work.image);
        work.left.copy_from_slice(v);
        for &(row, height) in &self.reach {
            for k in row..row + height {
                work.left[k] -= work.image[k];
            }
        }
        true
    }

    /// Adds y to z.
    pub(crate) fn add(&self, z: &mut [T]) {
        for (y, &unknown) in self.swept.iter().zip(&self.unknowns) {
            z[unknown as usize] += *y;
        }
    }
}

/// Vectors of all unknowns for a [`Smoother`].
pub(crate) struct Work<T> {
    /// y, zero elsewhere.
    swept: Vec<T>,
    /// A y, where it is not zero.
    image: Vec<T>,
    /// v − A y.
    pub(crate) left: Vec<T>,
}

impl<T: Number> Work<T> {
    pub(crate) fn new(n: usize) -> Self {
        let zero = vec![T::default(); n];
        Self { swept: zero.clone(), image: zero.clone(), left: zero }
    }
}

/// Panels with a row whose entries differ.
fn changed(rows: &Rows, data: &[f64], factored: &[f64]) -> Vec<(usize, usize)> {
    let differs = |row: usize| {
        let range = rows.range(row);
        let pairs = data[range.clone()].iter().zip(&factored[range]);
        let most = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        most > CHANGED * rows.place(row, row).map_or(0.0, |place| data[place].abs())
    };
    let panels = rows.panels().iter();
    panels.filter(|&&(row, height)| (row..row + height).any(differs)).copied().collect()
}

/// y = (D + U)⁻¹ D (D + L)⁻¹ v, in place.
#[inline(always)]
fn gauss_seidel<T: Number>(blocks: &[Block<T>], entries: &[(u32, Column<T>)], y: &mut [T]) {
    for block in blocks {
        let sums = products(&entries[block.before.0..block.before.1], y);
        let own = block.first..block.first + block.height;
        let mut rest = [T::default(); PANEL];
        for ((rest, v), sum) in rest.iter_mut().zip(&y[own.clone()]).zip(sums) {
            *rest = *v - sum;
        }
        y[own].copy_from_slice(&times(&block.inverse, rest)[..block.height]);
    }
    for block in blocks.iter().rev() {
        let sums = products(&entries[block.after.0..block.after.1], y);
        let change = times(&block.inverse, sums);
        for (y, change) in y[block.first..block.first + block.height].iter_mut().zip(change) {
            *y -= change;
        }
    }
}

#[inline(always)]
fn products<T: Number>(entries: &[(u32, Column<T>)], y: &[T]) -> Column<T> {
    let mut sums = [T::default(); PANEL];
    for (place, column) in entries {
        let y = y[*place as usize];
        for (sum, entry) in sums.iter_mut().zip(column) {
            *sum += *entry * y;
        }
    }
    sums
}

#[inline(always)]
fn times<T: Number>(matrix: &[Column<T>; PANEL], x: Column<T>) -> Column<T> {
    let mut result = [T::default(); PANEL];
    for (r, row) in result.iter_mut().zip(matrix) {
        *r = row[0] * x[0] + row[1] * x[1] + row[2] * x[2];
    }
    result
}

/// The inverse of three rows; zero where there is none.
fn inverse<T: Number>(m: &[Column<T>; PANEL]) -> [Column<T>; PANEL] {
    let minor = |i: usize, j: usize| {
        let (rows, columns) = (others(i), others(j));
        let entry = |row: usize, column: usize| m[rows[row]][columns[column]];
        entry(0, 0) * entry(1, 1) - entry(0, 1) * entry(1, 0)
    };
    let determinant = m[0][0] * minor(0, 0) + m[0][1] * minor(0, 1) + m[0][2] * minor(0, 2);
    let reciprocal = T::ONE / determinant;
    let mut result = [[T::default(); PANEL]; PANEL];
    if reciprocal.widened().is_finite() {
        for (i, row) in result.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry = minor(j, i) * reciprocal;
            }
        }
    }
    result
}

/// The two indices after one, so that the minors have their signs.
fn others(i: usize) -> [usize; 2] {
    [(i + 1) % PANEL, (i + 2) % PANEL]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn transposed(m: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
        std::array::from_fn(|i| std::array::from_fn(|j| m[j][i]))
    }

    #[test]
    fn inverses_are_inverses() {
        let m = [[4.0, 1.0, -0.5], [0.25, 3.0, 1.0], [0.0, -2.0, 5.0]];
        let found = inverse(&m);
        for (i, row) in found.iter().enumerate() {
            let products = times(&transposed(&m), *row);
            for (j, entry) in products.into_iter().enumerate() {
                assert!((entry - f64::from(u8::from(i == j))).abs() < 1e-14);
            }
        }
        assert_eq!(inverse(&[[1.0; 3]; 3]), [[0.0; 3]; 3]);
    }
}
