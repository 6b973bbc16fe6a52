//! Normals where the rays of a packet meet the surface.

use super::block::UNSEEN;
use super::packet::{Cube, Field, Hits, LANES, Lanes, Mask, Packet, cells, points};
use glam::Vec3;

/// Interpolated central differences; lanes whose surroundings were not all seen are left to the
/// sampler, which has more ways. A depth without a normal is dropped.
#[inline(always)]
pub(super) fn normals(field: &Field<'_>, packet: &Packet, depth_m: Lanes) -> Hits {
    let point = points(field, packet, &depth_m);
    let (mut normal, mut good) = central_gradient(field, &point);
    for i in 0..LANES {
        let [x, y, z] = [normal[0][i], normal[1][i], normal[2][i]];
        let [dx, dy, dz] = [packet.direction[0][i], packet.direction[1][i], packet.direction[2][i]];
        let square = x * x + y * y + z * z;
        // against the ray, and so not zero either
        good[i] &= (x * dx + y * dy + z * dz < 0.0) as u32;
        let seen = depth_m[i] > 0.0;
        let scale = if seen { 1.0 / square.sqrt() } else { 0.0 };
        normal[0][i] = if seen { x * scale } else { 0.0 };
        normal[1][i] = if seen { y * scale } else { 0.0 };
        normal[2][i] = if seen { z * scale } else { 0.0 };
        good[i] |= !seen as u32;
    }
    let mut hits = Hits { depth_m, normal };
    for i in (0..LANES).filter(|&i| good[i] == 0) {
        let of = |v: &[Lanes; 3]| Vec3::new(v[0][i], v[1][i], v[2][i]);
        let normal = field.sampler.normal(of(&point), of(&packet.direction));
        hits.depth_m[i] = if normal.is_some() { depth_m[i] } else { 0.0 };
        let normal = normal.unwrap_or_default();
        for axis in 0..3 {
            hits.normal[axis][i] = normal[axis];
        }
    }
    hits
}

/// Central differences at the eight corners around a point, interpolated: a weighted sum of the
/// 32 voxels of 4x4x4 that a difference reads. The mask tells where all were seen.
#[inline(always)]
fn central_gradient(field: &Field<'_>, point: &[Lanes; 3]) -> ([Lanes; 3], Mask) {
    let (base, fraction) = cells(field, point);
    let last = field.last as i32;
    let (mut whole, mut first) = ([1; LANES], base);
    // Weights of the four samples along an axis: of the value between the middle two, and of the
    // difference of their neighbours.
    let (mut value, mut slope) = ([[[0.0; LANES]; 4]; 3], [[[0.0; LANES]; 4]; 3]);
    for axis in 0..3 {
        for i in 0..LANES {
            whole[i] &= ((base[axis][i] >= 1) & (base[axis][i] + 2 <= last)) as u32;
            first[axis][i] = (base[axis][i] - 1).max(0).min(last - 3);
            let f = fraction[axis][i];
            (value[axis][1][i], value[axis][2][i]) = (1.0 - f, f);
            (slope[axis][0][i], slope[axis][1][i]) = (f - 1.0, -f);
            (slope[axis][2][i], slope[axis][3][i]) = (1.0 - f, f);
        }
    }
    let cube = Cube::<4>::new(field, &first);
    let mut gradient = [[0.0; LANES]; 3];
    for k in 0..64 {
        let at = [k & 3, k >> 2 & 3, k >> 4];
        let outer = [0, 1, 2].map(|axis| at[axis] == 0 || at[axis] == 3);
        if u8::from(outer[0]) + u8::from(outer[1]) + u8::from(outer[2]) > 1 {
            continue;
        }
        let stored = cube.at(field, at);
        for i in 0..LANES {
            whole[i] &= (stored[i] != i32::from(UNSEEN)) as u32;
        }
        for axis in 0..3 {
            let (p, q) = ((axis + 1) % 3, (axis + 2) % 3);
            if outer[p] || outer[q] {
                continue;
            }
            let (along, wp, wq) = (&slope[axis][at[axis]], &value[p][at[p]], &value[q][at[q]]);
            for i in 0..LANES {
                gradient[axis][i] += along[i] * wp[i] * wq[i] * stored[i] as f32;
            }
        }
    }
    (gradient, whole)
}
