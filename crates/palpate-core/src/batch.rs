//! Many rows of input, each with its rows of output, on one or several threads.
#![expect(clippy::inline_always, reason = "only what is inlined gets a kernel's instructions")]

use std::ops::Range;

use rayon::prelude::*;

use crate::curve::LARGEST;
use crate::error::{CurveError, Error};
use crate::knots::{Knots, Pieces};

/// Rows that are worked on together: enough to pay for handing them to a thread.
const CHUNK: usize = 64;

/// Room that a thread reuses from row to row.
#[derive(Default)]
pub(crate) struct Scratch {
    pub(crate) knots: Vec<Knots>,
    pub(crate) pieces: Pieces,
    /// Interpolated ordinates.
    pub(crate) values: Vec<f64>,
    /// Rows side by side.
    pub(crate) lanes: Vec<f64>,
}

/// A run of rows with the output that belongs to them.
struct Job<'a, const K: usize> {
    rows: Range<usize>,
    out: [&'a mut [f64]; K],
}

/// `K` arrays of `n_rows` rows of the given widths, filled chunk by chunk.
///
/// `threads` is at most the number of chunks; 0 takes as many as there are cores. Each value is
/// computed in the same way whatever their number, and of several errors that of the first row
/// is returned.
pub(crate) fn chunks<const K: usize>(
    widths: [usize; K],
    n_rows: usize,
    threads: usize,
    work: impl Fn(Range<usize>, &mut [&mut [f64]; K], &mut Scratch) -> Result<(), Error> + Sync,
) -> Result<[Vec<f64>; K], Error> {
    let mut out = widths.map(|width| vec![0.0; n_rows * width]);
    let jobs = jobs(&mut out, widths, n_rows);
    let pool = (threads != 1 && jobs.len() > 1)
        .then(|| rayon::ThreadPoolBuilder::new().num_threads(threads).build().ok())
        .flatten();
    let run = |scratch: &mut Scratch, mut job: Job<'_, K>| {
        let start = job.rows.start;
        work(job.rows, &mut job.out, scratch).err().map(|error| (start, error))
    };
    let failed = match pool {
        None => {
            let mut scratch = Scratch::default();
            jobs.into_iter().find_map(|job| run(&mut scratch, job))
        }
        Some(pool) => pool.install(|| {
            jobs.into_par_iter()
                .map_init(Scratch::default, run)
                .flatten_iter()
                .min_by_key(|(start, _)| *start)
        }),
    };
    match failed {
        Some((_, error)) => Err(error),
        None => Ok(out),
    }
}

/// [`chunks`] row by row.
pub(crate) fn rows<const K: usize>(
    widths: [usize; K],
    n_rows: usize,
    threads: usize,
    work: impl Fn(usize, [&mut [f64]; K], &mut Scratch) -> Result<(), Error> + Sync,
) -> Result<[Vec<f64>; K], Error> {
    chunks(widths, n_rows, threads, |range, out, scratch| {
        for (i, row) in range.enumerate() {
            let mut k = 0;
            let out = out.each_mut().map(|out| {
                k += 1;
                &mut out[i * widths[k - 1]..][..widths[k - 1]]
            });
            work(row, out, scratch)?;
        }
        Ok(())
    })
}

fn jobs<const K: usize>(
    out: &mut [Vec<f64>; K],
    widths: [usize; K],
    n_rows: usize,
) -> Vec<Job<'_, K>> {
    let mut rest = out.each_mut().map(Vec::as_mut_slice);
    let mut found = Vec::with_capacity(n_rows.div_ceil(CHUNK));
    for start in (0..n_rows).step_by(CHUNK) {
        let rows = start..n_rows.min(start + CHUNK);
        let mut k = 0;
        let out = rest.each_mut().map(|rest| {
            let (first, second) = std::mem::take(rest).split_at_mut(rows.len() * widths[k]);
            *rest = second;
            k += 1;
            first
        });
        found.push(Job { rows, out });
    }
    found
}

/// Checks that `sim` is `n_sets` rows of `n_points` values.
pub(crate) fn check_shape(sim: &[f64], n_sets: usize, n_points: usize) -> Result<(), CurveError> {
    let length = sim.len();
    if n_sets.checked_mul(n_points) == Some(length) {
        return Ok(());
    }
    Err(CurveError::BatchShape { length, n_sets, n_points })
}

/// The error of a value that is neither usable nor NaN.
pub(crate) fn unusable(row: usize, index: usize, value: f64) -> CurveError {
    debug_assert!(value.abs() > LARGEST);
    CurveError::InfiniteInBatch { array: "sim", row, index, value }
}

/// Runs `kernel` with the widest vector instructions of this processor.
///
/// No product is fused with a sum and no sum is reordered by that, so the bits stay the same. A
/// large kernel is a type whose `call` is always inlined, because a large closure may not be.
#[inline(always)]
pub(crate) fn vectorised<K: pulp::NullaryFnOnce>(kernel: K) -> K::Output {
    pulp::Arch::new().dispatch(kernel)
}
