//! Where a volume's voxels are in the world.

use super::block::SIDE;
use super::{FusionError, VolumeParams};
use glam::Vec3;
use std::ops::RangeInclusive;

/// Smaller, and voxels of 512 a side are no longer apart in f32 a few metres from the origin.
const SIDES_M: RangeInclusive<f32> = 1e-3..=100.0;

/// A world-aligned cube of voxels.
///
/// Voxel (i, j, k) has its centre at `lowest corner + (i + 1/2, j + 1/2, k + 1/2) * voxel`. World
/// coordinates are f32: keep the world's origin within some tens of metres of the cube.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    pub(crate) min_corner: Vec3,
    side_m: f32,
    pub(crate) voxel_m: f32,
    /// The truncation distance in use.
    pub(crate) truncation_m: f32,
    /// Blocks a side.
    pub(crate) grid: usize,
}

impl Lattice {
    /// A cube around `centre` (world, metres). `params.centre` is not read: it tells the caller where
    /// to place the cube.
    pub fn new(params: &VolumeParams, centre: Vec3) -> Result<Self, FusionError> {
        Ok(Self {
            truncation_m: check(params, centre)?,
            min_corner: centre - 0.5 * params.side_m,
            side_m: params.side_m,
            voxel_m: params.side_m / params.resolution as f32,
            grid: params.resolution / SIDE,
        })
    }

    /// Lowest and highest corner in world coordinates.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        (self.min_corner, self.min_corner + self.side_m)
    }

    /// Voxel coordinates of a world point: integers are voxel centres.
    pub(crate) fn voxel_from_world(&self, point: Vec3) -> Vec3 {
        (point - self.min_corner) / self.voxel_m - 0.5
    }

    pub(crate) fn world_from_voxel(&self, point: Vec3) -> Vec3 {
        (point + 0.5) * self.voxel_m + self.min_corner
    }

    pub(crate) fn blocks(&self) -> usize {
        self.grid * self.grid * self.grid
    }

    /// The truncation distance in voxels.
    pub(crate) fn truncation_voxels(&self) -> f32 {
        self.truncation_m / self.voxel_m
    }
}

/// All problems at once, else the truncation distance.
fn check(params: &VolumeParams, centre: Vec3) -> Result<f32, FusionError> {
    let mut problems = params.problems();
    if !centre.is_finite() {
        problems.push(format!("centre is {centre}, must be finite"));
    }
    if problems.is_empty() {
        Ok(params.truncation())
    } else {
        Err(FusionError::Params(problems.join("; ")))
    }
}

impl VolumeParams {
    /// The truncation distance in use, metres.
    fn truncation(&self) -> f32 {
        let voxel_m = self.side_m / self.resolution as f32;
        if self.truncation_m == 0.0 { (4.0 * voxel_m).max(0.02) } else { self.truncation_m }
    }

    /// Everything that is out of range, each beginning with the parameter's name.
    pub(crate) fn problems(&self) -> Vec<String> {
        let Self { side_m, resolution, max_weight, free_weight, .. } = *self;
        let mut problems = Vec::new();
        if !SIDES_M.contains(&side_m) {
            let (least, most) = (SIDES_M.start(), SIDES_M.end());
            problems.push(format!("side_m is {side_m}, must be above 0, from {least} to {most}"));
        }
        if !(8..=512).contains(&resolution) || !resolution.is_multiple_of(8) {
            problems
                .push(format!("resolution is {resolution}, must be a multiple of 8 from 8 to 512"));
        }
        if !(1..=1024).contains(&max_weight) {
            problems.push(format!("max_weight is {max_weight}, must be from 1 to 1024"));
        }
        if free_weight == 0 {
            problems.push("free_weight is 0, must be at least 1".into());
        }
        // Nearer than a diagonal, a surface between voxels may have no voxel of either sign beside it.
        let least = 3f32.sqrt() * side_m / resolution as f32;
        let truncation = self.truncation();
        if problems.is_empty() && !(least..=side_m.max(0.02)).contains(&truncation) {
            problems.push(format!(
                "truncation_m is {truncation}, must be 0 or from {least} (a voxel's diagonal) to side_m {side_m}"
            ));
        }
        problems
    }
}
