//! Designs made better by exchanging values within columns.
//!
//! Every exchange leaves each column the same set of values, so a Latin hypercube stays one. The
//! search is threshold annealing: an exchange is made if it raises the criterion by less than a
//! random share of a threshold, which falls; and partners, far apart in value at first, come ever
//! closer, because in a good design only small moves still help.

use std::str::FromStr;

use crate::design::{Columns, checked_rows};
use crate::error::{Error, SamplingError};
use crate::rng::Rng;
use crate::swap::{Correlation, Discrepancy, Distance, Room, Swap, Swappable};

/// Exchanges tried for each value of the design by default, in a design of moderate
/// size.
const SWAPS_PER_VALUE: u64 = 20;
/// Default limit of exchanges times values of a search: a few seconds.
const MOST_WORK: u64 = 4_000_000_000;

/// Times that the threshold falls and the partners come closer.
const EPOCHS: u32 = 100;
/// Largest rise accepted, as a share of the criterion, at first; after all epochs 1e-3 of that.
const THRESHOLD: f64 = 1e-2;
/// 1e-3^(1/100).
const COOLING: f64 = 0.933_254_300_796_991;
/// 0.02^(1/100): partners are up to half of the strata apart at first, a hundredth at last.
const APPROACH: f64 = 0.961_635_150_045_655_8;
/// Nearest reach, in strata.
const LEAST_REACH: f64 = 2.0;
/// A criterion that fell to this share has lost digits of its running sum; it is summed afresh.
const FELL: f64 = 1e-3;

const SALT: u64 = 0x6f70_7469_6d69_7365;

/// Criterion of a design.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Criterion {
    /// Least squared centred L2 discrepancy (Hickernell 1998): every box holds its share of the sets.
    CentredDiscrepancy,
    /// Largest distance of the two closest sets, by way of φp = (Σ distance^−p)^(1/p) with p = 20.
    Maximin,
    /// Least sum of the squared correlations of the parameters.
    Correlation,
}

impl FromStr for Criterion {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        match name {
            "cd" => Ok(Self::CentredDiscrepancy),
            "maximin" => Ok(Self::Maximin),
            "correlation" => Ok(Self::Correlation),
            _ => Err(SamplingError::UnknownCriterion { name: name.to_owned() }.into()),
        }
    }
}

/// How to search.
#[derive(Debug, Clone, PartialEq)]
pub struct Search {
    /// What to improve.
    pub criterion: Criterion,
    /// Decides the exchanges tried.
    pub seed: u64,
    /// Exchanges tried; [`default_swaps`] if left out.
    pub n_swaps: Option<u64>,
    /// Rows at the top that stay as they are.
    pub n_fixed: usize,
}

impl Search {
    /// A search of the default length in which every row may change.
    #[must_use]
    pub fn new(criterion: Criterion, seed: u64) -> Self {
        Self { criterion, seed, n_swaps: None, n_fixed: 0 }
    }
}

/// Exchanges that a search tries by default: 20 for each value of the design, fewer in a
/// large one so that it ends within seconds.
#[must_use]
pub fn default_swaps(n: usize, d: usize) -> u64 {
    let n_values = (n as u64).saturating_mul(d as u64).max(1);
    n_values.saturating_mul(SWAPS_PER_VALUE).min(MOST_WORK / n_values)
}

/// A better arrangement of `points`, n rows of `d` parameters in the unit cube: each column keeps
/// its values, in another order.
///
/// The criterion never gets worse. An exchange costs O(n d), for correlations O(d), and the search
/// begins and ends with one evaluation of O(n² d). Only +, −, ×, ÷ and √ in a fixed order decide,
/// so a seed gives the same bits on every platform.
///
/// # Errors
/// [`SamplingError`] if `points` is not one or more rows of `d` values between 0 and 1, or `n_fixed`
/// exceeds the rows.
///
/// # Examples
/// ```
/// use palpate_core::lhs::latin_hypercube;
/// use palpate_core::optimise::{Criterion, Search, optimise};
/// let drawn = latin_hypercube(50, 3, 2024, true)?;
/// let better = optimise(&drawn, 3, &Search::new(Criterion::CentredDiscrepancy, 2024))?;
/// assert_ne!(better, drawn);
/// # Ok::<(), palpate_core::Error>(())
/// ```
pub fn optimise(points: &[f64], d: usize, search: &Search) -> Result<Vec<f64>, Error> {
    let n = checked_rows(points, d)?;
    if search.n_fixed > n {
        return Err(SamplingError::FixedRows { n_fixed: search.n_fixed, n }.into());
    }
    let start = Columns::of(points, d)?;
    let rows = match search.criterion {
        Criterion::CentredDiscrepancy => annealed(&start, Discrepancy, search),
        Criterion::Maximin => annealed(&start, Distance::new(&start), search),
        Criterion::Correlation => annealed(&start, Correlation::new(&start), search),
    };
    let mut better = points.to_vec();
    for (k, origin) in rows.chunks_exact(n).enumerate() {
        for (row, &from) in origin.iter().enumerate() {
            better[row * d + k] = points[from as usize * d + k];
        }
    }
    Ok(better)
}

/// For each column, the row of `start` from which each row of the better design takes its value.
fn annealed<C: Swappable>(start: &Columns, criterion: C, search: &Search) -> Vec<u32> {
    let same: Vec<u32> = (0..start.d).flat_map(|_| numbers(start.n)).collect();
    if start.n - search.n_fixed < 2 {
        return same;
    }
    let before = criterion.value(start);
    let mut annealing = Annealing::new(start, criterion, before, same.clone(), search);
    let n_swaps = search.n_swaps.unwrap_or_else(|| default_swaps(start.n, start.d));
    annealing.run(n_swaps);
    let Annealing { design, criterion, origin, .. } = annealing;
    let is_better = criterion.value(&design) < before && criterion.prefers(&design, start);
    if is_better { origin } else { same }
}

#[expect(clippy::cast_possible_truncation, reason = "a design has at most 2^28 rows")]
fn numbers(n: usize) -> impl Iterator<Item = u32> {
    0..n as u32
}

struct Annealing<C> {
    design: Columns,
    criterion: C,
    rng: Rng,
    room: Room,
    /// Row of the first design from which each value came, by column.
    origin: Vec<u32>,
    /// Rows that may change, in the order of their values, by column.
    ordered: Vec<u32>,
    n_movable: u32,
    value: f64,
    /// The value when it was last summed afresh.
    summed: f64,
}

impl<C: Swappable> Annealing<C> {
    fn new(start: &Columns, criterion: C, value: f64, origin: Vec<u32>, search: &Search) -> Self {
        let mut ordered = Vec::new();
        for k in 0..start.d {
            let column = start.column(k);
            let mut rows: Vec<u32> = numbers(start.n).skip(search.n_fixed).collect();
            rows.sort_by(|a, b| column[*a as usize].total_cmp(&column[*b as usize]));
            ordered.extend(rows);
        }
        Self {
            n_movable: numbers(start.n).skip(search.n_fixed).fold(0, |count, _| count + 1),
            design: start.clone(),
            criterion,
            rng: Rng::salted(search.seed, SALT),
            room: Room::new(start.n),
            origin,
            ordered,
            value,
            summed: value,
        }
    }

    fn run(&mut self, n_swaps: u64) {
        let mut threshold = THRESHOLD;
        let mut reach = 0.5 * f64::from(self.n_movable);
        let mut column = (0..self.design.d).cycle();
        for epoch in 0..u64::from(EPOCHS) {
            let shares = |e: u64| u128::from(n_swaps) * u128::from(e) / u128::from(EPOCHS);
            for _ in shares(epoch)..shares(epoch + 1) {
                if let Some(k) = column.next() {
                    self.try_one(k, reach, threshold);
                }
            }
            threshold *= COOLING;
            reach *= APPROACH;
        }
    }

    /// Tries one exchange in column `k` of partners up to `reach` places apart.
    fn try_one(&mut self, k: usize, reach: f64, threshold: f64) {
        let ordered = &mut self.ordered[k * self.n_movable as usize..];
        let (place, partner) = pair(&mut self.rng, self.n_movable, reach);
        let (i, j) = (ordered[place] as usize, ordered[partner] as usize);
        let swap = Swap { k, i, j };
        let change = self.criterion.change(&self.design, swap, &mut self.room);
        if change < threshold * self.value * self.rng.unit() {
            ordered.swap(place, partner);
            self.criterion.made(&self.design, swap);
            self.design.swap(k, i, j);
            self.origin[k * self.design.n..].swap(i, j);
            self.value += change;
            if self.value < FELL * self.summed {
                self.value = self.criterion.value(&self.design);
                self.summed = self.value;
            }
        }
    }
}

/// Two different places of `n`, at most `reach` or so apart.
fn pair(rng: &mut Rng, n: u32, reach: f64) -> (usize, usize) {
    let reach = if reach > LEAST_REACH { reach } else { LEAST_REACH };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "2 to 2^27")]
    let reach = reach as u32;
    let place = rng.below(n);
    let (low, high) = (place.saturating_sub(reach), (place + reach).min(n - 1));
    let other = low + rng.below(high - low);
    (place as usize, (if other < place { other } else { other + 1 }) as usize)
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::lhs::latin_hypercube;
    use crate::real;
    use crate::rng::Rng;
    use proptest::prelude::*;

    fn changes_agree<C: Swappable>(
        mut criterion: C,
        mut design: Columns,
        picks: &[u64],
    ) -> Result<(), TestCaseError> {
        let mut rng = Rng::new(picks[0]);
        let mut room = Room::new(design.n);
        for (at, _) in picks.iter().enumerate() {
            #[expect(clippy::cast_possible_truncation)]
            let (i, j) = pair(&mut rng, design.n as u32, real(design.n));
            let swap = Swap { k: at % design.d, i, j };
            let before = criterion.value(&design);
            let change = criterion.change(&design, swap, &mut room);
            criterion.made(&design, swap);
            design.swap(swap.k, i, j);
            let after = criterion.value(&design);
            // A discrepancy is the small difference of terms near 1, and has their rounding.
            let tolerance = 1e-12 * before.abs().max(after.abs()) + 1e-14;
            prop_assert!(
                (after - before - change).abs() <= tolerance,
                "{before} + {change} is not {after}"
            );
        }
        Ok(())
    }

    proptest! {
        #[test]
        fn the_change_of_a_criterion_is_the_difference_of_its_values(
            n in 2..40_usize, d in 1..6_usize, seed in any::<u64>(),
            picks in proptest::collection::vec(any::<u64>(), 1..8), centred in any::<bool>(),
        ) {
            let points = latin_hypercube(n, d, seed, centred).unwrap();
            let design = Columns::of(&points, d).unwrap();
            changes_agree(Discrepancy, design.clone(), &picks)?;
            changes_agree(Distance::new(&design), design.clone(), &picks)?;
            changes_agree(Correlation::new(&design), design, &picks)?;
        }
    }

    #[test]
    fn partners_differ_and_stay_within_reach() {
        let mut rng = Rng::new(3);
        for n in [2, 3, 50] {
            for _ in 0..2_000 {
                let (a, b) = pair(&mut rng, n, 5.9);
                assert!(a != b && a.max(b) < n as usize && a.abs_diff(b) <= 5, "{a} {b} of {n}");
            }
        }
    }
}
