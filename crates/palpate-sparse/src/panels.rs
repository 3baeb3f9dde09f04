//! Columns of supernodes, packed in the order in which the triangular solutions read them.
//!
//! faer keeps a supernode by columns, of which a solution reads several at a time from as many places.
//! Here a panel of [`WIDTH`] columns is in sequence: its triangle, then tiles of [`LANES`] rows. So the
//! factor comes out of memory as one stream, down and up, which takes half the time.
#![expect(
    clippy::inline_always,
    reason = "only what is inlined into a dispatch is compiled for the processor at hand"
)]

use pulp::Simd;

use crate::triangular_solve::Number;

/// Columns of a panel.
const WIDTH: usize = 4;

/// Rows of a tile, and partial sums of a scalar product: whole vectors of any processor.
pub(crate) const LANES: usize = 16;

/// Size of a supernode: its columns, and the rows below its own.
///
/// Vectors of its rows begin with its own, followed by zeros up to whole panels; zeros for one tile
/// end them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shape {
    pub(crate) width: usize,
    pub(crate) below: usize,
}

impl Shape {
    /// Length of a vector of the rows.
    #[inline(always)]
    pub(crate) fn length(self) -> usize {
        self.first_below() + self.below + LANES
    }

    /// Place of the first row below the supernode's own.
    #[inline(always)]
    pub(crate) fn first_below(self) -> usize {
        self.width.next_multiple_of(WIDTH)
    }

    /// Numbers of all panels.
    pub(crate) fn packed(self) -> usize {
        self.panels().map(|(_, length)| length).sum()
    }

    /// First column and length of every panel.
    #[inline(always)]
    fn panels(self) -> impl DoubleEndedIterator<Item = (usize, usize)> {
        let rows = self.first_below() + self.below;
        (0..self.first_below()).step_by(WIDTH).map(move |first| {
            (first, WIDTH * (WIDTH + (rows - first - WIDTH).next_multiple_of(LANES)))
        })
    }

    /// Packs columns, of which the supernode's own rows are the first.
    pub(crate) fn pack<T: Number>(self, columns: &[T], packed: &mut [T]) {
        let (width, height) = (self.width, self.width + self.below);
        let mut rest = packed;
        let mut spread = vec![T::default(); self.length()];
        for (first, length) in self.panels() {
            let (panel, others) = rest.split_at_mut(length);
            let (triangle, tiles) = panel.split_at_mut(WIDTH * WIDTH);
            for c in 0..WIDTH {
                if first + c < width {
                    let column = &columns[(first + c) * height..][..height];
                    spread[first..width].copy_from_slice(&column[first..width]);
                    spread[self.first_below()..][..self.below].copy_from_slice(&column[width..]);
                } else {
                    spread.fill(T::default());
                }
                triangle[c * WIDTH..][..WIDTH].copy_from_slice(&spread[first..first + WIDTH]);
                let rows = spread[first + WIDTH..].chunks_exact(LANES);
                for (tile, rows) in tiles.chunks_exact_mut(WIDTH * LANES).zip(rows) {
                    tile[c * LANES..][..LANES].copy_from_slice(rows);
                }
            }
            rest = others;
        }
    }

    /// Solves L₁₁ y = x, where x are the supernode's rows of each of some vectors, and takes L₂₁ y from
    /// the others.
    #[inline(always)]
    pub(crate) fn down<T: Number, S: Simd>(self, simd: S, packed: &[T], vectors: &mut [T]) {
        let mut rest = packed;
        for (first, length) in self.panels() {
            let (panel, others) = rest.split_at(length);
            for vector in vectors.chunks_exact_mut(self.length()) {
                eliminate(simd, panel, &mut vector[first..]);
            }
            rest = others;
        }
    }

    /// Solves L₁₁ᵀ y = x − L₂₁ᵀ z, where x are the supernode's rows of each of some vectors and z the
    /// others.
    #[inline(always)]
    pub(crate) fn up<T: Number, S: Simd>(self, simd: S, packed: &[T], vectors: &mut [T]) {
        let mut rest = packed;
        for (first, length) in self.panels().rev() {
            let (others, panel) = rest.split_at(rest.len() - length);
            for vector in vectors.chunks_exact_mut(self.length()) {
                substitute(simd, panel, &mut vector[first..]);
            }
            rest = others;
        }
    }
}

/// Solves the triangle of a panel for its rows, the first ones, and takes what they give from the
/// others.
#[inline(always)]
fn eliminate<T: Number, S: Simd>(simd: S, panel: &[T], vector: &mut [T]) {
    let (triangle, tiles) = panel.split_at(WIDTH * WIDTH);
    let (own, below) = vector.split_at_mut(WIDTH);
    for c in 0..WIDTH {
        for i in c + 1..WIDTH {
            let change = triangle[c * WIDTH + i] * own[c];
            own[i] -= change;
        }
    }
    let own: [T::Vector<S>; WIDTH] = std::array::from_fn(|c| T::splat(simd, own[c]));
    let zero = T::splat(simd, T::default());
    for (tile, below) in tiles.chunks_exact(WIDTH * LANES).zip(below.chunks_exact_mut(LANES)) {
        let (tile, below) = (T::vectors::<S>(tile), T::vectors_mut::<S>(below));
        let height = below.len();
        for (k, below) in below.iter_mut().enumerate() {
            let mut change = zero;
            for (column, own) in tile.chunks_exact(height).zip(&own) {
                change = T::plus_product(simd, change, column[k], *own);
            }
            *below = T::minus(simd, *below, change);
        }
    }
}

/// Solves the transposed triangle of a panel for its rows, the first ones, given the others.
#[inline(always)]
fn substitute<T: Number, S: Simd>(simd: S, panel: &[T], vector: &mut [T]) {
    let (triangle, tiles) = panel.split_at(WIDTH * WIDTH);
    let (own, below) = vector.split_at_mut(WIDTH);
    let mut sums = [[T::splat(simd, T::default()); LANES]; WIDTH];
    // Backwards, as all else on the way up: one stream of memory.
    let tiles = tiles.chunks_exact(WIDTH * LANES);
    for (tile, below) in tiles.zip(below.chunks_exact(LANES)).rev() {
        let (tile, below) = (T::vectors::<S>(tile), T::vectors::<S>(below));
        for (sums, column) in sums.iter_mut().zip(tile.chunks_exact(below.len())) {
            for ((sum, entry), value) in sums.iter_mut().zip(column).zip(below) {
                *sum = T::plus_product(simd, *sum, *entry, *value);
            }
        }
    }
    for c in (0..WIDTH).rev() {
        let mut value = own[c] - summed::<T, S>(&sums[c]);
        for b in c + 1..WIDTH {
            value -= triangle[c * WIDTH + b] * own[b];
        }
        own[c] = value;
    }
}

/// Sum of all lanes of as many vectors as there are in a tile.
#[inline(always)]
pub(crate) fn summed<T: Number, S: Simd>(sums: &[T::Vector<S>; LANES]) -> T {
    let mut lanes = [T::default(); LANES];
    let parts = T::vectors_mut::<S>(&mut lanes);
    parts.iter_mut().zip(sums).for_each(|(part, sum)| *part = *sum);
    total(lanes)
}

/// Sum of lanes, by halves.
#[inline(always)]
pub(crate) fn total<T: Number, const N: usize>(mut lanes: [T; N]) -> T {
    let mut width = N;
    while width > 1 {
        width /= 2;
        for lane in 0..width {
            let other = lanes[lane + width];
            lanes[lane] += other;
        }
    }
    lanes[0]
}

#[cfg(test)]
mod tests {
    use pulp::{Arch, WithSimd};

    use super::*;
    use crate::graph::narrow;

    /// Both passes over one vector.
    struct Passes<'a> {
        shape: Shape,
        packed: &'a [f64],
        down: &'a mut [f64],
        up: &'a mut [f64],
    }

    impl WithSimd for Passes<'_> {
        type Output = ();

        fn with_simd<S: Simd>(self, simd: S) {
            self.shape.down(simd, self.packed, self.down);
            self.shape.up(simd, self.packed, self.up);
        }
    }

    #[test]
    fn passes_undo_products_with_the_columns() {
        for (width, below) in [(1, 0), (3, 1), (4, 15), (5, 16), (12, 33), (18, 7)] {
            let (shape, height) = (Shape { width, below }, width + below);
            // Above the diagonal, and on it, are numbers that take no part.
            let entry = |i: usize, j: usize| f64::from(narrow((7 * i + 3 * j) % 11)) / 11.0 - 0.4;
            let columns: Vec<f64> =
                (0..width).flat_map(|j| (0..height).map(move |i| entry(i, j))).collect();
            let lower = |i: usize, j: usize| match i.cmp(&j) {
                std::cmp::Ordering::Less => 0.0,
                std::cmp::Ordering::Equal => 1.0,
                std::cmp::Ordering::Greater => entry(i, j),
            };
            let mut packed = vec![0.0; shape.packed()];
            shape.pack(&columns, &mut packed);
            let known = |i: usize| 1.0 + f64::from(narrow(i % 5));
            let place = |i: usize| if i < width { i } else { shape.first_below() + i - width };
            let (mut down, mut up) = (vec![0.0; shape.length()], vec![0.0; shape.length()]);
            for i in 0..height {
                down[place(i)] = (0..width).map(|j| lower(i, j) * known(j)).sum();
                up[place(i)] = known(i);
            }
            for (j, up) in up.iter_mut().enumerate().take(width) {
                *up = (0..height).map(|i| lower(i, j) * known(i)).sum();
            }
            Arch::new().dispatch(Passes { shape, packed: &packed, down: &mut down, up: &mut up });
            for i in 0..height {
                let expected = if i < width { known(i) } else { 0.0 };
                assert!((down[place(i)] - expected).abs() < 1e-9, "{width}, {below}: row {i}");
                assert!((up[place(i)] - known(i)).abs() < 1e-9, "{width}, {below}: row {i}");
            }
        }
    }
}
