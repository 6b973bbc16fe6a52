//! From the nearest triangle at each sample to what a pixel shows.

use super::cover::{Holes, SAMPLES, sample_offset};
use super::project::{CHUNK_BITS, CHUNK_TRIANGLES, Chunk, Projector, ScreenVertex};
use crate::geometry::GBuffer;
use crate::math::View;
use crate::scene::model::{Material, Model};
use crate::scene::objects::VirtualScene;
use glam::{Mat3, Vec2, Vec3};

/// A virtual surface must be nearer than the real one by this share of its depth. 1 mm at 1 m: what
/// filtered depth is uncertain by, so that an object standing on a real surface does not flicker
/// through it, and too little to see that its foot is missing.
const DEPTH_BIAS: f32 = 1e-3;
/// Where real and virtual depths differ by less than this share, the line where the surfaces cross is
/// found between pixel centres; where they differ by more, the edge lies half-way between.
const CROSSING_RANGE: f32 = 0.02;
/// Slope, in depth per width of a pixel at that depth, beyond which a triangle is not continued to
/// the next pixel: 83 degrees from the viewer.
const MAX_SLOPE: f32 = 8.0;

/// An object that may be in the picture.
#[derive(Clone, Copy, Debug)]
pub struct DrawnObject {
    /// Index into the scene's objects.
    pub index: usize,
    /// Of its first vertex in the list of projected vertices.
    pub first_vertex: usize,
    pub world_from_object: Mat3,
}

/// Everything that a band needs to look up surfaces; shared by all threads.
pub struct Resolver<'a> {
    pub scene: &'a VirtualScene,
    pub drawn: &'a [DrawnObject],
    pub chunks: &'a [Chunk],
    pub vertices: &'a [ScreenVertex],
    pub view: View,
    pub projector: Projector,
    pub world_from_view: Mat3,
}

/// One pixel of the result.
pub struct Seen {
    /// Share of the samples that show a virtual surface; never zero.
    pub coverage: f32,
    pub albedo: [f32; 3],
    /// Depth in metres and world normal, where the pixel's centre shows a virtual surface.
    pub surface: Option<(f32, Vec3)>,
}

struct Face<'a> {
    model: &'a Model,
    material: &'a Material,
    indices: [usize; 3],
    /// Homogeneous pixel coordinates of the corners.
    corners: [Vec3; 3],
    world_from_object: &'a Mat3,
}

/// A face at one place of the picture.
struct Sight {
    /// Barycentric coordinates; may be outside the face.
    weights: Vec3,
    /// Their change to the next pixel in x and y.
    weights_u: Vec3,
    weights_v: Vec3,
    /// Whether the outside is seen.
    front: bool,
}

impl Sight {
    /// Barycentric coordinates of the nearest place within the face.
    fn inside(&self) -> Vec3 {
        let weights = self.weights.max(Vec3::ZERO);
        let sum = weights.element_sum();
        if sum > 0.0 && sum.is_finite() { weights / sum } else { Vec3::splat(1.0 / 3.0) }
    }
}

impl<'a> Resolver<'a> {
    /// The id under which a triangle is drawn.
    pub fn id(chunk: usize, triangle: u32) -> u32 {
        (chunk as u32) << CHUNK_BITS | triangle
    }

    fn face(&self, id: u32) -> Face<'a> {
        let chunk = &self.chunks[(id >> CHUNK_BITS) as usize];
        let drawn = &self.drawn[chunk.object];
        let model = &*self.scene.objects[drawn.index].model;
        let triangle = chunk.triangles.start + id as usize % CHUNK_TRIANGLES;
        let indices = model.triangles()[triangle].map(|i| i as usize);
        Face {
            model,
            material: &model.parts()[chunk.part].material,
            indices,
            corners: indices.map(|i| self.vertices[drawn.first_vertex + i].homogeneous),
            world_from_object: &drawn.world_from_object,
        }
    }

    /// Perspective-correct barycentric coordinates by homogeneous edge functions (Olano and Greer
    /// 1997): valid for corners behind the viewer too. `None` where the face is seen edge-on.
    fn sight(&self, face: &Face, pixel: Vec2) -> Option<Sight> {
        // Relative to the pixel, so that f32 holds small triangles far from the image corner.
        let w = face.corners.map(|c| if self.projector.perspective { c.z } else { 1.0 });
        let p: [Vec2; 3] = std::array::from_fn(|i| face.corners[i].truncate() - pixel * w[i]);
        let per_corner = |f: &dyn Fn(usize, usize) -> f32| Vec3::new(f(1, 2), f(2, 0), f(0, 1));
        let edges = per_corner(&|j, k| p[j].perp_dot(p[k]));
        let edges_u = per_corner(&|j, k| w[k] * p[j].y - w[j] * p[k].y);
        let edges_v = per_corner(&|j, k| w[j] * p[k].x - w[k] * p[j].x);
        let inverse = edges.element_sum().recip();
        let weights = edges * inverse;
        if !weights.is_finite() {
            return None;
        }
        let (scale, _) = self.view.scale_and_centre();
        let mirrored = scale.x * scale.y < 0.0;
        Some(Sight {
            weights,
            weights_u: (edges_u - weights * edges_u.element_sum()) * inverse,
            weights_v: (edges_v - weights * edges_v.element_sum()) * inverse,
            front: (edges.dot(Vec3::from(w)) < 0.0) != mirrored,
        })
    }

    fn depth(&self, nearness: f32) -> f32 {
        if self.projector.perspective { nearness.recip() } else { -nearness }
    }

    /// What pixel (x, y) shows, given its samples' nearest virtual surfaces and the real depth.
    pub fn pixel(
        &self,
        x: usize,
        y: usize,
        nearness: &[f32; SAMPLES],
        ids: &[u32; SAMPLES],
        real: &GBuffer,
    ) -> Option<Seen> {
        let covered = (0..SAMPLES).filter(|&s| nearness[s] > f32::NEG_INFINITY);
        let covered = covered.fold(0u8, |mask, s| mask | 1 << s);
        if covered == 0 {
            return None;
        }
        let visible = self.visible(covered, x, y, nearness, ids, real);
        if visible == 0 {
            return None;
        }
        // The centre if it is seen, else any sample that is: never a place off the surface.
        let sample = visible.trailing_zeros() as usize;
        let face = self.face(ids[sample]);
        let pixel = Vec2::new(x as f32, y as f32) + sample_offset(sample);
        let sight = self.sight(&face, pixel);
        let [r, g, b, _] = color(&face, sight.as_ref());
        let surface = (sample == 0).then(|| {
            let depths = Vec3::from(face.corners.map(|c| c.z));
            let depth = sight.as_ref().map_or(0.0, |s| s.inside().dot(depths));
            let depth = if depth > 0.0 { depth } else { self.depth(nearness[0]) };
            (depth, self.normal(&face, sight.as_ref(), pixel))
        });
        let coverage = visible.count_ones() as f32 / SAMPLES as f32;
        // max first: NaN from a file becomes 0
        Some(Seen { coverage, albedo: [r, g, b].map(|c| c.max(0.0).min(1.0)), surface })
    }

    /// Which of the covered samples lie in front of the real surface. Missing depth is far away.
    fn visible(
        &self,
        covered: u8,
        x: usize,
        y: usize,
        nearness: &[f32; SAMPLES],
        ids: &[u32; SAMPLES],
        real: &GBuffer,
    ) -> u8 {
        let around = Neighbourhood::new(&real.depth_m, x, y);
        let (mut near, mut far) = (f32::INFINITY, 0.0f32);
        let (mut real_near, mut real_far) = (f32::INFINITY, 0.0f32);
        for s in (0..SAMPLES).filter(|s| covered >> s & 1 != 0) {
            let depth = self.depth(nearness[s]);
            (near, far) = (near.min(depth), far.max(depth));
        }
        for &depth in around.depth.as_flattened() {
            (real_near, real_far) = (real_near.min(depth), real_far.max(depth));
        }
        // No continued triangle leaves this range within a pixel.
        let slack = 2.0 * self.max_slope(far) + DEPTH_BIAS * far;
        if real_near > far + slack {
            return covered;
        }
        if real_far < near - slack {
            return 0;
        }
        (0..SAMPLES)
            .filter(|s| covered >> s & 1 != 0)
            .filter(|&s| self.sample_is_in_front(s, x, y, self.depth(nearness[s]), ids[s], &around))
            .fold(0, |mask, s| mask | 1 << s)
    }

    /// Largest change of depth to the next pixel.
    fn max_slope(&self, depth: f32) -> f32 {
        let (scale, _) = self.view.scale_and_centre();
        let w = if self.projector.perspective { depth } else { 1.0 };
        MAX_SLOPE * w / scale.abs().min_element()
    }

    /// Compares the real depth with the sample's triangle, continued to the four pixel centres around
    /// the sample, and interpolates the bounded differences. So surfaces that cross do so on a straight
    /// line, and the edge of a real object, known only by whole pixels, is cut half-way.
    fn sample_is_in_front(
        &self,
        sample: usize,
        x: usize,
        y: usize,
        depth: f32,
        id: u32,
        around: &Neighbourhood,
    ) -> bool {
        let bias = DEPTH_BIAS * depth;
        let offset = sample_offset(sample);
        if offset == Vec2::ZERO {
            return around.depth[1][1] > depth + bias;
        }
        let face = self.face(id);
        let limit = self.max_slope(depth);
        let bounded = |slope: f32| if slope.is_finite() { slope.clamp(-limit, limit) } else { 0.0 };
        let slope =
            self.sight(&face, Vec2::new(x as f32, y as f32) + offset).map_or(Vec2::ZERO, |sight| {
                let depths = Vec3::from(face.corners.map(|c| c.z));
                let (u, v) = (sight.weights_u.dot(depths), sight.weights_v.dot(depths));
                Vec2::new(bounded(u), bounded(v))
            });
        let side = [offset.x, offset.y].map(|o| if o < 0.0 { 0 } else { 2 });
        let (tx, ty) = (offset.x.abs(), offset.y.abs());
        let corners = [
            (1, 1, (1.0 - tx) * (1.0 - ty)),
            (side[0], 1, tx * (1.0 - ty)),
            (1, side[1], (1.0 - tx) * ty),
            (side[0], side[1], tx * ty),
        ];
        let range = CROSSING_RANGE * depth;
        let difference: f32 = corners
            .iter()
            .map(|&(i, j, weight)| {
                let step = Vec2::new(around.step_x[i], around.step_y[j]) - offset;
                let gap = around.depth[j][i] - (depth + slope.dot(step)) - bias;
                weight * (gap / range).clamp(-1.0, 1.0)
            })
            .sum();
        difference > 0.0
    }

    /// Interpolated world normal, on the side that is seen.
    fn normal(&self, face: &Face, sight: Option<&Sight>, pixel: Vec2) -> Vec3 {
        let eye = self.world_from_view * self.view.towards_eye(pixel);
        let Some(sight) = sight else { return eye };
        let side = if sight.front { 1.0 } else { -1.0 };
        let vertices = face.indices.map(|i| &face.model.vertices()[i]);
        let weights = sight.inside();
        let smooth = vertices[0].normal * weights.x
            + vertices[1].normal * weights.y
            + vertices[2].normal * weights.z;
        let [a, b, c] = vertices.map(|v| v.position.as_dvec3());
        let flat = || (b - a).cross(c - a).normalize_or_zero().as_vec3();
        let to_world = |normal: Vec3| (*face.world_from_object * normal * side).try_normalize();
        let Some(normal) = to_world(smooth).or_else(|| to_world(flat())) else { return eye };
        // A smooth normal may turn away before the silhouette is reached: it stops at the horizon.
        let facing = normal.dot(eye);
        if facing >= 0.0 {
            return normal;
        }
        (normal - eye * facing).try_normalize().unwrap_or(eye)
    }
}

/// The real depth of 3x3 pixels; missing is infinitely far.
struct Neighbourhood {
    depth: [[f32; 3]; 3],
    /// Distance in pixels of columns and rows from the middle one; 0 where the image ends.
    step_x: [f32; 3],
    step_y: [f32; 3],
}

impl Neighbourhood {
    fn new(depth: &crate::image::Image<f32>, x: usize, y: usize) -> Self {
        let columns = [x.saturating_sub(1), x, (x + 1).min(depth.width() - 1)];
        let rows = [y.saturating_sub(1), y, (y + 1).min(depth.height() - 1)];
        Self {
            depth: rows.map(|row| {
                let row = depth.row(row);
                columns.map(|column| if row[column] > 0.0 { row[column] } else { f32::INFINITY })
            }),
            step_x: columns.map(|column| column as f32 - x as f32),
            step_y: rows.map(|row| row as f32 - y as f32),
        }
    }
}

/// Linear RGBA of the face: base colour times vertex colour times texture.
fn color(face: &Face, sight: Option<&Sight>) -> [f32; 4] {
    let mut color = face.material.base_color;
    let mut multiply = |other: [f32; 4]| (0..4).for_each(|c| color[c] *= other[c]);
    let weights = sight.map_or(Vec3::splat(1.0 / 3.0), Sight::inside);
    let colors = face.model.colors();
    if !colors.is_empty() {
        let [a, b, c] = face.indices.map(|i| glam::Vec4::from(colors[i]));
        multiply((a * weights.x + b * weights.y + c * weights.z).to_array());
    }
    if let Some(texture) = &face.material.texture {
        let uvs = face.indices.map(|i| face.model.vertices()[i].uv);
        let mix = |w: Vec3| uvs[0] * w.x + uvs[1] * w.y + uvs[2] * w.z;
        let (du, dv) =
            sight.map_or_else(Default::default, |s| (mix(s.weights_u), mix(s.weights_v)));
        multiply(texture.sample(mix(weights), du, dv));
    }
    color
}

impl Holes for Resolver<'_> {
    fn is_hole(&self, id: u32, x: usize, y: usize) -> bool {
        let face = self.face(id);
        let Some(cutoff) = face.material.alpha_cutoff else { return false };
        let sight = self.sight(&face, Vec2::new(x as f32, y as f32));
        color(&face, sight.as_ref())[3] < cutoff
    }
}
