//! A depth picture enters the volume: weighted running average of truncated projective distances
//! (Curless and Levoy 1996; Newcombe et al., "KinectFusion", 2011, Eq. 6-13).

#![allow(unsafe_code, reason = "look-ups of inner loops, whose bounds are said beside each")]

use super::block::{Block, ColorBlock, ONE, SIDE, UNSEEN, VOXELS};
use super::crossings::Sides;
use super::rays::ViewFromVoxel;
use super::{FusionError, TsdfVolume};
use crate::capture::RgbdFrame;
use crate::image::Size;
use crate::math::View;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Voxels handled together: two rows of a block.
const LANES: usize = 16;
/// Neighbouring depths that differ by more than this share of the depth lie on an edge: they are
/// not interpolated. To a Kinect's 640 pixels a plane seen at 80 degrees changes by 1 % from one to the next.
const EDGE: f32 = 0.02;
/// Tangent of 75 degrees: where pixels are so large that a plane seen at that angle changes by more than `EDGE`
/// from one to the next, it is still one surface. Nearest pixels would put steps into every wall.
const STEEPEST: f32 = 3.73;
/// Voxels nearer to the camera's plane are not seen.
pub(crate) const NEAREST_M: f32 = 1e-3;
/// Frames in the running average of colour: an 8-bit average of more frames would not move.
pub(crate) const COLOR_WEIGHT: u8 = 8;
/// Adding and taking this rounds to the nearest integer, ties to even: no drift in either
/// direction, and it vectorises without SSE4.1.
const ROUND: f32 = 12_582_912.0;

/// The share of a depth beyond which neighbours in this view lie on an edge.
pub(crate) fn edge(view: &View) -> f32 {
    let (pixels_per_unit, _) = view.scale_and_centre();
    if view.is_perspective() { EDGE.max(STEEPEST / pixels_per_unit.min_element()) } else { EDGE }
}

impl TsdfVolume {
    /// Averages the frame's depth, seen in `view`, into the volume. Pixels without depth say
    /// nothing. Voxels in front of the surface along the whole ray become free, where they have
    /// storage.
    ///
    /// Every frame counts the same. A voxel's stored distance moves by less than half a step
    /// (1/32767 of the truncation distance) only where the frame agrees with it to within
    /// `max_weight / 2` steps: repeated integration of one frame leaves it unchanged.
    pub fn integrate(&mut self, frame: &RgbdFrame, view: &View) -> Result<(), FusionError> {
        let size = frame.depth_m.size();
        if size != view.size() {
            return Err(FusionError::Size { frame: frame.index, depth: size, view: view.size() });
        }
        let from_voxel = ViewFromVoxel::new(&self.lattice, view);
        if !(from_voxel.origin + from_voxel.x + from_voxel.y).is_finite() {
            return Err(FusionError::Pose { frame: frame.index });
        }
        if size.pixels() == 0 {
            return Ok(());
        }
        self.revision += 1;
        self.allocate_near(&frame.depth_m, view);
        let fuse = Fuse::new(self, frame, view, from_voxel);
        self.store.blocks.par_iter_mut().with_min_len(32).for_each(|block| {
            if block.live && fuse.sees(block.coords) {
                fuse_block(&fuse, block);
            }
        });
        self.release_free_blocks();
        self.store.find_crossings();
        Ok(())
    }
}

/// What the kernel knows of a frame.
struct Fuse<'a> {
    depth_m: &'a [f32],
    colors: Option<&'a [[u8; 3]]>,
    size: Size,
    max_depth_m: f32,
    from_voxel: ViewFromVoxel,
    scale: Vec2,
    centre: Vec2,
    /// `w = z * by_depth + (1 - by_depth)` divides image coordinates: 1 perspective, 0 parallel.
    by_depth: f32,
    voxel_m: f32,
    truncation_m: f32,
    max_weight: f32,
    free_weight: f32,
    /// See [`edge`].
    edge: f32,
}

impl<'a> Fuse<'a> {
    fn new(
        volume: &TsdfVolume,
        frame: &'a RgbdFrame,
        view: &View,
        from_voxel: ViewFromVoxel,
    ) -> Self {
        let (scale, centre) = view.scale_and_centre();
        let size = view.size();
        let max_weight = f32::from(volume.params.max_weight);
        let depth_m = frame.depth_m.as_slice();
        Self {
            depth_m,
            colors: (volume.params.color && frame.color_srgb.size() == size)
                .then(|| frame.color_srgb.as_slice()),
            size,
            max_depth_m: depth_m.iter().fold(0.0, |a, &b| if b > a { b } else { a }),
            from_voxel,
            scale,
            centre,
            by_depth: if view.is_perspective() { 1.0 } else { 0.0 },
            voxel_m: volume.lattice.voxel_m,
            truncation_m: volume.lattice.truncation_m,
            max_weight,
            free_weight: f32::from(volume.params.free_weight).min(max_weight),
            edge: edge(view),
        }
    }

    /// Whether the block's bounding sphere reaches into the frustum, and in front of the farthest
    /// surface.
    fn sees(&self, coords: [u16; 3]) -> bool {
        let centre = Vec3::from(coords.map(|v| f32::from(v) * SIDE as f32 + 3.5));
        let radius = 3.5 * 3f32.sqrt() * self.voxel_m;
        let p = self.from_voxel.apply(centre);
        let depth = NEAREST_M..=self.max_depth_m + self.truncation_m;
        if p.z + radius < *depth.start() || p.z - radius > *depth.end() {
            return false;
        }
        let inside = |position: f32, scale: f32, centre: f32, pixels: usize| {
            // half-spaces u >= -1/2 and u <= pixels - 1/2, multiplied by w
            let w =
                |c: f32| (c * self.by_depth * p.z + c * (1.0 - self.by_depth), c * self.by_depth);
            let ((low, low_z), (high, high_z)) = (w(centre + 0.5), w(pixels as f32 - 0.5 - centre));
            position * scale + low >= -radius * scale.hypot(low_z)
                && high - position * scale >= -radius * scale.hypot(high_z)
        };
        inside(p.x, self.scale.x, self.centre.x, self.size.width)
            && inside(p.y, self.scale.y, self.centre.y, self.size.height)
    }
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn fuse_block(fuse: &Fuse<'_>, block: &mut Block) {
    let corner = Vec3::from(block.coords.map(|v| f32::from(v) * SIDE as f32));
    for chunk in 0..VOXELS / LANES {
        let first = Vec3::new(0.0, (chunk % 4 * 2) as f32, (chunk / 4) as f32);
        let Some(seen) = look_up(fuse, fuse.from_voxel.apply(corner + first)) else { continue };
        let range = chunk * LANES..(chunk + 1) * LANES;
        if let (Some(stored), Some(colors)) = (&mut block.color, fuse.colors) {
            average_color(fuse, &seen, colors, stored, chunk * LANES);
        }
        average(fuse, &seen, &mut block.tsdf[range.clone()], &mut block.weight[range]);
    }
    block.lowest = lowest(&block.tsdf);
    block.sides = Sides::of(&block.tsdf);
}

/// Signed distances of 16 voxels, metres, and the pixels they fall on.
struct Seen {
    valid: [u32; LANES],
    distance_m: [f32; LANES],
    pixel: [i32; LANES],
}

/// `None` where no voxel sees a depth that it does not lie far behind.
#[inline(always)]
fn look_up(fuse: &Fuse<'_>, first: Vec3) -> Option<Seen> {
    let (width, height) = (fuse.size.width as i32, fuse.size.height as i32);
    let (right, bottom) = ((width - 1) as f32, (height - 1) as f32);
    let (dx, dy) = (fuse.from_voxel.x, fuse.from_voxel.y);
    let (mut x0, mut y0) = ([0i32; LANES], [0i32; LANES]);
    let (mut fx, mut fy) = ([0f32; LANES], [0f32; LANES]);
    let (mut z, mut valid) = ([0f32; LANES], [0u32; LANES]);
    for i in 0..LANES {
        let (column, row) = ((i % SIDE) as f32, (i / SIDE) as f32);
        let px = first.x + column * dx.x + row * dy.x;
        let py = first.y + column * dx.y + row * dy.y;
        let pz = first.z + column * dx.z + row * dy.z;
        let w = pz * fuse.by_depth + (1.0 - fuse.by_depth);
        let u = px * fuse.scale.x / w + fuse.centre.x;
        let v = py * fuse.scale.y / w + fuse.centre.y;
        let inside =
            (pz > NEAREST_M) & (u >= -0.5) & (v >= -0.5) & (u <= right + 0.5) & (v <= bottom + 0.5);
        // max before min: NaN becomes 0
        let (u, v) = (u.max(0.0).min(right), v.max(0.0).min(bottom));
        // SAFETY: both are finite and within [0, 2^31), as image sides are.
        let (ui, vi) = unsafe { (u.to_int_unchecked::<i32>(), v.to_int_unchecked::<i32>()) };
        (x0[i], y0[i]) = (ui, vi);
        (fx[i], fy[i]) = (u - ui as f32, v - vi as f32);
        z[i] = pz;
        valid[i] = inside as u32;
    }
    if valid.iter().fold(0, |a, b| a | b) == 0 {
        return None;
    }

    let mut taps = [[0f32; LANES]; 4];
    let mut pixel = [0i32; LANES];
    for i in 0..LANES {
        let step_x = (x0[i] + 1 < width) as i32;
        let step_y = if y0[i] + 1 < height { width } else { 0 };
        let at = y0[i] * width + x0[i];
        for (tap, offset) in taps.iter_mut().zip([0, step_x, step_y, step_x + step_y]) {
            // SAFETY: x0 < width and y0 < height, the steps stay inside; depth_m is that large
            // (`integrate` compares the sizes).
            tap[i] = unsafe { *fuse.depth_m.get_unchecked((at + offset) as usize) };
        }
        pixel[i] =
            at + if fx[i] >= 0.5 { step_x } else { 0 } + if fy[i] >= 0.5 { step_y } else { 0 };
    }
    let mut distance_m = [0f32; LANES];
    for i in 0..LANES {
        let [a, b, c, d] = [taps[0][i], taps[1][i], taps[2][i], taps[3][i]];
        let (low, high) = (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
        let smooth = (low > 0.0) & (high - low <= fuse.edge * low);
        let (top, bottom) = (a + (b - a) * fx[i], c + (d - c) * fx[i]);
        let (near_top, near_bottom) =
            (if fx[i] >= 0.5 { b } else { a }, if fx[i] >= 0.5 { d } else { c });
        let nearest = if fy[i] >= 0.5 { near_bottom } else { near_top };
        let depth = if smooth { top + (bottom - top) * fy[i] } else { nearest };
        distance_m[i] = depth - z[i];
        // infinite depth is no depth
        let known = (depth > 0.0) & (depth < f32::INFINITY);
        valid[i] &= (known & (distance_m[i] >= -fuse.truncation_m)) as u32;
    }
    (valid.iter().fold(0, |a, b| a | b) != 0).then_some(Seen { valid, distance_m, pixel })
}

#[inline(always)]
fn average(fuse: &Fuse<'_>, seen: &Seen, tsdf: &mut [i16], weights: &mut [u16]) {
    let one = f32::from(ONE);
    let per_m = one / fuse.truncation_m;
    let (tsdf, weights) = (&mut tsdf[..LANES], &mut weights[..LANES]);
    for i in 0..LANES {
        let free = seen.distance_m[i] > fuse.truncation_m;
        let target = (seen.distance_m[i] * per_m).max(-one).min(one);
        let (old, weight) = (f32::from(tsdf[i]), f32::from(weights[i]));
        let weight = if free { weight.min(fuse.free_weight) } else { weight };
        // An unseen voxel has weight 0: `old` cancels.
        let mean = old + (target - old) / (weight + 1.0);
        let rounded = ((mean + ROUND) - ROUND).max(-one).min(one);
        let weight = (weight + 1.0).min(fuse.max_weight);
        // SAFETY: clamped to [-32767, 32767] and [1, 1024]; never NaN: depths and poses are finite.
        let (value, weight) =
            unsafe { (rounded.to_int_unchecked::<i32>(), weight.to_int_unchecked::<i32>()) };
        let valid = seen.valid[i] != 0;
        tsdf[i] = if valid { value as i16 } else { tsdf[i] };
        weights[i] = if valid { weight as u16 } else { weights[i] };
    }
}

/// Colour is kept beside the surface only. Encoded values are averaged: what is averaged are
/// observations of one colour, and steps of equal visibility lose least in 8 bits.
#[inline(always)]
fn average_color(
    fuse: &Fuse<'_>,
    seen: &Seen,
    colors: &[[u8; 3]],
    stored: &mut ColorBlock,
    first: usize,
) {
    let band_m = 2.0 * fuse.voxel_m;
    for i in 0..LANES {
        if seen.valid[i] == 0 || seen.distance_m[i].abs() > band_m {
            continue;
        }
        let (color, voxel) = (colors[seen.pixel[i] as usize], &mut stored[first + i]);
        let weight = i32::from(voxel[3]);
        for (old, new) in voxel.iter_mut().zip(color) {
            let (sum, n) = (i32::from(*old) * weight + i32::from(new), weight + 1);
            *old = ((sum + n / 2) / n) as u8;
        }
        voxel[3] = (voxel[3] + 1).min(COLOR_WEIGHT);
    }
}

#[inline(always)]
pub(super) fn lowest(tsdf: &[i16; VOXELS]) -> i16 {
    tsdf.iter().fold(ONE, |low, &v| low.min(if v == UNSEEN { ONE } else { v }))
}
