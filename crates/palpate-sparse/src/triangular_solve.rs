//! The two triangular solutions of a symmetric factor, as one pass down and one pass up.
//!
//! A preconditioner is applied hundreds of times per factorisation, and its time is the time in
//! which the factor comes out of memory. So the factor is packed once in the order in which it is
//! read, and nothing here is allocated, copied or permuted on its own: a right-hand side is permuted
//! as it is read, and the block diagonal is applied on the way.
#![expect(
    clippy::inline_always,
    reason = "only what is inlined into a dispatch is compiled for the processor at hand"
)]

use std::ops::Range;

use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use faer::traits::RealField;
use pulp::{Arch, Simd, WithSimd};

use crate::panels::{Packed, Panels, Shape, Tiled};

/// Numbers that a factor is kept in.
pub(crate) trait Number:
    RealField
    + Copy
    + Default
    + std::ops::Add<Output = Self>
    + std::ops::Sub<Output = Self>
    + std::ops::Mul<Output = Self>
    + std::ops::Div<Output = Self>
    + std::ops::AddAssign
    + std::ops::SubAssign
    + std::ops::MulAssign
    + PartialEq
{
    const ONE: Self;

    /// The nearest number of this precision.
    fn rounded(value: f64) -> Self;

    /// The same number in double precision.
    fn widened(self) -> f64;

    /// Numbers that a processor takes at a time.
    type Vector<S: Simd>: Copy;

    /// The whole vectors of some numbers.
    fn vectors<S: Simd>(numbers: &[Self]) -> &[Self::Vector<S>];

    /// As [`Self::vectors`], to change.
    fn vectors_mut<S: Simd>(numbers: &mut [Self]) -> &mut [Self::Vector<S>];

    /// The same number in every lane.
    fn splat<S: Simd>(simd: S, number: Self) -> Self::Vector<S>;

    /// sum + a b, rounded after the product too: the same bits on every processor.
    fn plus_product<S: Simd>(
        simd: S,
        sum: Self::Vector<S>,
        a: Self::Vector<S>,
        b: Self::Vector<S>,
    ) -> Self::Vector<S>;

    /// a − b.
    fn minus<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
}

/// Vectors of one precision, by the methods of [`Simd`] for it.
macro_rules! vectors {
    ($vector:ident, $slice:ident, $slice_mut:ident, $splat:ident, $add:ident, $subtract:ident, $multiply:ident) => {
        type Vector<S: Simd> = S::$vector;

        #[inline(always)]
        fn vectors<S: Simd>(numbers: &[Self]) -> &[S::$vector] {
            S::$slice(numbers).0
        }

        #[inline(always)]
        fn vectors_mut<S: Simd>(numbers: &mut [Self]) -> &mut [S::$vector] {
            S::$slice_mut(numbers).0
        }

        #[inline(always)]
        fn splat<S: Simd>(simd: S, number: Self) -> S::$vector {
            simd.$splat(number)
        }

        #[inline(always)]
        fn plus_product<S: Simd>(
            simd: S,
            sum: S::$vector,
            a: S::$vector,
            b: S::$vector,
        ) -> S::$vector {
            simd.$add(sum, simd.$multiply(a, b))
        }

        #[inline(always)]
        fn minus<S: Simd>(simd: S, a: S::$vector, b: S::$vector) -> S::$vector {
            simd.$subtract(a, b)
        }
    };
}

impl Number for f32 {
    const ONE: Self = 1.0;

    #[expect(clippy::cast_possible_truncation, reason = "rounding is what single precision means")]
    #[inline]
    fn rounded(value: f64) -> Self {
        value as Self
    }

    #[inline]
    fn widened(self) -> f64 {
        f64::from(self)
    }

    vectors!(f32s, as_simd_f32s, as_mut_simd_f32s, splat_f32s, add_f32s, sub_f32s, mul_f32s);
}

impl Number for f64 {
    const ONE: Self = 1.0;

    #[inline]
    fn rounded(value: f64) -> Self {
        value
    }

    #[inline]
    fn widened(self) -> f64 {
        self
    }

    vectors!(f64s, as_simd_f64s, as_mut_simd_f64s, splat_f64s, add_f64s, sub_f64s, mul_f64s);
}

/// The way through a supernodal factor P A Pᵀ = L B Lᵀ.
///
/// faer gives L, with a diagonal of ones: of every supernode a dense block of columns, its own rows
/// first.
#[derive(Debug)]
pub(crate) struct TriangularSolve<T: Tiled> {
    supernodes: Vec<Supernode>,
    /// Panels of all supernodes.
    packed: Packed<T>,
    /// Rows below the diagonal blocks.
    rows: Vec<u32>,
    /// Unknown at every place.
    order: Vec<u32>,
    /// Diagonal of B⁻¹, and its off-diagonal entry, by the first of two rows.
    diagonal: Vec<T>,
    subdiagonal: Vec<T>,
    tallest: usize,
}

#[derive(Debug, Clone)]
struct Supernode {
    columns: Range<usize>,
    rows: Range<usize>,
    /// Where faer keeps its columns.
    values: Range<usize>,
    triangles: Range<usize>,
    tiles: Range<usize>,
}

impl Supernode {
    #[inline(always)]
    fn shape(&self) -> Shape {
        Shape { width: self.columns.len(), below: self.rows.len() }
    }
}

impl<T: Tiled> TriangularSolve<T> {
    /// Reads the structure; the numbers and the order are still to come.
    pub(crate) fn new(symbolic: &SymbolicSupernodalCholesky<u32>) -> Self {
        let (n, mut n_triangles, mut n_tiles) = (symbolic.nrows(), 0, 0);
        let mut rows = Vec::new();
        let mut supernodes = Vec::with_capacity(symbolic.n_supernodes());
        let ends = symbolic.supernode_end();
        let values = symbolic.col_ptr_for_val();
        for (s, &end) in ends.iter().enumerate() {
            let node = symbolic.supernode(s);
            let first = rows.len();
            rows.extend_from_slice(node.pattern());
            let (columns, rows) = (node.start()..end as usize, first..rows.len());
            let shape = Shape { width: columns.len(), below: rows.len() };
            let triangles = n_triangles..n_triangles + shape.n_triangles();
            let tiles = n_tiles..n_tiles + shape.n_tiles() * T::PER_TILE;
            (n_triangles, n_tiles) = (triangles.end, tiles.end);
            let values = values[s] as usize..values[s + 1] as usize;
            supernodes.push(Supernode { columns, rows, values, triangles, tiles });
        }
        let tallest = supernodes.iter().map(|s| s.shape().length()).max().unwrap_or(0);
        let (diagonal, subdiagonal) = (vec![T::ONE; n], vec![T::default(); n]);
        let packed = Packed {
            triangles: Vec::with_capacity(n_triangles),
            tiles: Vec::with_capacity(n_tiles),
        };
        Self { supernodes, packed, rows, order: Vec::new(), diagonal, subdiagonal, tallest }
    }

    /// Takes the numbers of L, pivots inside supernodes, which move rows, and the block diagonal B.
    ///
    /// `pattern` has the rows of L as of the analysis; `moved` and `places` give which row
    /// is now at a place, and where a row now is.
    pub(crate) fn take(
        &mut self,
        order: &[u32],
        symbolic: &SymbolicSupernodalCholesky<u32>,
        values: &[T],
        subdiagonal: &[T],
        (moved, places): (&[u32], &[u32]),
    ) {
        self.order = moved.iter().map(|&row| order[row as usize]).collect();
        self.packed.triangles.clear();
        self.packed.tiles.clear();
        for (s, node) in self.supernodes.iter().enumerate() {
            let pattern = symbolic.supernode(s).pattern();
            let rows = &mut self.rows[node.rows.clone()];
            rows.iter_mut().zip(pattern).for_each(|(row, &was)| *row = places[was as usize]);
            let height = node.columns.len() + node.rows.len();
            let block = &values[node.values.clone()];
            node.shape().pack(block, &mut self.packed);
            let first = node.columns.start;
            let mut j = 0;
            while j < node.columns.len() {
                let (one, off) = (block[j * height + j], subdiagonal[first + j]);
                if off == T::default() {
                    self.diagonal[first + j] = T::ONE / one;
                    self.subdiagonal[first + j] = T::default();
                    j += 1;
                } else {
                    // Divided by the entry off the diagonal first: it is the largest of the three.
                    let other = block[(j + 1) * height + j + 1];
                    let scaled = T::ONE / (off * ((one / off) * (other / off) - T::ONE));
                    self.diagonal[first + j] = (other / off) * scaled;
                    self.diagonal[first + j + 1] = (one / off) * scaled;
                    self.subdiagonal[first + j] = T::default() - scaled;
                    self.subdiagonal[first + j + 1] = T::default();
                    j += 2;
                }
            }
        }
    }

    #[inline(always)]
    fn panels(&self, node: &Supernode) -> Panels<'_, T> {
        Panels {
            triangles: &self.packed.triangles[node.triangles.clone()],
            tiles: &self.packed.tiles[node.tiles.clone()],
        }
    }

    /// Solves for `n_rhs` right-hand sides: `read(k, unknown)` gives the k-th, `write(k, unknown, value)`
    /// takes its solution. `work` is kept from call to call.
    pub(crate) fn apply(
        &self,
        n_rhs: usize,
        work: &mut Vec<T>,
        read: impl Fn(usize, usize) -> T,
        mut write: impl FnMut(usize, usize, T),
    ) {
        let n = self.diagonal.len();
        work.resize(n_rhs * (n + self.tallest), T::default());
        let (x, work) = work.split_at_mut(n_rhs * n);
        for (k, x) in x.chunks_exact_mut(n).enumerate() {
            for (x, &unknown) in x.iter_mut().zip(&self.order) {
                *x = read(k, unknown as usize);
            }
        }
        Arch::new().dispatch(Passes { triangles: self, n_rhs, x, work });
        for (k, x) in x.chunks_exact(n).enumerate() {
            for (x, &unknown) in x.iter().zip(&self.order) {
                write(k, unknown as usize, *x);
            }
        }
    }
}

/// Both passes over x (m, n), compiled for this processor.
///
/// Right-hand sides take turns at every few columns, so that the factor comes out of memory once.
struct Passes<'a, T: Tiled> {
    triangles: &'a TriangularSolve<T>,
    n_rhs: usize,
    x: &'a mut [T],
    work: &'a mut [T],
}

impl<T: Tiled> WithSimd for Passes<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { triangles, n_rhs, x, work } = self;
        let n = triangles.diagonal.len();
        for node in &triangles.supernodes {
            let (shape, own) = (node.shape(), node.columns.clone());
            let rows = &triangles.rows[node.rows.clone()];
            let work = &mut work[..n_rhs * shape.length()];
            for (x, work) in x.chunks_exact(n).zip(work.chunks_exact_mut(shape.length())) {
                work[..own.len()].copy_from_slice(&x[own.clone()]);
                work[own.len()..].fill(T::default());
            }
            shape.down(simd, triangles.panels(node), work);
            let (diagonal, subdiagonal) =
                (&triangles.diagonal[own.clone()], &triangles.subdiagonal[own.clone()]);
            for (x, work) in x.chunks_exact_mut(n).zip(work.chunks_exact_mut(shape.length())) {
                for (&row, change) in rows.iter().zip(&work[shape.first_below()..]) {
                    x[row as usize] += *change;
                }
                block_diagonal(diagonal, subdiagonal, &mut work[..own.len()]);
                x[own.clone()].copy_from_slice(&work[..own.len()]);
            }
        }
        for node in triangles.supernodes.iter().rev() {
            let (shape, own) = (node.shape(), node.columns.clone());
            let rows = &triangles.rows[node.rows.clone()];
            let work = &mut work[..n_rhs * shape.length()];
            for (x, work) in x.chunks_exact(n).zip(work.chunks_exact_mut(shape.length())) {
                let (first, below) = work.split_at_mut(shape.first_below());
                let (below, padding) = below.split_at_mut(rows.len());
                first[..own.len()].copy_from_slice(&x[own.clone()]);
                first[own.len()..].fill(T::default());
                for (below, &row) in below.iter_mut().zip(rows) {
                    *below = x[row as usize];
                }
                padding.fill(T::default());
            }
            shape.up(simd, triangles.panels(node), work);
            for (x, work) in x.chunks_exact_mut(n).zip(work.chunks_exact(shape.length())) {
                x[own.clone()].copy_from_slice(&work[..own.len()]);
            }
        }
    }
}

#[inline(always)]
fn block_diagonal<T: Number>(diagonal: &[T], subdiagonal: &[T], x: &mut [T]) {
    let mut j = 0;
    while j < x.len() {
        let own = x[j];
        if subdiagonal[j] == T::default() {
            x[j] = diagonal[j] * own;
            j += 1;
        } else {
            let next = x[j + 1];
            x[j] = diagonal[j] * own + subdiagonal[j] * next;
            x[j + 1] = subdiagonal[j] * own + diagonal[j + 1] * next;
            j += 2;
        }
    }
}
