//! A design as the kernels hold it: column after column, checked.

use crate::error::{Error, SamplingError};
use crate::lhs::LARGEST_DESIGN;

/// Values of n sets in d parameters, column after column, shifted by −½ to be centred at 0.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Columns {
    pub(crate) n: usize,
    pub(crate) d: usize,
    values: Vec<f64>,
}

impl Columns {
    /// The columns of `points`, given row after row.
    pub(crate) fn of(points: &[f64], d: usize) -> Result<Self, Error> {
        let n = checked_rows(points, d)?;
        let mut values = Vec::with_capacity(points.len());
        for k in 0..d {
            values.extend(points[k..].iter().step_by(d).map(|x| x - 0.5));
        }
        Ok(Self { n, d, values })
    }

    /// Column `k`.
    pub(crate) fn column(&self, k: usize) -> &[f64] {
        &self.values[k * self.n..][..self.n]
    }

    /// Swaps the values of rows `i` and `j` in column `k`.
    pub(crate) fn swap(&mut self, k: usize, i: usize, j: usize) {
        self.values[k * self.n..][..self.n].swap(i, j);
    }
}

/// Number of rows of `d` values in `points`, each between 0 and 1.
pub(crate) fn checked_rows(points: &[f64], d: usize) -> Result<usize, SamplingError> {
    let length = points.len();
    if length == 0 || d == 0 || !length.is_multiple_of(d) {
        return Err(SamplingError::PointsShape { length, d });
    }
    if length > LARGEST_DESIGN {
        return Err(SamplingError::DesignTooLarge { n: length / d, d, limit: LARGEST_DESIGN });
    }
    match points.iter().position(|x| !(0.0..=1.0).contains(x)) {
        None => Ok(length / d),
        Some(at) => {
            Err(SamplingError::OutsideCube { row: at / d, column: at % d, value: points[at] })
        }
    }
}
