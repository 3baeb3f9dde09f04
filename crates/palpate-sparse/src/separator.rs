//! Few vertices whose removal leaves two parts of a graph of about equal weight.
//!
//! Multilevel: matched neighbours are drawn together until few are left; a separator is grown
//! there, carried back level by level, and improved on each by moving vertices out of it
//! (Fiduccia and Mattheyses 1982; Karypis and Kumar 1998).

use std::collections::BinaryHeap;

use crate::graph::{Graph, narrow};

/// Where a vertex is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    Left,
    Right,
    Between,
}

impl Side {
    fn other(self) -> Self {
        if self == Self::Left { Self::Right } else { Self::Left }
    }
}

/// Vertices of the coarsest graph.
const COARSEST: usize = 120;

/// Starts for the separator of the coarsest graph.
const TRIALS: usize = 8;

/// Sweeps of improvement on every level.
const SWEEPS: usize = 6;

/// Moves without improvement after which a pass ends.
const PATIENCE: usize = 150;

/// Largest part of the weight on one side.
const LARGEST_PERCENTAGE: i64 = 60;

/// Separators tried, each over its own matchings; fewer for a graph of at most [`MIDDLING`] vertices.
const TRIES: usize = 8;
const FEW_TRIES: usize = 2;
const MIDDLING: usize = 1000;

/// The side of every vertex; no edge joins left and right.
pub(crate) fn separate(graph: &Graph) -> Vec<Side> {
    let n_tries = if graph.n() > MIDDLING { TRIES } else { FEW_TRIES };
    let tries = (0..n_tries).map(|seed| multilevel(graph, seed));
    tries.min_by_key(Separation::cost).map(|best| best.sides).unwrap_or_default()
}

fn multilevel(graph: &Graph, seed: usize) -> Separation<'_> {
    let mut separation = if graph.n() <= COARSEST {
        grown(graph, seed)
    } else {
        let (groups, n) = matching(graph, seed);
        let coarse = graph.quotient(&groups, n);
        // If nothing matches any more, as in a star, coarsening ends.
        let ended = n * 20 > graph.n() * 19;
        let coarse = if ended { grown(&coarse, seed) } else { multilevel(&coarse, seed) };
        let sides = coarse.sides;
        let side = |group: &Option<u32>| group.map_or(Side::Between, |g| sides[g as usize]);
        Separation::new(graph, groups.iter().map(side).collect())
    };
    separation.improve();
    separation
}

/// Groups of one or two neighbours, those with the strongest edge first; and their number.
fn matching(graph: &Graph, seed: usize) -> (Vec<Option<u32>>, usize) {
    let most = 3 * graph.weight() / (2 * COARSEST as u64);
    let mut groups = vec![None; graph.n()];
    let mut order: Vec<usize> = (0..graph.n()).collect();
    order.sort_by_key(|&v| (graph.neighbours(v).count(), scrambled(v + seed)));
    let mut n = 0;
    for v in order {
        if groups[v].is_some() {
            continue;
        }
        let light = |u: usize| u64::from(graph.weights[u]) + u64::from(graph.weights[v]) <= most;
        let free = graph.edges(v).filter(|&(u, _)| groups[u].is_none() && light(u));
        if let Some((u, _)) = free.max_by_key(|&(u, strength)| (strength, scrambled(u + seed))) {
            groups[u] = Some(narrow(n));
        }
        groups[v] = Some(narrow(n));
        n += 1;
    }
    (groups, n)
}

/// The best of several separators, each the rim of a region grown from one vertex to half the weight.
fn grown(graph: &Graph, seed: usize) -> Separation<'_> {
    let trial = |trial: usize| {
        let seed = TRIALS * seed + trial;
        let mut separation = Separation::new(graph, region(graph, scrambled(seed) % graph.n()));
        separation.improve();
        separation
    };
    let mut best = trial(0);
    for other in (1..TRIALS).map(trial) {
        if other.cost() < best.cost() {
            best = other;
        }
    }
    best
}

fn region(graph: &Graph, seed: usize) -> Vec<Side> {
    let mut sides = vec![Side::Right; graph.n()];
    let mut queue = std::collections::VecDeque::from([seed]);
    let mut queued = vec![false; graph.n()];
    queued[seed] = true;
    let (mut weight, half) = (0, graph.weight() / 2);
    while let Some(v) = queue.pop_front() {
        if weight >= half {
            break;
        }
        sides[v] = Side::Left;
        weight += u64::from(graph.weights[v]);
        for u in graph.neighbours(v) {
            if !std::mem::replace(&mut queued[u], true) {
                queue.push_back(u);
            }
        }
    }
    let touches = |v: usize| graph.neighbours(v).any(|u| sides[u] == Side::Right);
    let rim: Vec<usize> =
        (0..graph.n()).filter(|&v| sides[v] == Side::Left && touches(v)).collect();
    for v in rim {
        sides[v] = Side::Between;
    }
    sides
}

/// Sides of a graph's vertices, with the weights that they add up to.
struct Separation<'a> {
    graph: &'a Graph,
    sides: Vec<Side>,
    left: i64,
    right: i64,
    between: i64,
    most: i64,
    /// Weight of every vertex's neighbours on the left and on the right.
    side_weights: Vec<[i64; 2]>,
}

impl<'a> Separation<'a> {
    fn new(graph: &'a Graph, sides: Vec<Side>) -> Self {
        let on = |side| -> i64 {
            let there = sides.iter().zip(&graph.weights).filter(|(s, _)| **s == side);
            there.map(|(_, w)| i64::from(*w)).sum()
        };
        let (left, right, between) = (on(Side::Left), on(Side::Right), on(Side::Between));
        let most = (left + right + between) * LARGEST_PERCENTAGE / 100;
        let side_weights = vec![[0; 2]; graph.n()];
        let mut separation = Self { graph, sides, left, right, between, most, side_weights };
        for v in 0..graph.n() {
            separation.tell_neighbours(v, i64::from(graph.weights[v]));
        }
        separation
    }

    /// Objective: excess weight of a side first, then the separator, then the imbalance.
    fn cost(&self) -> (i64, i64, i64) {
        let heavier = self.left.max(self.right);
        ((heavier - self.most).max(0), self.between, heavier)
    }

    fn improve(&mut self) {
        for _ in 0..SWEEPS {
            if !self.sweep() {
                break;
            }
        }
    }

    /// Decrease of the separator's weight when `v` moves to `side` and its other neighbours join.
    fn gain(&self, v: usize, side: Side) -> i64 {
        let drawn = self.side_weights[v][usize::from(side == Side::Left)];
        i64::from(self.graph.weights[v]) - drawn
    }

    /// Adds `weight` to what the neighbours of `v` have on its side.
    fn tell_neighbours(&mut self, v: usize, weight: i64) {
        if self.sides[v] != Side::Between {
            let place = usize::from(self.sides[v] == Side::Right);
            self.graph.neighbours(v).for_each(|u| self.side_weights[u][place] += weight);
        }
    }

    fn put(&mut self, v: usize, side: Side) {
        let weight = i64::from(self.graph.weights[v]);
        *self.total(self.sides[v]) -= weight;
        *self.total(side) += weight;
        self.tell_neighbours(v, -weight);
        self.sides[v] = side;
        self.tell_neighbours(v, weight);
    }

    fn total(&mut self, side: Side) -> &mut i64 {
        match side {
            Side::Left => &mut self.left,
            Side::Right => &mut self.right,
            Side::Between => &mut self.between,
        }
    }

    /// Moves every vertex at most once, best first, and keeps the best state; returns whether it improved.
    fn sweep(&mut self) -> bool {
        let before = self.cost();
        let mut best = before;
        let mut undo: Vec<(usize, Side)> = Vec::new();
        let (mut kept, mut idle) = (0, 0);
        let mut moved = vec![false; self.graph.n()];
        let mut queue = BinaryHeap::new();
        for v in 0..self.graph.n() {
            if self.sides[v] == Side::Between {
                self.offer(&mut queue, v, Side::Left);
                self.offer(&mut queue, v, Side::Right);
            }
        }
        while let Some((gain, _, v, to_left)) = queue.pop() {
            let side = if to_left { Side::Left } else { Side::Right };
            if moved[v] || self.sides[v] != Side::Between {
                continue;
            }
            // Gains that fell are found out here; those that rose were offered again.
            if gain > self.gain(v, side) {
                self.offer(&mut queue, v, side);
                continue;
            }
            if self.too_heavy(v, side) {
                continue;
            }
            moved[v] = true;
            self.shift(v, side, &mut undo, &mut queue, &moved);
            idle += 1;
            if self.cost() < best {
                (best, kept, idle) = (self.cost(), undo.len(), 0);
            }
            if idle > PATIENCE {
                break;
            }
        }
        for (v, side) in undo.drain(kept..).rev() {
            self.put(v, side);
        }
        best < before
    }

    fn too_heavy(&self, v: usize, side: Side) -> bool {
        let weight = i64::from(self.graph.weights[v]);
        let (here, there) =
            if side == Side::Left { (self.left, self.right) } else { (self.right, self.left) };
        here + weight > self.most.max(there)
    }

    /// Moves `v` out of the separator and its neighbours beyond into it.
    fn shift(
        &mut self,
        v: usize,
        side: Side,
        undo: &mut Vec<(usize, Side)>,
        queue: &mut BinaryHeap<Offer>,
        moved: &[bool],
    ) {
        undo.push((v, Side::Between));
        self.put(v, side);
        let graph = self.graph;
        for u in graph.neighbours(v) {
            if self.sides[u] == side.other() {
                undo.push((u, side.other()));
                self.put(u, Side::Between);
                if !moved[u] {
                    self.offer(queue, u, Side::Left);
                    self.offer(queue, u, Side::Right);
                }
                // Vertices next to u have one neighbour fewer on the other side.
                for w in graph.neighbours(u) {
                    if self.sides[w] == Side::Between && !moved[w] {
                        self.offer(queue, w, side);
                    }
                }
            }
        }
    }

    fn offer(&self, queue: &mut BinaryHeap<Offer>, v: usize, side: Side) {
        queue.push((self.gain(v, side), scrambled(v) % 1024, v, side == Side::Left));
    }
}

/// Gain, tie breaker, vertex, and whether it goes left.
type Offer = (i64, usize, usize, bool);

/// A number without relation to its neighbours', the same every time (SplitMix64).
fn scrambled(v: usize) -> usize {
    let mut z = (v as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    short(z >> 40)
}

/// Of 24 bits.
#[expect(clippy::cast_possible_truncation, reason = "24 bits fit any usize")]
fn short(number: u64) -> usize {
    number as usize
}
