//! From model space to pixels: projection, clipping, and sorting of triangles into bands of rows.

use crate::math::View;
use crate::scene::objects::Similarity;
use glam::{Affine3A, DAffine3, DMat3, DVec3, Vec3};
use std::ops::Range;

/// Positions are rounded to 1/256 pixel, so that edge functions are exact integers.
pub const SUBPIXELS: i32 = 256;
/// Surfaces nearer than this to the view plane are not seen; it keeps 1 / z finite.
pub const NEAR_M: f32 = 1e-3;
/// Triangles are clipped this far from the middle of the image: the edge functions of anything
/// inside fit the integers of the coverage kernel. Images may be twice as wide.
const GUARD_PX: f32 = 8190.0;
/// Furthest that a sample lies from its pixel's centre, in subpixels.
pub const MAX_SAMPLE_OFFSET: i32 = 7 * SUBPIXELS / 16;

/// Triangles of a chunk: one unit of parallel work, and the low bits of a triangle's id.
pub const CHUNK_BITS: u32 = 12;
pub const CHUNK_TRIANGLES: usize = 1 << CHUNK_BITS;
/// The other bits are left for the number of the chunk.
pub const MAX_CHUNKS: usize = 1 << (32 - CHUNK_BITS);
/// Marks entries that stand for a clipped piece.
const CLIPPED: u32 = 1 << 31;

const LEFT: u32 = 1;
const RIGHT: u32 = 2;
const TOP: u32 = 4;
const BOTTOM: u32 = 8;
const NEAR: u32 = 16;
const GUARD: u32 = 32;
const BROKEN: u32 = 64;

/// A projected vertex as the coverage kernel needs it.
#[derive(Clone, Copy, Debug, Default)]
pub struct ScreenPoint {
    /// Pixel coordinates in [`SUBPIXELS`]; unspecified where the point needs clipping.
    pub u: i32,
    pub v: i32,
    /// Grows towards the viewer and is linear on the screen: 1 / z in a perspective view, -z in an
    /// orthographic one.
    pub nearness: f32,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct ScreenVertex {
    /// Homogeneous pixel coordinates `(u w, v w)` and z in metres; w is z in a perspective view
    /// and 1 in an orthographic one.
    pub homogeneous: Vec3,
    pub point: ScreenPoint,
    outcode: u32,
}

/// The view of one frame, ready to project.
#[derive(Clone, Copy, Debug)]
pub struct Projector {
    view: View,
    pub perspective: bool,
    /// Last column and row of pixel centres.
    last: glam::Vec2,
    middle: glam::Vec2,
}

impl Projector {
    pub fn new(view: &View) -> Self {
        let size = view.size();
        let last = glam::Vec2::new(size.width as f32 - 1.0, size.height as f32 - 1.0);
        Self { view: *view, perspective: view.is_perspective(), last, middle: 0.5 * last }
    }

    /// Homogeneous pixel coordinates from model space.
    pub fn screen_from_object(&self, world_from_object: &Similarity) -> Affine3A {
        let rigid = DAffine3::from_rotation_translation(
            world_from_object.rotation.as_dquat(),
            world_from_object.translation.as_dvec3(),
        );
        let (scale, centre) = self.view.scale_and_centre();
        let (scale, centre) = (scale.as_dvec2(), centre.as_dvec2());
        let (by_depth, by_one) = if self.perspective {
            (centre, glam::DVec2::ZERO)
        } else {
            (glam::DVec2::ZERO, centre)
        };
        let screen_from_view = DAffine3::from_mat3_translation(
            DMat3::from_cols(
                DVec3::new(scale.x, 0.0, 0.0),
                DVec3::new(0.0, scale.y, 0.0),
                by_depth.extend(1.0),
            ),
            by_one.extend(0.0),
        );
        let size = DAffine3::from_scale(DVec3::splat(world_from_object.scale.into()));
        (screen_from_view * view_from_world(&self.view) * rigid * size).as_affine3a()
    }

    /// Whether nothing of a sphere can be in the picture.
    pub fn misses(&self, centre: Vec3, radius: f32) -> bool {
        let (scale, offset) = self.view.scale_and_centre();
        let p = view_from_world(&self.view).transform_point3(centre.as_dvec3()).as_vec3();
        // The picture lies between scale x - low w >= 0 and high w - scale x >= 0; same for y.
        let (low, high) = (-0.5 - offset, self.last + 0.5 - offset);
        let w = if self.perspective { p.z } else { 1.0 };
        let side = |x: f32, scale: f32, low: f32, high: f32| {
            let by_w = |edge: f32| if self.perspective { edge } else { 0.0 };
            let far_low = (scale * x - low * w) < -radius * scale.hypot(by_w(low));
            let far_high = (high * w - scale * x) < -radius * scale.hypot(by_w(high));
            far_low || far_high
        };
        p.z + radius < NEAR_M
            || side(p.x, scale.x, low.x, high.x)
            || side(p.y, scale.y, low.y, high.y)
    }

    fn w(&self, z: f32) -> f32 {
        if self.perspective { z } else { 1.0 }
    }

    pub fn vertex(&self, homogeneous: Vec3) -> ScreenVertex {
        let Vec3 { x, y, z } = homogeneous;
        let w = self.w(z);
        let mut outcode = 0;
        let mut set = |outside: bool, bit: u32| outcode |= if outside { bit } else { 0 };
        set(x < -0.5 * w, LEFT);
        set(x > (self.last.x + 0.5) * w, RIGHT);
        set(y < -0.5 * w, TOP);
        set(y > (self.last.y + 0.5) * w, BOTTOM);
        set(z < NEAR_M, NEAR);
        let far = (x - self.middle.x * w).abs().max((y - self.middle.y * w).abs());
        set(far > GUARD_PX * w, GUARD);
        set(!homogeneous.is_finite(), BROKEN);
        let point = if outcode & (NEAR | GUARD | BROKEN) == 0 {
            self.point(homogeneous.as_dvec3())
        } else {
            ScreenPoint::default()
        };
        ScreenVertex { homogeneous, point, outcode }
    }

    /// f64, so that a clipped vertex does not depend on which triangle it was clipped for.
    fn point(&self, homogeneous: DVec3) -> ScreenPoint {
        let DVec3 { x, y, z } = homogeneous;
        let w = if self.perspective { z } else { 1.0 };
        let fixed = |h: f64| (h / w * f64::from(SUBPIXELS)).round() as i32;
        let nearness = if self.perspective { 1.0 / z } else { -z };
        ScreenPoint { u: fixed(x), v: fixed(y), nearness: nearness as f32 }
    }

    /// Clips a triangle to the near plane and the guard band (Sutherland and Hodgman 1974). Calls
    /// `out` with the triangles of a fan.
    fn clip(&self, triangle: [Vec3; 3], mut out: impl FnMut([ScreenPoint; 3])) {
        let (middle, guard) = (self.middle.as_dvec2(), f64::from(GUARD_PX));
        let w = |p: DVec3| if self.perspective { p.z } else { 1.0 };
        let planes: [&dyn Fn(DVec3) -> f64; 5] = [
            &|p| p.z - f64::from(NEAR_M),
            &|p| p.x - (middle.x - guard) * w(p),
            &|p| (middle.x + guard) * w(p) - p.x,
            &|p| p.y - (middle.y - guard) * w(p),
            &|p| (middle.y + guard) * w(p) - p.y,
        ];
        // Each plane adds at most one corner.
        let mut polygon = [DVec3::ZERO; 8];
        let mut count = 3;
        polygon[..3].copy_from_slice(&triangle.map(|p| p.as_dvec3()));
        for distance in planes {
            let (corners, n) = (polygon, count);
            count = 0;
            let mut push = |p| {
                polygon[count] = p;
                count += 1;
            };
            for i in 0..n {
                let (a, b) = (corners[i], corners[(i + 1) % n]);
                let (da, db) = (distance(a), distance(b));
                if da >= 0.0 {
                    push(a);
                }
                // From inside to outside, so that both triangles at an edge cut it at the same bits.
                if da >= 0.0 && db < 0.0 {
                    push(a + (b - a) * (da / (da - db)));
                } else if da < 0.0 && db >= 0.0 {
                    push(b + (a - b) * (db / (db - da)));
                }
            }
            if count < 3 {
                return;
            }
        }
        let points =
            polygon.map(|p| if p.z > 0.0 { self.point(p) } else { ScreenPoint::default() });
        for i in 1..count - 1 {
            out([points[0], points[i], points[i + 1]]);
        }
    }
}

fn view_from_world(view: &View) -> DAffine3 {
    let inverse = view.world_from_view.inverse();
    let (q, t) = (inverse.rotation.coords, inverse.translation.vector);
    DAffine3::from_rotation_translation(
        glam::DQuat::from_xyzw(q.x, q.y, q.z, q.w),
        DVec3::new(t.x, t.y, t.z),
    )
}

/// Up to [`CHUNK_TRIANGLES`] triangles of one part of one object, sorted into bands of rows.
#[derive(Debug, Default)]
pub struct Chunk {
    /// Index into the list of drawn objects, and of the part in its model.
    pub object: usize,
    pub part: usize,
    /// Indices into the model's triangles.
    pub triangles: Range<usize>,
    /// Pixels that may be touched; empty where `rows` is.
    pub columns: Range<usize>,
    pub rows: Range<usize>,
    clipped: Vec<([ScreenPoint; 3], u32)>,
    /// Triangles of band b: `entries[offsets[b]..offsets[b + 1]]`, in the model's order.
    entries: Vec<u32>,
    offsets: Vec<u32>,
    found: Vec<(u32, Range<u16>)>,
}

impl Chunk {
    pub fn reset(&mut self, object: usize, part: usize, triangles: Range<usize>) {
        (self.object, self.part, self.triangles) = (object, part, triangles);
    }

    /// Finds the bands that each triangle touches. `vertices` are those of the object.
    pub fn sort(
        &mut self,
        projector: &Projector,
        vertices: &[ScreenVertex],
        triangles: &[[u32; 3]],
        band_rows: usize,
    ) {
        let (width, height) = (projector.last.x as i32 + 1, projector.last.y as i32 + 1);
        let bands = (height as usize).div_ceil(band_rows);
        self.clipped.clear();
        self.found.clear();
        self.offsets.clear();
        self.offsets.resize(bands + 1, 0);
        let (mut columns, mut rows) = ((i32::MAX, -1), (i32::MAX, -1));
        let (found, offsets) = (&mut self.found, &mut self.offsets);
        let mut place = |entry: u32, corners: [ScreenPoint; 3]| {
            let u = pixels(corners.map(|p| p.u), width);
            let v = pixels(corners.map(|p| p.v), height);
            if u.0 > u.1 || v.0 > v.1 || double_area(corners) == 0 {
                return false;
            }
            columns = (columns.0.min(u.0), columns.1.max(u.1));
            rows = (rows.0.min(v.0), rows.1.max(v.1));
            let (first, last) = (v.0 as usize / band_rows, v.1 as usize / band_rows);
            found.push((entry, first as u16..last as u16 + 1));
            offsets[first + 1..=last + 1].iter_mut().for_each(|count| *count += 1);
            true
        };
        for (local, triangle) in triangles[self.triangles.clone()].iter().enumerate() {
            let corners = triangle.map(|i| &vertices[i as usize]);
            let all = corners[0].outcode & corners[1].outcode & corners[2].outcode;
            let any = corners[0].outcode | corners[1].outcode | corners[2].outcode;
            if all & (LEFT | RIGHT | TOP | BOTTOM | NEAR) != 0 || any & BROKEN != 0 {
                continue;
            }
            if any & (NEAR | GUARD) == 0 {
                place(local as u32, corners.map(|c| c.point));
                continue;
            }
            let clipped = &mut self.clipped;
            projector.clip(corners.map(|c| c.homogeneous), |piece| {
                if place(CLIPPED | clipped.len() as u32, piece) {
                    clipped.push((piece, local as u32));
                }
            });
        }
        self.columns = columns.0.max(0) as usize..(columns.1 + 1) as usize;
        self.rows = rows.0.max(0) as usize..(rows.1 + 1) as usize;
        self.fill_entries();
    }

    /// Counting sort by band; keeps the order of triangles within a band.
    fn fill_entries(&mut self) {
        for band in 1..self.offsets.len() {
            self.offsets[band] += self.offsets[band - 1];
        }
        let total = self.offsets.last().copied().unwrap_or(0) as usize;
        self.entries.clear();
        self.entries.resize(total, 0);
        // `offsets` serves as the list of write positions, then is shifted back.
        for (entry, bands) in &self.found {
            for band in bands.clone() {
                let at = &mut self.offsets[usize::from(band)];
                self.entries[*at as usize] = *entry;
                *at += 1;
            }
        }
        self.offsets.rotate_right(1);
        if let Some(first) = self.offsets.first_mut() {
            *first = 0;
        }
    }

    /// Corners of the triangles of a band, and which of the chunk's triangles each belongs to.
    pub fn band<'a>(
        &'a self,
        band: usize,
        vertices: &'a [ScreenVertex],
        triangles: &'a [[u32; 3]],
    ) -> impl Iterator<Item = ([ScreenPoint; 3], u32)> + use<'a> {
        let range = self.offsets[band] as usize..self.offsets[band + 1] as usize;
        let triangles = &triangles[self.triangles.clone()];
        self.entries[range].iter().map(move |&entry| {
            if entry & CLIPPED != 0 {
                self.clipped[(entry & !CLIPPED) as usize]
            } else {
                (triangles[entry as usize].map(|i| vertices[i as usize].point), entry)
            }
        })
    }
}

/// Twice the signed area in square subpixels.
pub fn double_area([a, b, c]: [ScreenPoint; 3]) -> i64 {
    i64::from(b.u - a.u) * i64::from(c.v - a.v) - i64::from(b.v - a.v) * i64::from(c.u - a.u)
}

/// First and last of `n` pixels that may have a sample between the least and the largest coordinate.
pub fn pixels([a, b, c]: [i32; 3], n: i32) -> (i32, i32) {
    let first = (a.min(b).min(c) - MAX_SAMPLE_OFFSET + SUBPIXELS - 1).div_euclid(SUBPIXELS);
    let last = (a.max(b).max(c) + MAX_SAMPLE_OFFSET).div_euclid(SUBPIXELS);
    (first.max(0), last.min(n - 1))
}
