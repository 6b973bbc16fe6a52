//! Made sequences: a small deterministic path tracer that writes RGB-D recordings whose depth,
//! poses and light are known exactly.
//!
//! ```text
//! scenes -> Scene -> World (one moment) -> tracer -> colour, exact depth -> kinect -> TumWriter
//! ```
//!
//! Files depend on the options alone: every sample is seeded by seed, frame, pixel and index, so
//! the number of threads does not matter. The system's mathematical library has a small part in
//! them (sRGB encoding, sensor noise), so two systems may differ by a step in a few pixels.

pub mod ball;
mod develop;
mod generate;
pub mod glb;
pub mod kinect;
pub mod light;
pub mod material;
pub mod mesh;
mod options;
mod props;
pub mod sampler;
pub mod scene;
pub mod scenes;
pub mod shape;
mod still_life;
pub mod tracer;
mod true_world;
pub mod truth;
pub mod virtual_object;

#[cfg(test)]
mod sequence_tests;
#[cfg(test)]
mod tests;

pub(crate) use develop::developed;
pub use generate::{OPTIONS_FILE, generate, generate_until};
#[cfg(any(test, fuzzing))]
pub(crate) use options::read_environment;
pub use options::{LightSwitch, SynthError, SynthOptions};
pub use scene::VirtualKind;
pub use scenes::STUDY;
pub use true_world::{TrueWorld, environment_picture, true_world, true_world_with_virtual};
