//! Bounding volume hierarchy over boxes: the same one holds the objects of a scene and the
//! triangles of a mesh.

use glam::{Vec2, Vec3A};

/// Half line. Distances along it are in units of `direction`'s length.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub origin: Vec3A,
    pub direction: Vec3A,
    inverse: Vec3A,
}

impl Ray {
    pub fn new(origin: Vec3A, direction: Vec3A) -> Self {
        // A tiny slope instead of zero keeps the slab test free of 0 * inf.
        let tiny = Vec3A::splat(1e-30);
        let safe = Vec3A::select(direction.abs().cmplt(tiny), tiny, direction);
        Self { origin, direction, inverse: safe.recip() }
    }

    pub fn at(&self, t: f32) -> Vec3A {
        self.origin + self.direction * t
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Aabb {
    pub min: Vec3A,
    pub max: Vec3A,
}

impl Aabb {
    pub const EMPTY: Self = Self { min: Vec3A::INFINITY, max: Vec3A::NEG_INFINITY };

    pub fn of_points(points: impl IntoIterator<Item = Vec3A>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| b.union(&Self { min: p, max: p }))
    }

    pub fn union(&self, other: &Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    pub fn centre(&self) -> Vec3A {
        (self.min + self.max) * 0.5
    }

    fn half_area(&self) -> f32 {
        let d = (self.max - self.min).max(Vec3A::ZERO);
        d.x * d.y + d.y * d.z + d.z * d.x
    }

    pub fn corners(&self) -> [Vec3A; 8] {
        std::array::from_fn(|i| {
            let pick = |bit: usize, a: f32, b: f32| if i >> bit & 1 == 0 { a } else { b };
            Vec3A::new(
                pick(0, self.min.x, self.max.x),
                pick(1, self.min.y, self.max.y),
                pick(2, self.min.z, self.max.z),
            )
        })
    }

    /// Where the ray enters, if it does so before `t_max`.
    fn entry(&self, ray: &Ray, t_max: f32) -> Option<f32> {
        let a = (self.min - ray.origin) * ray.inverse;
        let b = (self.max - ray.origin) * ray.inverse;
        let near = a.min(b).max_element().max(0.0);
        let far = a.max(b).min_element().min(t_max);
        (near <= far).then_some(near)
    }
}

/// `count` > 0: a leaf with `items[start..start + count]`; else children `start` and `start + 1`.
#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Aabb,
    start: u32,
    count: u32,
}

#[derive(Clone, Debug)]
pub struct Bvh {
    nodes: Vec<Node>,
    items: Vec<u32>,
}

/// A node in a list without pointers to children: the first child follows its parent.
#[cfg(feature = "gpu")]
pub(crate) struct FlatNode {
    pub bounds: Aabb,
    /// Index of the node that follows where this one's box is missed.
    pub next: usize,
    /// Of [`Bvh::items`]; none where the node is not a leaf.
    pub items: std::ops::Range<usize>,
}

const BINS: usize = 12;
const LEAF: usize = 2;
/// Depth that the traversal stack holds; deeper nodes become leaves.
const MAX_DEPTH: usize = 48;

impl Bvh {
    pub fn build(bounds: &[Aabb]) -> Self {
        // Slab tests round: boxes grow by a few units in the last place of the coordinates.
        let grown: Vec<Aabb> = bounds
            .iter()
            .map(|b| {
                let pad = b.min.abs().max(b.max.abs()) * 1e-6 + Vec3A::splat(1e-7);
                Aabb { min: b.min - pad, max: b.max + pad }
            })
            .collect();
        let mut bvh = Self { nodes: Vec::new(), items: (0..bounds.len() as u32).collect() };
        bvh.nodes.push(Node { bounds: Aabb::EMPTY, start: 0, count: 0 });
        bvh.split(&grown, 0, 0, bounds.len(), 0);
        bvh
    }

    pub fn bounds(&self) -> Aabb {
        self.nodes[0].bounds
    }

    fn split(&mut self, bounds: &[Aabb], node: usize, start: usize, end: usize, depth: usize) {
        let items = &mut self.items[start..end];
        let whole = items.iter().fold(Aabb::EMPTY, |b, &i| b.union(&bounds[i as usize]));
        self.nodes[node] = Node { bounds: whole, start: start as u32, count: items.len() as u32 };
        if items.len() <= LEAF || depth == MAX_DEPTH {
            return;
        }
        let middle = match best_plane(items, bounds) {
            Some((axis, position)) => {
                partition(items, |i| bounds[i as usize].centre()[axis] < position)
            }
            None => return, // all centres coincide
        };
        let left = self.nodes.len();
        self.nodes.extend([Node { bounds: whole, start: 0, count: 0 }; 2]);
        self.nodes[node] = Node { bounds: whole, start: left as u32, count: 0 };
        self.split(bounds, left, start, start + middle, depth + 1);
        self.split(bounds, left + 1, start + middle, end, depth + 1);
    }

    #[cfg(feature = "gpu")]
    pub(crate) fn items(&self) -> &[u32] {
        &self.items
    }

    /// All nodes depth first, for searches that need neither order nor stack.
    #[cfg(feature = "gpu")]
    pub(crate) fn flattened(&self) -> Vec<FlatNode> {
        let mut flat = Vec::with_capacity(self.nodes.len());
        if !self.items.is_empty() {
            self.flatten(0, &mut flat);
        }
        flat
    }

    #[cfg(feature = "gpu")]
    fn flatten(&self, index: usize, flat: &mut Vec<FlatNode>) {
        let Node { bounds, start, count } = self.nodes[index];
        let (start, count, here) = (start as usize, count as usize, flat.len());
        let items = if count > 0 { start..start + count } else { 0..0 };
        flat.push(FlatNode { bounds, next: 0, items });
        if count == 0 {
            self.flatten(start, flat);
            self.flatten(start + 1, flat);
        }
        flat[here].next = flat.len();
    }

    /// Calls `visit(item, t_max)` for items whose box the ray meets before `t_max`, near ones
    /// first. It returns the new `t_max`; a negative one ends the search.
    #[inline]
    pub fn traverse(&self, ray: &Ray, mut t_max: f32, mut visit: impl FnMut(u32, f32) -> f32) {
        if self.items.is_empty() || self.nodes[0].bounds.entry(ray, t_max).is_none() {
            return;
        }
        let mut stack = [(0u32, 0.0f32); MAX_DEPTH + 2];
        let mut depth = 0;
        let mut index = 0;
        loop {
            let node = &self.nodes[index as usize];
            if node.count > 0 {
                for &item in &self.items[node.start as usize..(node.start + node.count) as usize] {
                    t_max = visit(item, t_max);
                }
            } else {
                let (a, b) = (node.start, node.start + 1);
                let at = |i: u32| self.nodes[i as usize].bounds.entry(ray, t_max);
                match (at(a), at(b)) {
                    (Some(ta), Some(tb)) => {
                        let (near, far) = if ta <= tb { (a, (b, tb)) } else { (b, (a, ta)) };
                        stack[depth] = far;
                        depth += 1;
                        index = near;
                        continue;
                    }
                    (Some(_), None) => {
                        index = a;
                        continue;
                    }
                    (None, Some(_)) => {
                        index = b;
                        continue;
                    }
                    (None, None) => {}
                }
            }
            loop {
                if depth == 0 {
                    return;
                }
                depth -= 1;
                if stack[depth].1 <= t_max {
                    index = stack[depth].0;
                    break;
                }
            }
        }
    }
}

/// Where a ray meets a triangle before `t_max`, and the weights of its second and third corner there
/// (Moller and Trumbore 1997, both sides).
pub fn hit_triangle(ray: &Ray, [a, b, c]: [Vec3A; 3], t_max: f32) -> Option<(f32, Vec2)> {
    let (ab, ac) = (b - a, c - a);
    let p = ray.direction.cross(ac);
    let inverse = 1.0 / ab.dot(p);
    let s = ray.origin - a;
    let u = s.dot(p) * inverse;
    let q = s.cross(ab);
    let v = ray.direction.dot(q) * inverse;
    let t = ac.dot(q) * inverse;
    // All comparisons are false for the NaN of a ray inside the triangle's plane.
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 && t < t_max).then(|| (t, Vec2::new(u, v)))
}

/// Axis and coordinate of the cheapest of the binned surface-area splits (Wald 2007); `None` where
/// the centres have no extent.
fn best_plane(items: &[u32], bounds: &[Aabb]) -> Option<(usize, f32)> {
    let centres = Aabb::of_points(items.iter().map(|&i| bounds[i as usize].centre()));
    let extent = centres.max - centres.min;
    let mut best: Option<(f32, usize, f32)> = None;
    for axis in 0..3 {
        if extent[axis] <= 0.0 {
            continue;
        }
        for k in 1..BINS {
            let position = centres.min[axis] + extent[axis] * k as f32 / BINS as f32;
            let (mut left, mut right) = ((Aabb::EMPTY, 0), (Aabb::EMPTY, 0));
            for &i in items {
                let b = &bounds[i as usize];
                let side = if b.centre()[axis] < position { &mut left } else { &mut right };
                *side = (side.0.union(b), side.1 + 1);
            }
            if left.1 == 0 || right.1 == 0 {
                continue;
            }
            let cost = left.0.half_area() * left.1 as f32 + right.0.half_area() * right.1 as f32;
            if best.is_none_or(|(c, ..)| cost < c) {
                best = Some((cost, axis, position));
            }
        }
    }
    best.map(|(_, axis, position)| (axis, position))
}

/// Moves items that satisfy `first` to the front; returns their number.
fn partition(items: &mut [u32], first: impl Fn(u32) -> bool) -> usize {
    let mut middle = 0;
    for i in 0..items.len() {
        if first(items[i]) {
            items.swap(i, middle);
            middle += 1;
        }
    }
    middle
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Rng;

    #[test]
    fn finds_the_same_nearest_box_as_trying_all() {
        let mut rng = Rng::new(&[3]);
        let mut point = |scale: f32| {
            Vec3A::new(rng.uniform() - 0.5, rng.uniform() - 0.5, rng.uniform() - 0.5) * scale
        };
        let boxes: Vec<Aabb> = (0..300)
            .map(|_| {
                let (centre, half) = (point(4.0), point(0.2).abs());
                Aabb { min: centre - half, max: centre + half }
            })
            .collect();
        let bvh = Bvh::build(&boxes);
        let mut hits = 0;
        for _ in 0..2000 {
            let ray = Ray::new(point(6.0), point(1.0));
            let all =
                boxes.iter().filter_map(|b| b.entry(&ray, f32::INFINITY)).min_by(f32::total_cmp);
            let mut found = None;
            bvh.traverse(&ray, f32::INFINITY, |i, t_max| {
                match boxes[i as usize].entry(&ray, t_max) {
                    Some(t) => *found.insert(t),
                    None => t_max,
                }
            });
            assert_eq!(found, all);
            hits += usize::from(all.is_some());
        }
        assert!(hits > 100, "{hits} rays met a box");
    }

    #[test]
    fn empty_and_coinciding_boxes() {
        Bvh::build(&[]).traverse(&Ray::new(Vec3A::ZERO, Vec3A::X), 1.0, |_, _| panic!("no items"));
        let same = [Aabb { min: Vec3A::ONE, max: Vec3A::splat(2.0) }; 9];
        let mut seen = 0;
        Bvh::build(&same).traverse(&Ray::new(Vec3A::ZERO, Vec3A::ONE), 9.0, |_, t| {
            seen += 1;
            t
        });
        assert_eq!(seen, 9);
    }
}
