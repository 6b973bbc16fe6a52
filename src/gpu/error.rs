//! What can go wrong between Rust and a device.

/// An error of the GPU backend.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum GpuError {
    #[error(
        "no Vulkan, Metal or D3D12 adapter was found; on Debian, mesa-vulkan-drivers brings a software one"
    )]
    NoAdapter,
    #[error("no adapter's name or driver contains '{asked}'; there are: {known}")]
    UnknownAdapter { asked: String, known: String },
    #[error("{adapter} falls short of WebGPU's limits: {problem}")]
    Device { adapter: String, problem: String },
    #[error("the device was lost: {reason}")]
    Lost { reason: String },
    /// `what` names what was asked for, its size and what there is.
    #[error("out of GPU memory: {what}")]
    OutOfMemory { what: String },
    #[error("the device refused a command: {0}")]
    Refused(String),
    #[error("shader {shader}: {problem}")]
    Shader { shader: String, problem: String },
    #[error("shader {shader}, binding {binding}: {problem}")]
    Binding { shader: String, binding: usize, problem: String },
}

impl GpuError {
    /// Whether the device is gone for good, with everything on it.
    pub fn is_lost(&self) -> bool {
        matches!(self, Self::Lost { .. })
    }

    /// Whether the device is too small for what was asked of it.
    pub fn is_out_of_memory(&self) -> bool {
        matches!(self, Self::OutOfMemory { .. })
    }
}
