//! The graph of a symmetric pattern, with unknowns that share their neighbours drawn together.
//!
//! The three displacements of a node couple to the same unknowns, so the graph of nodes has all
//! that an ordering needs, with a ninth of the edges.

use std::collections::HashMap;

/// Vertices with weights, and their neighbours: no loops, every edge from both ends.
#[derive(Debug, Clone)]
pub(crate) struct Graph {
    starts: Vec<usize>,
    neighbours: Vec<u32>,
    /// Unknowns of a vertex.
    pub(crate) weights: Vec<u32>,
    /// Number of original edges of an edge, in the order of `neighbours`.
    multiplicities: Vec<u32>,
}

impl Graph {
    pub(crate) fn n(&self) -> usize {
        self.weights.len()
    }

    pub(crate) fn weight(&self) -> u64 {
        self.weights.iter().map(|&w| u64::from(w)).sum()
    }

    pub(crate) fn neighbours(&self, v: usize) -> impl Iterator<Item = usize> + '_ {
        self.neighbours[self.starts[v]..self.starts[v + 1]].iter().map(|&u| u as usize)
    }

    pub(crate) fn edges(&self, v: usize) -> impl Iterator<Item = (usize, u32)> + '_ {
        let range = self.starts[v]..self.starts[v + 1];
        self.neighbours(v).zip(self.multiplicities[range].iter().copied())
    }

    /// Pointers and neighbours, as faer takes them.
    pub(crate) fn compressed(&self) -> (Vec<u32>, Vec<u32>) {
        let starts = self.starts.iter().map(|&start| narrow(start)).collect();
        (starts, self.neighbours.clone())
    }

    /// The graph in which `groups[v]` of `n` new vertices represents v; `None` leaves v out.
    pub(crate) fn quotient(&self, groups: &[Option<u32>], n: usize) -> Self {
        let mut weights = vec![0; n];
        let mut members = vec![Vec::new(); n];
        for (v, group) in groups.iter().enumerate() {
            if let Some(g) = group {
                weights[*g as usize] += self.weights[v];
                members[*g as usize].push(v);
            }
        }
        let mut graph =
            Self { starts: vec![0], neighbours: Vec::new(), weights, multiplicities: Vec::new() };
        let mut place = vec![usize::MAX; n];
        for (g, members) in members.iter().enumerate() {
            let start = graph.neighbours.len();
            for (u, multiplicity) in members.iter().flat_map(|&v| self.edges(v)) {
                let Some(h) = groups[u].filter(|&h| h as usize != g) else { continue };
                let at = &mut place[h as usize];
                if *at == usize::MAX || *at < start {
                    *at = graph.neighbours.len();
                    graph.neighbours.push(h);
                    graph.multiplicities.push(0);
                }
                graph.multiplicities[*at] += multiplicity;
            }
            graph.starts.push(graph.neighbours.len());
        }
        graph
    }
}

/// A graph whose vertices are groups of unknowns with the same neighbours.
pub(crate) struct Compressed {
    pub(crate) graph: Graph,
    /// Unknowns of every vertex.
    pub(crate) members: Vec<Vec<u32>>,
}

impl Compressed {
    /// Reads the lower triangle of an n × n pattern as pairs (row, column).
    pub(crate) fn new(n: usize, entries: impl Iterator<Item = (usize, usize)> + Clone) -> Self {
        let full = full_graph(n, entries);
        let mut representatives: HashMap<Vec<u32>, u32> = HashMap::new();
        let mut groups = Vec::with_capacity(n);
        let mut members: Vec<Vec<u32>> = Vec::new();
        for v in 0..n {
            let mut closed: Vec<u32> = full.neighbours[full.starts[v]..full.starts[v + 1]].to_vec();
            closed.push(narrow(v));
            closed.sort_unstable();
            let next = narrow(members.len());
            let group = *representatives.entry(closed).or_insert(next);
            if group == next {
                members.push(Vec::new());
            }
            members[group as usize].push(narrow(v));
            groups.push(Some(group));
        }
        Self { graph: full.quotient(&groups, members.len()), members }
    }
}

fn full_graph(n: usize, entries: impl Iterator<Item = (usize, usize)> + Clone) -> Graph {
    let entries = entries.filter(|(i, j)| i != j);
    let mut starts = vec![0; n + 1];
    for (i, j) in entries.clone() {
        starts[i + 1] += 1;
        starts[j + 1] += 1;
    }
    (0..n).for_each(|v| starts[v + 1] += starts[v]);
    let mut next = starts.clone();
    let mut neighbours = vec![0; starts[n]];
    for (i, j) in entries {
        neighbours[next[i]] = narrow(j);
        neighbours[next[j]] = narrow(i);
        next[i] += 1;
        next[j] += 1;
    }
    let multiplicities = vec![1; neighbours.len()];
    Graph { starts, neighbours, weights: vec![1; n], multiplicities }
}

/// An index as it is stored; patterns are checked to have fewer than 2³² rows and entries.
#[expect(clippy::cast_possible_truncation, reason = "checked when the pattern was read")]
pub(crate) fn narrow(index: usize) -> u32 {
    index as u32
}
