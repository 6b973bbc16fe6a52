//! Sixteen rays marched side by side. Lanes whose ray ended keep computing; what they compute is
//! not taken.

use super::block::{Block, EMPTY, ONE, SIDE, UNSEEN};
use super::packet_normals::normals;
use super::sample::Sampler;

pub(super) const LANES: usize = 16;
pub(super) type Lanes = [f32; LANES];
pub(super) type Ints = [i32; LANES];
/// 1 or 0 a lane: wide as the values, so that selections vectorise.
pub(super) type Mask = [u32; LANES];

/// Shortest step, voxels: half a voxel looks at every cell about twice.
const MIN_STEP: f32 = 0.5;
/// Share of the distance to the surface that a step covers: projective distances are longer than
/// true ones on slanted surfaces.
const STEP_SHARE: f32 = 0.8;
/// Voxels more, so that a near surface is passed and bracketed at once.
const STEP_BEYOND: f32 = 0.25;
/// The stored voxel looked at instead of the trilinear value lies within a voxel's diagonal.
const DIAGONAL: f32 = 1.75;
/// A crossing is refined until its distance is below this, voxels, or for `REFINEMENTS` steps.
const CLOSE: f32 = 0.01;
const REFINEMENTS: usize = 4;
/// Step past the border of an empty block, voxels.
const NUDGE: f32 = 0.01;

/// The voxels as the packet reads them.
#[derive(Clone, Copy)]
pub(super) struct Field<'a> {
    pub table: &'a [u32],
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

/// Follows the distances from the near end (as a sphere tracer does), by stored voxels where the
/// surface is far and by trilinear values where it is near.
#[inline(always)]
fn march(field: &Field<'_>, packet: &Packet) -> Brackets {
    let mut t = packet.near;
    let mut per_voxel = [0.0; LANES];
    let mut open = [0; LANES];
    for i in 0..LANES {
        let [x, y, z] = [packet.direction[0][i], packet.direction[1][i], packet.direction[2][i]];
        per_voxel[i] = 1.0 / (x * x + y * y + z * z).sqrt();
        open[i] = (packet.near[i] <= packet.far[i]) as u32;
    }
    let (mut found, mut a, mut b) = ([0; LANES], t, t);
    // `at_a` is not positive: no sample in front yet
    let (mut at_a, mut at_b) = ([-1.0; LANES], [0.0; LANES]);
    while any(&open) {
        let point = points(field, packet, &t);
        let voxel = [rounded(&point[0]), rounded(&point[1]), rounded(&point[2])];
        let (stored, slot) = stored_at(field, &voxel);
        let (mut close, mut empty) = ([0; LANES], [0; LANES]);
        let mut step = [MIN_STEP; LANES];
        for i in 0..LANES {
            let distance = stored[i] as f32 * field.scale;
            // an unseen voxel's distance is negative
            let far = (distance > DIAGONAL + MIN_STEP) as u32;
            let seen = (stored[i] != i32::from(UNSEEN)) as u32;
            close[i] = open[i] & seen & (1 - far);
            empty[i] = (slot[i] == EMPTY as i32) as u32;
            step[i] = if far != 0 { distance - DIAGONAL } else { MIN_STEP };
            let front = if far != 0 { distance } else { -1.0 };
            let skip = open[i] & (1 - close[i]);
            at_a[i] = if skip != 0 { front } else { at_a[i] };
            a[i] = if skip != 0 { t[i] } else { a[i] };
        }
        if any(&close) {
            let value = trilinear(field, &point);
            for i in 0..LANES {
                let distance = value[i]; // NaN where unseen
                let front = (distance > 0.0) as u32;
                let behind = (distance <= 0.0) as u32;
                let hit = close[i] & behind & (at_a[i] > 0.0) as u32;
                found[i] |= hit;
                b[i] = if hit != 0 { t[i] } else { b[i] };
                at_b[i] = if hit != 0 { distance } else { at_b[i] };
                open[i] &= 1 - hit;
                let take = close[i] & (1 - hit);
                let at = if front != 0 { distance } else { -1.0 };
                a[i] = if take != 0 { t[i] } else { a[i] };
                at_a[i] = if take != 0 { at } else { at_a[i] };
                let further = (distance.abs() * STEP_SHARE + STEP_BEYOND).max(MIN_STEP); // NaN: the least
                step[i] = if close[i] != 0 { further } else { step[i] };
            }
        }
        let mut next = [0.0; LANES];
        for i in 0..LANES {
            next[i] = t[i] + step[i] * per_voxel[i];
        }
        if any(&empty) {
            let leave = leave_blocks(packet, &voxel);
            for i in 0..LANES {
                let skip = leave[i].max(t[i] + NUDGE * per_voxel[i]);
                next[i] = if empty[i] != 0 { skip } else { next[i] };
            }
        }
        t = next;
        for i in 0..LANES {
            open[i] &= (t[i] <= packet.far[i]) as u32;
        }
    }
    Brackets { found, a, at_a, b, at_b }
}

#[inline(always)]
fn any(mask: &Mask) -> bool {
    mask.iter().fold(0, |a, b| a | b) != 0
}

/// Points at depths along the rays, kept in the volume.
#[inline(always)]
pub(super) fn points(field: &Field<'_>, packet: &Packet, t: &Lanes) -> [Lanes; 3] {
    let mut out = [[0.0; LANES]; 3];
    for axis in 0..3 {
        for i in 0..LANES {
            let p = packet.origin[axis][i] + packet.direction[axis][i] * t[i];
            out[axis][i] = p.max(0.0).min(field.last); // max first: NaN becomes 0
        }
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
fn rounded(p: &Lanes) -> Ints {
    let mut half = *p;
    half.iter_mut().for_each(|v| *v += 0.5);
    truncated(&half) // `last` + 1/2 still truncates to `last`
}

/// Stored distances and slots of voxels, which must lie in the volume.
#[inline(always)]
pub(super) fn stored_at(field: &Field<'_>, [x, y, z]: &[Ints; 3]) -> (Ints, Ints) {
    let (mut index, mut local) = ([0; LANES], [0; LANES]);
    for i in 0..LANES {
        index[i] = ((z[i] >> 3) * field.grid + (y[i] >> 3)) * field.grid + (x[i] >> 3);
        local[i] = ((z[i] & 7) * SIDE as i32 + (y[i] & 7)) * SIDE as i32 + (x[i] & 7);
    }
    let (mut stored, mut slots) = ([0; LANES], [0; LANES]);
    for i in 0..LANES {
        debug_assert!((index[i] as usize) < field.table.len());
        // SAFETY: voxel coordinates are from 0 to 8 grid - 1, so the index is below grid^3, the
        // table's length; entries are slots of blocks (`EMPTY` too); local is below 512.
        unsafe {
            let slot = *field.table.get_unchecked(index[i] as usize);
            let block = field.blocks.get_unchecked(slot as usize);
            stored[i] = i32::from(*block.tsdf.get_unchecked(local[i] as usize));
            slots[i] = slot as i32;
        }
    }
    (stored, slots)
}

/// Trilinear distances in voxels; NaN where a corner was not seen.
#[inline(always)]
fn trilinear(field: &Field<'_>, point: &[Lanes; 3]) -> Lanes {
    let (base, fraction) = cells(field, point);
    let mut corners = [[0.0; LANES]; 8];
    let mut unseen = [0; LANES];
    for (k, corner) in corners.iter_mut().enumerate() {
        let (stored, _) = stored_at(field, &offset(&base, [k & 1, k >> 1 & 1, k >> 2]));
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
    let (mut base, mut fraction) = ([[0; LANES]; 3], [[0.0; LANES]; 3]);
    for axis in 0..3 {
        let corner = truncated(&point[axis]);
        for i in 0..LANES {
            base[axis][i] = corner[i].min(field.last as i32 - 1);
            fraction[axis][i] = point[axis][i] - base[axis][i] as f32;
        }
    }
    (base, fraction)
}

#[inline(always)]
pub(super) fn offset(base: &[Ints; 3], by: [usize; 3]) -> [Ints; 3] {
    let mut out = *base;
    for axis in 0..3 {
        out[axis].iter_mut().for_each(|v| *v += by[axis] as i32);
    }
    out
}

/// Depths just past the blocks around voxels.
#[inline(always)]
fn leave_blocks(packet: &Packet, voxel: &[Ints; 3]) -> Lanes {
    let mut out = [f32::INFINITY; LANES];
    for axis in 0..3 {
        for i in 0..LANES {
            let (origin, direction) = (packet.origin[axis][i], packet.direction[axis][i]);
            // a voxel's share of space ends half a voxel from its centre
            let low = (voxel[axis][i] & !(SIDE as i32 - 1)) as f32 - 0.5;
            let side = if direction > 0.0 { low + SIDE as f32 + NUDGE } else { low - NUDGE };
            out[i] = out[i].min((side - origin) / direction);
        }
    }
    out
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
    pub fn new(store: &'a super::block::BlockStore, truncation_voxels: f32) -> Self {
        Self {
            table: &store.table,
            blocks: &store.blocks,
            sampler: Sampler::new(store),
            grid: store.grid as i32,
            last: (store.grid * SIDE - 1) as f32,
            scale: truncation_voxels / f32::from(ONE),
        }
    }
}
