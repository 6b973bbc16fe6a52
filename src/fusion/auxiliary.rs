//! The auxiliary views: parallel projections that look at the volume from its sides and from the
//! light, so that geometry outside the camera's view still casts shadows (Gruber et al. 2015,
//! Sec. 5.1).

use super::{Lattice, SurfaceParams};
use crate::math::{Orthographic, Pose, Projection, View};
use glam::{Mat3, Quat, Vec3};
use nalgebra as na;

/// The plane of depth 0 lies this share of the side before the cube, so that surfaces at its
/// border have a positive depth.
const CLEARANCE: f32 = 0.01;
/// Closer to the camera's down axis (cosine), a light's picture takes its rows from the forward axis.
const STEEP: f32 = 0.9;

/// Views around a cube, with the axes of the first camera. Placed once, with the volume.
#[derive(Clone, Debug)]
pub struct AuxiliaryRig {
    centre: Vec3,
    side_m: f32,
    /// Axes of the first camera in the world.
    right: Vec3,
    down: Vec3,
    forward: Vec3,
    params: SurfaceParams,
}

impl AuxiliaryRig {
    pub fn new(lattice: &Lattice, first_camera: &View, params: &SurfaceParams) -> Self {
        let (low, high) = lattice.bounds();
        let axes = first_camera.world_from_view_f32().matrix3;
        Self {
            centre: 0.5 * (low + high),
            side_m: (high - low).max_element(),
            right: axes.x_axis.into(),
            down: axes.y_axis.into(),
            forward: axes.z_axis.into(),
            params: params.clone(),
        }
    }

    /// Other views and sizes, around the same cube.
    pub fn reconfigure(&mut self, params: &SurfaceParams) {
        self.params = params.clone();
    }

    /// The views that are switched on: left, right, top and, where a direction is given, light.
    pub fn views(&self, towards_light: Option<Vec3>) -> Vec<View> {
        let mut views = Vec::new();
        if self.params.left {
            views.push(self.look(self.right, self.down));
        }
        if self.params.right {
            views.push(self.look(-self.right, self.down));
        }
        if self.params.top {
            views.push(self.look(self.down, -self.forward));
        }
        if let (true, Some(towards_light)) = (self.params.light, towards_light) {
            views.push(self.light_view(towards_light));
        }
        views
    }

    /// From the light, `towards_light` a unit vector.
    pub fn light_view(&self, towards_light: Vec3) -> View {
        let down =
            if towards_light.dot(self.down).abs() < STEEP { self.down } else { self.forward };
        self.look(-towards_light, down)
    }

    /// A square picture that covers the cube's projection along `forward`; its columns follow
    /// `down` as far as they can.
    fn look(&self, forward: Vec3, down: Vec3) -> View {
        let z = forward.normalize();
        let x = down.cross(z).normalize();
        let axes = Mat3::from_cols(x, z.cross(x), z);
        let half = |axis: Vec3| 0.5 * self.side_m * axis.abs().element_sum();
        let eye = self.centre - z * (half(z) + CLEARANCE * self.side_m);
        let pixels = self.params.auxiliary_resolution;
        let middle = (pixels as f32 - 1.0) / 2.0;
        let projection = Orthographic {
            width: pixels,
            height: pixels,
            pixels_per_m: pixels as f32 / (2.0 * half(axes.x_axis).max(half(axes.y_axis))),
            cx: middle,
            cy: middle,
        };
        let q = Quat::from_mat3(&axes).as_dquat();
        let rotation = na::UnitQuaternion::from_quaternion(na::Quaternion::new(q.w, q.x, q.y, q.z));
        let eye = eye.as_dvec3();
        View {
            projection: Projection::Orthographic(projection),
            world_from_view: Pose::from_parts(na::Translation3::new(eye.x, eye.y, eye.z), rotation),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fusion::VolumeParams;
    use crate::math::Pinhole;
    use glam::Vec2;

    fn rig() -> AuxiliaryRig {
        let params = VolumeParams { resolution: 64, ..VolumeParams::default() };
        let lattice = Lattice::new(&params, Vec3::new(1.0, -2.0, 0.5)).unwrap();
        let camera = Pinhole { width: 64, height: 48, fx: 50.0, fy: 50.0, cx: 31.5, cy: 23.5 };
        let pose = Pose::new(na::Vector3::zeros(), na::Vector3::new(0.4, -1.1, 0.3));
        let params = SurfaceParams { left: true, right: true, ..SurfaceParams::default() };
        AuxiliaryRig::new(&lattice, &View::perspective(camera, pose), &params)
    }

    #[test]
    fn every_view_covers_the_cube_tightly() {
        let rig = rig();
        let lights = [Vec3::X, -rig.down, rig.down, Vec3::new(0.3, -0.5, 0.8).normalize()];
        for light in lights {
            let views = rig.views(Some(light));
            assert_eq!(views.len(), 4);
            for view in views {
                let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
                for i in 0..8 {
                    let sign = Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32);
                    let corner = rig.centre + (sign - 0.5) * rig.side_m;
                    let p = view.view_from_world_f32().transform_point3(corner);
                    assert!(p.z > 0.0);
                    let pixel = view.project(p).unwrap();
                    (low, high) = (low.min(pixel), high.max(pixel));
                }
                // pixel areas run from -1/2 to 255 1/2; 1e-3 for rounding
                assert!(low.min_element() > -0.501 && high.max_element() < 255.501);
                assert!((high - low).max_element() > 255.9);
            }
        }
    }

    #[test]
    fn the_views_look_from_the_named_sides() {
        let rig = rig();
        let views = rig.views(Some(Vec3::Z));
        let looks = |i: usize, axis: Vec3| {
            let m = views[i].world_from_view_f32().matrix3;
            // quaternion in f32
            assert!((Vec3::from(m.z_axis) - axis).length() < 1e-5, "view {i}");
        };
        looks(0, rig.right);
        looks(1, -rig.right);
        looks(2, rig.down);
        looks(3, -Vec3::Z);
    }
}
