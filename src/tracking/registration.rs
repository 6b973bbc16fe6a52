//! Coarse-to-fine alignment of a frame with a picture of the model.

use super::TrackingParams;
use super::normal_equations::{Gates, ModelView, Reduction, Sums};
use super::pyramid::Pyramid;
use super::solve::{Solution, solve};
use crate::geometry::GBuffer;
use crate::math::{Pose, Projection};

/// What an alignment found. Numbers belong to the pose that is given.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit {
    pub world_from_camera: Pose,
    /// Partners over pixels that project onto the model.
    pub inlier_share: f32,
    /// Pixels that project onto the model over pixels with depth.
    pub overlap: f32,
    pub rms_m: f32,
    pub condition: f64,
    pub rank: usize,
}

impl Fit {
    fn new(world_from_camera: Pose, sums: &Sums, solution: &Solution) -> Self {
        let share = |part: f64, whole: f64| (part / whole.max(1.0)) as f32;
        Self {
            world_from_camera,
            inlier_share: share(sums.partners(), sums.seen()),
            overlap: share(sums.seen(), sums.valid()),
            rms_m: sums.rms_m() as f32,
            condition: solution.condition,
            rank: solution.rank,
        }
    }
}

/// How hard to try.
#[derive(Clone, Copy, Debug)]
pub(super) struct Effort {
    /// Multiplies the number of iterations of each level.
    pub iterations: usize,
    /// Multiplies the distance gate.
    pub reach: f32,
}

impl Effort {
    pub const NORMAL: Self = Self { iterations: 1, reach: 1.0 };
    pub const WIDE: Self = Self { iterations: 3, reach: 3.0 };
}

/// Aligns the frame in `pyramid` with `model`, starting from `guess` (`world_from_camera`).
/// `None` where the model is not a perspective picture, or one of the two has no pixels.
pub(super) fn align(
    pyramid: &Pyramid,
    model: &GBuffer,
    guess: &Pose,
    params: &TrackingParams,
    effort: Effort,
    reduction: &mut Reduction,
) -> Option<Fit> {
    let Projection::Perspective(camera) = model.view.projection else { return None };
    if camera.size().pixels() == 0 {
        return None;
    }
    let finest = pyramid.levels.first()?;
    let model_view = ModelView::new(model, camera);
    let gates = Gates::new(params, effort.reach);
    let world_from_model = model.view.world_from_view;
    let mut model_from_camera = world_from_model.inverse() * guess;
    let mut measured = None;
    for (number, level) in pyramid.levels.iter().enumerate().rev() {
        let steps = params.iterations.get(number).map_or(0, |n| n * effort.iterations);
        for _ in 0..steps {
            let sums = reduction.accumulate(level, &model_view, &model_from_camera, &gates);
            let solution =
                solve(&sums.a(), &sums.b(), sums.mean_depth_m(), params.min_eigenvalue_ratio);
            model_from_camera = solution.step.exp() * model_from_camera;
            model_from_camera.rotation.renormalize();
            let small = solution.step.rotation.norm().max(solution.step.translation.norm())
                < params.convergence;
            if small {
                measured = (number == 0).then_some((sums, solution));
                break;
            }
        }
    }
    // The last sums belong to this pose up to `convergence`, unless the iterations ran out.
    let (sums, solution) = measured.unwrap_or_else(|| {
        let sums = reduction.accumulate(finest, &model_view, &model_from_camera, &gates);
        let ratio = params.min_eigenvalue_ratio;
        (sums, solve(&sums.a(), &sums.b(), sums.mean_depth_m(), ratio))
    });
    Some(Fit::new(world_from_model * model_from_camera, &sums, &solution))
}
