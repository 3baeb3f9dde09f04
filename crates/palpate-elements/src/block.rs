//! Elements of one kind, packed for the kernels.

use std::array::from_fn;
use std::sync::Arc;

use pulp::Arch;

use crate::deformation::{Deform, Deformation};
use crate::error::Error;
use crate::lanes::{Lanes, Triple, WIDTH, ZERO};

/// How many elements, quadrature points and nodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Elements of the block.
    pub elements: usize,
    /// Quadrature points of each element.
    pub points: usize,
    /// Nodes of each element.
    pub nodes: usize,
}

impl Shape {
    /// Rows and columns of an element's stiffness.
    #[must_use]
    pub fn freedoms(self) -> usize {
        3 * self.nodes
    }

    pub(crate) fn groups(self) -> usize {
        self.elements.div_ceil(WIDTH)
    }

    /// The elements of a group; the last group repeats its last element.
    pub(crate) fn members(self, group: usize) -> [usize; WIDTH] {
        from_fn(|lane| (group * WIDTH + lane).min(self.elements - 1))
    }

    /// How many elements of a group are no repetition.
    pub(crate) fn width(self, group: usize) -> usize {
        WIDTH.min(self.elements - group * WIDTH)
    }
}

/// Where the three by three entries of a pair of nodes go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Place {
    first: u32,
    /// From one row to the next; 0 if all nine entries go to `first`.
    stride: u32,
}

impl Place {
    /// Of rows of places, if each has three in sequence at one distance from the next, or all are the same.
    fn of(rows: [[u32; 3]; 3]) -> Option<Self> {
        let first = rows[0][0];
        let stride = rows[1][0].checked_sub(first)?;
        let step = u32::from(stride > 0);
        let after =
            |start: u32, by: u32| [Some(start), start.checked_add(by), start.checked_add(2 * by)];
        let starts = after(first, stride);
        let follows = rows
            .iter()
            .zip(starts)
            .all(|(row, start)| start.is_some_and(|start| row.map(Some) == after(start, step)));
        follows.then_some(Self { first, stride })
    }

    /// Adds the entries of the pair to sparse values.
    #[inline(always)]
    pub(crate) fn add(self, entries: &[[f64; 3]; 3], values: &mut [f64]) {
        let (first, stride) = (self.first as usize, self.stride as usize);
        if stride == 0 {
            entries.iter().flatten().for_each(|entry| values[first] += entry);
            return;
        }
        for (i, row) in entries.iter().enumerate() {
            let start = first + i * stride;
            for (value, entry) in values[start..start + 3].iter_mut().zip(row) {
                *value += entry;
            }
        }
    }
}

/// Elements of one kind with their reference geometry.
///
/// # Examples
/// A tetrahedron with one quadrature point, pulled to 1.1 times its length along x:
/// ```
/// use std::sync::Arc;
/// use palpate_elements::{ElementBlock, Shape};
/// let gradients = [-1., -1., -1., 1., 0., 0., 0., 1., 0., 0., 0., 1.];
/// let shape = Shape { elements: 1, points: 1, nodes: 4 };
/// let block = ElementBlock::new(shape, &[0, 1, 2, 3], &gradients, &[1. / 6.], false, None)?;
/// let pulled = [0., 0., 0., 0.1, 0., 0., 0., 0., 0., 0., 0., 0.];
/// let deformation = Arc::new(block).deform(&pulled)?;
/// assert!((deformation.least_jacobian() - 1.1).abs() < 1e-15);
/// let mut stretches = deformation.stretches();
/// stretches.sort_by(f64::total_cmp);
/// assert!((stretches[2] - 1.1).abs() < 1e-15);
/// # Ok::<(), palpate_elements::Error>(())
/// ```
#[derive(Debug)]
pub struct ElementBlock {
    pub(crate) shape: Shape,
    pub(crate) mean_dilatation: bool,
    /// Nodes of each element.
    pub(crate) nodes: Vec<u32>,
    /// By group, point and node.
    pub(crate) gradients: Vec<Triple>,
    /// By group and point.
    pub(crate) volumes: Vec<Lanes>,
    /// Places of the pairs of nodes of each element, by rows; empty if there are none.
    pub(crate) places: Vec<Place>,
    last_node: usize,
    last_place: usize,
}

impl ElementBlock {
    /// Packs elements.
    ///
    /// `nodes` (e, n); `gradients` (e, q, n, 3) of the shape functions in the reference
    /// configuration \[1/mm\]; `volumes` (e, q), quadrature weight times reference Jacobian
    /// \[mm³\], 0 for a point that only pads; `places` (e, 3n, 3n), where each entry of the
    /// stiffness goes in the values of a sparse matrix: those of two nodes in three rows of three in
    /// sequence, at one distance, or all in one place.
    ///
    /// # Errors
    /// [`Error`] if the arrays do not fit one another or a value makes no sense.
    pub fn new(
        shape: Shape,
        nodes: &[i64],
        gradients: &[f64],
        volumes: &[f64],
        mean_dilatation: bool,
        places: Option<&[i64]>,
    ) -> Result<Self, Error> {
        let Shape { elements, points, nodes: n } = shape;
        if elements * points * n == 0 {
            return Err(Error::Empty { elements, points, nodes: n });
        }
        length("nodes", nodes, elements * n)?;
        length("gradients", gradients, elements * points * n * 3)?;
        length("volumes", volumes, elements * points)?;
        check_geometry(shape, gradients, volumes)?;
        let entries = shape.freedoms() * shape.freedoms();
        if let Some(places) = places {
            length("places", places, elements * entries)?;
        }
        let nodes = indices("nodes", nodes, n)?;
        let places = indices("places", places.unwrap_or_default(), entries)?;
        let last_place = largest(&places);
        let places = pairs(&places, n)?;
        Ok(Self {
            shape,
            mean_dilatation,
            last_node: largest(&nodes),
            last_place,
            gradients: packed(shape, points * n, gradients),
            volumes: packed::<1>(shape, points, volumes).into_iter().map(|[v]| v).collect(),
            nodes,
            places,
        })
    }

    /// How many elements, points and nodes there are.
    #[must_use]
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// The deformation at every quadrature point, for displacements (`n_nodes`, 3) \[mm\].
    ///
    /// # Errors
    /// [`Error`] if the displacements are not three for every node in use.
    pub fn deform(self: Arc<Self>, displacements: &[f64]) -> Result<Deformation, Error> {
        self.check_nodes("displacements", displacements)?;
        Ok(Arch::new().dispatch(Deform { block: self, displacements }))
    }

    pub(crate) fn check_nodes(&self, array: &'static str, values: &[f64]) -> Result<(), Error> {
        let n_nodes = values.len() / 3;
        length(array, values, 3 * n_nodes)?;
        reaches(array, n_nodes, self.last_node)
    }

    pub(crate) fn check_entries(&self, array: &'static str, values: &[f64]) -> Result<(), Error> {
        if self.places.is_empty() {
            return Err(Error::NoPlaces);
        }
        reaches(array, values.len(), self.last_place)
    }

    /// The pairs of nodes (n, n) of an element in the sparse values.
    pub(crate) fn places_of(&self, element: usize) -> &[Place] {
        let pairs = self.shape.nodes * self.shape.nodes;
        &self.places[element * pairs..(element + 1) * pairs]
    }

    pub(crate) fn nodes_of(&self, element: usize) -> &[u32] {
        &self.nodes[element * self.shape.nodes..(element + 1) * self.shape.nodes]
    }

    pub(crate) fn volumes_of(&self, group: usize) -> &[Lanes] {
        &self.volumes[group * self.shape.points..(group + 1) * self.shape.points]
    }

    /// Gradients of a group's nodes at one point.
    pub(crate) fn gradients_at(&self, group: usize, point: usize) -> &[Triple] {
        let start = (group * self.shape.points + point) * self.shape.nodes;
        &self.gradients[start..start + self.shape.nodes]
    }
}

/// Checks that an array has as many values as expected.
pub(crate) fn length<T>(array: &'static str, values: &[T], expected: usize) -> Result<(), Error> {
    match values.len() {
        length if length == expected => Ok(()),
        length => Err(Error::Length { array, length, expected }),
    }
}

fn reaches(array: &'static str, length: usize, index: usize) -> Result<(), Error> {
    if index < length { Ok(()) } else { Err(Error::TooShort { array, length, index }) }
}

fn check_geometry(shape: Shape, gradients: &[f64], volumes: &[f64]) -> Result<(), Error> {
    let of_element = gradients.len() / shape.elements;
    if let Some(k) = gradients.iter().position(|g| !g.is_finite()) {
        return Err(Error::Gradient { element: k / of_element, value: gradients[k] });
    }
    for (element, own) in volumes.chunks_exact(shape.points).enumerate() {
        let bad = own.iter().copied().find(|v| !(v.is_finite() && *v >= 0.0));
        let total: f64 = own.iter().sum();
        if let Some(value) = bad.or((total <= 0.0).then_some(total)) {
            return Err(Error::Volume { element, value });
        }
    }
    Ok(())
}

fn indices(array: &'static str, values: &[i64], of_element: usize) -> Result<Vec<u32>, Error> {
    let narrow = |(k, &value): (usize, &i64)| {
        u32::try_from(value).map_err(|_| Error::Index { array, element: k / of_element, value })
    };
    values.iter().enumerate().map(narrow).collect()
}

/// Places of each pair of nodes from those of each entry (elements, 3n, 3n).
fn pairs(places: &[u32], n: usize) -> Result<Vec<Place>, Error> {
    let freedoms = 3 * n;
    let mut pairs = Vec::with_capacity(places.len() / 9);
    for (element, own) in places.chunks_exact(freedoms * freedoms).enumerate() {
        for (a, b) in (0..n * n).map(|pair| (pair / n, pair % n)) {
            let at = |i: usize, k: usize| own[(3 * a + i) * freedoms + 3 * b + k];
            let place = Place::of(from_fn(|i| from_fn(|k| at(i, k))));
            pairs.push(place.ok_or(Error::Places { element, row: 3 * a, column: 3 * b })?);
        }
    }
    Ok(pairs)
}

fn largest(indices: &[u32]) -> usize {
    indices.iter().max().map_or(0, |&index| index as usize)
}

/// Values (elements, items, N) by group and item.
fn packed<const N: usize>(shape: Shape, items: usize, values: &[f64]) -> Vec<[Lanes; N]> {
    (0..shape.groups())
        .flat_map(|group| {
            let members = shape.members(group);
            (0..items).map(move |item| gathered(values, members.map(|e| e * items + item)))
        })
        .collect()
}

/// `N` numbers of each row given.
#[inline(always)]
pub(crate) fn gathered<const N: usize>(values: &[f64], rows: [usize; WIDTH]) -> [Lanes; N] {
    let mut result = [ZERO; N];
    for (lane, row) in rows.into_iter().enumerate() {
        let own = &values[row * N..(row + 1) * N];
        for (entry, value) in result.iter_mut().zip(own) {
            entry.0[lane] = *value;
        }
    }
    result
}
