//! Sweeps over the rows that changed since the factor was made, ahead of the factor.
//!
//! Between two tangents most rows stay nearly as they are; where points begin or cease to touch or to
//! slide, a few change by the stiffness of the contact. Symmetric Gauss–Seidel sweeps over these, with
//! the matrix at hand, and the factor for the rest: z = y + M⁻¹ (v − A y), y from the sweeps. A quarter of
//! the steps of GMRES is left of those with an older factor alone.
#![expect(
    clippy::inline_always,
    reason = "only what is inlined into a dispatch is compiled for the processor at hand"
)]

use pulp::{Arch, NullaryFnOnce};

use crate::graph::narrow;
use crate::rows::{PANEL, Rows};
use crate::triangular_solve::Number;

/// Change of a row's largest entry, as a share of its diagonal, from which it takes part.
const CHANGED: f64 = 0.1;

/// Sweeps forth and back. One leaves 7.6 steps of GMRES for each system of a path, two 6.1, four 5.5, but the
/// steps of Newton that follow are cut more often: more of what is left of them is smooth.
const SWEEPS: usize = 1;

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
    known: Vec<T>,
}

/// Rows that share their columns.
struct Block<T> {
    /// First of its rows among those that changed.
    first: usize,
    height: usize,
    /// Where the entries outside of the diagonal block are.
    entries: (usize, usize),
    inverse: [Column<T>; PANEL],
}

impl<T: Number> Smoother<T> {
    /// The rows in which `data` differs from the `factored` matrix; `values` are `data` as the cycle
    /// has them.
    pub(crate) fn new(rows: &Rows, data: &[f64], factored: &[f64], values: &[T]) -> Self {
        let changed = Arch::new().dispatch(Changed { rows, data, factored });
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
            swept: Vec::new(),
            known: vec![T::default(); unknowns.len()],
            reach: Vec::new(),
            unknowns,
        };
        if changed.is_empty() {
            return smoother;
        }
        smoother.reach = rows.panels_around(&changed);
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
                _ => self.entries.push((place, column)),
            }
        }
        self.blocks.push(Block {
            first,
            height,
            entries: (start, self.entries.len()),
            inverse: inverse(&own),
        });
    }

    /// y of each of some vectors v (m, n), and v − A y; whether there is a y, which
    /// [`Self::add`] gives.
    pub(crate) fn sweep(&mut self, rows: &Rows, values: &[T], v: &[T], work: &mut Work<T>) -> bool {
        if self.blocks.is_empty() {
            return false;
        }
        let (n, own) = (rows.n(), self.unknowns.len());
        work.fit(v.len());
        self.swept.resize(v.len() / n * own, T::default());
        let Self { blocks, entries, swept, known, unknowns, .. } = self;
        let spread = work.swept.chunks_exact_mut(n);
        for ((y, v), spread) in swept.chunks_exact_mut(own).zip(v.chunks_exact(n)).zip(spread) {
            for (known, &unknown) in known.iter_mut().zip(&*unknowns) {
                *known = v[unknown as usize];
            }
            Arch::new().dispatch(Sweep { blocks, entries, v: known, y });
            for (y, &unknown) in y.iter().zip(&*unknowns) {
                spread[unknown as usize] = *y;
            }
        }
        rows.multiply_panels(&self.reach, values, &work.swept, &mut work.image);
        work.left.copy_from_slice(v);
        for (left, image) in work.left.chunks_exact_mut(n).zip(work.image.chunks_exact(n)) {
            for &(row, height) in &self.reach {
                for k in row..row + height {
                    left[k] -= image[k];
                }
            }
        }
        true
    }

    /// Adds each y to its z (m, n).
    pub(crate) fn add(&self, n: usize, z: &mut [T]) {
        for (z, y) in z.chunks_exact_mut(n).zip(self.swept.chunks_exact(self.unknowns.len())) {
            for (y, &unknown) in y.iter().zip(&self.unknowns) {
                z[unknown as usize] += *y;
            }
        }
    }
}

/// Vectors (m, n) of all unknowns for a [`Smoother`].
pub(crate) struct Work<T> {
    /// y, zero elsewhere.
    swept: Vec<T>,
    /// A y, where it is not zero.
    image: Vec<T>,
    /// v − A y.
    pub(crate) left: Vec<T>,
}

impl<T: Number> Work<T> {
    pub(crate) fn new() -> Self {
        Self { swept: Vec::new(), image: Vec::new(), left: Vec::new() }
    }

    /// Gives every vector `length` numbers; y is written in the same places each time.
    fn fit(&mut self, length: usize) {
        for vector in [&mut self.swept, &mut self.image, &mut self.left] {
            vector.resize(length, T::default());
        }
    }
}

/// Finds panels with a row whose entries differ, compiled for this processor; a closure would not be.
struct Changed<'a> {
    rows: &'a Rows,
    data: &'a [f64],
    factored: &'a [f64],
}

impl NullaryFnOnce for Changed<'_> {
    type Output = Vec<(usize, usize)>;

    #[inline(always)]
    fn call(self) -> Vec<(usize, usize)> {
        let Self { rows, data, factored } = self;
        let mut changed = Vec::new();
        for &(row, height) in rows.panels() {
            let mut differs = false;
            for row in row..row + height {
                let range = rows.range(row);
                let least = CHANGED * rows.diagonal(row).map_or(0.0, |place| data[place].abs());
                let pairs = data[range.clone()].iter().zip(&factored[range]);
                // Without a way out the loop takes several entries at a time.
                differs |= pairs.fold(false, |differs, (a, b)| differs | ((a - b).abs() > least));
            }
            if differs {
                changed.push((row, height));
            }
        }
        changed
    }
}

/// Sweeps forth and back that take y towards the solution for v, compiled for this processor; a closure
/// would not be.
struct Sweep<'a, T> {
    blocks: &'a [Block<T>],
    entries: &'a [(u32, Column<T>)],
    v: &'a [T],
    y: &'a mut [T],
}

impl<T: Number> NullaryFnOnce for Sweep<'_, T> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { blocks, entries, v, y } = self;
        y.fill(T::default());
        for _ in 0..SWEEPS {
            for block in blocks {
                relax(block, entries, v, y);
            }
            for block in blocks.iter().rev() {
                relax(block, entries, v, y);
            }
        }
    }
}

/// Solves the rows of a block for its own unknowns.
#[inline(always)]
fn relax<T: Number>(block: &Block<T>, entries: &[(u32, Column<T>)], v: &[T], y: &mut [T]) {
    let sums = products(&entries[block.entries.0..block.entries.1], y);
    let own = block.first..block.first + block.height;
    let mut rest = [T::default(); PANEL];
    for ((rest, v), sum) in rest.iter_mut().zip(&v[own.clone()]).zip(sums) {
        *rest = *v - sum;
    }
    y[own].copy_from_slice(&times(&block.inverse, rest)[..block.height]);
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
