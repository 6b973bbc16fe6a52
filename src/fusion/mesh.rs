//! The surface as triangles: marching cubes over the blocks that have storage.
//!
//! A vertex lies on a grid edge and belongs to the edge's lower voxel. Every block lists its
//! crossed edges as bits, so a vertex's number is the block's first number plus a count of bits:
//! triangles that meet share vertices, without a hash table, in an order that no thread changes.

use super::TsdfVolume;
use super::block::{Block, EMPTY, SIDE, UNSEEN, VOXELS};
use super::marching_cubes::{EDGES, TRIANGLES};
use super::sample::local;
use crate::mesh::TriangleMesh;
use glam::{IVec3, Vec3};
use rayon::prelude::*;

const WORDS: usize = 3 * VOXELS / 64;

/// The crossed edges of one block, bit `3 * voxel + axis`.
struct Crossed {
    bits: [u64; WORDS],
    /// Number of the block's first vertex.
    first: u32,
}

impl Crossed {
    fn count(&self) -> u32 {
        self.bits.iter().map(|word| word.count_ones()).sum()
    }

    fn number(&self, edge: usize) -> u32 {
        let (word, below) = (edge / 64, (1u64 << (edge % 64)) - 1);
        let before: u32 = self.bits[..word].iter().map(|w| w.count_ones()).sum();
        self.first + before + (self.bits[word] & below).count_ones()
    }

    fn edges(&self) -> impl Iterator<Item = usize> {
        (0..3 * VOXELS).filter(|edge| self.bits[edge / 64] >> (edge % 64) & 1 == 1)
    }
}

impl TsdfVolume {
    /// Welded triangles of the zero surface between voxels seen in `mesh_min_weight` frames or
    /// more: world metres, counter-clockwise from free space, with normals, and with colours
    /// where the volume keeps them. Closed wherever the surface was seen all round.
    pub fn mesh(&self) -> TriangleMesh {
        let blocks = &self.store.blocks;
        let mut crossed: Vec<Crossed> = blocks.par_iter().map(|b| self.crossed_edges(b)).collect();
        let mut total = 0;
        for block in &mut crossed {
            block.first = total;
            total += block.count();
        }
        let triangles: Vec<Vec<[u32; 3]>> =
            blocks.par_iter().map(|block| self.block_triangles(block, &crossed)).collect();
        let vertices: Vec<Vec<Vertex>> = blocks
            .par_iter()
            .zip(&crossed)
            .map(|(block, crossed)| crossed.edges().map(|e| self.vertex(block, e)).collect())
            .collect();
        let mut mesh = TriangleMesh { triangles: triangles.concat(), ..TriangleMesh::default() };
        for vertex in vertices.iter().flatten() {
            mesh.positions.push(vertex.position);
            mesh.normals.push(vertex.normal);
            if self.params.color {
                mesh.colors.push(vertex.color);
            }
        }
        drop_unused(&mut mesh);
        mesh
    }

    /// Distance of a voxel, where it was seen often enough.
    fn reliable(&self, voxel: IVec3) -> Option<i16> {
        let last = (self.store.grid * SIDE) as i32;
        if voxel.min_element() < 0 || voxel.max_element() >= last {
            return None;
        }
        let slot = self.store.table[self.sampler().block_index(voxel)];
        if slot == EMPTY {
            return None;
        }
        self.reliable_in(&self.store.blocks[slot as usize], local(voxel))
    }

    fn reliable_in(&self, block: &Block, voxel: usize) -> Option<i16> {
        let value = block.tsdf[voxel];
        (value != UNSEEN && block.weight[voxel] >= self.params.mesh_min_weight).then_some(value)
    }

    fn crossed_edges(&self, block: &Block) -> Crossed {
        let mut bits = [0; WORDS];
        if !self.may_hold_surface(block) {
            return Crossed { bits, first: 0 };
        }
        for index in 0..VOXELS {
            let Some(value) = self.reliable_in(block, index) else { continue };
            let voxel = voxel_at(block, index);
            for (axis, step) in IVec3::AXES.into_iter().enumerate() {
                let inner = voxel[axis] & 7 < 7;
                let other = if inner {
                    self.reliable_in(block, local(voxel + step))
                } else {
                    self.reliable(voxel + step)
                };
                if other.is_some_and(|other| (other < 0) != (value < 0)) {
                    let edge = 3 * index + axis;
                    bits[edge / 64] |= 1 << (edge % 64);
                }
            }
        }
        Crossed { bits, first: 0 }
    }

    fn may_hold_surface(&self, block: &Block) -> bool {
        block.live && self.store.neighbourhood(block.coords).any(|b| b.lowest < 0)
    }

    /// Triangles of the cells whose lowest corner lies in this block.
    fn block_triangles(&self, block: &Block, crossed: &[Crossed]) -> Vec<[u32; 3]> {
        let mut triangles = Vec::new();
        if !self.may_hold_surface(block) {
            return triangles;
        }
        for index in 0..VOXELS {
            let base = voxel_at(block, index);
            let Some(inside) = self.inside_corners(block, base) else { continue };
            for triangle in &TRIANGLES[usize::from(inside)] {
                triangles.push(triangle.map(|edge| self.vertex_number(base, edge, crossed)));
            }
        }
        triangles
    }

    /// A bit for each corner behind the surface; `None` where one is not reliable.
    fn inside_corners(&self, block: &Block, base: IVec3) -> Option<u8> {
        let whole = (base & 7).max_element() < 7;
        let mut inside = 0;
        for i in 0..8 {
            let corner = base + corner_offset(i);
            let value =
                if whole { self.reliable_in(block, local(corner)) } else { self.reliable(corner) }?;
            inside |= u8::from(value < 0) << i;
        }
        Some(inside)
    }

    fn vertex_number(&self, base: IVec3, edge: u8, crossed: &[Crossed]) -> u32 {
        let voxel = base + corner_offset(EDGES[usize::from(edge)][0]);
        let slot = self.store.table[self.sampler().block_index(voxel)];
        crossed[slot as usize].number(3 * local(voxel) + usize::from(edge) / 4)
    }

    fn vertex(&self, block: &Block, edge: usize) -> Vertex {
        let (voxel, axis) = (voxel_at(block, edge / 3), IVec3::AXES[edge % 3]);
        let sampler = self.sampler();
        let (a, b) = (f32::from(sampler.voxel(voxel)), f32::from(sampler.voxel(voxel + axis)));
        let share = a / (a - b); // signs differ: the difference is not zero
        let point = voxel.as_vec3() + axis.as_vec3() * share;
        let outward = axis.as_vec3() * (b - a).signum();
        Vertex {
            position: self.world_from_voxel(point).to_array(),
            normal: sampler.gradient(point).unwrap_or(outward).to_array(),
            color: self.mixed_color(voxel, voxel + axis, share),
        }
    }

    /// Colour between two voxels; the other one's where one has none, black where neither has.
    fn mixed_color(&self, a: IVec3, b: IVec3, share: f32) -> [u8; 3] {
        let (a, b) = (self.color(a), self.color(b));
        let share = match (a[3] > 0, b[3] > 0) {
            (true, true) => share,
            (seen_a, _) => f32::from(u8::from(!seen_a)),
        };
        std::array::from_fn(|c| {
            let (a, b) = (f32::from(a[c]), f32::from(b[c]));
            (a + (b - a) * share).round() as u8
        })
    }

    fn color(&self, voxel: IVec3) -> [u8; 4] {
        let slot = self.store.table[self.sampler().block_index(voxel)];
        let block = self.store.blocks.get(slot as usize);
        block.and_then(|b| b.color.as_ref()).map_or([0; 4], |colors| colors[local(voxel)])
    }
}

struct Vertex {
    position: [f32; 3],
    normal: [f32; 3],
    color: [u8; 3],
}

fn voxel_at(block: &Block, index: usize) -> IVec3 {
    let corner = Vec3::from(block.coords.map(f32::from)).as_ivec3() * SIDE as i32;
    let i = index as i32;
    corner + IVec3::new(i & 7, i >> 3 & 7, i >> 6)
}

fn corner_offset(i: usize) -> IVec3 {
    let i = i as i32;
    IVec3::new(i & 1, i >> 1 & 1, i >> 2)
}

/// Vertices on crossed edges whose cells all have an unreliable corner.
fn drop_unused(mesh: &mut TriangleMesh) {
    let mut number = vec![u32::MAX; mesh.positions.len()];
    mesh.triangles.iter().flatten().for_each(|&v| number[v as usize] = 0);
    let used = |at: usize, number: &[u32]| number[at] != u32::MAX;
    fn keep<T>(values: &mut Vec<T>, mut used: impl FnMut(usize) -> bool) {
        let mut at = 0;
        values.retain(|_| {
            at += 1;
            used(at - 1)
        });
    }
    keep(&mut mesh.positions, |at| used(at, &number));
    keep(&mut mesh.normals, |at| used(at, &number));
    keep(&mut mesh.colors, |at| used(at, &number));
    for (next, n) in (0..).zip(number.iter_mut().filter(|n| **n == 0)) {
        *n = next;
    }
    mesh.triangles.iter_mut().flatten().for_each(|v| *v = number[*v as usize]);
}
