//! The kernels with their constants, which are those of the CPU.

use crate::fusion::block::{ONE, SIDE, UNSEEN, VOXELS};
use crate::fusion::{allocate, crossings, empty_space, integrate, packet, raycast, tiles};
use crate::gpu::{Constant, Shader};

// what the shaders take for granted
const _: () = assert!(SIDE == 8 && VOXELS == 512 && crossings::FIRST_OCTANT >> 32 == 0);

fn number(shader: Shader, name: &'static str, value: f32) -> Shader {
    shader.with(name, Constant::F32(value))
}

/// How a voxel's word is read.
fn with_voxels(shader: Shader) -> Shader {
    shader.with_u32("ONE", ONE as usize).with_u32("BIAS", usize::from(UNSEEN.unsigned_abs()))
}

fn fuse(file: &'static str) -> Shader {
    number(Shader::new(file), "FUSE_NEAREST_M", integrate::NEAREST_M)
}

pub fn mark() -> Shader {
    number(Shader::new("fusion/mark"), "FAR_AWAY", allocate::FAR_AWAY)
}

pub fn allocate() -> Shader {
    fuse("fusion/allocate")
}

pub fn integrate() -> Shader {
    with_voxels(fuse("fusion/integrate"))
}

pub fn color() -> Shader {
    fuse("fusion/color").with_u32("COLOR_WEIGHT", integrate::COLOR_WEIGHT.into())
}

pub fn release() -> Shader {
    Shader::new("fusion/release").with_u32("FREE", allocate::FREE as usize)
}

pub fn crossings() -> Shader {
    Shader::new("fusion/crossings")
}

pub fn settle() -> Shader {
    Shader::new("fusion/settle")
}

pub fn tiles() -> Shader {
    let shader = Shader::new("fusion/tiles")
        .with_u32("TILE", tiles::TILE)
        .with_u32("FIRST_OCTANT", crossings::FIRST_OCTANT as usize);
    let constants = [
        ("TILE_NEAREST_M", tiles::NEAREST_M),
        ("OCTANT", tiles::OCTANT),
        ("MARGIN", tiles::MARGIN),
        ("MAX_STEP", packet::MAX_STEP),
    ];
    constants.into_iter().fold(shader, |shader, (name, value)| number(shader, name, value))
}

/// Distances to blocks with surface, axis by axis.
pub fn surveys() -> [Shader; 3] {
    let survey = |axis| Shader::new("fusion/survey").with_u32("AXIS", axis);
    [Shader::new("fusion/survey_x"), survey(1), survey(2)]
        .map(|shader| shader.with_u32("FARTHEST", empty_space::FARTHEST.into()))
}

/// How rays walk through the volume: the constants of `fusion/walk`.
pub fn with_walk(shader: Shader) -> Shader {
    let constants = [
        ("LEAST_COMPONENT", raycast::LEAST_COMPONENT),
        ("MIN_STEP", packet::MIN_STEP),
        ("STEP_SHARE", packet::STEP_SHARE),
        ("STEP_BEYOND", packet::STEP_BEYOND),
        ("MAX_STEP", packet::MAX_STEP),
        ("NUDGE", packet::NUDGE),
    ];
    let shader = with_voxels(shader).with_u32("FIRST_OCTANT", crossings::FIRST_OCTANT as usize);
    constants.into_iter().fold(shader, |shader, (name, value)| number(shader, name, value))
}

pub fn raycast() -> Shader {
    let shader = with_walk(Shader::new("fusion/raycast"))
        .with_u32("TILE", tiles::TILE)
        .with_u32("REFINEMENTS", packet::REFINEMENTS);
    let constants = [("CAST_NEAREST_M", raycast::NEAREST_M), ("CLOSE", packet::CLOSE)];
    constants.into_iter().fold(shader, |shader, (name, value)| number(shader, name, value))
}

#[cfg(test)]
pub fn shaders() -> Vec<Shader> {
    let volume = [mark(), allocate(), integrate(), color(), release(), crossings(), settle()];
    [&volume[..], &surveys(), &[tiles(), raycast()]].concat()
}
