//! Criteria with the change by an exchange of two values of one column.

mod correlation;
mod discrepancy;
mod distance;

pub(crate) use correlation::Correlation;
pub(crate) use discrepancy::Discrepancy;
pub(crate) use distance::Distance;

use crate::design::Columns;

/// An exchange of the values of rows `i` ≠ `j` in column `k`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Swap {
    pub(crate) k: usize,
    pub(crate) i: usize,
    pub(crate) j: usize,
}

/// A criterion to make small. Every sum runs in a fixed order of additions, so that its bits are
/// the same wherever it runs.
pub(crate) trait Swappable {
    /// The criterion of a whole design.
    fn value(&self, design: &Columns) -> f64;

    /// What `swap` would add to it, with `room` to work in.
    fn change(&self, design: &Columns, swap: Swap, room: &mut Room) -> f64;

    /// Learns that `swap` has been made.
    fn made(&mut self, _design: &Columns, _swap: Swap) {}

    /// Whether a design of lower [`value`](Self::value) is the better one in the end too.
    fn prefers(&self, _design: &Columns, _to: &Columns) -> bool {
        true
    }
}

/// Two columns of scratch memory.
pub(crate) struct Room {
    pub(crate) of_i: Vec<f64>,
    pub(crate) of_j: Vec<f64>,
}

impl Room {
    pub(crate) fn new(n: usize) -> Self {
        Self { of_i: vec![0.0; n], of_j: vec![0.0; n] }
    }
}

/// Running sums side by side, which the compiler can put into one register.
const LANES: usize = 4;

/// Σ f(a, b, c) over three columns of one length.
#[inline]
fn sum3(a: &[f64], b: &[f64], c: &[f64], f: impl Fn(f64, f64, f64) -> f64) -> f64 {
    let mut sums = [0.0; LANES];
    let (a_lanes, a_rest) = a.as_chunks::<LANES>();
    let (b_lanes, b_rest) = b.as_chunks::<LANES>();
    let (c_lanes, c_rest) = c.as_chunks::<LANES>();
    for ((a, b), c) in a_lanes.iter().zip(b_lanes).zip(c_lanes) {
        for lane in 0..LANES {
            sums[lane] += f(a[lane], b[lane], c[lane]);
        }
    }
    let mut sum = (sums[0] + sums[1]) + (sums[2] + sums[3]);
    for ((a, b), c) in a_rest.iter().zip(b_rest).zip(c_rest) {
        sum += f(*a, *b, *c);
    }
    sum
}
