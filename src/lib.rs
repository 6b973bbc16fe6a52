//! kinlight lights virtual objects with the light of the real room, from one RGB-D camera and no
//! light probe.
//!
//! ```text
//! capture -> Input -> Reconstruct -> Surface -> DynGeo -> RadTransfer -> LightEst -> Rendering
//! ```
//!
//! Conventions: camera axes x right, y down, z forward; depth is z in metres, missing = 0.0; poses
//! are `world_from_camera`; colour is linear light; spherical harmonics are real, orthonormal, without
//! Condon-Shortley sign, in world axes.

#![deny(unsafe_code)] // modules that need it say why

// In the order of the data flow.
pub mod capture;

pub mod tracking;

pub mod fusion;

pub mod geometry;

pub mod transfer;

pub mod lighting;

pub mod scene;

pub mod compositing;

pub mod eval;

pub mod output;

pub mod pipeline;

pub mod replay;
pub mod stop;

#[cfg(feature = "gpu")]
pub mod parity;

pub mod synth;

pub mod study;

pub mod report;

pub mod budget;
pub mod calibrate;
pub mod config;
pub mod diagnosis;
mod files;
#[cfg(any(test, fuzzing))]
#[doc(hidden)]
pub mod fuzzing;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod image;
pub mod math;
pub mod mesh;
pub mod timing;

#[cfg(test)]
mod test_data;
