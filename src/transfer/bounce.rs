//! One bounce of light (Gruber et al. 2015, Sec. 5.3).
//!
//! Where a sample is hidden by a surface s, s stands for the patch that fills the sample's solid angle
//! dw as seen from x. Its area is dA = dw d^2 / (n_s . -t) for a distance d along t. Eq. 11, taken
//! times dA, loses the cosine at s and the 1 / d^2:
//!
//! ```text
//! F dA = (n_x . t) (n_s . -t) / (pi d^2) dA = (n_x . t) dw / pi
//! ```
//!
//! So what a direction contributes is bounded however near s is, does not depend on the unit of
//! length, and converges as directions are added. With B(s) the radiance that leaves s, that is albedo
//! and light of s, (n_s . L_D) in Eq. 10:
//!
//! ```text
//! R_i(x) = sum_j (1 - K_j) B(s_j) max(0, n_x . w_j) [n_s . -t_j > 0] / sum_j max(0, n_x . w_j)
//! ```
//!
//! - The sum below stands for pi / dw, as in the transfer, and n_x . w_j for n_x . t_j: s lies
//!   somewhere in the cell of w_j. What the transfer takes away as hidden light comes back here, exactly,
//!   as light of the hiding surface. With n_x . t_j, which is larger on average because nothing below
//!   the horizon of x hides anything, a white corner returned 117 % of what it hid.
//! - The bracket is G of Eq. 12. As printed, it asks for n_x . -t > 0, the very directions in which F is
//!   negative, so nothing could ever arrive. The text wants to leave out surfaces that face away from x;
//!   that is n_s . -t > 0.

use super::batch::{Batch, Scratch, hiddenness};
use super::directions::LANES;
use super::occluder::Occluder;
use super::radiance_transfer::{Buffers, Pass, Radiance};
use crate::geometry::{GBuffer, Origin};
use crate::image::Image;
use glam::{Vec2, Vec3};

/// What a bounce needs besides the pass.
pub(super) struct BounceInput<'a> {
    buffers: Buffers<'a>,
    radiance: Radiance<'a>,
    strength: f32,
}

impl<'a> BounceInput<'a> {
    /// Panics where a picture has not the size of its buffer.
    pub fn new(buffers: Buffers<'a>, radiance: Radiance<'a>, strength: f32) -> Self {
        assert_eq!(radiance.0.size(), buffers.0.size(), "radiance of the main buffer");
        assert!(
            radiance.1.iter().map(Image::size).eq(buffers.1.iter().map(GBuffer::size)),
            "radiance of the auxiliary buffers"
        );
        Self { buffers, radiance, strength }
    }

    fn source(&self, view: usize) -> (&GBuffer, &Image<[f32; 3]>) {
        match view.checked_sub(1) {
            None => (self.buffers.0, self.radiance.0),
            Some(k) => (&self.buffers.1[k], &self.radiance.1[k]),
        }
    }

    /// The bounce at the points of a batch, from what `scratch` has found with virtual surfaces; `sum` are
    /// the sums of cosines.
    #[inline(always)]
    pub fn write(
        &self,
        pass: &Pass,
        batch: &Batch,
        on_virtual: &[bool; LANES],
        sum: &[f32; LANES],
        scratch: &Scratch,
        out: &mut [[f32; 3]],
    ) {
        for i in (0..LANES).filter(|&i| batch.valid[i] && sum[i] > 0.0) {
            let light = gathered(pass, self, batch, i, on_virtual[i], scratch);
            out[batch.index[i]] = (light * (self.strength / sum[i])).to_array();
        }
    }
}

/// sum_j (1 - K_j) B(s_j) max(0, n_x . w_j) [n_s . -t_j > 0] of one point.
fn gathered(
    pass: &Pass,
    input: &BounceInput,
    batch: &Batch,
    i: usize,
    on_virtual: bool,
    scratch: &Scratch,
) -> Vec3 {
    let world_from_main = pass.world_from_main;
    let x = world_from_main.transform_point3(Vec3::from(batch.x.map(|axis| axis[i])));
    let mut light = Vec3::ZERO;
    for k in scratch.active.iter().map(|&direction| direction as usize) {
        let cosine = scratch.cosine[k][i];
        let hidden = hiddenness(scratch.best[k][i], pass.set.chi);
        if cosine <= 0.0 || hidden <= 0.0 {
            continue;
        }
        let (view, (u, v)) = pixel_of_code(pass.occluders, scratch.hit[k][i]);
        let (buffer, radiance) = input.source(view);
        if !(on_virtual || buffer.origin[(u, v)] == Origin::Virtual) {
            continue;
        }
        let pixel = Vec2::new(u as f32, v as f32);
        let in_view = buffer.view.unproject(pixel, buffer.depth_m[(u, v)]);
        let s = pass.occluders[view].view.world_from_view.transform_point3(in_view);
        if buffer.normals.at(u, v).dot(x - s) > 0.0 {
            light += hidden * cosine * Vec3::from(radiance[(u, v)]);
        }
    }
    light
}

/// Buffer and pixel of a code that [`Occluder::cast_merged`] wrote.
fn pixel_of_code(occluders: &[Occluder], code: u32) -> (usize, (usize, usize)) {
    let mut index = code as usize;
    let mut view = 0;
    while index >= occluders[view].padded_len() {
        index -= occluders[view].padded_len();
        view += 1;
    }
    (view, occluders[view].pixel(index))
}
