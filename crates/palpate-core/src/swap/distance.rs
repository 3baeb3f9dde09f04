//! φp, which the closest sets decide, and its change.

use super::{Room, Swap, Swappable, sum3};
use crate::design::Columns;
use crate::real;

/// Σ over pairs of (s / distance²)^10, the twentieth power of φ20 up to a scale s.
pub(crate) struct Distance {
    /// Keeps the powers in range; about the squared distance of neighbours.
    scale: f64,
}

/// Sets at one place count as this close, so that the sum stays finite.
const CLOSEST: f64 = 1e28;

impl Distance {
    /// For designs like this one: n cubes of the side √s or a little larger ones fill the unit
    /// cube. A power of ½, found without the platform's mathematical library.
    pub(crate) fn new(design: &Columns) -> Self {
        let mut side = 1.0;
        let volume = |side: f64| (0..design.d).fold(1.0, |volume, _| volume * side);
        while volume(side) * real(design.n) > 1.0 {
            side *= 0.5;
        }
        Self { scale: side * side }
    }

    /// The tenth power of s / distance².
    #[inline]
    fn term(&self, squared_distance: f64) -> f64 {
        let x = self.scale / squared_distance;
        let x = if x < CLOSEST { x } else { CLOSEST };
        let x2 = x * x;
        let x4 = x2 * x2;
        x4 * x4 * x2
    }

    /// Distance of the two closest sets.
    fn least(design: &Columns) -> f64 {
        let mut least = f64::INFINITY;
        let mut squares = vec![0.0; design.n];
        for i in 1..design.n {
            squared_distances(design, i, &mut squares[..i], None);
            least = squares[..i].iter().fold(least, |a, b| if *b < a { *b } else { a });
        }
        least.sqrt()
    }
}

/// Squared distances of row `i` to the first rows, in every column but `without`.
fn squared_distances(design: &Columns, i: usize, squares: &mut [f64], without: Option<usize>) {
    squares.fill(0.0);
    for k in (0..design.d).filter(|k| Some(*k) != without) {
        let column = design.column(k);
        let a = column[i];
        squares.iter_mut().zip(column).for_each(|(s, b)| *s += (b - a) * (b - a));
    }
}

impl Swappable for Distance {
    fn value(&self, design: &Columns) -> f64 {
        let mut squares = vec![0.0; design.n];
        let mut sum = 0.0;
        for i in 1..design.n {
            squared_distances(design, i, &mut squares[..i], None);
            let squares = &squares[..i];
            sum += sum3(squares, squares, squares, |s, _, _| self.term(s));
        }
        sum
    }

    /// The distance of i to j stays; their other distances change only in column k.
    fn change(&self, design: &Columns, Swap { k, i, j }: Swap, room: &mut Room) -> f64 {
        let (of_i, of_j) = (&mut room.of_i[..], &mut room.of_j[..]);
        squared_distances(design, i, of_i, Some(k));
        squared_distances(design, j, of_j, Some(k));
        for l in [i, j] {
            (of_i[l], of_j[l]) = (f64::INFINITY, f64::INFINITY);
        }
        let column = design.column(k);
        let (at_i, at_j) = (column[i], column[j]);
        sum3(of_i, of_j, column, |p, q, c| {
            let (to_i, to_j) = ((c - at_i) * (c - at_i), (c - at_j) * (c - at_j));
            (self.term(p + to_j) - self.term(p + to_i))
                + (self.term(q + to_i) - self.term(q + to_j))
        })
    }

    /// A power mean may fall while the least distance does too.
    fn prefers(&self, design: &Columns, to: &Columns) -> bool {
        Self::least(design) >= Self::least(to)
    }
}
