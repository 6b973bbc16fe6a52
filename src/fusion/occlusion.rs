//! Whether rays from points meet a surface of the volume: sixteen points at a time, all looking in
//! the same direction. Neighbouring points then pass the same blocks: sixteen directions of one point
//! take 3.2 times as long. Half of the time goes into reading voxels near surfaces, a third into
//! looking up what is empty; reading single voxels where the nearest one is far from any surface gains
//! nothing over trilinear values everywhere.

#![allow(unsafe_code, reason = "look-ups of inner loops, whose bounds are said beside each")]

use super::TsdfVolume;
use super::block::SIDE;
use super::empty_space::EmptySpace;
use super::packet::{
    Field, Ints, LANES, Lanes, MAX_STEP, MIN_STEP, Mask, NUDGE, Packet, STEP_BEYOND, STEP_SHARE,
    any, empty_side, points, rounded, trilinear,
};
use super::raycast::away_from_zero;
use glam::Vec3;

/// A volume made ready for rays of any origin.
#[derive(Clone, Copy)]
pub(crate) struct Occlusion<'a> {
    field: Field<'a>,
    distances: &'a [u8],
    volume: &'a TsdfVolume,
}

impl<'a> Occlusion<'a> {
    /// `space` must have surveyed the volume as it is.
    pub fn new(volume: &'a TsdfVolume, space: &'a EmptySpace) -> Self {
        let field = Field::of(volume);
        assert_eq!(space.distances().len(), field.table.len(), "a survey of another volume");
        Self { field, distances: space.distances(), volume }
    }

    pub fn voxel_m(&self) -> f32 {
        self.volume.lattice.voxel_m
    }

    /// World points (metres, by axis) in the coordinates that [`Self::meets`] takes.
    #[inline(always)]
    pub fn voxels_from_world(&self, points: &[Lanes; 3]) -> [Lanes; 3] {
        let corner = self.volume.lattice.min_corner;
        std::array::from_fn(|axis| {
            points[axis].map(|p| (p - corner[axis]) / self.volume.lattice.voxel_m - 0.5)
        })
    }

    /// 1 for each of the `wanted` points that a surface hides within `reach_m` along the unit vector
    /// `direction`.
    ///
    /// A ray is stopped by the first distance not above zero that it meets after it has been outside:
    /// in front of a surface, or further than the truncation band from any. Faces seen from behind
    /// stop it as well, for what lies behind a surface is solid. Until it has been outside, a ray is
    /// taken to be leaving its own surface. What lies beyond the volume stops nothing.
    pub fn meets(&self, from: &[Lanes; 3], direction: Vec3, reach_m: f32, wanted: &Mask) -> Mask {
        let per_m = (direction / self.volume.lattice.voxel_m).to_array().map(away_from_zero);
        any_hit(&self.field, self.distances, from, per_m, reach_m, wanted)
    }
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn any_hit(
    field: &Field<'_>,
    distances: &[u8],
    from: &[Lanes; 3],
    direction: [f32; 3],
    reach_m: f32,
    wanted: &Mask,
) -> Mask {
    let mut packet = Packet {
        origin: *from,
        direction: direction.map(|d| [d; LANES]),
        near: [0.0; LANES],
        far: [reach_m; LANES],
    };
    clip(field, &mut packet);
    let [x, y, z] = direction;
    let per_voxel = 1.0 / (x * x + y * y + z * z).sqrt();
    let mut t = packet.near;
    let (mut open, mut outside, mut hidden) = ([0; LANES], [0; LANES], [0; LANES]);
    for i in 0..LANES {
        open[i] = wanted[i] & (packet.near[i] <= packet.far[i]) as u32;
        outside[i] = (packet.near[i] > 0.0) as u32;
    }
    while any(&open) {
        let point = points(field, &packet, &t);
        let voxel = [rounded(&point[0]), rounded(&point[1]), rounded(&point[2])];
        let side = empty_side(field, &voxel);
        let mut empty = [0; LANES];
        for i in 0..LANES {
            empty[i] = open[i] & (side[i] != 0) as u32;
        }
        if any(&empty) {
            let leave = leave(field, distances, &packet, &voxel, &side);
            for i in 0..LANES {
                let next = leave[i].max(t[i] + NUDGE * per_voxel);
                t[i] = if empty[i] != 0 { next } else { t[i] };
                outside[i] |= empty[i];
                open[i] &= (t[i] <= packet.far[i]) as u32;
            }
            continue;
        }
        let distance = trilinear(field, &point); // NaN where unseen
        for i in 0..LANES {
            let v = distance[i];
            hidden[i] |= open[i] & outside[i] & (v <= 0.0) as u32;
            outside[i] |= (v > 0.0) as u32;
            // NaN takes the least step, which `clamp` would keep NaN
            #[allow(clippy::manual_clamp)]
            let step = (v.abs() * STEP_SHARE + STEP_BEYOND).max(MIN_STEP).min(MAX_STEP);
            t[i] += step * per_voxel;
            open[i] &= (1 - hidden[i]) & (t[i] <= packet.far[i]) as u32;
        }
    }
    hidden
}

/// Leaves of the rays what lies in the volume.
#[inline(always)]
fn clip(field: &Field<'_>, packet: &mut Packet) {
    for axis in 0..3 {
        let inverse = 1.0 / packet.direction[axis][0];
        for i in 0..LANES {
            let a = -packet.origin[axis][i] * inverse;
            let b = (field.last - packet.origin[axis][i]) * inverse;
            packet.near[i] = packet.near[i].max(a.min(b));
            packet.far[i] = packet.far[i].min(a.max(b));
        }
    }
}

/// Depths just past the empty cubes around voxels. Where the cube is a block, those around it that
/// are known to be empty count to it.
#[inline(always)]
fn leave(
    field: &Field<'_>,
    distances: &[u8],
    packet: &Packet,
    voxel: &[Ints; 3],
    side: &Ints,
) -> Lanes {
    let mut margin = [0; LANES];
    for i in 0..LANES {
        let [x, y, z] = [0, 1, 2].map(|axis| voxel[axis][i] >> 3);
        let index = (z * field.grid + y) * field.grid + x;
        debug_assert!((index as usize) < distances.len());
        // SAFETY: voxel coordinates are from 0 to 8 grid - 1, so the index is below grid^3, the length
        // of the table and of the distances (checked when they came together).
        let blocks = i32::from(unsafe { *distances.get_unchecked(index as usize) });
        margin[i] = if side[i] == SIDE as i32 { (blocks - 1) * SIDE as i32 } else { 0 };
    }
    let mut out = [f32::INFINITY; LANES];
    for axis in 0..3 {
        let direction = packet.direction[axis][0];
        let inverse = 1.0 / direction;
        for i in 0..LANES {
            // a voxel's share of space ends half a voxel from its centre
            let low = (voxel[axis][i] & -side[i]) as f32 - 0.5;
            let (side, margin) = (side[i] as f32, margin[i] as f32);
            let end =
                if direction > 0.0 { low + side + margin + NUDGE } else { low - margin - NUDGE };
            out[i] = out[i].min((end - packet.origin[axis][i]) * inverse);
        }
    }
    out
}
