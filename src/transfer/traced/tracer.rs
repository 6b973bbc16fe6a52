//! Which directions are hidden from sixteen points, by rays.

use super::super::TransferParams;
use super::super::directions::{DirectionSet, LANES};
use super::points::{Lanes, Mask, Points};
use crate::fusion::Occlusion;
use crate::math::sh;
use crate::scene::SceneRays;
use glam::Vec3;
use std::f64::consts::PI;

/// Directions that a set has at most.
const MAX_DIRECTIONS: usize = 1024;
/// Rays against triangles start this far off their surface: a surface drawn from the same triangles
/// is known to better than a millimetre, and an object's foot shall still darken the floor beside it.
pub(crate) const OBJECT_LIFT_M: f32 = 0.002;
/// Rays through voxels start this many voxels off their surface at least: a noisy surface is wavy by
/// about one.
const LIFT_VOXELS: f32 = 1.5;

/// How far off their surface rays through voxels start, metres.
pub(crate) fn volume_lift_m(params: &TransferParams, voxel_m: f32) -> f32 {
    params.bias_m.max(LIFT_VOXELS * voxel_m)
}

/// For each direction, a bit for each of sixteen points that something hides it from.
pub(super) struct Hidden([u16; MAX_DIRECTIONS]);

impl Hidden {
    pub fn none() -> Self {
        Self([0; MAX_DIRECTIONS])
    }

    /// Adds a point's stored hits: a bit for each direction.
    pub fn load(&mut self, lane: usize, words: &[u32]) {
        for_each_bit(words, |direction| self.0[direction] |= 1 << lane);
    }

    /// Writes one point's hits.
    pub fn store(&self, lane: usize, words: &mut [u32]) {
        words.fill(0);
        for (direction, bits) in self.0[..(words.len() * 32).min(MAX_DIRECTIONS)].iter().enumerate()
        {
            words[direction / 32] |= u32::from(bits >> lane & 1) << (direction % 32);
        }
    }
}

fn for_each_bit(words: &[u32], mut visit: impl FnMut(usize)) {
    for (k, &word) in words.iter().enumerate() {
        let mut bits = word;
        while bits != 0 {
            visit(k * 32 + bits.trailing_zeros() as usize);
            bits &= bits - 1;
        }
    }
}

/// Everything that rays can meet.
pub(super) struct Tracer<'a> {
    set: &'a DirectionSet,
    volume: Occlusion<'a>,
    objects: &'a SceneRays,
    reach_m: f32,
    lift_m: f32,
}

impl<'a> Tracer<'a> {
    pub fn new(
        params: &TransferParams,
        set: &'a DirectionSet,
        volume: Occlusion<'a>,
        objects: &'a SceneRays,
    ) -> Self {
        let lift_m = volume_lift_m(params, volume.voxel_m());
        Self { set, volume, objects, reach_m: params.ray_length_m, lift_m }
    }

    /// Adds what the volume hides from the points of `lanes`.
    pub fn add_volume(&self, points: &Points, lanes: &Mask, hidden: &mut Hidden) {
        let from = self.volume.voxels_from_world(&points.lifted(self.lift_m));
        for (bits, &w) in hidden.0.iter_mut().zip(&self.set.directions) {
            let (wanted, any) = above(&points.cosines(w), lanes);
            if any {
                let met = self.volume.meets(&from, w, self.reach_m, &wanted);
                for (i, &met) in met.iter().enumerate() {
                    *bits |= (met as u16) << i;
                }
            }
        }
    }

    /// Whether an object is near enough to hide anything from the points.
    pub fn objects_in_reach(&self, points: &Points) -> bool {
        let (centre, radius) = points.bounds();
        self.objects.bounds().any(|sphere| {
            centre.distance(sphere.centre) <= radius + sphere.radius + self.reach_m + OBJECT_LIFT_M
        })
    }

    /// Adds what objects hide, where nothing else does yet.
    pub fn add_objects(&self, points: &Points, hidden: &mut Hidden) {
        let from = points.lifted(OBJECT_LIFT_M);
        for (bits, &w) in hidden.0.iter_mut().zip(&self.set.directions) {
            let (wanted, any) = above(&points.cosines(w), &points.valid);
            if !any {
                continue;
            }
            for lane in (0..LANES).filter(|&i| wanted[i] == 1) {
                let origin = Vec3::from(from.each_ref().map(|p| p[lane]));
                if *bits >> lane & 1 == 0 && self.objects.meets(origin, w, self.reach_m) {
                    *bits |= 1 << lane;
                }
            }
        }
    }
}

#[inline(always)]
fn above(cosine: &Lanes, lanes: &Mask) -> (Mask, bool) {
    let (mut wanted, mut any) = ([0; LANES], 0);
    for i in 0..LANES {
        wanted[i] = lanes[i] & (cosine[i] > 0.0) as u32;
        any |= wanted[i];
    }
    (wanted, any != 0)
}

/// Writes T = T_unoccluded - sum of c_j Y_j over the hidden directions / sum of all c_j, with
/// c_j = max(0, n.w_j), to the places `slots` of a row of results of `n` coefficients each; zero for
/// points without surface.
#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
pub(super) fn write_transfer(
    set: &DirectionSet,
    points: &Points,
    hidden: &Hidden,
    n: usize,
    slots: &[u32],
    out: &mut [f32],
) {
    let mut sum = [0.0; LANES];
    for &w in &set.directions {
        let cosine = points.cosines(w);
        for i in 0..LANES {
            sum[i] += cosine[i];
        }
    }
    let bands = n.isqrt();
    let mut lobe = [[0.0; LANES]; sh::MAX_COEFFICIENTS];
    sh::basis_lanes(&points.normal, bands, &mut lobe);
    for l in 0..bands {
        let factor = (sh::CLAMPED_COSINE[l] / PI) as f32;
        for row in &mut lobe[l * l..(l + 1) * (l + 1)] {
            row.iter_mut().for_each(|v| *v *= factor);
        }
    }
    for (lane, &slot) in slots.iter().enumerate() {
        let out = &mut out[slot as usize * n..][..n];
        if points.valid[lane] == 0 {
            out.fill(0.0);
            continue;
        }
        let normal = Vec3::from(points.normal.map(|axis| axis[lane]));
        // A lattice that leaves a hemisphere empty hides nothing from it.
        let share = if sum[lane] > 0.0 { 1.0 / sum[lane] } else { 0.0 };
        for (c, out) in out.chunks_mut(LANES).enumerate() {
            let mut taken = [0.0; LANES];
            for (direction, &bits) in hidden.0[..set.len()].iter().enumerate() {
                if bits >> lane & 1 == 0 {
                    continue;
                }
                let weight = normal.dot(set.directions[direction]) * share;
                let row = &set.row(direction)[c * LANES..(c + 1) * LANES];
                for k in 0..LANES {
                    taken[k] += weight * row[k];
                }
            }
            for (k, out) in out.iter_mut().enumerate() {
                *out = lobe[c * LANES + k][lane] - taken[k];
            }
        }
    }
}
