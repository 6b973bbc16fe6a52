//! The light of a frame, as parameters of a pass.

use crate::compositing::Lamp;
use crate::gpu::uniform;

uniform! {
    /// [`Lamp`] for `shaders/compositing/lamp.wgsl`: always three channels.
    pub struct LampUniform {
        /// 36 coefficients of RGB.
        coefficients: [[[f32; 4]; 4]; 9],
        polynomial: [[f32; 4]; 9],
        floor: f32,
        visibility_offset: f32,
        pad0: u32,
        pad1: u32,
    }
}

impl LampUniform {
    pub fn new(lamp: &Lamp) -> Self {
        let rgb = |i: usize| [0, 1, 2, 3].map(|c| lamp.coefficients.get(c).map_or(0.0, |l| l[i]));
        let terms = |i: usize| [0, 1, 2, 3].map(|c| lamp.polynomial.get(c).map_or(0.0, |l| l[i]));
        Self {
            coefficients: std::array::from_fn(|i| std::array::from_fn(|k| rgb(4 * i + k))),
            polynomial: std::array::from_fn(terms),
            floor: lamp.floor,
            visibility_offset: lamp.visibility_offset,
            pad0: 0,
            pad1: 0,
        }
    }
}
