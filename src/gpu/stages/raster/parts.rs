//! What is drawn in one view: the parts of all objects that may be seen, and how they are shaded.

use super::models::{GpuModels, finite};
use super::window::{hull, window_of_sphere};
use crate::gpu::{Draw, Window, uniform};
use crate::math::View;
use crate::scene::raster::{NEAR_M, Projector};
use crate::scene::{Similarity, VirtualScene};
use glam::{Affine3A, Mat4};

uniform! {
    /// As in `shaders/raster/scene.wgsl`.
    pub struct Part {
        screen_from_object: [[f32; 4]; 4],
        world_from_object: [[f32; 4]; 4],
        base_color: [f32; 4],
        first_number: u32,
        first_triangle: u32,
        texture_size: [u32; 2],
        first_texel: u32,
        levels: u32,
        wrap_u: u32,
        wrap_v: u32,
        alpha_cutoff: f32,
        is_masked: u32,
        pad0: u32,
        pad1: u32,
    }
}

/// The parts to draw, in the scene's order.
#[derive(Default)]
pub struct PartList {
    pub parts: Vec<Part>,
    /// One a part.
    pub draws: Vec<Draw>,
    /// Nothing is seen outside.
    pub window: Window,
    /// Depth that nothing exceeds, metres.
    pub far_m: f32,
    pub objects: usize,
    next_number: u64,
}

impl PartList {
    /// The objects of `scene` that `view` may show; their models are in `models`.
    pub fn new(scene: &VirtualScene, view: &View, models: &GpuModels) -> Self {
        let projector = Projector::new(view);
        let view_from_world = view.view_from_world_f32();
        let mut list = Self { far_m: 2.0 * NEAR_M, next_number: 1, ..Self::default() };
        for object in &scene.objects {
            let (Some(place), Some(bounds)) = (object.world_from_object(), object.bounds()) else {
                continue;
            };
            let screen_from_object = projector.screen_from_object(&place);
            if projector.misses(bounds.centre, bounds.radius) || !screen_from_object.is_finite() {
                continue;
            }
            let Some(model) = models.place(&object.model) else { continue };
            let centre = view_from_world.transform_point3(bounds.centre);
            // a little more, as vertices are rounded otherwise than the sphere
            list.far_m = list.far_m.max(1.001 * (centre.z + bounds.radius));
            list.window = hull(list.window, window_of_sphere(view, &bounds));
            list.objects += 1;
            for (part, texture) in object.model.parts().iter().zip(&model.textures) {
                let triangles = part.triangles.clone();
                let first_triangle = model.first_triangle + triangles.start as u32;
                let Some(first_number) = list.numbers(triangles.len()) else {
                    log::error!(
                        "virtual objects of more than 2^32 triangles: the rest is not drawn"
                    );
                    return list;
                };
                let cutoff = part.material.alpha_cutoff;
                list.draws.push(Draw {
                    vertices: 3 * first_triangle..3 * (first_triangle + triangles.len() as u32),
                    instance: list.parts.len() as u32,
                });
                list.parts.push(Part {
                    screen_from_object: columns(screen_from_object),
                    world_from_object: rotation(&place),
                    base_color: finite(part.material.base_color),
                    first_number,
                    first_triangle,
                    texture_size: texture.size,
                    first_texel: texture.first_texel,
                    levels: texture.levels,
                    wrap_u: texture.wrap[0],
                    wrap_v: texture.wrap[1],
                    alpha_cutoff: cutoff.unwrap_or(0.0),
                    is_masked: u32::from(cutoff.is_some()),
                    pad0: 0,
                    pad1: 0,
                });
            }
        }
        list
    }

    /// The first of so many numbers in a row; `None` where 32 bits don't hold them.
    fn numbers(&mut self, count: usize) -> Option<u32> {
        let first = u32::try_from(self.next_number).ok()?;
        let next = self.next_number + count as u64;
        (next <= 1 << 32).then(|| {
            self.next_number = next;
            first
        })
    }

    /// Whether any part has holes.
    pub fn masked(&self) -> bool {
        self.parts.iter().any(|part| part.is_masked == 1)
    }
}

fn columns(affine: Affine3A) -> [[f32; 4]; 4] {
    Mat4::from(affine).to_cols_array_2d()
}

fn rotation(place: &Similarity) -> [[f32; 4]; 4] {
    Mat4::from_quat(place.rotation).to_cols_array_2d()
}
