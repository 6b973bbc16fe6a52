//! Draws virtual objects into a geometry buffer: *which* surface is nearest is found for eight
//! samples a pixel with exact integer edges, and only what is seen is shaded.

mod cover;
mod project;
mod real_depth;
mod resolve;
#[cfg(test)]
pub(crate) mod tests;

#[cfg(feature = "gpu")]
pub(crate) use cover::{SAMPLES, sample_offset};
#[cfg(feature = "gpu")]
pub(crate) use project::NEAR_M;
#[cfg(feature = "gpu")]
pub(crate) use resolve::{CROSSING_RANGE, DEPTH_BIAS, MAX_SLOPE};

use super::objects::VirtualScene;
use crate::compositing::VirtualLayer;
use crate::geometry::{GBuffer, Origin};
use crate::math::View;
use cover::{SampleBlock, cover_solid, cover_with_holes};
use glam::{Mat3, Vec3};
pub(crate) use project::Projector;
use project::{CHUNK_TRIANGLES, Chunk, MAX_CHUNKS, ScreenPoint, ScreenVertex};
use rayon::prelude::*;
use real_depth::RealRange;
use resolve::{DrawnObject, Resolver};
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Rows that one thread draws at a time.
const BAND_ROWS: usize = 16;
/// Vertices that one thread projects at a time.
const VERTEX_BATCH: usize = 4096;

/// What was drawn.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DrawReport {
    /// Objects that may be in the picture.
    pub objects: usize,
    /// Pixels whose centre shows a virtual surface.
    pub pixels: usize,
    /// Pixels that a virtual surface reaches into, those whose centre shows one included.
    pub covered: usize,
    /// Outside these rows and columns the picture is that of the real scene.
    pub columns: Range<usize>,
    pub rows: Range<usize>,
}

/// Keeps its working memory from frame to frame and from view to view.
#[derive(Debug, Default)]
pub struct Rasteriser {
    vertices: Vec<ScreenVertex>,
    drawn: Vec<DrawnObject>,
    /// Only the first `active_chunks` are of this frame.
    chunks: Vec<Chunk>,
    active_chunks: usize,
    /// One a thread.
    scratch: Vec<Mutex<BandScratch>>,
}

#[derive(Debug, Default)]
struct BandScratch {
    block: SampleBlock,
    list: Vec<([ScreenPoint; 3], u32)>,
    real_range: RealRange,
}

impl Rasteriser {
    /// Whether no object can be in this view's picture.
    pub fn misses(scene: &VirtualScene, view: &View) -> bool {
        let projector = Projector::new(view);
        scene.bounds().all(|bounds| projector.misses(bounds.centre, bounds.radius))
    }

    /// Sets `merged` to `real` with the virtual surfaces that are nearer ([`Origin::Virtual`]), and
    /// `layer` to their base colour and coverage. `merged` says what is seen at pixel centres;
    /// coverage also counts surfaces that reach into a pixel beside its centre, where `merged` still
    /// shows the real one. Base colour is given wherever coverage is not zero, and unspecified
    /// elsewhere. Objects that wait for a place are not drawn.
    pub fn draw(
        &mut self,
        scene: &VirtualScene,
        real: &GBuffer,
        merged: &mut GBuffer,
        layer: &mut VirtualLayer,
    ) -> DrawReport {
        let size = real.size();
        assert_eq!(size, real.view.size(), "a geometry buffer has the size of its view");
        merged.set_view(real.view);
        layer.albedo.reshape(size, [0.0; 3]);
        layer.coverage.reshape(size, 0.0);
        if size.pixels() == 0 {
            return DrawReport::default();
        }
        let projector = Projector::new(&real.view);
        self.project(scene, &projector);
        self.sort(scene, &projector);
        self.draw_bands(scene, projector, real, merged, layer)
    }

    /// Projects the vertices of all objects that may be seen.
    fn project(&mut self, scene: &VirtualScene, projector: &Projector) {
        self.drawn.clear();
        self.vertices.clear();
        for (index, object) in scene.objects.iter().enumerate() {
            let Some(world_from_object) = object.world_from_object() else { continue };
            let Some(bounds) = object.bounds() else { continue };
            if projector.misses(bounds.centre, bounds.radius) {
                continue;
            }
            let first_vertex = self.vertices.len();
            let source = object.model.vertices();
            self.vertices.resize(first_vertex + source.len(), ScreenVertex::default());
            let screen_from_object = projector.screen_from_object(&world_from_object);
            let project = |(out, source): (&mut [ScreenVertex], &[super::Vertex])| {
                for (out, vertex) in out.iter_mut().zip(source) {
                    *out = projector.vertex(screen_from_object.transform_point3(vertex.position));
                }
            };
            let target = &mut self.vertices[first_vertex..];
            if source.len() <= VERTEX_BATCH {
                project((target, source));
            } else {
                target
                    .par_chunks_mut(VERTEX_BATCH)
                    .zip(source.par_chunks(VERTEX_BATCH))
                    .for_each(project);
            }
            let world_from_object = Mat3::from_quat(world_from_object.rotation);
            self.drawn.push(DrawnObject { index, first_vertex, world_from_object });
        }
    }

    /// Cuts the triangles into chunks and finds the bands of rows that each touches.
    fn sort(&mut self, scene: &VirtualScene, projector: &Projector) {
        let mut active = 0;
        for (object, drawn) in self.drawn.iter().enumerate() {
            let parts = scene.objects[drawn.index].model.parts();
            for (part, triangles) in parts.iter().map(|p| p.triangles.clone()).enumerate() {
                for start in triangles.clone().step_by(CHUNK_TRIANGLES) {
                    if active == self.chunks.len() {
                        self.chunks.push(Chunk::default());
                    }
                    let end = (start + CHUNK_TRIANGLES).min(triangles.end);
                    self.chunks[active].reset(object, part, start..end);
                    active += 1;
                }
            }
        }
        if active > MAX_CHUNKS {
            log::error!(
                "only the first {MAX_CHUNKS} of {active} parts of virtual objects are drawn"
            );
            active = MAX_CHUNKS;
        }
        self.active_chunks = active;
        let (drawn, vertices) = (&self.drawn, &self.vertices);
        self.chunks[..active].par_iter_mut().for_each(|chunk| {
            let object = &drawn[chunk.object];
            let model = &scene.objects[object.index].model;
            let vertices = &vertices[object.first_vertex..][..model.vertices().len()];
            chunk.sort(projector, vertices, model.triangles(), BAND_ROWS);
        });
    }

    fn draw_bands(
        &mut self,
        scene: &VirtualScene,
        projector: Projector,
        real: &GBuffer,
        merged: &mut GBuffer,
        layer: &mut VirtualLayer,
    ) -> DrawReport {
        let chunks = &self.chunks[..self.active_chunks];
        let (columns, rows) = (hull(chunks, |c| &c.columns), hull(chunks, |c| &c.rows));
        self.scratch.resize_with(rayon::current_num_threads().max(1), Default::default);
        let (drawn, vertices) = (&self.drawn, &self.vertices);
        let resolver = Resolver::new(scene, drawn, chunks, vertices, real.view, projector);
        let scratch = &self.scratch;
        let (pixels, covered) = bands(merged, layer)
            .enumerate()
            .map(|(index, mut band)| {
                let band_rows = index * BAND_ROWS..(index * BAND_ROWS + band.rows());
                let overlaps =
                    |r: &Range<usize>| r.start < band_rows.end && band_rows.start < r.end;
                band.restore(real, band_rows.start);
                if !overlaps(&rows) {
                    return (0, 0);
                }
                let rows = band_rows.start.max(rows.start)..band_rows.end.min(rows.end);
                let thread = rayon::current_thread_index().unwrap_or(0);
                let mut scratch = scratch[thread].lock().unwrap_or_else(PoisonError::into_inner);
                let BandScratch { block, list, real_range } = &mut *scratch;
                block.clear(columns.clone(), rows);
                cover_band(&resolver, index, block, list);
                resolve_band(&mut band, &resolver, block, real, real_range, index * BAND_ROWS)
            })
            .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        DrawReport { objects: self.drawn.len(), pixels, covered, columns, rows }
    }
}

/// Smallest range around those of all chunks; empty at 0 where there is none.
fn hull(chunks: &[Chunk], range: impl Fn(&Chunk) -> &Range<usize>) -> Range<usize> {
    chunks
        .iter()
        .map(range)
        .filter(|r| !r.is_empty())
        .cloned()
        .reduce(|a, b| a.start.min(b.start)..a.end.max(b.end))
        .unwrap_or(0..0)
}

fn cover_band(
    resolver: &Resolver,
    band: usize,
    block: &mut SampleBlock,
    list: &mut Vec<([ScreenPoint; 3], u32)>,
) {
    for (index, chunk) in resolver.chunks.iter().enumerate() {
        if chunk.rows.start >= block.rows.end || block.rows.start >= chunk.rows.end {
            continue;
        }
        let object = &resolver.drawn[chunk.object];
        let model = &resolver.scene.objects[object.index].model;
        let vertices = &resolver.vertices[object.first_vertex..];
        list.clear();
        list.extend(
            chunk
                .band(band, vertices, model.triangles())
                .map(|(corners, triangle)| (corners, Resolver::id(index, triangle))),
        );
        if model.parts()[chunk.part].material.alpha_cutoff.is_some() {
            cover_with_holes(block, list, resolver);
        } else {
            cover_solid(block, list);
        }
    }
}

/// The same rows of all output images.
struct Band<'a> {
    width: usize,
    depth_m: &'a mut [f32],
    normal: [&'a mut [f32]; 3],
    origin: &'a mut [Origin],
    albedo: &'a mut [[f32; 3]],
    coverage: &'a mut [f32],
}

fn bands<'a>(
    merged: &'a mut GBuffer,
    layer: &'a mut VirtualLayer,
) -> impl IndexedParallelIterator<Item = Band<'a>> {
    let width = merged.size().width;
    let n = width * BAND_ROWS;
    (
        merged.depth_m.as_mut_slice().par_chunks_mut(n),
        merged.normals.x.as_mut_slice().par_chunks_mut(n),
        merged.normals.y.as_mut_slice().par_chunks_mut(n),
        merged.normals.z.as_mut_slice().par_chunks_mut(n),
        merged.origin.as_mut_slice().par_chunks_mut(n),
        layer.albedo.as_mut_slice().par_chunks_mut(n),
        layer.coverage.as_mut_slice().par_chunks_mut(n),
    )
        .into_par_iter()
        .map(move |(depth_m, x, y, z, origin, albedo, coverage)| Band {
            width,
            depth_m,
            normal: [x, y, z],
            origin,
            albedo,
            coverage,
        })
}

impl Band<'_> {
    fn rows(&self) -> usize {
        self.depth_m.len() / self.width
    }

    /// Back to the real scene, without virtual surfaces.
    fn restore(&mut self, real: &GBuffer, first_row: usize) {
        let start = first_row * self.width;
        let pixels = start..start + self.depth_m.len();
        self.depth_m.copy_from_slice(&real.depth_m.as_slice()[pixels.clone()]);
        for (to, from) in
            self.normal.iter_mut().zip([&real.normals.x, &real.normals.y, &real.normals.z])
        {
            to.copy_from_slice(&from.as_slice()[pixels.clone()]);
        }
        self.origin.copy_from_slice(&real.origin.as_slice()[pixels]);
        self.coverage.fill(0.0);
    }

    fn set_normal(&mut self, at: usize, normal: Vec3) {
        for (plane, value) in self.normal.iter_mut().zip(normal.to_array()) {
            plane[at] = value;
        }
    }
}

/// Writes what the samples show; returns the numbers of pixels whose centre is virtual, and of those that
/// are covered at all.
#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn resolve_band(
    band: &mut Band,
    resolver: &Resolver,
    block: &SampleBlock,
    real: &GBuffer,
    real_range: &mut RealRange,
    first_row: usize,
) -> (usize, usize) {
    let (mut centres, mut covered, mut last_face) = (0, 0, None);
    for y in block.rows.clone() {
        real_range.set_row(real, y, block.columns.clone());
        let pixels = block.columns.clone().zip(block.row(y)).zip(real_range.iter());
        for ((x, (nearness, ids)), range) in pixels {
            let seen = resolver.pixel(x, y, nearness, ids, real, range, &mut last_face);
            let Some(seen) = seen else { continue };
            let at = (y - first_row) * band.width + x;
            band.albedo[at] = seen.albedo;
            band.coverage[at] = seen.coverage;
            covered += 1;
            if let Some((depth_m, normal)) = seen.surface {
                band.depth_m[at] = depth_m;
                band.set_normal(at, normal);
                band.origin[at] = Origin::Virtual;
                centres += 1;
            }
        }
    }
    (centres, covered)
}
