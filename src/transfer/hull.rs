//! Convex hull of points on a sphere, which is their spherical Delaunay triangulation (the Psi of
//! Gruber et al. 2015, Eq. 9).
//!
//! Incremental insertion with exact predicates: the points are snapped to a grid of 2^-30 and the
//! orientation of a point against a face is an integer determinant below 2^96. So points on one
//! circle, as in a cube, cannot make the hull inconsistent: a point in the plane of a face simply
//! does not see it.

use glam::DVec3;

const GRID: f64 = (1u64 << 30) as f64;

type Point = [i64; 3];

/// Triangles, counter-clockwise seen from outside. `None` where the points span no volume.
pub fn convex_hull(points: &[DVec3]) -> Option<Vec<[usize; 3]>> {
    let grid: Vec<Point> = points.iter().map(|p| snapped(*p)).collect();
    let start = first_tetrahedron(&grid)?;
    let [a, b, c, d] = start;
    let mut faces: Vec<Face> = [[a, b, c], [a, d, b], [b, d, c], [c, d, a]]
        .map(|corners| Face::new(corners, &grid))
        .into();
    let mut edges = Vec::new();
    for (i, &point) in grid.iter().enumerate() {
        if start.contains(&i) {
            continue;
        }
        // Take away every face that sees the point, keeping the rim of the hole.
        edges.clear();
        faces.retain(|face| {
            let seen = face.height(point) > 0;
            if seen {
                edges.extend((0..3).map(|k| (face.corners[k], face.corners[(k + 1) % 3])));
            }
            !seen
        });
        // Join the rim to the point. An edge between two removed faces occurs in both directions.
        let rim = edges.iter().filter(|&&(from, to)| !edges.contains(&(to, from)));
        faces.extend(rim.map(|&(from, to)| Face::new([from, to, i], &grid)));
    }
    Some(faces.into_iter().map(|face| face.corners).collect())
}

/// Each edge of a closed triangulation once, lower index first.
pub fn edges(triangles: &[[usize; 3]]) -> impl Iterator<Item = (usize, usize)> + '_ {
    triangles.iter().flat_map(|t| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])]).filter(|e| e.0 < e.1)
}

fn snapped(p: DVec3) -> Point {
    p.to_array().map(|v| (v.clamp(-1.0, 1.0) * GRID).round() as i64)
}

/// Four points that span a volume, ordered so that the fourth lies below (a, b, c).
fn first_tetrahedron(points: &[Point]) -> Option<[usize; 4]> {
    let b = (1..points.len()).find(|&i| points[i] != points[0])?;
    let c = (b + 1..points.len()).find(|&i| {
        cross(difference(points[b], points[0]), difference(points[i], points[0])) != [0; 3]
    })?;
    let face = Face::new([0, b, c], points);
    let d = (c + 1..points.len()).find(|&i| face.height(points[i]) != 0)?;
    Some(if face.height(points[d]) < 0 { [0, b, c, d] } else { [0, c, b, d] })
}

struct Face {
    corners: [usize; 3],
    anchor: Point,
    normal: [i128; 3],
}

impl Face {
    fn new(corners: [usize; 3], points: &[Point]) -> Self {
        let [a, b, c] = corners.map(|i| points[i]);
        Self { corners, anchor: a, normal: cross(difference(b, a), difference(c, a)) }
    }

    /// Positive for points on the outer side, 0 in the plane.
    fn height(&self, point: Point) -> i128 {
        let to_point = difference(point, self.anchor);
        (0..3).map(|k| self.normal[k] * i128::from(to_point[k])).sum()
    }
}

fn difference(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: Point, b: Point) -> [i128; 3] {
    let [a, b] = [a, b].map(|v| v.map(i128::from));
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Rng;

    /// Euler's formula, closedness, outward orientation, and no point outside any face.
    fn check(points: &[DVec3]) -> usize {
        let triangles = convex_hull(points).unwrap();
        let edges: Vec<_> = edges(&triangles).collect();
        assert_eq!(triangles.len(), 2 * points.len() - 4, "faces");
        assert_eq!(points.len() + triangles.len(), edges.len() + 2, "V - E + F = 2");
        let directed: std::collections::HashSet<_> =
            triangles.iter().flat_map(|t| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])]).collect();
        assert_eq!(directed.len(), 2 * edges.len(), "each edge once in each direction");
        for t in &triangles {
            let [a, b, c] = t.map(|i| points[i]);
            let normal = (b - a).cross(c - a);
            assert!(normal.dot(a) > 0.0, "outward");
            // the grid moves a point by 1e-9
            assert!(points.iter().all(|p| normal.dot(*p - a) < 1e-8), "convex");
        }
        edges.len()
    }

    #[test]
    fn known_solids() {
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        let octahedron: Vec<_> = axes.iter().flat_map(|&a| [a, -a]).collect();
        assert_eq!(check(&octahedron), 12);
        // Every face of a cube has four points on one circle.
        let cube: Vec<_> = (0..8)
            .map(|i| DVec3::from([0, 1, 2].map(|k| f64::from((i >> k & 1) * 2 - 1))).normalize())
            .collect();
        assert_eq!(check(&cube), 12 + 6);
        let golden = (1.0 + 5f64.sqrt()) / 2.0;
        let mut icosahedron = Vec::new();
        for (s, t) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            icosahedron.push(DVec3::new(0.0, s, t * golden).normalize());
            icosahedron.push(DVec3::new(s, t * golden, 0.0).normalize());
            icosahedron.push(DVec3::new(t * golden, 0.0, s).normalize());
        }
        assert_eq!(check(&icosahedron), 30);
        let triangles = convex_hull(&icosahedron).unwrap();
        for (a, b) in edges(&triangles) {
            // every edge of the icosahedron is 63.43 degrees long
            assert!(
                (icosahedron[a].angle_between(icosahedron[b]).to_degrees() - 63.4349).abs() < 1e-3
            );
        }
    }

    #[test]
    fn random_points_and_rings() {
        for seed in 0..20 {
            let mut rng = Rng::new(&[seed]);
            let points: Vec<_> = (0..60)
                .map(|_| DVec3::from([0; 3].map(|_| f64::from(rng.normal()))).normalize())
                .collect();
            check(&points);
        }
        // Rings of eight points on one circle each.
        let mut rings = vec![DVec3::Z, -DVec3::Z];
        for z in [-0.6f64, 0.0, 0.6] {
            rings.extend((0..8).map(|i| {
                let (sin, cos) = (f64::from(i) * std::f64::consts::FRAC_PI_4).sin_cos();
                DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z)
            }));
        }
        check(&rings);
    }

    #[test]
    fn flat_sets_have_no_hull() {
        assert!(convex_hull(&[]).is_none());
        assert!(convex_hull(&[DVec3::X; 5]).is_none());
        assert!(convex_hull(&[DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::X]).is_none());
    }
}
