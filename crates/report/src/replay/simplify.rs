//! Meshes with fewer triangles.

use std::collections::BTreeMap;

/// Numbers of cells along the longest side, tried in this order.
const CELLS: [f32; 6] = [128.0, 96.0, 64.0, 40.0, 24.0, 12.0];

/// Vertices and triangles.
pub type Mesh = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// Returns a mesh with at most `most` triangles, if a grid of 12 cells is coarse enough for that:
/// vertices in the same cell become one. A mesh that is small enough stays as it is.
///
/// # Reference
/// Rossignac and Borrel, "Multi-resolution 3D approximations for rendering complex scenes", 1993.
pub fn simplified(mesh: Mesh, most: usize) -> Mesh {
    let (vertices, triangles) = &mesh;
    let mut low = [f32::INFINITY; 3];
    let mut high = [f32::NEG_INFINITY; 3];
    for vertex in vertices {
        for i in 0..3 {
            low[i] = low[i].min(vertex[i]);
            high[i] = high[i].max(vertex[i]);
        }
    }
    let longest = (0..3).map(|i| high[i] - low[i]).fold(f32::MIN_POSITIVE, f32::max);
    let mut cells = CELLS.into_iter();
    let mut found = None;
    while found.as_ref().map_or(triangles.len(), |(_, triangles): &Mesh| triangles.len()) > most {
        let Some(cells) = cells.next() else { break };
        found = Some(clustered(&mesh, low, longest / cells));
    }
    found.unwrap_or(mesh)
}

/// Merges the vertices of each cell in their mean.
fn clustered(mesh: &Mesh, low: [f32; 3], cell: f32) -> Mesh {
    let (vertices, triangles) = mesh;
    let mut clusters: BTreeMap<[i32; 3], u32> = BTreeMap::new();
    let mut sums: Vec<([f32; 3], f32)> = Vec::new();
    let mut cluster_of = Vec::with_capacity(vertices.len());
    for vertex in vertices {
        let key = [0, 1, 2].map(|i| ((vertex[i] - low[i]) / cell) as i32);
        let index = *clusters.entry(key).or_insert(sums.len() as u32);
        if index as usize == sums.len() {
            sums.push(([0.0; 3], 0.0));
        }
        let (sum, count) = &mut sums[index as usize];
        (0..3).for_each(|i| sum[i] += vertex[i]);
        *count += 1.0;
        cluster_of.push(index);
    }
    let merged = triangles.iter().map(|corners| corners.map(|corner| cluster_of[corner as usize]));
    let mut triangles: Vec<[u32; 3]> = merged.filter(|[a, b, c]| a != b && b != c && a != c).collect();
    triangles.sort_unstable();
    triangles.dedup();
    (sums.into_iter().map(|(sum, count)| sum.map(|v| v / count)).collect(), triangles)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wavy sheet of 200 x 200 vertices.
    fn sheet() -> Mesh {
        let n = 200;
        let vertex = |i: u32, j: u32| [i as f32, j as f32, 5.0 * (0.1 * i as f32).sin()];
        let cell = |i: u32, j: u32| {
            let a = j * n + i;
            [[a, a + 1, a + n + 1], [a, a + n + 1, a + n]]
        };
        let vertices = (0..n).flat_map(|j| (0..n).map(move |i| vertex(i, j))).collect();
        (vertices, (0..n - 1).flat_map(|j| (0..n - 1).flat_map(move |i| cell(i, j))).collect())
    }

    #[test]
    fn a_simplified_mesh_is_small_and_close_to_the_mesh() {
        let (vertices, triangles) = simplified(sheet(), 20_000);
        assert!(triangles.len() <= 20_000 && triangles.len() > 5_000, "{}", triangles.len());
        for [x, _, z] in &vertices {
            // A cell is 199 / 96 long or shorter, and the slope is at most 0.5.
            assert!((z - 5.0 * (0.1 * x).sin()).abs() < 2.1, "{x} {z}");
        }
        assert!(triangles.iter().flatten().all(|corner| (*corner as usize) < vertices.len()));
    }

    #[test]
    fn a_small_mesh_stays_as_it_is() {
        let (vertices, triangles) = sheet();
        assert_eq!(simplified((vertices.clone(), triangles.clone()), 80_000), (vertices, triangles));
    }
}
