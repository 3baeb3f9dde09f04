//! The two triangular solutions of a symmetric factor, as one pass down and one pass up.
//!
//! A preconditioner is applied hundreds of times per factorisation, and its time is the time in
//! which the factor comes out of memory. So nothing here is allocated, copied or permuted on its
//! own: a right-hand side is permuted as it is read, columns are taken four at a time, and the
//! block diagonal is applied on the way.
#![expect(
    clippy::inline_always,
    reason = "only what is inlined into a dispatch is compiled for the processor at hand"
)]

use std::ops::Range;

use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use faer::traits::RealField;
use pulp::{Arch, Simd, WithSimd};

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
}

/// Columns taken at a time.
const WIDTH: usize = 4;

/// Partial sums of a scalar product.
const LANES: usize = 16;

/// The way through a supernodal factor P A Pᵀ = L B Lᵀ.
///
/// L, with a diagonal of ones, is kept by faer: of every supernode a dense block of columns, its own
/// rows first.
#[derive(Debug)]
pub(crate) struct TriangularSolve<T> {
    supernodes: Vec<Supernode>,
    /// Rows below the diagonal blocks.
    rows: Vec<u32>,
    /// Unknown at every place.
    order: Vec<u32>,
    /// Diagonal of B⁻¹, and its off-diagonal entry, by the first of two rows.
    diagonal: Vec<T>,
    beside: Vec<T>,
    tallest: usize,
}

#[derive(Debug, Clone)]
struct Supernode {
    columns: Range<usize>,
    rows: Range<usize>,
    values: Range<usize>,
}

impl<T: Number> TriangularSolve<T> {
    /// Reads the structure; the numbers and the order are still to come.
    pub(crate) fn new(symbolic: &SymbolicSupernodalCholesky<u32>) -> Self {
        let n = symbolic.nrows();
        let mut rows = Vec::new();
        let mut supernodes = Vec::with_capacity(symbolic.n_supernodes());
        let ends = symbolic.supernode_end();
        let values = symbolic.col_ptr_for_val();
        for (s, &end) in ends.iter().enumerate() {
            let node = symbolic.supernode(s);
            let first = rows.len();
            rows.extend_from_slice(node.pattern());
            supernodes.push(Supernode {
                columns: node.start()..end as usize,
                rows: first..rows.len(),
                values: values[s] as usize..values[s + 1] as usize,
            });
        }
        let height = |s: &Supernode| s.columns.len() + s.rows.len();
        let tallest = supernodes.iter().map(height).max().unwrap_or(0);
        let (diagonal, beside) = (vec![T::ONE; n], vec![T::default(); n]);
        Self { supernodes, rows, order: Vec::new(), diagonal, beside, tallest }
    }

    /// Takes pivots inside supernodes, which move rows, and the block diagonal B.
    ///
    /// `pattern` has the rows of L as of the analysis; `moved` and `places` give which row
    /// is now at a place, and where a row now is.
    pub(crate) fn take_pivots(
        &mut self,
        order: &[u32],
        symbolic: &SymbolicSupernodalCholesky<u32>,
        values: &[T],
        subdiagonal: &[T],
        (moved, places): (&[u32], &[u32]),
    ) {
        self.order = moved.iter().map(|&row| order[row as usize]).collect();
        for (s, node) in self.supernodes.iter().enumerate() {
            let pattern = symbolic.supernode(s).pattern();
            let rows = &mut self.rows[node.rows.clone()];
            rows.iter_mut().zip(pattern).for_each(|(row, &was)| *row = places[was as usize]);
            let height = node.columns.len() + node.rows.len();
            let block = &values[node.values.clone()];
            let first = node.columns.start;
            let mut j = 0;
            while j < node.columns.len() {
                let (one, off) = (block[j * height + j], subdiagonal[first + j]);
                if off == T::default() {
                    self.diagonal[first + j] = T::ONE / one;
                    self.beside[first + j] = T::default();
                    j += 1;
                } else {
                    // Divided by the entry off the diagonal first: it is the largest of the three.
                    let other = block[(j + 1) * height + j + 1];
                    let scaled = T::ONE / (off * ((one / off) * (other / off) - T::ONE));
                    self.diagonal[first + j] = (other / off) * scaled;
                    self.diagonal[first + j + 1] = (one / off) * scaled;
                    self.beside[first + j] = T::default() - scaled;
                    self.beside[first + j + 1] = T::default();
                    j += 2;
                }
            }
        }
    }

    /// Solves for `n_rhs` right-hand sides: `read(k, unknown)` gives the k-th, `write(k, unknown, value)`
    /// takes its solution. `values` are L; `work` is kept from call to call.
    pub(crate) fn apply(
        &self,
        values: &[T],
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
        Arch::new().dispatch(Passes { triangles: self, values, n_rhs, x, work });
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
struct Passes<'a, T> {
    triangles: &'a TriangularSolve<T>,
    values: &'a [T],
    n_rhs: usize,
    x: &'a mut [T],
    work: &'a mut [T],
}

impl<T: Number> WithSimd for Passes<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { triangles, values, n_rhs, x, work } = self;
        let n = triangles.diagonal.len();
        for node in &triangles.supernodes {
            let rows = &triangles.rows[node.rows.clone()];
            let (own, width) = (node.columns.clone(), node.columns.len());
            let height = width + rows.len();
            let work = &mut work[..n_rhs * height];
            for (x, work) in x.chunks_exact(n).zip(work.chunks_exact_mut(height)) {
                work[..width].copy_from_slice(&x[own.clone()]);
                work[width..].fill(T::default());
            }
            Block { values: &values[node.values.clone()], height }.down(width, work);
            let (diagonal, beside) =
                (&triangles.diagonal[own.clone()], &triangles.beside[own.clone()]);
            for (x, work) in x.chunks_exact_mut(n).zip(work.chunks_exact_mut(height)) {
                for (&row, change) in rows.iter().zip(&work[width..]) {
                    x[row as usize] += *change;
                }
                block_diagonal(diagonal, beside, &mut work[..width]);
                x[own.clone()].copy_from_slice(&work[..width]);
            }
        }
        for node in triangles.supernodes.iter().rev() {
            let rows = &triangles.rows[node.rows.clone()];
            let (own, width) = (node.columns.clone(), node.columns.len());
            let height = width + rows.len();
            let work = &mut work[..n_rhs * height];
            for (x, work) in x.chunks_exact(n).zip(work.chunks_exact_mut(height)) {
                work[..width].copy_from_slice(&x[own.clone()]);
                for (below, &row) in work[width..].iter_mut().zip(rows) {
                    *below = x[row as usize];
                }
            }
            Block { values: &values[node.values.clone()], height }.up(width, work);
            for (x, work) in x.chunks_exact_mut(n).zip(work.chunks_exact(height)) {
                x[own.clone()].copy_from_slice(&work[..width]);
            }
        }
    }
}

#[inline(always)]
fn block_diagonal<T: Number>(diagonal: &[T], beside: &[T], x: &mut [T]) {
    let mut j = 0;
    while j < x.len() {
        let own = x[j];
        if beside[j] == T::default() {
            x[j] = diagonal[j] * own;
            j += 1;
        } else {
            let next = x[j + 1];
            x[j] = diagonal[j] * own + beside[j] * next;
            x[j + 1] = beside[j] * own + diagonal[j + 1] * next;
            j += 2;
        }
    }
}

/// Columns of a supernode: its rows first, zero above a diagonal of ones, then those below.
#[derive(Clone, Copy)]
struct Block<'a, T> {
    values: &'a [T],
    height: usize,
}

impl<'a, T: Number> Block<'a, T> {
    /// Solves L₁₁ y = x, where x are the supernode's rows of each `work` (m, height), and takes L₂₁ y
    /// from the others.
    #[inline(always)]
    fn down(self, n: usize, work: &mut [T]) {
        let mut j = 0;
        while j < n {
            let whole = j + WIDTH <= n;
            for work in work.chunks_exact_mut(self.height) {
                if whole {
                    self.eliminate::<WIDTH>(j, work);
                } else {
                    self.eliminate::<1>(j, work);
                }
            }
            j += if whole { WIDTH } else { 1 };
        }
    }

    /// Solves L₁₁ᵀ y = x − L₂₁ᵀ z, where x are the supernode's rows of each `work` (m, height) and z the
    /// others.
    #[inline(always)]
    fn up(self, n: usize, work: &mut [T]) {
        let mut j = n;
        while j > 0 {
            let whole = j.is_multiple_of(WIDTH);
            j -= if whole { WIDTH } else { 1 };
            for work in work.chunks_exact_mut(self.height) {
                if whole {
                    self.substitute::<WIDTH>(j, work);
                } else {
                    self.substitute::<1>(j, work);
                }
            }
        }
    }

    #[inline(always)]
    fn columns<const N: usize>(self, j: usize) -> [&'a [T]; N] {
        let mut columns = [self.values; N];
        for (c, column) in columns.iter_mut().enumerate() {
            *column = &self.values[(j + c) * self.height..(j + c + 1) * self.height];
        }
        columns
    }

    /// Start of whole vectors up to the end that contain `first`.
    ///
    /// Rows before `first` are zero in every column from `first` on.
    #[inline(always)]
    fn aligned(self, first: usize) -> usize {
        let reach = (self.height - first).next_multiple_of(LANES);
        if reach <= self.height { self.height - reach } else { first }
    }

    #[inline(always)]
    fn eliminate<const N: usize>(self, j: usize, work: &mut [T]) {
        let columns = self.columns::<N>(j);
        let mut own = [T::default(); N];
        for c in 0..N {
            let mut value = work[j + c];
            for b in 0..c {
                value -= columns[b][j + c] * own[b];
            }
            own[c] = value;
        }
        let first = self.aligned(j + N);
        subtract(columns, own, &mut work[first..], first);
        work[j..j + N].copy_from_slice(&own);
    }

    #[inline(always)]
    fn substitute<const N: usize>(self, j: usize, work: &mut [T]) {
        let columns = self.columns::<N>(j);
        let mut own = [T::default(); N];
        own.copy_from_slice(&work[j..j + N]);
        // The rows of the diagonal block take part in the sums only as far as they are known.
        work[j..j + N].fill(T::default());
        let first = self.aligned(j + N);
        let sums = products(columns, &work[first..], first);
        for c in (0..N).rev() {
            let mut value = own[c] - sums[c];
            for b in c + 1..N {
                value -= columns[c][j + b] * own[b];
            }
            own[c] = value;
        }
        work[j..j + N].copy_from_slice(&own);
    }
}

/// Takes the rows from `first` on of every column, times its factor, from a vector.
#[inline(always)]
fn subtract<T: Number, const N: usize>(
    columns: [&[T]; N],
    factors: [T; N],
    vector: &mut [T],
    first: usize,
) {
    let n = vector.len();
    let mut below = columns;
    for column in &mut below {
        *column = &column[first..first + n];
    }
    for (i, entry) in vector.iter_mut().enumerate() {
        let mut change = below[0][i] * factors[0];
        for c in 1..N {
            change += below[c][i] * factors[c];
        }
        *entry -= change;
    }
}

/// Scalar products of the rows from `first` on of every column with a vector.
#[inline(always)]
pub(crate) fn products<T: Number, const N: usize>(
    columns: [&[T]; N],
    vector: &[T],
    first: usize,
) -> [T; N] {
    let n = vector.len();
    let mut below = columns;
    for column in &mut below {
        *column = &column[first..first + n];
    }
    let whole = n / LANES * LANES;
    let mut partial = [[T::default(); LANES]; N];
    let mut i = 0;
    while i < whole {
        let values = &vector[i..i + LANES];
        for (partial, column) in partial.iter_mut().zip(&below) {
            let column = &column[i..i + LANES];
            for ((sum, l), v) in partial.iter_mut().zip(column).zip(values) {
                *sum += *l * *v;
            }
        }
        i += LANES;
    }
    let mut sums = [T::default(); N];
    for c in 0..N {
        for width in [8, 4, 2, 1] {
            for lane in 0..width {
                let other = partial[c][lane + width];
                partial[c][lane] += other;
            }
        }
        sums[c] = partial[c][0];
        for (l, v) in below[c][whole..].iter().zip(&vector[whole..]) {
            sums[c] += *l * *v;
        }
    }
    sums
}
