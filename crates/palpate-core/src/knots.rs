//! Location of measured points between the support points of a simulated path.
//!
//! Both run the same way along corresponding branches, so one pass over each is enough. The run of
//! measured points between two knots is found without regard to the runs before it, and taken in
//! blocks of fixed size whose surplus the next run overwrites: so the processor can work on several
//! runs at a time, and the compiler turns a block into vector instructions.
#![expect(clippy::inline_always, reason = "only what is inlined gets a kernel's instructions")]

use crate::curve::{self, Branch, Named, ROUND_OFF};
use crate::error::Error;
use crate::real;

/// Measured points that are interpolated at once.
pub(crate) const BLOCK: usize = 8;

/// Ordinates at the knots of one branch.
#[derive(Default)]
pub(crate) struct KnotOrdinates {
    y: Vec<f64>,
    /// Measured points before each knot but the first.
    stops: Vec<usize>,
}

/// A measured path cut into branches, ready to be walked.
#[derive(Debug, Clone)]
pub(crate) struct Segments {
    name: &'static str,
    branches: Vec<Branch>,
    walks: Vec<Segment>,
    n_points: usize,
    /// How far a point may overshoot a simulated branch.
    slack: f64,
}

/// The points of one measured branch.
#[derive(Debug, Clone)]
struct Segment {
    start: usize,
    /// Along the direction of travel, then [`BLOCK`] infinities.
    s: Vec<f64>,
    index: Index,
}

impl Segments {
    pub(crate) fn new(path: Named<'_>) -> Result<Self, Error> {
        let branches = curve::cut(path)?;
        let walks = branches.iter().map(|&branch| Segment::new(path.values, branch)).collect();
        Ok(Self {
            name: path.name,
            branches,
            walks,
            n_points: path.values.len(),
            slack: ROUND_OFF * curve::span(path.values),
        })
    }

    pub(crate) fn n_points(&self) -> usize {
        self.n_points
    }

    /// Ordinates at the measured points of a path with these `knots` and ordinates `y`, NaN where
    /// it does not get to.
    ///
    /// `values` has room for [`BLOCK`] more values than there are points.
    #[inline(always)]
    pub(crate) fn interpolate(
        &self,
        knots: &[Knots],
        y: &[f64],
        ordinates: &mut KnotOrdinates,
        values: &mut [f64],
    ) {
        for (k, segment) in self.walks.iter().enumerate() {
            match knots.get(k) {
                Some(knots) => segment.interpolate(knots, y, self.slack, ordinates, values),
                None => segment.uncovered(values),
            }
        }
    }

    /// The knots of a simulated path, branch by branch, into `knots`.
    pub(crate) fn knots_of(&self, sim_x: &[f64], knots: &mut Vec<Knots>) -> Result<(), Error> {
        let branches = self.answering(sim_x)?;
        knots.resize_with(branches.len(), Knots::default);
        for (knots, branch) in knots.iter_mut().zip(branches) {
            knots.collect(sim_x, branch);
        }
        Ok(())
    }

    /// The branches of a simulated path, each of which runs like the measured one of its number.
    fn answering(&self, sim_x: &[f64]) -> Result<Vec<Branch>, Error> {
        let path = Named { name: "sim_x", values: sim_x };
        let branches = curve::cut(path)?;
        curve::correspond(path.name, &branches, self.name, &self.branches)?;
        Ok(branches)
    }

    /// Location of each measured point on a simulated path; `None` where the path does not reach.
    pub(crate) fn positions(&self, sim_x: &[f64]) -> Result<Positions, Error> {
        let mut found = Positions { segments: Vec::new(), points: vec![None; self.n_points] };
        self.knots_of(sim_x, &mut found.segments)?;
        for (k, (knots, segment)) in found.segments.iter().zip(&self.walks).enumerate() {
            let mut before = 0;
            for (point, &s) in found.points[segment.start..].iter_mut().zip(segment.own()) {
                let position = knots.position(s, self.slack, &mut before);
                *point = position.map(|(knot, share)| Position { segment: k, knot, share });
            }
        }
        Ok(found)
    }
}

/// Every measured point's position on a simulated path.
#[derive(Debug, Clone)]
pub(crate) struct Positions {
    /// The knots of each simulated branch.
    pub(crate) segments: Vec<Knots>,
    pub(crate) points: Vec<Option<Position>>,
}

/// A position between two knots of a branch.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Position {
    pub(crate) segment: usize,
    /// The knot before it.
    pub(crate) knot: usize,
    /// Way to the next knot, 0 to 1; 0 at the last one.
    pub(crate) share: f64,
}

impl Segment {
    fn new(x: &[f64], branch: Branch) -> Self {
        let own = branch.own_points();
        let along = |&x: &f64| branch.direction.along(x);
        let mut s: Vec<f64> = x[own.clone()].iter().map(along).collect();
        let index = Index::new(&s);
        s.extend([f64::INFINITY; BLOCK]);
        Self { start: own.start, s, index }
    }

    fn own(&self) -> &[f64] {
        &self.s[..self.s.len() - BLOCK]
    }

    fn uncovered(&self, values: &mut [f64]) {
        values[self.start..][..self.own().len()].fill(f64::NAN);
    }

    #[inline(always)]
    fn interpolate(
        &self,
        knots: &Knots,
        y: &[f64],
        slack: f64,
        KnotOrdinates { y: own, stops }: &mut KnotOrdinates,
        values: &mut [f64],
    ) {
        own.clear();
        own.extend(knots.at.iter().map(|&i| y[i]));
        let knotted = Knotted { s: &knots.s, y: own, slack };
        walk(&self.s, &self.index, knotted, stops, &mut values[self.start..]);
    }
}

/// Knots with their ordinates, and how far beyond them the end values hold.
#[derive(Clone, Copy)]
struct Knotted<'a> {
    s: &'a [f64],
    y: &'a [f64],
    slack: f64,
}

/// Ascending numbers in buckets of equal width, to find a position among them.
#[derive(Debug, Clone)]
struct Index {
    first: f64,
    buckets_per_unit: f64,
    /// Numbers before each bucket; all are before the last one, which is empty.
    before: Vec<usize>,
}

impl Index {
    fn new(s: &[f64]) -> Self {
        let (first, span) = match s {
            [first, .., last] => (*first, last - first),
            _ => (0.0, 0.0),
        };
        let per_unit = real(s.len()) / span;
        let buckets_per_unit = if per_unit.is_finite() { per_unit } else { 0.0 };
        let mut index = Self { first, buckets_per_unit, before: vec![0; s.len() + 2] };
        let mut next = 0;
        for (i, &s) in s.iter().enumerate() {
            let bucket = index.bucket(s);
            while next <= bucket {
                index.before[next] = i;
                next += 1;
            }
        }
        index.before[next..].fill(s.len());
        index
    }

    /// The bucket of `s`: it never falls as `s` grows.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "both saturate")]
    #[inline(always)]
    fn bucket(&self, s: f64) -> usize {
        let last = self.before.len() - 1;
        (((s - self.first) * self.buckets_per_unit) as usize).min(last)
    }

    /// How many of the numbers, which end in infinities, are less than `limit`.
    #[inline(always)]
    fn n_below(&self, s: &[f64], limit: f64) -> usize {
        let bucket = self.bucket(limit);
        let begin = self.before[bucket];
        // Most often there is one number in a bucket; counting two takes no branch.
        let i = begin + usize::from(s[begin] < limit) + usize::from(s[begin + 1] < limit);
        if s[i] < limit { self.n_below_in_bucket(s, limit, bucket) } else { i }
    }

    #[cold]
    fn n_below_in_bucket(&self, s: &[f64], limit: f64, bucket: usize) -> usize {
        let begin = self.before[bucket];
        let end = self.before.get(bucket + 1).copied().unwrap_or(s.len() - BLOCK);
        begin + s[begin..end].partition_point(|s| *s < limit)
    }
}

/// Interpolates at the points `at`, which end in [`BLOCK`] infinities.
#[inline(always)]
fn walk(
    at: &[f64],
    index: &Index,
    Knotted { s, y, slack }: Knotted<'_>,
    stops: &mut Vec<usize>,
    values: &mut [f64],
) {
    let (first, last) = (s[0], s.len() - 1);
    let n_points = at.len() - BLOCK;
    let early = index.n_below(at, first - slack);
    let mut start = index.n_below(at, first);
    values[..early].fill(f64::NAN);
    values[early..start].fill(y[0]);
    stops.clear();
    stops.extend(s[1..].iter().map(|&end| index.n_below(at, end)));
    for (k, &stop) in stops.iter().enumerate() {
        if start < stop {
            let (piece, begin) = (Line::new(s, y, k), s[k]);
            let (mut at, mut values) = (&at[start..], &mut values[start..]);
            let mut left = stop - start;
            while let (Some((block, rest)), Some((out, values_rest))) =
                (at.split_first_chunk::<BLOCK>(), values.split_first_chunk_mut::<BLOCK>())
            {
                *out = block.map(|at| piece.at(at - begin));
                if left <= BLOCK {
                    break;
                }
                left -= BLOCK;
                (at, values) = (rest, values_rest);
            }
        }
        start = stop;
    }
    for (value, &at) in values[start..n_points].iter_mut().zip(&at[start..n_points]) {
        *value = if at <= s[last] + slack { y[last] } else { f64::NAN };
    }
}

/// A straight segment.
struct Line {
    y: f64,
    rise: f64,
    per_width: f64,
}

impl Line {
    #[inline(always)]
    fn new(s: &[f64], y: &[f64], k: usize) -> Self {
        Self { y: y[k], rise: y[k + 1] - y[k], per_width: 1.0 / (s[k + 1] - s[k]) }
    }

    /// Value at a distance behind the first knot.
    #[inline(always)]
    fn at(&self, offset: f64) -> f64 {
        self.y + (offset * self.per_width) * self.rise
    }
}

/// Support points of one simulated branch, strictly ascending along the direction of travel.
#[derive(Debug, Clone, Default)]
pub(crate) struct Knots {
    pub(crate) s: Vec<f64>,
    /// Which points of the path they are.
    pub(crate) at: Vec<usize>,
}

impl Knots {
    /// Keeps the points that advance. Of equal abscissae the last counts, so that the value at a
    /// plateau is the one with which the path moves on, on both sides of a turning point.
    fn collect(&mut self, x: &[f64], branch: Branch) {
        let points = branch.points();
        self.clear();
        self.s.extend(x[points.clone()].iter().map(|&x| branch.direction.along(x)));
        // Counted, not searched for, so that several points are looked at at once.
        let n_still = self.s.windows(2).filter(|pair| pair[1] - pair[0] < LEAST_STEP).count();
        if n_still == 0 {
            self.at.extend(points);
            return;
        }
        self.clear();
        for i in points {
            let s = branch.direction.along(x[i]);
            match (self.s.last(), self.at.last_mut()) {
                (Some(&last), Some(at)) if s - last < LEAST_STEP => *at = i,
                _ => {
                    self.s.push(s);
                    self.at.push(i);
                }
            }
        }
    }

    fn clear(&mut self) {
        self.s.clear();
        self.at.clear();
    }

    /// The knot before `s` (the first one within `slack` before it, the last one within `slack` behind
    /// it), and the way from there to the next.
    ///
    /// `before` is where the previous point was found: measured points come in travel order.
    fn position(&self, s: f64, slack: f64, before: &mut usize) -> Option<(usize, f64)> {
        let knots = &self.s;
        let last = knots.len() - 1;
        if s < knots[0] - slack || s > knots[last] + slack {
            return None;
        }
        let s = s.max(knots[0]);
        if s >= knots[last] {
            return Some((last, 0.0));
        }
        while knots[*before + 1] <= s {
            *before += 1;
        }
        let begin = knots[*before];
        Some((*before, (s - begin) * (1.0 / (knots[*before + 1] - begin))))
    }
}

/// Least distance of two knots; its inverse is finite. Points closer than that are one.
const LEAST_STEP: f64 = f64::MIN_POSITIVE;
