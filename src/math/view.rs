//! Where a picture is taken from: a perspective camera or an orthographic side view.
//!
//! View axes are x right, y down, z forward. Depth is the z coordinate in metres; 0.0 is missing.

use super::{Pose, affine_from_pose};
use crate::image::Size;
use glam::{Affine3A, Vec2, Vec3};

/// Rectified perspective camera. Focal lengths and principal point in pixels.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Pinhole {
    pub width: usize,
    pub height: usize,
    pub fx: f32,
    pub fy: f32,
    pub cx: f32,
    pub cy: f32,
}

impl Pinhole {
    pub fn size(&self) -> Size {
        Size::new(self.width, self.height)
    }

    /// What keeps it from being one.
    pub fn check(&self) -> Result<(), String> {
        let Self { fx, fy, cx, cy, .. } = *self;
        if self.size().pixels() == 0 {
            return Err(format!("has pictures of {}", self.size()));
        }
        if !([fx, fy].iter().all(|f| *f > 0.0 && f.is_finite())) {
            return Err(format!(
                "has focal lengths {fx} and {fy}; both must be above 0 and finite"
            ));
        }
        match cx.is_finite() && cy.is_finite() {
            true => Ok(()),
            false => Err(format!("has its principal point at {cx}, {cy}; both must be finite")),
        }
    }

    /// The camera of an image made by averaging 2x2 pixels `level` times.
    pub fn halved(&self, level: u32) -> Self {
        let s = 0.5f32.powi(level as i32);
        Self {
            width: self.width >> level,
            height: self.height >> level,
            fx: self.fx * s,
            fy: self.fy * s,
            cx: (self.cx + 0.5) * s - 0.5,
            cy: (self.cy + 0.5) * s - 0.5,
        }
    }
}

/// Parallel projection along +z: `u = x * pixels_per_m + cx`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orthographic {
    pub width: usize,
    pub height: usize,
    pub pixels_per_m: f32,
    pub cx: f32,
    pub cy: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    Perspective(Pinhole),
    Orthographic(Orthographic),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    pub projection: Projection,
    pub world_from_view: Pose,
}

impl View {
    pub fn perspective(camera: Pinhole, world_from_view: Pose) -> Self {
        Self { projection: Projection::Perspective(camera), world_from_view }
    }

    pub fn size(&self) -> Size {
        match self.projection {
            Projection::Perspective(p) => p.size(),
            Projection::Orthographic(o) => Size::new(o.width, o.height),
        }
    }

    pub fn world_from_view_f32(&self) -> Affine3A {
        affine_from_pose(&self.world_from_view)
    }

    pub fn view_from_world_f32(&self) -> Affine3A {
        affine_from_pose(&self.world_from_view.inverse())
    }

    /// Scale and centre in pixels: `u = x * sx / w + cx`, `w` is depth in a perspective view and
    /// 1 in an orthographic one.
    pub fn scale_and_centre(&self) -> (Vec2, Vec2) {
        match self.projection {
            Projection::Perspective(p) => (Vec2::new(p.fx, p.fy), Vec2::new(p.cx, p.cy)),
            Projection::Orthographic(o) => (Vec2::splat(o.pixels_per_m), Vec2::new(o.cx, o.cy)),
        }
    }

    pub fn is_perspective(&self) -> bool {
        matches!(self.projection, Projection::Perspective(_))
    }

    /// Pixel coordinates of a point in view axes; `None` at or behind a perspective camera.
    pub fn project(&self, point_in_view: Vec3) -> Option<Vec2> {
        let (scale, centre) = self.scale_and_centre();
        let w = if self.is_perspective() { point_in_view.z } else { 1.0 };
        (w > 0.0).then(|| point_in_view.truncate() * scale / w + centre)
    }

    /// The point in view axes that is seen at a pixel with this depth.
    pub fn unproject(&self, pixel: Vec2, depth_m: f32) -> Vec3 {
        let (scale, centre) = self.scale_and_centre();
        let w = if self.is_perspective() { depth_m } else { 1.0 };
        ((pixel - centre) / scale * w).extend(depth_m)
    }

    /// Unit direction, in view axes, from the surface seen at `pixel` towards the eye.
    pub fn towards_eye(&self, pixel: Vec2) -> Vec3 {
        match self.projection {
            Projection::Perspective(_) => -self.unproject(pixel, 1.0).normalize(),
            Projection::Orthographic(_) => -Vec3::Z,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projection_round_trips() {
        let pinhole =
            Pinhole { width: 640, height: 480, fx: 525.0, fy: 520.0, cx: 319.5, cy: 239.5 };
        let ortho =
            Orthographic { width: 256, height: 256, pixels_per_m: 128.0, cx: 127.5, cy: 127.5 };
        for projection in [Projection::Perspective(pinhole), Projection::Orthographic(ortho)] {
            let view = View { projection, world_from_view: Pose::identity() };
            for (u, v, d) in [(0.0, 0.0, 0.4), (319.5, 239.5, 1.0), (17.25, 400.5, 8.0)] {
                let back = view.project(view.unproject(Vec2::new(u, v), d)).unwrap();
                // two roundings of values up to 400
                assert!((back - Vec2::new(u, v)).length() < 1e-4, "{back}");
            }
        }
    }

    #[test]
    fn halving_keeps_the_ray_of_a_block_of_four_pixels() {
        let full = Pinhole { width: 640, height: 480, fx: 525.0, fy: 525.0, cx: 319.5, cy: 239.5 };
        let half = full.halved(1);
        // pixel 10 of the half image covers pixels 20 and 21: centre 20.5
        let (a, b) = ((20.5 - full.cx) / full.fx, (10.0 - half.cx) / half.fx);
        assert!((a - b).abs() < 1e-6);
    }
}
