//! Sixteen rays marched side by side. Lanes whose ray ended keep computing; what they compute is
//! not taken.

#![allow(unsafe_code, reason = "look-ups of inner loops, whose bounds are said beside each")]

use super::TsdfVolume;
use super::block::{Block, ONE, SIDE, UNSEEN};
use super::crossings::{Bricks, FIRST_OCTANT};
use super::packet_normals::normals;
use super::sample::Sampler;

pub(super) const LANES: usize = 16;
pub(super) type Lanes = [f32; LANES];
pub(super) type Ints = [i32; LANES];
/// 1 or 0 a lane: wide as the values, so that selections vectorise.
pub(super) type Mask = [u32; LANES];

/// Shortest step, voxels: half a voxel looks at every cell about twice.
pub(crate) const MIN_STEP: f32 = 0.5;
/// Share of the distance to the surface that a step covers: projective distances are longer than
/// true ones on slanted surfaces.
pub(crate) const STEP_SHARE: f32 = 0.8;
/// Voxels more, so that a near surface is passed and bracketed at once.
pub(crate) const STEP_BEYOND: f32 = 0.25;
/// Longest step, voxels: nothing thinner is passed over.
pub(crate) const MAX_STEP: f32 = 2.0;
/// A crossing is refined until its distance is below this, voxels, or for `REFINEMENTS` steps.
pub(crate) const CLOSE: f32 = 0.01;
pub(crate) const REFINEMENTS: usize = 4;
/// Step past the border of an empty cube, voxels.
pub(crate) const NUDGE: f32 = 0.01;

/// The voxels as the packet reads them.
#[derive(Clone, Copy)]
pub(super) struct Field<'a> {
    pub table: &'a [u32],
    pub crossings: &'a [Bricks],
    pub blocks: &'a [Block],
    pub sampler: Sampler<'a>,
    pub grid: i32,
    /// Highest voxel coordinate: `8 grid - 1`.
    pub last: f32,
    /// Voxels per stored step.
    pub scale: f32,
}

/// Rays in voxel coordinates, `origin + direction * depth`, with the depths to look at. A lane
/// without a ray has `near > far`. No direction has a zero component.
#[derive(Clone, Default)]
pub(super) struct Packet {
    pub origin: [Lanes; 3],
    pub direction: [Lanes; 3],
    pub near: Lanes,
    pub far: Lanes,
}

/// Depth of the first front face and its normal; depth 0 where there is none.
#[derive(Clone, Default)]
pub(super) struct Hits {
    pub depth_m: Lanes,
    pub normal: [Lanes; 3],
}

/// Where distances turn from positive (`a`) to negative (`b`).
struct Brackets {
    found: Mask,
    a: Lanes,
    at_a: Lanes,
    b: Lanes,
    at_b: Lanes,
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
pub(super) fn cast(field: &Field<'_>, packet: &Packet) -> Hits {
    let brackets = march(field, packet);
    if !any(&brackets.found) {
        return Hits::default();
    }
    let depth_m = refine(field, packet, brackets);
    normals(field, packet, depth_m)
}

/// Follows the distances from the near end (as a sphere tracer does). Bricks without surface are
/// passed at once: whatever crossing comes after one has its positive side after it as well.
#[inline(always)]
fn march(field: &Field<'_>, packet: &Packet) -> Brackets {
    let mut walk = Walk::new(packet);
    let (mut found, mut a, mut b) = ([0; LANES], packet.near, packet.near);
    let mut at_b = [0.0; LANES];
    while let Some(point) = walk.approach(field, packet) {
        let value = trilinear(field, &point);
        for i in 0..LANES {
            let (distance, open) = (value[i], walk.open[i]); // NaN where unseen
            let (front, behind) = ((distance > 0.0) as u32, (distance <= 0.0) as u32);
            let hit = open & behind & (walk.at_a[i] > 0.0) as u32;
            found[i] |= hit;
            b[i] = if hit != 0 { walk.t[i] } else { b[i] };
            at_b[i] = if hit != 0 { distance } else { at_b[i] };
            let take = open & (1 - hit);
            let at = if front != 0 { distance } else { -1.0 };
            a[i] = if take != 0 { walk.t[i] } else { a[i] };
            walk.at_a[i] = if take != 0 { at } else { walk.at_a[i] };
            // NaN takes the least step, which `clamp` would keep NaN
            #[allow(clippy::manual_clamp)]
            let step = (distance.abs() * STEP_SHARE + STEP_BEYOND).max(MIN_STEP).min(MAX_STEP);
            walk.t[i] += step * walk.per_voxel[i];
            walk.open[i] = take & (walk.t[i] <= packet.far[i]) as u32;
        }
    }
    Brackets { found, a, at_a: walk.at_a, b, at_b }
}

/// Where the rays of a packet are.
struct Walk {
    t: Lanes,
    open: Mask,
    /// Last distance; not positive where no sample in front came last.
    at_a: Lanes,
    /// Depth of a step of one voxel.
    per_voxel: Lanes,
    inverse: [Lanes; 3],
}

impl Walk {
    #[inline(always)]
    fn new(packet: &Packet) -> Self {
        let (mut per_voxel, mut open) = ([0.0; LANES], [0; LANES]);
        let mut inverse = [[0.0; LANES]; 3];
        for i in 0..LANES {
            let [x, y, z] = [0, 1, 2].map(|axis| packet.direction[axis][i]);
            per_voxel[i] = 1.0 / (x * x + y * y + z * z).sqrt();
            open[i] = (packet.near[i] <= packet.far[i]) as u32;
            (inverse[0][i], inverse[1][i], inverse[2][i]) = (1.0 / x, 1.0 / y, 1.0 / z);
        }
        Self { t: packet.near, open, at_a: [-1.0; LANES], per_voxel, inverse }
    }

    /// Takes every open ray into a brick that may hold surface; `None` where no ray is left.
    #[inline(always)]
    fn approach(&mut self, field: &Field<'_>, packet: &Packet) -> Option<[Lanes; 3]> {
        while any(&self.open) {
            let point = points(field, packet, &self.t);
            let voxel = [rounded(&point[0]), rounded(&point[1]), rounded(&point[2])];
            let side = empty_side(field, &voxel);
            let mut empty = [0; LANES];
            for i in 0..LANES {
                empty[i] = self.open[i] & (side[i] != 0) as u32;
            }
            if !any(&empty) {
                return Some(point);
            }
            let leave = self.leave(packet, &voxel, &side);
            for i in 0..LANES {
                let next = leave[i].max(self.t[i] + NUDGE * self.per_voxel[i]);
                self.t[i] = if empty[i] != 0 { next } else { self.t[i] };
                self.at_a[i] = if empty[i] != 0 { -1.0 } else { self.at_a[i] };
                self.open[i] &= (self.t[i] <= packet.far[i]) as u32;
            }
        }
        None
    }

    /// Depths just past cubes around voxels, of sides that are powers of two.
    #[inline(always)]
    fn leave(&self, packet: &Packet, voxel: &[Ints; 3], side: &Ints) -> Lanes {
        let along =
            |axis: usize| leave_axis(&packet.origin[axis], &self.inverse[axis], &voxel[axis], side);
        let (x, y, z) = (along(0), along(1), along(2));
        let mut out = [0.0; LANES];
        for i in 0..LANES {
            out[i] = x[i].min(y[i]).min(z[i]);
        }
        out
    }
}

#[inline(always)]
fn leave_axis(origin: &Lanes, inverse: &Lanes, voxel: &Ints, side: &Ints) -> Lanes {
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        // a voxel's share of space ends half a voxel from its centre
        let low = (voxel[i] & -side[i]) as f32 - 0.5;
        let end = if inverse[i] > 0.0 { low + side[i] as f32 + NUDGE } else { low - NUDGE };
        out[i] = (end - origin[i]) * inverse[i];
    }
    out
}

/// Sides of the largest of the cubes of 8, 4 and 2 voxels around voxels that hold no surface; 0
/// where the smallest may hold some.
#[inline(always)]
pub(super) fn empty_side(field: &Field<'_>, [x, y, z]: &[Ints; 3]) -> Ints {
    let mut out = [0; LANES];
    for i in 0..LANES {
        let index = ((z[i] >> 3) * field.grid + (y[i] >> 3)) * field.grid + (x[i] >> 3);
        debug_assert!((index as usize) < field.crossings.len());
        // SAFETY: voxel coordinates are from 0 to 8 grid - 1, so the index is below grid^3.
        let bricks = unsafe { *field.crossings.get_unchecked(index as usize) };
        let [bx, by, bz] = [x[i], y[i], z[i]].map(|v| v >> 1 & 3);
        let brick = bricks >> (bz * 16 + by * 4 + bx) & 1;
        let octant = bricks >> ((bz & 2) * 16 + (by & 2) * 4 + (bx & 2)) & FIRST_OCTANT;
        let side = if octant != 0 { 2 } else { 4 };
        let side = if bricks != 0 { side } else { SIDE as i32 };
        out[i] = if brick != 0 { 0 } else { side };
    }
    out
}

#[inline(always)]
pub(super) fn any(mask: &Mask) -> bool {
    mask.iter().fold(0, |a, b| a | b) != 0
}

/// Points at depths along the rays, kept in the volume.
#[inline(always)]
pub(super) fn points(field: &Field<'_>, packet: &Packet, t: &Lanes) -> [Lanes; 3] {
    // Axes one by one: of nested loops the compiler makes one that scatters its results.
    let along = |axis: usize| coordinates(field, &packet.origin[axis], &packet.direction[axis], t);
    [along(0), along(1), along(2)]
}

#[inline(always)]
fn coordinates(field: &Field<'_>, origin: &Lanes, direction: &Lanes, t: &Lanes) -> Lanes {
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        let p = origin[i] + direction[i] * t[i];
        out[i] = p.max(0.0).min(field.last); // max first: NaN becomes 0
    }
    out
}

#[inline(always)]
fn truncated(p: &Lanes) -> Ints {
    let mut out = [0; LANES];
    for i in 0..LANES {
        // SAFETY: `points` leaves values from 0 to 511, and at most 1/2 is added.
        out[i] = unsafe { p[i].to_int_unchecked() };
    }
    out
}

#[inline(always)]
pub(super) fn rounded(p: &Lanes) -> Ints {
    let mut half = *p;
    half.iter_mut().for_each(|v| *v += 0.5);
    truncated(&half) // `last` + 1/2 still truncates to `last`
}

/// Parts of addresses, an entry for each of `N` neighbouring coordinates along an axis.
pub(super) struct Steps<const N: usize> {
    block: [Ints; N],
    local: [Ints; N],
}

impl<const N: usize> Steps<N> {
    /// From `first`, along an axis whose steps are `stride` voxels in a block and `blocks` blocks
    /// in the table.
    #[inline(always)]
    pub fn new(first: &Ints, stride: i32, blocks: i32) -> Self {
        let (mut block, mut local) = ([[0; LANES]; N], [[0; LANES]; N]);
        for k in 0..N {
            for i in 0..LANES {
                let v = first[i] + k as i32;
                (block[k][i], local[k][i]) = ((v >> 3) * blocks, (v & 7) * stride);
            }
        }
        Self { block, local }
    }
}

/// The N x N x N voxels from `first` on, which must lie in the volume.
pub(super) struct Cube<const N: usize>([Steps<N>; 3]);

impl<const N: usize> Cube<N> {
    #[inline(always)]
    pub fn new(field: &Field<'_>, [x, y, z]: &[Ints; 3]) -> Self {
        let (side, grid) = (SIDE as i32, field.grid);
        Self([
            Steps::new(x, 1, 1),
            Steps::new(y, side, grid),
            Steps::new(z, side * side, grid * grid),
        ])
    }

    /// Stored distances.
    #[inline(always)]
    pub fn at(&self, field: &Field<'_>, [x, y, z]: [usize; 3]) -> Ints {
        let [sx, sy, sz] = &self.0;
        let mut stored = [0; LANES];
        for i in 0..LANES {
            let index = sx.block[x][i] + sy.block[y][i] + sz.block[z][i];
            let local = sx.local[x][i] + sy.local[y][i] + sz.local[z][i];
            debug_assert!((index as usize) < field.table.len());
            // SAFETY: voxel coordinates are from 0 to 8 grid - 1, so the index is below grid^3,
            // the table's length; entries are slots of blocks (`EMPTY` too); local is below 512.
            stored[i] = unsafe {
                let slot = *field.table.get_unchecked(index as usize);
                let block = field.blocks.get_unchecked(slot as usize);
                i32::from(*block.tsdf.get_unchecked(local as usize))
            };
        }
        stored
    }
}

/// Trilinear distances in voxels; NaN where a corner was not seen.
#[inline(always)]
pub(super) fn trilinear(field: &Field<'_>, point: &[Lanes; 3]) -> Lanes {
    let (base, fraction) = cells(field, point);
    let cube = Cube::<2>::new(field, &base);
    let mut corners = [[0.0; LANES]; 8];
    let mut unseen = [0; LANES];
    for (k, corner) in corners.iter_mut().enumerate() {
        let stored = cube.at(field, [k & 1, k >> 1 & 1, k >> 2]);
        for i in 0..LANES {
            unseen[i] |= (stored[i] == i32::from(UNSEEN)) as u32;
            corner[i] = stored[i] as f32;
        }
    }
    let [fx, fy, fz] = fraction;
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        let x00 = corners[0][i] + (corners[1][i] - corners[0][i]) * fx[i];
        let x10 = corners[2][i] + (corners[3][i] - corners[2][i]) * fx[i];
        let x01 = corners[4][i] + (corners[5][i] - corners[4][i]) * fx[i];
        let x11 = corners[6][i] + (corners[7][i] - corners[6][i]) * fx[i];
        let (y0, y1) = (x00 + (x10 - x00) * fy[i], x01 + (x11 - x01) * fy[i]);
        let value = (y0 + (y1 - y0) * fz[i]) * field.scale;
        out[i] = if unseen[i] != 0 { f32::NAN } else { value };
    }
    out
}

/// Lowest corners of the cells around points, and the places within, from 0 to 1.
#[inline(always)]
pub(super) fn cells(field: &Field<'_>, point: &[Lanes; 3]) -> ([Ints; 3], [Lanes; 3]) {
    let (x, fx) = split(field, &point[0]);
    let (y, fy) = split(field, &point[1]);
    let (z, fz) = split(field, &point[2]);
    ([x, y, z], [fx, fy, fz])
}

#[inline(always)]
fn split(field: &Field<'_>, point: &Lanes) -> (Ints, Lanes) {
    let (mut base, mut fraction) = (truncated(point), [0.0; LANES]);
    for i in 0..LANES {
        base[i] = base[i].min(field.last as i32 - 1);
        fraction[i] = point[i] - base[i] as f32;
    }
    (base, fraction)
}

/// Regula falsi (Illinois). A crossing with unseen voxels inside the bracket is none.
#[inline(always)]
fn refine(field: &Field<'_>, packet: &Packet, brackets: Brackets) -> Lanes {
    let Brackets { mut found, mut a, mut at_a, mut b, mut at_b } = brackets;
    let (mut t, mut open) = (b, found);
    for _ in 0..REFINEMENTS {
        for i in 0..LANES {
            let next = a[i] + (b[i] - a[i]) * at_a[i] / (at_a[i] - at_b[i]);
            t[i] = if open[i] != 0 { next } else { t[i] };
        }
        let value = trilinear(field, &points(field, packet, &t));
        for i in 0..LANES {
            let v = value[i];
            let known = !v.is_nan() as u32;
            found[i] &= known | (1 - open[i]);
            open[i] &= known & (v.abs() >= CLOSE) as u32;
            let front = v > 0.0;
            a[i] = if front { t[i] } else { a[i] };
            b[i] = if front { b[i] } else { t[i] };
            let (half_a, half_b) = (0.5 * at_a[i], 0.5 * at_b[i]);
            at_a[i] = if front { v } else { half_a };
            at_b[i] = if front { half_b } else { v };
        }
        if !any(&open) {
            break;
        }
    }
    for i in 0..LANES {
        t[i] = if found[i] != 0 { t[i] } else { 0.0 };
    }
    t
}

impl<'a> Field<'a> {
    pub fn of(volume: &'a TsdfVolume) -> Self {
        let store = &volume.store;
        Self {
            table: &store.table,
            crossings: &store.crossings,
            blocks: &store.blocks,
            sampler: Sampler::new(store),
            grid: store.grid as i32,
            last: (store.grid * SIDE - 1) as f32,
            scale: volume.lattice.truncation_voxels() / f32::from(ONE),
        }
    }
}
