//! Eq. 6-9 of image-space transfer read off the page, in f64, a sample at a time.

use super::on_device::{Fallible, say};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use kinlight::geometry::GBuffer;
use kinlight::math::sh::{CLAMPED_COSINE, MAX_COEFFICIENTS, basis_f64, coefficients};
use kinlight::math::{Pose, Projection, View};
use kinlight::transfer::{DirectionSet, TransferParams};
use std::f64::consts::PI;

pub struct TransferOracle<'a> {
    params: &'a TransferParams,
    set: DirectionSet,
    main: &'a GBuffer,
    views: Vec<Seen<'a>>,
}

pub struct Exact {
    pub coefficients: Vec<f64>,
    /// Whether anything hides any direction.
    pub hidden: bool,
}

/// A buffer whose surfaces hide samples.
struct Seen<'a> {
    buffer: &'a GBuffer,
    view_from_world: DAffine3,
    /// By pixel.
    limits_m: Vec<f64>,
}

fn affine(pose: &Pose) -> DAffine3 {
    let (q, t) = (pose.rotation.coords, pose.translation.vector);
    DAffine3::from_rotation_translation(
        DQuat::from_xyzw(q.x, q.y, q.z, q.w),
        DVec3::new(t.x, t.y, t.z),
    )
}

/// Scale and centre in pixels, and whether depth divides.
fn lens(view: &View) -> ([f64; 2], [f64; 2], bool) {
    match view.projection {
        Projection::Perspective(p) => {
            ([p.fx.into(), p.fy.into()], [p.cx.into(), p.cy.into()], true)
        }
        Projection::Orthographic(o) => {
            ([o.pixels_per_m.into(); 2], [o.cx.into(), o.cy.into()], false)
        }
    }
}

impl<'a> Seen<'a> {
    fn new(buffer: &'a GBuffer, bias_m: f64) -> Self {
        let view_from_world = affine(&buffer.view.world_from_view.inverse());
        let size = buffer.size();
        let pixels = (0..size.pixels()).map(|k| (k % size.width, k / size.width));
        let limits_m = pixels
            .map(|at| {
                limit_m(buffer, &view_from_world.matrix3, at).map_or(f64::INFINITY, |z| z + bias_m)
            })
            .collect();
        Self { buffer, view_from_world, limits_m }
    }

    /// The surface that hides the sample `x + r w`, as the cosine of its direction from x; world axes.
    fn cosine(&self, x: DVec3, n: DVec3, w: DVec3, r: f64, bias_m: f64) -> Option<f64> {
        let y = self.view_from_world.transform_point3(x + r * w);
        let (scale, centre, perspective) = lens(&self.buffer.view);
        let divisor = if perspective { y.z } else { 1.0 };
        let pixel = [0, 1].map(|a| (y[a] * scale[a] / divisor + centre[a] + 0.5).floor());
        let size = self.buffer.size();
        let inside = (0.0..size.width as f64).contains(&pixel[0])
            && (0.0..size.height as f64).contains(&pixel[1]);
        if !inside || (perspective && y.z <= 0.0) {
            return None;
        }
        let limit_m = self.limits_m[pixel[1] as usize * size.width + pixel[0] as usize];
        if y.z <= limit_m {
            return None;
        }
        // on the ray of the sample, as deep as the surface
        let depth_m = limit_m - bias_m;
        let surface = if perspective { y * (depth_m / y.z) } else { DVec3::new(y.x, y.y, depth_m) };
        let t = surface - self.view_from_world.transform_point3(x);
        let [n, w] = [n, w].map(|v| self.view_from_world.transform_vector3(v));
        (t.dot(n) > 0.0).then(|| t.dot(w) / t.length())
    }
}

/// The depth of the pixel's tangent plane where it is farthest inside the pixel; none hides nothing.
fn limit_m(buffer: &GBuffer, view_from_world: &DMat3, (x, y): (usize, usize)) -> Option<f64> {
    let z = f64::from(buffer.depth_m[(x, y)]);
    let n = *view_from_world * buffer.normals.at(x, y).as_dvec3();
    let (scale, centre, perspective) = lens(&buffer.view);
    let across = (n.x / scale[0]).abs() / 2.0 + (n.y / scale[1]).abs() / 2.0;
    if z <= 0.0 {
        return None;
    }
    if n == DVec3::ZERO {
        return Some(z);
    }
    if !perspective {
        return (n.z != 0.0).then(|| z + across / n.z.abs());
    }
    let ray = DVec3::new((x as f64 - centre[0]) / scale[0], (y as f64 - centre[1]) / scale[1], 1.0);
    let along = n.dot(ray).abs();
    (along > across).then(|| z * along / (along - across))
}

impl<'a> TransferOracle<'a> {
    pub fn new(
        params: &'a TransferParams,
        main: &'a GBuffer,
        sides: &'a [GBuffer],
    ) -> Fallible<Self> {
        let bias_m = f64::from(params.bias_m);
        let views = std::iter::once(main).chain(sides).map(|b| Seen::new(b, bias_m)).collect();
        Ok(Self { params, set: DirectionSet::new(params).map_err(say)?, main, views })
    }

    /// Of the surface at a pixel; zero where there is none.
    pub fn at(&self, x: usize, y: usize) -> Exact {
        let (bands, bias_m) = (self.params.bands, f64::from(self.params.bias_m));
        let mut out = Exact { coefficients: vec![0.0; coefficients(bands)], hidden: false };
        let depth_m = f64::from(self.main.depth_m[(x, y)]);
        if depth_m <= 0.0 {
            return out;
        }
        let n = self.main.normals.at(x, y).as_dvec3();
        let (scale, centre, _) = lens(&self.main.view);
        let ray =
            DVec3::new((x as f64 - centre[0]) / scale[0], (y as f64 - centre[1]) / scale[1], 1.0);
        let seen = affine(&self.main.view.world_from_view).transform_point3(ray * depth_m);
        let point = seen + bias_m * n;

        let mut harmonics = [0.0; MAX_COEFFICIENTS];
        basis_f64(n, bands, &mut harmonics);
        for l in 0..bands {
            for i in l * l..(l + 1) * (l + 1) {
                out.coefficients[i] = CLAMPED_COSINE[l] / PI * harmonics[i];
            }
        }
        let directions = self.set.directions.iter().map(|w| w.as_dvec3());
        let sum: f64 = directions.clone().map(|w| n.dot(w).max(0.0)).sum();
        let chi = f64::from(self.set.chi);
        for (j, w) in directions.enumerate().filter(|(_, w)| n.dot(*w) > 0.0) {
            let samples =
                (0..self.params.samples).map(|s| f64::from(self.set.distance_m(j, s, x, y)));
            let cosines = samples.flat_map(|r| {
                self.views.iter().filter_map(move |view| view.cosine(point, n, w, r, bias_m))
            });
            let Some(best) = cosines.reduce(f64::max) else { continue };
            // 1 - K
            let hidden = ((best - (1.0 - chi)) / chi).clamp(0.0, 1.0);
            out.hidden |= hidden > 0.0;
            basis_f64(w, bands, &mut harmonics);
            let share = hidden * n.dot(w) / sum;
            out.coefficients.iter_mut().zip(harmonics).for_each(|(c, y)| *c -= share * y);
        }
        out
    }
}
