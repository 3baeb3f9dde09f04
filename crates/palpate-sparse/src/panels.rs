//! Columns of supernodes, packed in the order in which the triangular solutions read them.
//!
//! faer keeps a supernode by columns, of which a solution reads several at a time from as many places.
//! Here a panel of [`WIDTH`] columns is in sequence, as tiles of [`LANES`] rows, so that the factor comes
//! out of memory as one stream, down and up, which takes half the time.
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

    /// Panels, which have a triangle each.
    pub(crate) fn n_triangles(self) -> usize {
        self.first_below() / WIDTH
    }

    /// Tiles of all panels.
    pub(crate) fn n_tiles(self) -> usize {
        self.panels().map(|(_, n_tiles)| n_tiles).sum()
    }

    /// First column of every panel, and how many tiles it has.
    #[inline(always)]
    fn panels(self) -> impl DoubleEndedIterator<Item = (usize, usize)> {
        let rows = self.first_below() + self.below;
        let n_tiles = move |first: usize| (rows - first - WIDTH).div_ceil(LANES);
        (0..self.first_below()).step_by(WIDTH).map(move |first| (first, n_tiles(first)))
    }

    /// Packs columns, of which the supernode's own rows are the first.
    pub(crate) fn pack<T: Tiled>(self, columns: &[T], packed: &mut Packed<T>) {
        let (width, height) = (self.width, self.width + self.below);
        let mut spread = vec![vec![T::default(); self.length()]; WIDTH];
        for (first, n_tiles) in self.panels() {
            let mut triangle = [[T::default(); WIDTH]; WIDTH];
            for (c, (spread, triangle)) in spread.iter_mut().zip(&mut triangle).enumerate() {
                if first + c < width {
                    let column = &columns[(first + c) * height..][..height];
                    spread[first..width].copy_from_slice(&column[first..width]);
                    spread[self.first_below()..][..self.below].copy_from_slice(&column[width..]);
                } else {
                    spread.fill(T::default());
                }
                triangle[c + 1..].copy_from_slice(&spread[first + c + 1..first + WIDTH]);
                triangle[c] = T::unit(&spread[first + WIDTH..]);
            }
            for t in 0..n_tiles {
                let rows = first + WIDTH + t * LANES;
                T::store(&spread, rows, &triangle, &mut packed.tiles);
            }
            packed.triangles.push(triangle);
        }
    }

    /// Solves L₁₁ y = x, where x are the supernode's rows of each of some vectors, and takes L₂₁ y from
    /// the others.
    #[inline(always)]
    pub(crate) fn down<T: Tiled, S: Simd>(self, simd: S, packed: Panels<'_, T>, vectors: &mut [T]) {
        let mut rest = packed.tiles;
        for ((first, n_tiles), triangle) in self.panels().zip(packed.triangles) {
            let (tiles, others) = rest.split_at(n_tiles * T::PER_TILE);
            for vector in vectors.chunks_exact_mut(self.length()) {
                eliminate(simd, triangle, tiles, &mut vector[first..]);
            }
            rest = others;
        }
    }

    /// Solves L₁₁ᵀ y = x − L₂₁ᵀ z, where x are the supernode's rows of each of some vectors and z the
    /// others.
    #[inline(always)]
    pub(crate) fn up<T: Tiled, S: Simd>(self, simd: S, packed: Panels<'_, T>, vectors: &mut [T]) {
        let mut rest = packed.tiles;
        for ((first, n_tiles), triangle) in self.panels().rev().zip(packed.triangles.iter().rev()) {
            let (others, tiles) = rest.split_at(rest.len() - n_tiles * T::PER_TILE);
            for vector in vectors.chunks_exact_mut(self.length()) {
                substitute(simd, triangle, tiles, &mut vector[first..]);
            }
            rest = others;
        }
    }
}

/// Of a panel: its triangle by columns, below the diagonal, and on it what a column's tiles are
/// multiples of.
pub(crate) type Triangle<T> = [[T; WIDTH]; WIDTH];

/// Panels of supernodes, one after the other.
#[derive(Debug)]
pub(crate) struct Packed<T: Tiled> {
    pub(crate) triangles: Vec<Triangle<T>>,
    pub(crate) tiles: Vec<T::Stored>,
}

/// Panels of one supernode.
#[derive(Clone, Copy)]
pub(crate) struct Panels<'a, T: Tiled> {
    pub(crate) triangles: &'a [Triangle<T>],
    pub(crate) tiles: &'a [T::Stored],
}

/// How tiles are kept, whose columns are multiples of a unit.
pub(crate) trait Tiled: Number {
    /// In what.
    type Stored: Copy + std::fmt::Debug;

    /// How many of them a tile takes.
    const PER_TILE: usize;

    /// Unit of a column with these numbers.
    fn unit(column: &[Self]) -> Self;

    /// Appends the tile of columns that begins at a row; `triangle` has their units.
    fn store(
        columns: &[Vec<Self>],
        row: usize,
        triangle: &Triangle<Self>,
        tiles: &mut Vec<Self::Stored>,
    );

    /// The k-th vector of every column of a tile, in units.
    fn columns<S: Simd>(simd: S, tile: &[Self::Stored], k: usize) -> [Self::Vector<S>; WIDTH];
}

/// Every number as it is.
impl Tiled for f64 {
    type Stored = Self;

    const PER_TILE: usize = WIDTH * LANES;

    fn unit(_: &[Self]) -> Self {
        1.0
    }

    fn store(columns: &[Vec<Self>], row: usize, _: &Triangle<Self>, tiles: &mut Vec<Self>) {
        for column in columns {
            tiles.extend_from_slice(&column[row..row + LANES]);
        }
    }

    #[inline(always)]
    fn columns<S: Simd>(_: S, tile: &[Self], k: usize) -> [S::f64s; WIDTH] {
        let vectors = Self::vectors::<S>(tile);
        let height = vectors.len() / WIDTH;
        std::array::from_fn(|c| vectors[c * height + k])
    }
}

/// Largest multiple of a unit.
const MOST: f32 = 32767.0;

/// Bits of 2²³, to which the last bits of a number add a whole number.
const WHOLE: u32 = 0x4b00_0000;

/// 2²³ and what makes every multiple positive.
const SHIFT: f32 = 8_388_608.0 + 32_768.0;

/// 16 bits for a number, two columns in a word: the factor comes out of memory in half the time, and GMRES
/// takes as many steps. Rounding to 2⁻¹⁶ of a column's largest number is little next to what changes
/// between tangents.
impl Tiled for f32 {
    type Stored = u32;

    const PER_TILE: usize = WIDTH / 2 * LANES;

    fn unit(column: &[Self]) -> Self {
        let unit = column.iter().fold(0.0, |most: Self, v| most.max(v.abs())) / MOST;
        if unit.is_normal() { unit } else { 1.0 }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in 16 bits")]
    fn store(columns: &[Vec<Self>], row: usize, triangle: &Triangle<Self>, tiles: &mut Vec<u32>) {
        let mut words = [[0; LANES]; WIDTH];
        for (c, (words, column)) in words.iter_mut().zip(columns).enumerate() {
            let per_unit = 1.0 / triangle[c][c];
            for (word, value) in words.iter_mut().zip(&column[row..row + LANES]) {
                *word = ((value * per_unit).clamp(-MOST, MOST) + 32768.5) as u32;
            }
        }
        for pair in words.chunks_exact(2) {
            tiles.extend(pair[0].iter().zip(&pair[1]).map(|(low, high)| low | (high << 16)));
        }
    }

    #[inline(always)]
    fn columns<S: Simd>(simd: S, tile: &[u32], k: usize) -> [S::f32s; WIDTH] {
        let (words, _) = S::as_simd_u32s(tile);
        let height = words.len() / 2;
        let (low, bits) = (simd.splat_u32s(0xffff), simd.splat_u32s(16));
        let (whole, shift) = (simd.splat_u32s(WHOLE), simd.splat_f32s(SHIFT));
        std::array::from_fn(|c| {
            let word = words[c / 2 * height + k];
            let number = if c % 2 == 0 {
                simd.and_u32s(word, low)
            } else {
                simd.wrapping_dyn_shr_u32s(word, bits)
            };
            simd.sub_f32s(simd.transmute_f32s_u32s(simd.or_u32s(number, whole)), shift)
        })
    }
}

/// Solves the triangle of a panel for its rows, the first ones, and takes what they give from the
/// others.
#[inline(always)]
fn eliminate<T: Tiled, S: Simd>(
    simd: S,
    triangle: &Triangle<T>,
    tiles: &[T::Stored],
    vector: &mut [T],
) {
    let (own, below) = vector.split_at_mut(WIDTH);
    for c in 0..WIDTH {
        for i in c + 1..WIDTH {
            let change = triangle[c][i] * own[c];
            own[i] -= change;
        }
    }
    let factors: [T::Vector<S>; WIDTH] =
        std::array::from_fn(|c| T::splat(simd, triangle[c][c] * own[c]));
    let zero = T::splat(simd, T::default());
    for (tile, below) in tiles.chunks_exact(T::PER_TILE).zip(below.chunks_exact_mut(LANES)) {
        for (k, below) in T::vectors_mut::<S>(below).iter_mut().enumerate() {
            let mut change = zero;
            for (column, factor) in T::columns(simd, tile, k).into_iter().zip(factors) {
                change = T::plus_product(simd, change, column, factor);
            }
            *below = T::minus(simd, *below, change);
        }
    }
}

/// Solves the transposed triangle of a panel for its rows, the first ones, given the others.
#[inline(always)]
fn substitute<T: Tiled, S: Simd>(
    simd: S,
    triangle: &Triangle<T>,
    tiles: &[T::Stored],
    vector: &mut [T],
) {
    let (own, below) = vector.split_at_mut(WIDTH);
    let mut sums = [[T::splat(simd, T::default()); LANES]; WIDTH];
    // Backwards, as all else on the way up: one stream of memory.
    let tiles = tiles.chunks_exact(T::PER_TILE);
    for (tile, below) in tiles.zip(below.chunks_exact(LANES)).rev() {
        for (k, below) in T::vectors::<S>(below).iter().enumerate() {
            for (sums, column) in sums.iter_mut().zip(T::columns(simd, tile, k)) {
                sums[k] = T::plus_product(simd, sums[k], column, *below);
            }
        }
    }
    for c in (0..WIDTH).rev() {
        let mut value = own[c] - triangle[c][c] * summed::<T, S>(&sums[c]);
        for b in c + 1..WIDTH {
            value -= triangle[c][b] * own[b];
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
    use std::cmp::Ordering;

    use pulp::{Arch, WithSimd};

    use super::*;
    use crate::graph::narrow;

    /// Both passes over one vector.
    struct Passes<'a, T: Tiled> {
        shape: Shape,
        packed: &'a Packed<T>,
        down: &'a mut [T],
        up: &'a mut [T],
    }

    impl<T: Tiled> WithSimd for Passes<'_, T> {
        type Output = ();

        fn with_simd<S: Simd>(self, simd: S) {
            let Packed { triangles, tiles } = self.packed;
            let panels = Panels { triangles, tiles };
            self.shape.down(simd, panels, self.down);
            self.shape.up(simd, panels, self.up);
        }
    }

    /// Above the diagonal, and on it, are numbers that take no part.
    fn entry(i: usize, j: usize) -> f64 {
        0.1 * (f64::from(narrow((7 * i + 3 * j) % 11)) - 4.0)
    }

    fn lower(i: usize, j: usize) -> f64 {
        match i.cmp(&j) {
            Ordering::Less => 0.0,
            Ordering::Equal => 1.0,
            Ordering::Greater => entry(i, j),
        }
    }

    fn known(i: usize) -> f64 {
        1.0 + f64::from(narrow(i % 5))
    }

    /// Largest error of both passes for a product of the columns with known numbers.
    fn error_of_passes<T: Tiled>(shape: Shape) -> f64 {
        let (width, height) = (shape.width, shape.width + shape.below);
        let columns: Vec<T> =
            (0..width).flat_map(|j| (0..height).map(move |i| T::rounded(entry(i, j)))).collect();
        let mut packed = Packed { triangles: Vec::new(), tiles: Vec::new() };
        shape.pack(&columns, &mut packed);
        assert_eq!(packed.triangles.len(), shape.n_triangles());
        assert_eq!(packed.tiles.len(), shape.n_tiles() * T::PER_TILE);
        let place = |i: usize| if i < width { i } else { shape.first_below() + i - width };
        let mut down = vec![T::default(); shape.length()];
        let mut up = down.clone();
        for i in 0..height {
            down[place(i)] = T::rounded((0..width).map(|j| lower(i, j) * known(j)).sum());
            up[place(i)] = T::rounded(known(i));
        }
        for (j, up) in up.iter_mut().enumerate().take(width) {
            *up = T::rounded((0..height).map(|i| lower(i, j) * known(i)).sum());
        }
        Arch::new().dispatch(Passes { shape, packed: &packed, down: &mut down, up: &mut up });
        let error = |i: usize| {
            let expected = if i < width { known(i) } else { 0.0 };
            let (down, up) = (down[place(i)].widened(), up[place(i)].widened());
            (down - expected).abs().max((up - known(i)).abs())
        };
        (0..height).map(error).fold(0.0, f64::max)
    }

    #[test]
    fn passes_undo_products_with_the_columns() {
        for (width, below) in [(1, 0), (3, 1), (4, 15), (5, 16), (12, 33), (18, 7)] {
            let shape = Shape { width, below };
            let (double, single) = (error_of_passes::<f64>(shape), error_of_passes::<f32>(shape));
            assert!(double < 1e-9, "{width}, {below}: {double}");
            assert!(single < 2e-2, "{width}, {below}: {single}");
        }
    }
}
