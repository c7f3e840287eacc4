//! Closed triangle meshes that rays are cut with: entry and exit points of a line, in `f64`.
//!
//! A mesh is closed if an even number of triangles meets in every edge. Every line then crosses it an even number of
//! times. The parts of the line between crossings 1 and 2, 3 and 4, and so on are inside.
//!
//! This must also hold for lines through edges and vertices; otherwise a pixel would show a region that is cut away.
//! Crossings are therefore decided in the plane across the line, as in Woop, Benthin and Wald 2013 ("Watertight
//! ray/triangle intersection"). In addition, signs are exact, and points on an edge are moved to one side (Edelsbrunner
//! and Mücke 1990, "Simulation of simplicity"). So adjacent triangles always agree.
//!
//! Triangles are stored in a tree of boxes; each box is halved along its longest side. Boxes are slightly larger than
//! their content, so that rounding never misses a triangle. Existing crates find only the first hit, work in `f32`, or
//! lose edges.

use std::collections::HashMap;

use glam::DVec3;

use supervol_format::cast::narrow;

use super::interval::clip_slab;

/// Most triangles of a mesh; a triangle takes about 90 bytes.
pub const TRIANGLE_LIMIT: usize = 1 << 20;
/// Most triangles of a leaf of the tree.
const LEAF_TRIANGLES: usize = 4;
/// Margin of the tree's boxes, as a share of the mesh's diagonal: far greater than rounding errors.
const BOX_MARGIN: f64 = 1e-9;
/// Depth, as a share of the mesh's diagonal, up to which a crossing of two triangles is taken for a rounding error and
/// accepted.
const CROSSING_DEPTH: f64 = 1e-6;
/// Most pairs of triangles with overlapping boxes that are checked for crossings, per triangle.
const PAIRS_PER_TRIANGLE: usize = 512;

/// Reason why triangles are no closed mesh. Points are in the file's coordinates.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum MeshError {
    #[error("expected triangles, found none that has an area")]
    Empty,
    #[error("expected at most {TRIANGLE_LIMIT} triangles, found more; take a coarser mesh")]
    TooLarge,
    #[error("expected finite coordinates, found {found} of vertex {vertex}")]
    NotFinite { vertex: usize, found: DVec3 },
    #[error("expected numbers of the {vertices} vertices, found {found} in triangle {triangle}")]
    NoSuchVertex { triangle: usize, found: u64, vertices: usize },
    #[error(
        "expected a closed mesh, found an open edge from {from} to {to}: {triangles} triangle(s) meet there; close its holes \
         (a surface that leaves the volume is open where it does)"
    )]
    Open { from: DVec3, to: DVec3, triangles: usize },
    #[error("expected a mesh that does not cross itself, found two triangles that do, near {near}")]
    CrossesItself { near: DVec3 },
    #[error("expected triangles side by side, found far too many in one place, near {near}")]
    TooDense { near: DVec3 },
}

/// A closed mesh with its tree; see the module.
#[derive(Debug, Clone, PartialEq)]
pub struct ClosedMesh {
    vertices: Vec<DVec3>,
    /// Indices of vertices, in the order of the tree's leaves.
    triangles: Vec<[u32; 3]>,
    /// The first is the root; the two children of a node are adjacent.
    nodes: Vec<Node>,
    middle: DVec3,
}

/// A box of the tree with its content.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Node {
    low: DVec3,
    high: DVec3,
    /// Index of the first of its triangles, or of its two children.
    first: u32,
    /// Number of triangles; 0 for a node with children.
    count: u32,
}

impl ClosedMesh {
    /// A mesh of vertices and of triangles given by vertex indices. Vertices at the same position are merged; triangles
    /// without an area are dropped.
    ///
    /// # Errors
    /// If the mesh is not closed, crosses itself, is empty or too large, or has an index that is no vertex.
    pub fn new(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Result<Self, MeshError> {
        if triangles.len() > TRIANGLE_LIMIT {
            return Err(MeshError::TooLarge);
        }
        let (vertices, triangles) = merge_vertices(vertices, triangles)?;
        check_closed(&vertices, &triangles)?;
        let (low, high) = bounds(&vertices);
        let margin = DVec3::splat(BOX_MARGIN * (high - low).length());
        let middle = low + 0.5 * (high - low);
        let mut mesh = Self { vertices, triangles, nodes: Vec::new(), middle };
        mesh.build(margin);
        mesh.check_crossings(CROSSING_DEPTH * (high - low).length())?;
        Ok(mesh)
    }

    /// Bytes of memory.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let parts = [size_of_val(&self.vertices[..]), size_of_val(&self.triangles[..]), size_of_val(&self.nodes[..])];
        parts.iter().map(|&bytes| bytes as u64).sum()
    }

    /// Number of triangles, without those that have no area.
    #[must_use]
    pub fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    /// The t at which the line `origin + t * direction` crosses the mesh, ascending. Their number is always even.
    #[must_use]
    pub fn crossings(&self, origin: DVec3, direction: DVec3) -> Vec<f64> {
        let mut found: Vec<f64> = Vec::new();
        self.cross(origin, direction, |t, _| found.push(t));
        found.sort_by(f64::total_cmp);
        debug_assert!(found.len().is_multiple_of(2), "{} crossings of a closed mesh", found.len());
        found
    }

    /// The same t, each with the unit normal of the triangle that is crossed; zero if that has no area.
    #[must_use]
    pub fn faces(&self, origin: DVec3, direction: DVec3) -> Vec<(f64, DVec3)> {
        let mut found = Vec::new();
        self.cross(origin, direction, |t, [a, b, c]| found.push((t, (b - a).cross(c - a).normalize_or_zero())));
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        found
    }

    /// Calls `found` for every triangle that a line crosses, with t and its corners, in no order.
    fn cross(&self, origin: DVec3, direction: DVec3, mut found: impl FnMut(f64, [DVec3; 3])) {
        // Start near the mesh's middle, so that a distant eye costs no precision.
        let start = (self.middle - origin).dot(direction) / direction.length_squared();
        let Some(line) = Line::new(origin + start * direction, direction) else { return };
        let mut stack = vec![0];
        while let Some(node) = stack.pop() {
            let node = &self.nodes[node as usize];
            if !line.meets(node) {
                continue;
            }
            let first = node.first as usize;
            if node.count == 0 {
                stack.extend([node.first, node.first + 1]);
            }
            for triangle in &self.triangles[first..first + node.count as usize] {
                let corners = self.corners(*triangle);
                if let Some(t) = line.crossing(corners) {
                    found(start + t, corners);
                }
            }
        }
    }

    /// Whether a triangle may reach into the box between two corners. The answer `false` is certain.
    #[must_use]
    pub fn may_enter(&self, low: DVec3, high: DVec3) -> bool {
        let mut stack = vec![0];
        while let Some(node) = stack.pop() {
            let node = &self.nodes[node as usize];
            if (node.low.cmpgt(high) | node.high.cmplt(low)).any() {
                continue;
            }
            let mut triangles = self.triangles[node.first as usize..].iter().take(node.count as usize);
            let may_enter = |corners: [DVec3; 3]| {
                let (least, greatest) = bounds(&corners);
                !(least.cmpgt(high) | greatest.cmplt(low)).any()
            };
            if triangles.any(|t| may_enter(self.corners(*t))) {
                return true;
            }
            if node.count == 0 {
                stack.extend([node.first, node.first + 1]);
            }
        }
        false
    }

    fn corners(&self, triangle: [u32; 3]) -> [DVec3; 3] {
        let [a, b, c] = triangle;
        [self.vertices[a as usize], self.vertices[b as usize], self.vertices[c as usize]]
    }

    /// Builds the tree and sorts the triangles in the order of its leaves.
    fn build(&mut self, margin: DVec3) {
        let mut triangles = std::mem::take(&mut self.triangles);
        let placeholder = Node { low: DVec3::ZERO, high: DVec3::ZERO, first: 0, count: 0 };
        self.nodes.push(placeholder);
        let mut stack = vec![(0, 0..triangles.len())];
        while let Some((node, range)) = stack.pop() {
            let part = &mut triangles[range.clone()];
            let (low, high) = bounds_of(part.iter().flat_map(|t| self.corners(*t)));
            let (low, high) = (low - margin, high + margin);
            if part.len() <= LEAF_TRIANGLES {
                self.nodes[node] =
                    Node { low, high, first: narrow::<u32>(range.start), count: narrow::<u32>(part.len()) };
                continue;
            }
            let size = (high - low).to_array();
            let axis = (0..3).fold(0, |longest, a| if size[a] > size[longest] { a } else { longest });
            let middle = part.len() / 2;
            let place = |t: &[u32; 3]| self.corners(*t).map(|corner| corner[axis]).iter().sum::<f64>();
            part.select_nth_unstable_by(middle, |a, b| place(a).total_cmp(&place(b)));
            let first = self.nodes.len();
            self.nodes.extend([placeholder; 2]);
            self.nodes[node] = Node { low, high, first: narrow::<u32>(first), count: 0 };
            stack.push((first, range.start..range.start + middle));
            stack.push((first + 1, range.start + middle..range.end));
        }
        self.triangles = triangles;
    }

    /// Refuses meshes in which two triangles cross each other.
    fn check_crossings(&self, depth: f64) -> Result<(), MeshError> {
        let mut pairs_left = PAIRS_PER_TRIANGLE * self.triangles.len();
        let mut stack = Vec::new();
        for (number, &triangle) in self.triangles.iter().enumerate() {
            let corners = self.corners(triangle);
            let (low, high) = bounds(&corners);
            stack.push(0);
            while let Some(node) = stack.pop() {
                let node = &self.nodes[node as usize];
                if (node.low.cmpgt(high) | node.high.cmplt(low)).any() {
                    continue;
                }
                if node.count == 0 {
                    stack.extend([node.first, node.first + 1]);
                    continue;
                }
                for other in (node.first as usize..(node.first + node.count) as usize).filter(|&n| n > number) {
                    let pair = [triangle, self.triangles[other]];
                    if let Some(near) = pair_crossing(pair, pair.map(|t| self.corners(t)), depth) {
                        return Err(MeshError::CrossesItself { near });
                    }
                    pairs_left = pairs_left.checked_sub(1).ok_or(MeshError::TooDense { near: corners[0] })?;
                }
            }
        }
        Ok(())
    }
}

/// Merges vertices at the same position and drops triangles with fewer than three different vertices.
fn merge_vertices(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Result<(Vec<DVec3>, Vec<[u32; 3]>), MeshError> {
    let mut kept: Vec<DVec3> = Vec::new();
    let mut number_of: HashMap<[u64; 3], u32> = HashMap::new();
    let mut numbers = Vec::with_capacity(vertices.len());
    for (vertex, &found) in vertices.iter().enumerate() {
        if !found.is_finite() {
            return Err(MeshError::NotFinite { vertex, found });
        }
        // Zero has two signs but is one position.
        let bits = found.to_array().map(|x| (x + 0.0).to_bits());
        let next = narrow::<u32>(kept.len());
        let number = *number_of.entry(bits).or_insert(next);
        if number == next {
            kept.push(found);
        }
        numbers.push(number);
    }
    let mut different = Vec::with_capacity(triangles.len());
    for (triangle, corners) in triangles.iter().enumerate() {
        let number = |found: u32| {
            let vertices = vertices.len();
            let refused = MeshError::NoSuchVertex { triangle, found: found.into(), vertices };
            numbers.get(found as usize).copied().ok_or(refused)
        };
        let corners = [number(corners[0])?, number(corners[1])?, number(corners[2])?];
        if corners[0] != corners[1] && corners[1] != corners[2] && corners[2] != corners[0] {
            different.push(corners);
        }
    }
    if different.is_empty() { Err(MeshError::Empty) } else { Ok((kept, different)) }
}

/// Refuses meshes with an edge in which an odd number of triangles meets.
fn check_closed(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Result<(), MeshError> {
    let edge = |t: &[u32; 3], i: usize| [t[i].min(t[(i + 1) % 3]), t[i].max(t[(i + 1) % 3])];
    let mut edges: Vec<[u32; 2]> = triangles.iter().flat_map(|t| [0, 1, 2].map(|i| edge(t, i))).collect();
    edges.sort_unstable();
    let open = edges.chunk_by(|a, b| a == b).find(|same| !same.len().is_multiple_of(2));
    open.map_or(Ok(()), |same| {
        let [from, to] = same[0].map(|vertex| vertices[vertex as usize]);
        Err(MeshError::Open { from, to, triangles: same.len() })
    })
}

fn bounds(points: &[DVec3]) -> (DVec3, DVec3) {
    bounds_of(points.iter().copied())
}

fn bounds_of(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    let nothing = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    points.fold(nothing, |(low, high), point| (low.min(point), high.max(point)))
}

/// A point in which an edge of one triangle crosses the other triangle. Edges that end at a common corner are ignored.
fn pair_crossing(pair: [[u32; 3]; 2], corners: [[DVec3; 3]; 2], depth: f64) -> Option<DVec3> {
    (0..2).find_map(|one| {
        let (triangle, edges) = (corners[1 - one], corners[one]);
        (0..3).find_map(|i| {
            let ends = [i, (i + 1) % 3];
            let is_shared = ends.iter().any(|&end| pair[1 - one].contains(&pair[one][end]));
            if is_shared { None } else { segment_crossing(ends.map(|end| edges[end]), triangle, depth) }
        })
    })
}

/// The point in which a line segment crosses a triangle, if both its ends lie at least `depth` away from the plane.
fn segment_crossing([p, q]: [DVec3; 2], [a, b, c]: [DVec3; 3], depth: f64) -> Option<DVec3> {
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let [before, after] = [normal.dot(p - a), normal.dot(q - a)];
    if before.abs() < depth || after.abs() < depth || before * after >= 0.0 {
        return None;
    }
    let at = p + before / (before - after) * (q - p);
    let sides = [(a, b), (b, c), (c, a)].map(|(from, to)| normal.dot((to - from).cross(at - from)));
    sides.iter().all(|side| *side > 0.0).then_some(at)
}

/// A line with coordinates in its own frame: x and y across it, z along it.
struct Line {
    origin: DVec3,
    direction: DVec3,
    axes: [usize; 3],
    /// Change of x and y per step along the third axis.
    shear: [f64; 2],
}

impl Line {
    fn new(origin: DVec3, direction: DVec3) -> Option<Self> {
        let sizes = direction.abs().to_array();
        let z = (0..3).fold(0, |largest, a| if sizes[a] > sizes[largest] { a } else { largest });
        let axes = [(z + 1) % 3, (z + 2) % 3, z];
        let along = direction[z];
        let shear = [direction[axes[0]] / along, direction[axes[1]] / along];
        (along != 0.0 && origin.is_finite()).then_some(Self { origin, direction, axes, shear })
    }

    fn meets(&self, node: &Node) -> bool {
        let everywhere = (f64::NEG_INFINITY, f64::INFINITY);
        let clip = |span, a: usize| clip_slab(self.origin[a], self.direction[a], node.low[a], node.high[a], span);
        (0..3).try_fold(everywhere, clip).is_some()
    }

    /// The t at which the line crosses a triangle.
    fn crossing(&self, corners: [DVec3; 3]) -> Option<f64> {
        // Depends on the vertex alone: the same result for every triangle that shares it.
        let across = |corner: DVec3| {
            let from = corner - self.origin;
            let z = from[self.axes[2]];
            [from[self.axes[0]] - self.shear[0] * z, from[self.axes[1]] - self.shear[1] * z, z]
        };
        let (a, b, c) = (across(corners[0]), across(corners[1]), across(corners[2]));
        let [first, second, third] = [side(b, c), side(c, a), side(a, b)];
        if first != second || second != third {
            return None;
        }
        let weights = [cross(b, c), cross(c, a), cross(a, b)];
        let sum: f64 = weights.iter().sum();
        let along = self.direction[self.axes[2]];
        let depths = [a[2] / along, b[2] / along, c[2] / along];
        let mean = depths.iter().sum::<f64>() / 3.0;
        let t: f64 = (0..3).map(|i| weights[i] * depths[i]).sum::<f64>() / sum;
        let [nearest, farthest] =
            [depths.iter().copied().fold(mean, f64::min), depths.iter().copied().fold(mean, f64::max)];
        Some(if t.is_nan() { mean } else { t.clamp(nearest, farthest) })
    }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

/// The side of the edge from a to b on which zero lies, exactly. Zero never lies on the edge: it counts as moved along
/// x by an infinitesimal amount, and along y by a still smaller one. The edge from b to a gives the opposite answer.
fn side(a: [f64; 3], b: [f64; 3]) -> bool {
    let (p, q) = (a[0] * b[1], a[1] * b[0]);
    if p != q {
        return p > q;
    }
    // The rounding errors of the two products decide.
    let (of_p, of_q) = (a[0].mul_add(b[1], -p), a[1].mul_add(b[0], -q));
    if of_p != of_q {
        return of_p > of_q;
    }
    if a[1] == b[1] { b[0] > a[0] } else { a[1] > b[1] }
}

#[cfg(test)]
mod tests;
