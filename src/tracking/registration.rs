//! Coarse-to-fine alignment of a frame with a picture of the model.

use super::TrackingParams;
use super::normal_equations::{Gates, Sums};
use super::picture_pair::PicturePair;
use super::solve::{Solution, solve};
use crate::math::{Pose, Projection, View};

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

/// Aligns the frame that was prepared with the map's picture, starting from `guess` (`world_from_camera`).
/// `None` where there is no perspective picture of the map, or one of the two has no pixels.
pub(super) fn align<P: PicturePair>(
    pictures: &mut P,
    guess: &Pose,
    params: &TrackingParams,
    effort: Effort,
) -> Result<Option<Fit>, P::Error> {
    let Some(View { projection: Projection::Perspective(camera), world_from_view }) =
        pictures.model_view()
    else {
        return Ok(None);
    };
    let levels = pictures.levels();
    if camera.size().pixels() == 0 || levels == 0 {
        return Ok(None);
    }
    let ratio = params.min_eigenvalue_ratio;
    let gates = Gates::new(params, effort.reach);
    let mut model_from_camera = world_from_view.inverse() * guess;
    let mut evaluate = |level: usize, model_from_camera: &Pose| {
        let sums = pictures.sums(level, camera, model_from_camera, &gates)?;
        Ok((sums, solve(&sums.a(), &sums.b(), sums.mean_depth_m(), ratio)))
    };
    let mut measured = None;
    for level in (0..levels).rev() {
        let steps = params.iterations.get(level).map_or(0, |n| n * effort.iterations);
        for _ in 0..steps {
            let (sums, solution) = evaluate(level, &model_from_camera)?;
            model_from_camera = solution.step.exp() * model_from_camera;
            model_from_camera.rotation.renormalize();
            let small = solution.step.rotation.norm().max(solution.step.translation.norm())
                < params.convergence;
            if small {
                measured = (level == 0).then_some((sums, solution));
                break;
            }
        }
    }
    // The last sums belong to this pose up to `convergence`, unless the iterations ran out.
    let (sums, solution) = match measured {
        Some(measured) => measured,
        None => evaluate(0, &model_from_camera)?,
    };
    Ok(Some(Fit::new(world_from_view * model_from_camera, &sums, &solution)))
}
