//! From the nearest triangle at each sample to what a pixel shows.

use super::cover::{Holes, SAMPLES, sample_offset};
use super::project::{CHUNK_BITS, CHUNK_TRIANGLES, Chunk, Projector, ScreenVertex};
use super::real_depth::Neighbourhood;
use crate::geometry::GBuffer;
use crate::math::View;
use crate::scene::model::{Material, Model};
use crate::scene::objects::VirtualScene;
use glam::{Mat3, Vec2, Vec3};

/// A virtual surface must be nearer than the real one by this share of its depth. 1 mm at 1 m: what
/// filtered depth is uncertain by, so that an object standing on a real surface does not flicker
/// through it, and too little to see that its foot is missing.
pub const DEPTH_BIAS: f32 = 1e-3;
/// Where real and virtual depths differ by less than this share, the line where the surfaces cross is
/// found between pixel centres; where they differ by more, the edge lies half-way between.
pub const CROSSING_RANGE: f32 = 0.02;
/// Slope, in depth per width of a pixel at that depth, beyond which a triangle is not continued to
/// the next pixel: 83 degrees from the viewer.
pub const MAX_SLOPE: f32 = 8.0;

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
    /// Whether pixels count against the view's x or y axis.
    pub mirrored: bool,
    /// Largest change of depth to the next pixel, for w = 1.
    pub max_slope: f32,
}

/// One pixel of the result.
pub struct Seen {
    /// Share of the samples that show a virtual surface; never zero.
    pub coverage: f32,
    pub albedo: [f32; 3],
    /// Depth in metres and world normal, where the pixel's centre shows a virtual surface.
    pub surface: Option<(f32, Vec3)>,
}

/// A triangle and what shades it.
pub struct Face<'a> {
    model: &'a Model,
    material: &'a Material,
    indices: [usize; 3],
    /// Homogeneous pixel coordinates of the corners.
    corners: [Vec3; 3],
    world_from_object: &'a Mat3,
}

/// A face at one place of the picture, by homogeneous edge functions (Olano and Greer 1997): they are
/// perspective-correct, and valid for corners behind the viewer too.
struct Sight {
    /// Corners relative to the place, times their w.
    corners: [Vec2; 3],
    w: [f32; 3],
    edges: Vec3,
    /// Of the edges' sum.
    inverse: f32,
    /// Barycentric coordinates; may be outside the face.
    weights: Vec3,
}

impl Sight {
    /// `None` where the face is seen edge-on.
    #[inline(always)]
    fn new(face: &Face, perspective: bool, pixel: Vec2) -> Option<Self> {
        // Relative to the pixel, so that f32 holds small triangles far from the image corner.
        let w = face.corners.map(|c| if perspective { c.z } else { 1.0 });
        let p: [Vec2; 3] = std::array::from_fn(|i| face.corners[i].truncate() - pixel * w[i]);
        let edges = Vec3::new(p[1].perp_dot(p[2]), p[2].perp_dot(p[0]), p[0].perp_dot(p[1]));
        let inverse = (edges.x + edges.y + edges.z).recip();
        let weights = edges * inverse;
        weights.is_finite().then_some(Self { corners: p, w, edges, inverse, weights })
    }

    /// Change of the barycentric coordinates to the next pixel in x and in y.
    fn weight_steps(&self) -> [Vec3; 2] {
        let (p, w) = (&self.corners, &self.w);
        let edges_u = [(1, 2), (2, 0), (0, 1)].map(|(j, k)| w[k] * p[j].y - w[j] * p[k].y);
        let edges_v = [(1, 2), (2, 0), (0, 1)].map(|(j, k)| w[j] * p[k].x - w[k] * p[j].x);
        [edges_u, edges_v].map(|edges| {
            let edges = Vec3::from(edges);
            (edges - self.weights * edges.element_sum()) * self.inverse
        })
    }

    /// Barycentric coordinates of the nearest place within the face.
    #[inline(always)]
    fn inside(&self) -> Vec3 {
        let weights = self.weights.max(Vec3::ZERO);
        // The weights sum to one, so without negative ones it is no less.
        weights / (weights.x + weights.y + weights.z)
    }

    /// Sign of the face's orientation: negative where the outside is seen in an unmirrored view.
    #[inline(always)]
    fn orientation(&self) -> f32 {
        self.edges.dot(Vec3::from(self.w))
    }
}

impl<'a> Resolver<'a> {
    pub fn new(
        scene: &'a VirtualScene,
        drawn: &'a [DrawnObject],
        chunks: &'a [Chunk],
        vertices: &'a [ScreenVertex],
        view: View,
        projector: Projector,
    ) -> Self {
        let (scale, _) = view.scale_and_centre();
        Self {
            scene,
            drawn,
            chunks,
            vertices,
            view,
            projector,
            world_from_view: Mat3::from(view.world_from_view_f32().matrix3),
            mirrored: scale.x * scale.y < 0.0,
            max_slope: MAX_SLOPE / scale.abs().min_element(),
        }
    }

    /// The id under which a triangle is drawn.
    pub fn id(chunk: usize, triangle: u32) -> u32 {
        (chunk as u32) << CHUNK_BITS | triangle
    }

    #[inline(always)]
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

    fn depth(&self, nearness: f32) -> f32 {
        if self.projector.perspective { nearness.recip() } else { -nearness }
    }

    /// What pixel (x, y) shows, given its samples' nearest virtual surfaces and the real depth.
    /// `real_range` is the least and the largest real depth of the 3x3 pixels; `last` keeps the face of
    /// one pixel for the next.
    #[inline(always)]
    pub fn pixel(
        &self,
        x: usize,
        y: usize,
        nearness: &[f32; SAMPLES],
        ids: &[u32; SAMPLES],
        real: &GBuffer,
        real_range: (f32, f32),
        last: &mut Option<(u32, Face<'a>)>,
    ) -> Option<Seen> {
        let mut covered = 0u8;
        let (mut nearest, mut furthest) = (f32::NEG_INFINITY, f32::INFINITY);
        for s in 0..SAMPLES {
            let drawn = nearness[s] > f32::NEG_INFINITY;
            covered |= u8::from(drawn) << s;
            nearest = if nearness[s] > nearest { nearness[s] } else { nearest };
            furthest = if drawn & (nearness[s] < furthest) { nearness[s] } else { furthest };
        }
        if covered == 0 {
            return None;
        }
        let (near, far) = (self.depth(nearest), self.depth(furthest));
        // No triangle, continued by a pixel, leaves this range.
        let slack = 2.0 * self.max_slope(far) + DEPTH_BIAS * far;
        let visible = if real_range.0 > far + slack {
            covered
        } else if real_range.1 < near - slack {
            0
        } else {
            self.visible(covered, x, y, nearness, ids, real)
        };
        if visible == 0 {
            return None;
        }
        // The centre if it is seen, else any sample that is: never a place off the surface.
        let sample = visible.trailing_zeros() as usize;
        let id = ids[sample];
        let face = match last {
            Some((last_id, face)) if *last_id == id => face,
            last => &last.insert((id, self.face(id))).1,
        };
        let pixel = Vec2::new(x as f32, y as f32) + sample_offset(sample);
        let sight = Sight::new(face, self.projector.perspective, pixel);
        let surface = if sample == 0 {
            let depths = Vec3::from(face.corners.map(|c| c.z));
            let depth = sight.as_ref().map_or(0.0, |s| s.inside().dot(depths));
            let depth = if depth > 0.0 { depth } else { self.depth(nearness[0]) };
            Some((depth, self.normal(face, sight.as_ref(), pixel)))
        } else {
            None
        };
        let [r, g, b, _] = color(face, sight.as_ref());
        let coverage = visible.count_ones() as f32 / SAMPLES as f32;
        // NaN from a file becomes 0
        let albedo = [r, g, b].map(|c| if c > 0.0 { c.min(1.0) } else { 0.0 });
        Some(Seen { coverage, albedo, surface })
    }

    /// Which of the covered samples lie in front of the real surface. Missing depth is far away.
    ///
    /// Compares the real depth with the sample's triangle, continued to the four pixel centres around
    /// the sample, and interpolates the bounded differences. So surfaces that cross do so on a straight
    /// line, and the edge of a real object, known only by whole pixels, is cut half-way.
    #[inline(never)]
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
        let (mut open, mut visible) = (covered, 0);
        // Samples of the same triangle share one comparison.
        while open != 0 {
            let first = open.trailing_zeros() as usize;
            let gaps = self.gaps(x, y, first, self.depth(nearness[first]), ids[first], &around);
            for s in first..SAMPLES {
                if open >> s & 1 == 0 || ids[s] != ids[first] {
                    continue;
                }
                open &= !(1 << s);
                visible |= u8::from(interpolated(&gaps, s) > 0.0) << s;
            }
        }
        visible
    }

    /// Real depth minus that of a triangle at 3x3 pixel centres, bounded to -1..1. The triangle has
    /// `depth` at `sample`.
    fn gaps(
        &self,
        x: usize,
        y: usize,
        sample: usize,
        depth: f32,
        id: u32,
        around: &Neighbourhood,
    ) -> [[f32; 3]; 3] {
        let face = self.face(id);
        let offset = sample_offset(sample);
        let limit = self.max_slope(depth);
        let bounded = |slope: f32| if slope.is_finite() { slope.clamp(-limit, limit) } else { 0.0 };
        let pixel = Vec2::new(x as f32, y as f32) + offset;
        let slope = Sight::new(&face, self.projector.perspective, pixel).map_or(Vec2::ZERO, |s| {
            let depths = Vec3::from(face.corners.map(|c| c.z));
            Vec2::from(s.weight_steps().map(|step| bounded(step.dot(depths))))
        });
        let per_range = (CROSSING_RANGE * depth).recip();
        std::array::from_fn(|j| {
            std::array::from_fn(|i| {
                let step = Vec2::new(around.step_x[i], around.step_y[j]) - offset;
                let virtual_depth = depth + slope.dot(step) + DEPTH_BIAS * depth;
                ((around.depth[j][i] - virtual_depth) * per_range).clamp(-1.0, 1.0)
            })
        })
    }

    fn max_slope(&self, depth: f32) -> f32 {
        if self.projector.perspective { self.max_slope * depth } else { self.max_slope }
    }

    /// Interpolated world normal, on the side that is seen.
    #[inline(always)]
    fn normal(&self, face: &Face, sight: Option<&Sight>, pixel: Vec2) -> Vec3 {
        let to_eye = self.world_from_view * self.view_to_eye(pixel);
        let Some(sight) = sight else { return to_eye.normalize() };
        let front = (sight.orientation() < 0.0) != self.mirrored;
        let side = if front { 1.0 } else { -1.0 };
        let vertices = face.indices.map(|i| &face.model.vertices()[i]);
        let weights = sight.inside();
        let smooth = vertices[0].normal * weights.x
            + vertices[1].normal * weights.y
            + vertices[2].normal * weights.z;
        let to_world = |normal: Vec3| (*face.world_from_object * normal * side).try_normalize();
        let normal = to_world(smooth).or_else(|| {
            let [a, b, c] = vertices.map(|v| v.position.as_dvec3());
            to_world((b - a).cross(c - a).normalize_or_zero().as_vec3())
        });
        let Some(normal) = normal else { return to_eye.normalize() };
        if normal.dot(to_eye) >= 0.0 {
            return normal;
        }
        // A smooth normal may turn away before the silhouette is reached: it stops at the horizon.
        let eye = to_eye.normalize();
        (normal - eye * normal.dot(eye)).try_normalize().unwrap_or(eye)
    }

    /// Towards the eye in view axes, of any length.
    #[inline(always)]
    fn view_to_eye(&self, pixel: Vec2) -> Vec3 {
        if self.projector.perspective { -self.view.unproject(pixel, 1.0) } else { -Vec3::Z }
    }
}

/// Bilinear value at a sample from those at 3x3 pixel centres.
fn interpolated(values: &[[f32; 3]; 3], sample: usize) -> f32 {
    let offset = sample_offset(sample);
    let [i, j] = [offset.x, offset.y].map(|o| if o < 0.0 { 0 } else { 2 });
    let (tx, ty) = (offset.x.abs(), offset.y.abs());
    let near = values[1][1] + tx * (values[1][i] - values[1][1]);
    let far = values[j][1] + tx * (values[j][i] - values[j][1]);
    near + ty * (far - near)
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
        let (du, dv) = sight.map_or_else(Default::default, |s| s.weight_steps().map(mix).into());
        multiply(texture.sample(mix(weights), du, dv));
    }
    color
}

impl Holes for Resolver<'_> {
    fn is_hole(&self, id: u32, x: usize, y: usize) -> bool {
        let face = self.face(id);
        let Some(cutoff) = face.material.alpha_cutoff else { return false };
        let sight = Sight::new(&face, self.projector.perspective, Vec2::new(x as f32, y as f32));
        color(&face, sight.as_ref())[3] < cutoff
    }
}
