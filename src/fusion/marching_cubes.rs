//! Triangles of a cube for each pattern of corners inside (Lorensen and Cline 1987), derived
//! rather than listed.
//!
//! Every face of the cube joins its crossed edges so that inside corners stay apart. Two cubes
//! that share a face therefore agree on it, also in the ambiguous cases, and meshes are closed.

use std::sync::LazyLock;

/// Corner i is at (i & 1, i >> 1 & 1, i >> 2). Edge 4 a + k runs along axis a from its k-th
/// corner with bit a clear.
pub(super) const EDGES: [[usize; 2]; 12] = [
    [0, 1],
    [2, 3],
    [4, 5],
    [6, 7],
    [0, 2],
    [1, 3],
    [4, 6],
    [5, 7],
    [0, 4],
    [1, 5],
    [2, 6],
    [3, 7],
];

/// Corners of each face, counter-clockwise seen from outside.
const FACES: [[usize; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Triangles of edge numbers, for a byte with a bit set for each corner inside. They are
/// counter-clockwise seen from outside the surface.
pub(super) static TRIANGLES: LazyLock<Vec<Vec<[u8; 3]>>> =
    LazyLock::new(|| (0..=255).map(|inside| triangulate(&loops(inside))).collect());

fn edge_between(a: usize, b: usize) -> usize {
    let pair = [a.min(b), a.max(b)];
    EDGES.iter().position(|&edge| edge == pair).expect("neighbours on a face share an edge")
}

/// Closed polygons of crossed edges.
fn loops(inside: u8) -> Vec<Vec<usize>> {
    let mut next = [None; 12];
    for face in FACES {
        let is_inside = |k: usize| inside >> face[k % 4] & 1 == 1;
        for k in (0..4).filter(|&k| !is_inside(k) && is_inside(k + 1)) {
            // The boundary enters a run of inside corners here; it leaves where the run ends.
            let end = (k + 1..k + 4).find(|&j| !is_inside(j + 1)).expect("corner k is outside");
            let enter = edge_between(face[k], face[(k + 1) % 4]);
            let leave = edge_between(face[end % 4], face[(end + 1) % 4]);
            next[enter] = Some(leave);
        }
    }
    let mut found = Vec::new();
    for start in 0..12 {
        let mut polygon = Vec::new();
        let mut edge = start;
        while let Some(following) = next[edge].take() {
            polygon.push(edge);
            edge = following;
        }
        if !polygon.is_empty() {
            found.push(polygon);
        }
    }
    found
}

/// Fans whose diagonals stay off the cube's faces, where the neighbour could have the same one.
fn triangulate(polygons: &[Vec<usize>]) -> Vec<[u8; 3]> {
    let mut triangles = Vec::new();
    for polygon in polygons {
        let n = polygon.len();
        let at = |i: usize| polygon[i % n];
        let apex = (0..n)
            .find(|&apex| (apex + 2..apex + n - 1).all(|i| !share_face(at(apex), at(i))))
            .unwrap_or(0);
        for i in 1..n - 1 {
            triangles.push([at(apex), at(apex + i), at(apex + i + 1)].map(|e| e as u8));
        }
    }
    triangles
}

fn share_face(a: usize, b: usize) -> bool {
    FACES.iter().any(|face| {
        [a, b].iter().all(|&edge| EDGES[edge].iter().all(|corner| face.contains(corner)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn corner(i: usize) -> Vec3 {
        Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32)
    }

    #[test]
    fn faces_are_counter_clockwise_from_outside() {
        for face in FACES {
            let [a, b, c, _] = face.map(corner);
            let normal = (b - a).cross(c - b);
            assert!(normal.dot(a - Vec3::splat(0.5)) > 0.0, "{face:?}");
        }
    }

    /// Every edge inside the cube is used once in each direction, every edge on its boundary once.
    #[test]
    fn every_pattern_is_closed_but_for_the_cubes_faces() {
        for inside in 0..=255u8 {
            let triangles = &TRIANGLES[usize::from(inside)];
            let crossed = EDGES.iter().filter(|e| inside >> e[0] & 1 != inside >> e[1] & 1);
            let used: std::collections::BTreeSet<u8> =
                triangles.iter().flatten().copied().collect();
            assert_eq!(used.len(), crossed.count(), "pattern {inside}");
            let mut sides = std::collections::BTreeMap::new();
            for t in triangles {
                for k in 0..3 {
                    *sides.entry((t[k], t[(k + 1) % 3])).or_insert(0) += 1;
                }
            }
            for (&(a, b), &count) in &sides {
                assert_eq!(count, 1, "pattern {inside}: side used twice");
                let on_face = share_face(usize::from(a), usize::from(b));
                assert_ne!(on_face, sides.contains_key(&(b, a)), "pattern {inside}: {a} {b}");
            }
        }
    }

    #[test]
    fn a_single_corner_inside_shows_its_triangle_to_the_outside() {
        for i in 0..8 {
            let [t] = TRIANGLES[1 << i][..] else { panic!("one triangle") };
            let [a, b, c] = t.map(|e| {
                let [p, q] = EDGES[usize::from(e)];
                (corner(p) + corner(q)) / 2.0
            });
            assert!((b - a).cross(c - b).dot(a - corner(i)) > 0.0, "corner {i}");
        }
    }
}
