//! The GPU, through wgpu: adapters, one device, shaders, buffers, passes. What is computed stands in
//! [`stages`], as twins of the CPU's stages.
//!
//! ```text
//! Adapters::find -> Gpu::open -> Commands -> Pass (bindings in the shader's order) -> submit
//! ```
//!
//! A device is asked for WebGPU's default limits and for no feature that must be there, so that whatever
//! runs anywhere runs on a phone. A shader is one `main` in one file of `shaders/`, or a `vertex_main` with its
//! `fragment_main`; its bindings,
//! workgroup size and parameter structs are read from the shader itself and compared with what Rust
//! binds, at every pass.

mod adapter;
mod buffer;
mod commands;
mod device;
pub mod diagnosis;
mod drawing;
mod error;
mod memory;
pub mod parity;
mod pipeline;
mod profile;
mod read_back;
pub mod roofline;
mod shader;
#[cfg(test)]
mod shader_tests;
mod stage_timer;
pub mod stages;
#[cfg(test)]
mod test_log;
mod traffic;
mod uniform;
mod view;

pub use adapter::{AdapterChoice, AdapterSummary, Adapters};
pub use buffer::{GpuBuffer, GpuImage};
pub use commands::{Commands, Pass};
pub use device::Gpu;
pub use drawing::{Draw, SampleTargets, Window};
pub use error::GpuError;
pub use profile::{Measure, PassRecord};
pub use read_back::ReadBack;
pub use shader::{Constant, Shader, library};
pub use stage_timer::StageTimer;
pub use traffic::Traffic;
pub(crate) use uniform::uniform;
pub use uniform::{Field, Uniform};
pub use view::{GpuGBuffer, ViewUniform};
