//! The volume itself: its place in the world, its storage, its revision.

use super::VolumeParams;
use super::allocate::BlockMarks;
use super::block::{BlockStore, SIDE};
use super::sample::Sampler;
use super::tiles::TileMap;
use crate::image::Size;
use glam::Vec3;
use std::sync::Mutex;

#[derive(Debug, thiserror::Error)]
pub enum FusionError {
    #[error("volume: {0}")]
    Params(String),
    #[error("frame {frame}: depth is {depth}, its view is {view}")]
    Size { frame: usize, depth: Size, view: Size },
    #[error("frame {frame}: the pose holds values that are not finite")]
    Pose { frame: usize },
}

/// Truncated signed distances in a world-aligned cube.
///
/// Voxel (i, j, k) has its centre at `lowest corner + (i + 1/2, j + 1/2, k + 1/2) * voxel`. World
/// coordinates are f32: keep the world's origin within some tens of metres of the cube.
#[derive(Debug)]
pub struct TsdfVolume {
    pub(super) params: VolumeParams,
    pub(super) min_corner: Vec3,
    pub(super) voxel_m: f32,
    pub(super) truncation_m: f32,
    pub(super) store: BlockStore,
    pub(super) marks: BlockMarks,
    pub(super) tiles: Mutex<TileMap>,
    pub(super) revision: u64,
}

impl TsdfVolume {
    /// An empty volume around `centre` (world, metres). `params.centre` is not read: it tells the
    /// caller where to place the cube.
    pub fn new(params: &VolumeParams, centre: Vec3) -> Result<Self, FusionError> {
        let truncation_m = check(params, centre)?;
        let grid = params.resolution / SIDE;
        Ok(Self {
            params: params.clone(),
            min_corner: centre - 0.5 * params.side_m,
            voxel_m: params.side_m / params.resolution as f32,
            truncation_m,
            store: BlockStore::new(grid, params.color),
            marks: BlockMarks::new(grid * grid * grid),
            tiles: Mutex::default(),
            revision: 0,
        })
    }

    /// Forgets everything seen; keeps memory.
    pub fn reset(&mut self) {
        self.store.clear();
        self.revision += 1;
    }

    /// Changes whenever the contents may have changed.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    pub fn is_empty(&self) -> bool {
        self.store.live_blocks() == 0
    }

    /// Lowest and highest corner in world coordinates.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        (self.min_corner, self.min_corner + self.params.side_m)
    }

    pub fn voxel_m(&self) -> f32 {
        self.voxel_m
    }

    /// The truncation distance in use.
    pub fn truncation_m(&self) -> f32 {
        self.truncation_m
    }

    pub fn params(&self) -> &VolumeParams {
        &self.params
    }

    /// Blocks of 8x8x8 voxels that have storage.
    pub fn allocated_blocks(&self) -> usize {
        self.store.live_blocks()
    }

    pub fn memory_bytes(&self) -> usize {
        self.store.memory_bytes() + self.marks.memory_bytes()
    }

    pub(super) fn sampler(&self) -> Sampler<'_> {
        Sampler::new(&self.store)
    }

    /// Voxel coordinates of a world point: integers are voxel centres.
    pub(super) fn voxel_from_world(&self, point: Vec3) -> Vec3 {
        (point - self.min_corner) / self.voxel_m - 0.5
    }

    pub(super) fn world_from_voxel(&self, point: Vec3) -> Vec3 {
        (point + 0.5) * self.voxel_m + self.min_corner
    }
}

/// All problems at once, else the truncation distance.
fn check(params: &VolumeParams, centre: Vec3) -> Result<f32, FusionError> {
    let VolumeParams { side_m, resolution, truncation_m, max_weight, free_weight, .. } = *params;
    let mut problems = Vec::new();
    if !(side_m.is_finite() && side_m > 0.0) {
        problems.push(format!("side_m is {side_m}, must be above 0"));
    }
    if !(8..=512).contains(&resolution) || !resolution.is_multiple_of(8) {
        problems.push(format!("resolution is {resolution}, must be a multiple of 8 from 8 to 512"));
    }
    if !(1..=1024).contains(&max_weight) {
        problems.push(format!("max_weight is {max_weight}, must be from 1 to 1024"));
    }
    if free_weight == 0 {
        problems.push("free_weight is 0, must be at least 1".into());
    }
    if !centre.is_finite() {
        problems.push(format!("centre is {centre}, must be finite"));
    }
    let voxel_m = side_m / resolution as f32;
    let truncation = if truncation_m == 0.0 { (4.0 * voxel_m).max(0.02) } else { truncation_m };
    // Nearer than a diagonal, a surface between voxels may have no voxel of either sign beside it.
    let least = 3f32.sqrt() * voxel_m;
    if problems.is_empty() && !(least..=side_m.max(0.02)).contains(&truncation) {
        problems.push(format!(
            "truncation_m is {truncation}, must be from {least} (a voxel's diagonal) to side_m {side_m}"
        ));
    }
    if problems.is_empty() { Ok(truncation) } else { Err(FusionError::Params(problems.join("; "))) }
}
