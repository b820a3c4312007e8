//! Triangles: meshes and cloths with a hierarchy of bounding boxes.

use crate::lanes::{LANES, Lanes, Lanes3, dot};
use crate::vector::{add, cross, scale, sub, unit};

/// The largest number of triangles of a leaf.
const LEAF: usize = 4;

/// The deepest tree: a median split of 2^32 triangles needs 32 levels.
const DEPTH: usize = 40;

/// A node of the hierarchy. The left child of a node follows it.
#[derive(Clone, Copy, Debug)]
struct Node {
    low: [f32; 3],
    high: [f32; 3],
    /// The first triangle of a leaf, or the right child.
    next: u32,
    /// The number of triangles of a leaf; 0 for a node with children.
    count: u32,
}

/// Triangles in a hierarchy of bounding boxes. Both sides of a triangle are visible.
#[derive(Clone, Debug)]
pub struct Mesh {
    vertices: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    nodes: Vec<Node>,
    /// Normals of the vertices of a smooth surface; empty if each triangle is flat.
    normals: Vec<[f32; 3]>,
}

impl Mesh {
    /// Makes a mesh with flat triangles.
    ///
    /// # Panics
    /// If a triangle has a vertex that does not exist.
    pub fn new(vertices: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Mesh {
        let mut mesh = Mesh { vertices, triangles, nodes: Vec::new(), normals: Vec::new() };
        let count = mesh.triangles.len();
        if count > 0 {
            mesh.split(0, count);
            mesh.refit();
        }
        mesh
    }

    /// Makes a mesh whose normals change smoothly over its triangles, for a cloth.
    ///
    /// # Panics
    /// If a triangle has a vertex that does not exist.
    pub fn smooth(vertices: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Mesh {
        let mut mesh = Mesh::new(vertices, triangles);
        mesh.normals = vec![[0.0; 3]; mesh.vertices.len()];
        mesh.refit_normals();
        mesh
    }

    /// Returns the positions of the vertices, m.
    pub fn vertices(&self) -> &[[f32; 3]] {
        &self.vertices
    }

    /// Returns the corners of the triangles, in the order of the hierarchy.
    pub(crate) fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Returns the nodes, each before its children: its first triangle and the one after its last,
    /// the node after its descendants, and 1 for a leaf.
    pub(crate) fn preorder(&self) -> Vec<[u32; 4]> {
        let mut out = vec![[0; 4]; self.nodes.len()];
        for index in (0..self.nodes.len()).rev() {
            let node = self.nodes[index];
            out[index] = match node.count {
                0 => {
                    let [left, right] = [out[index + 1], out[node.next as usize]];
                    [left[0], right[1], right[2], 0]
                }
                count => [node.next, node.next + count, index as u32 + 1, 1],
            };
        }
        out
    }

    /// Moves the vertices; the triangles stay those of the same vertices.
    ///
    /// # Panics
    /// If the number of vertices differs.
    pub(crate) fn deform(&mut self, vertices: &[[f32; 3]]) {
        self.vertices.copy_from_slice(vertices);
        self.refit();
        self.refit_normals();
    }

    /// Makes the nodes of these triangles and sorts them by the median along the longest side.
    fn split(&mut self, first: usize, count: usize) {
        let node = self.nodes.len();
        self.nodes.push(Node {
            low: [0.0; 3],
            high: [0.0; 3],
            next: first as u32,
            count: count.min(LEAF) as u32,
        });
        if count <= LEAF {
            return;
        }
        let vertices = &self.vertices;
        let center = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|vertex| vertices[vertex as usize]);
            add(add(a, b), c)
        };
        let own = &mut self.triangles[first..first + count];
        let mut low = [f32::INFINITY; 3];
        let mut high = [f32::NEG_INFINITY; 3];
        own.iter().for_each(|triangle| grow(&mut low, &mut high, center(triangle)));
        let size = sub(high, low);
        let axis = (1..3).fold(0, |best, axis| if size[axis] > size[best] { axis } else { best });
        own.sort_by(|a, b| center(a)[axis].total_cmp(&center(b)[axis]).then(a.cmp(b)));
        let half = count / 2;
        self.split(first, half);
        self.nodes[node].next = self.nodes.len() as u32;
        self.nodes[node].count = 0;
        self.split(first + half, count - half);
    }

    /// Fits all boxes to the vertices. Children come after their parent.
    fn refit(&mut self) {
        for index in (0..self.nodes.len()).rev() {
            let node = self.nodes[index];
            let mut low = [f32::INFINITY; 3];
            let mut high = [f32::NEG_INFINITY; 3];
            if node.count > 0 {
                let own = &self.triangles[node.next as usize..][..node.count as usize];
                for vertex in own.as_flattened() {
                    grow(&mut low, &mut high, self.vertices[*vertex as usize]);
                }
            } else {
                for child in [index + 1, node.next as usize] {
                    grow(&mut low, &mut high, self.nodes[child].low);
                    grow(&mut low, &mut high, self.nodes[child].high);
                }
            }
            (self.nodes[index].low, self.nodes[index].high) = (low, high);
        }
    }

    fn refit_normals(&mut self) {
        if self.normals.is_empty() {
            return;
        }
        self.normals.fill([0.0; 3]);
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|vertex| self.vertices[vertex as usize]);
            let normal = cross(sub(b, a), sub(c, a));
            for vertex in triangle {
                let own = &mut self.normals[*vertex as usize];
                *own = add(*own, normal);
            }
        }
        self.normals.iter_mut().for_each(|normal| *normal = unit(*normal));
    }

    /// Returns the bounds: lowest and highest corner, m.
    pub(crate) fn bounds(&self) -> [[f32; 3]; 2] {
        self.nodes.first().map_or([[0.0; 3]; 2], |root| [root.low, root.high])
    }

    /// Returns the normal of a triangle at a point of it.
    pub(crate) fn normal(&self, triangle: u32, p: [f32; 3]) -> [f32; 3] {
        let corners = self.triangles[triangle as usize];
        let [a, b, c] = corners.map(|vertex| self.vertices[vertex as usize]);
        let flat = cross(sub(b, a), sub(c, a));
        if self.normals.is_empty() {
            return unit(flat);
        }
        // Areas of the parts opposite to the corners, along the normal.
        let area = |from: [f32; 3], to: [f32; 3]| crate::vector::dot(flat, cross(sub(from, p), sub(to, p)));
        let weights = [area(b, c), area(c, a), area(a, b)];
        let parts = [0, 1, 2].map(|i| scale(self.normals[corners[i] as usize], weights[i]));
        unit(add(add(parts[0], parts[1]), parts[2]))
    }

    /// Returns where rays first meet a triangle after `least` and before `most`, and writes which.
    #[inline]
    pub(crate) fn enter(
        &self,
        o: Lanes3,
        d: Lanes3,
        least: f32,
        mut most: Lanes,
        hit: &mut [u32; LANES],
    ) -> Lanes {
        if self.nodes.is_empty() {
            return most;
        }
        let inverse = d.map(|d| Lanes::all(1.0) / d);
        let mut stack = [0_u32; DEPTH];
        let mut size = 1;
        while size > 0 {
            size -= 1;
            let index = stack[size];
            let node = &self.nodes[index as usize];
            if !meets(node, o, inverse, most) {
                continue;
            }
            if node.count == 0 {
                stack[size] = node.next;
                stack[size + 1] = index + 1;
                size += 2;
                continue;
            }
            for triangle in node.next..node.next + node.count {
                let t = self.enter_triangle(triangle, o, d);
                for i in 0..LANES {
                    let is_first = t.0[i] > least && t.0[i] < most.0[i];
                    most.0[i] = if is_first { t.0[i] } else { most.0[i] };
                    hit[i] = if is_first { triangle } else { hit[i] };
                }
            }
        }
        most
    }

    /// Returns where rays meet a triangle, also behind their origin. Two triangles with a common
    /// edge leave no gap: the sides of an edge are computed from the same products.
    #[inline(always)]
    fn enter_triangle(&self, triangle: u32, o: Lanes3, d: Lanes3) -> Lanes {
        let corners = self.triangles[triangle as usize].map(|vertex| self.vertices[vertex as usize]);
        let [a, b, c] = corners.map(|corner| [0, 1, 2].map(|i| Lanes::all(corner[i]) - o[i]));
        let side = |p: Lanes3, q: Lanes3| {
            dot(d, [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]])
        };
        let u = side(b, c);
        let v = side(c, a);
        let w = side(a, b);
        let normal = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0])).map(Lanes::all);
        let t = dot(normal, a) / dot(normal, d);
        let outside = Lanes::ZERO.select_at_most(u.min(v).min(w), t, Lanes::MISS);
        u.max(v).max(w).select_at_most(Lanes::ZERO, t, outside)
    }
}

/// Returns whether any ray meets the box of a node before `most`.
#[inline(always)]
fn meets(node: &Node, o: Lanes3, inverse: Lanes3, most: Lanes) -> bool {
    let mut first = Lanes::ZERO;
    let mut last = most;
    for i in 0..3 {
        let a = (Lanes::all(node.low[i]) - o[i]) * inverse[i];
        let b = (Lanes::all(node.high[i]) - o[i]) * inverse[i];
        first = a.min(b).max(first);
        last = a.max(b).min(last);
    }
    // A box that rays touch may be missed by rounding, so it is a little larger.
    let mut any = false;
    for i in 0..LANES {
        any |= first.0[i] <= last.0[i] * 1.000_001 + 1e-6;
    }
    any
}

fn grow(low: &mut [f32; 3], high: &mut [f32; 3], p: [f32; 3]) {
    for i in 0..3 {
        low[i] = low[i].min(p[i]);
        high[i] = high[i].max(p[i]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle_random::Sequence;

    /// Returns where a ray meets a triangle, by the algorithm of Möller and Trumbore (1997).
    fn meets_triangle(o: [f64; 3], d: [f64; 3], [a, b, c]: [[f64; 3]; 3]) -> Option<f64> {
        use mishandle_world::frame::{cross, dot, sub};
        let ab = sub(b, a);
        let ac = sub(c, a);
        let from = sub(o, a);
        let p = cross(d, ac);
        let q = cross(from, ab);
        let determinant = dot(ab, p);
        let u = dot(from, p) / determinant;
        let v = dot(d, q) / determinant;
        let t = dot(ac, q) / determinant;
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
    }

    /// Returns a wavy sheet of `count` x `count` cells over the unit square.
    fn sheet(count: u32, height: f32) -> Mesh {
        let vertex = |i: u32, j: u32| {
            let wave = ((i * 7 + j * 3) % 5) as f32 / 5.0;
            [i as f32 / count as f32, j as f32 / count as f32, height * wave]
        };
        let vertices = (0..=count).flat_map(|j| (0..=count).map(move |i| vertex(i, j))).collect();
        let cell = |i: u32, j: u32| {
            let a = j * (count + 1) + i;
            [[a, a + 1, a + count + 2], [a, a + count + 2, a + count + 1]]
        };
        let triangles = (0..count).flat_map(|j| (0..count).flat_map(move |i| cell(i, j))).collect();
        Mesh::new(vertices, triangles)
    }

    #[test]
    fn rays_meet_the_first_triangle_also_after_the_vertices_moved() {
        let mut numbers = Sequence::new(4, 0);
        let mut random = |low: f32, high: f32| low + (high - low) * numbers.uniform() as f32;
        let mut mesh = sheet(9, 0.4);
        let mut hits = 0;
        for round in 0..300 {
            if round == 150 {
                let moved: Vec<[f32; 3]> =
                    mesh.vertices.iter().map(|[x, y, z]| [*y, *x + *z, 0.5 * *x]).collect();
                mesh.deform(&moved);
            }
            let o = [random(-1.0, 2.0), random(-1.0, 2.0), random(-1.0, 1.0)];
            let mut d = [Lanes::ZERO; 3];
            for lane in 0..LANES {
                let target = [random(0.0, 1.0), random(0.0, 1.0), random(0.0, 0.4)];
                (0..3).for_each(|i| d[i].0[lane] = target[i] - o[i]);
            }
            let mut which = [u32::MAX; LANES];
            let t = mesh.enter(o.map(Lanes::all), d, 0.0, Lanes::MISS, &mut which);
            for lane in 0..LANES {
                let wide = |v: [f32; 3]| v.map(f64::from);
                let direction = d.map(|d| f64::from(d.0[lane]));
                let corners = |triangle: &[u32; 3]| triangle.map(|i| wide(mesh.vertices[i as usize]));
                let truth =
                    mesh.triangles.iter().filter_map(|own| meets_triangle(wide(o), direction, corners(own)));
                let truth = truth.fold(f64::INFINITY, f64::min);
                let own = f64::from(t.0[lane]);
                // A ray through the outer edge may miss in one precision and not in the other.
                if truth.is_finite() != own.is_finite() {
                    continue;
                }
                assert!(own == truth || (own - truth).abs() < 1e-4 * truth.max(1.0), "{own}, {truth}");
                if truth.is_finite() {
                    hits += 1;
                    let corners = corners(&mesh.triangles[which[lane] as usize]);
                    assert!(
                        meets_triangle(wide(o), direction, corners).is_none_or(|t| (t - own).abs() < 1e-4)
                    );
                }
            }
        }
        assert!(hits > 1000, "{hits}");
    }

    /// A ray to a point of an edge inside the sheet meets one of its triangles.
    #[test]
    fn triangles_with_a_common_edge_leave_no_gap() {
        let mesh = sheet(8, 0.0);
        let mut numbers = Sequence::new(9, 0);
        let mut random = |low: f32, high: f32| low + (high - low) * numbers.uniform() as f32;
        for _ in 0..2000 {
            let o = [random(-3.0, 3.0), random(-3.0, 3.0), random(0.5, 3.0)];
            let mut d = [Lanes::ZERO; 3];
            for lane in 0..LANES {
                // Points of grid lines and of diagonals.
                let i = (random(1.0, 8.0) as u32) as f32 / 8.0;
                let s = random(0.1, 0.9);
                let target = [[i, s, 0.0], [s, i, 0.0], [s, s, 0.0]][lane % 3];
                (0..3).for_each(|i| d[i].0[lane] = target[i] - o[i]);
            }
            let t = mesh.enter(o.map(Lanes::all), d, 0.0, Lanes::MISS, &mut [0; LANES]);
            assert!(t.0.iter().all(|t| (*t - 1.0).abs() < 1e-4), "{t:?} from {o:?}");
        }
    }

    #[test]
    fn normals_of_a_smooth_sheet_are_between_those_of_its_triangles() {
        let vertices = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let triangles = vec![[0, 1, 2], [0, 3, 1]];
        let flat = Mesh::new(vertices.clone(), triangles.clone());
        let smooth = Mesh::smooth(vertices, triangles);
        assert_eq!(flat.normal(0, [0.2, 0.2, 0.0]), [0.0, 0.0, 1.0]);
        let edge = smooth.normal(0, [0.5, 0.0, 0.0]);
        let half = 0.5_f32.sqrt();
        assert!(sub(edge, [0.0, half, half]).iter().all(|v| v.abs() < 1e-6), "{edge:?}");
        let corner = smooth.normal(0, [0.0, 1.0, 0.0]);
        assert!(sub(corner, [0.0, 0.0, 1.0]).iter().all(|v| v.abs() < 1e-6), "{corner:?}");
    }
}
