//! What can go wrong between Rust and a device.

/// An error of the GPU backend.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum GpuError {
    #[error(
        "no Vulkan, Metal or D3D12 adapter was found; on Debian, mesa-vulkan-drivers brings a software one"
    )]
    NoAdapter,
    #[error("no adapter's name contains '{asked}'; there are: {known}")]
    UnknownAdapter { asked: String, known: String },
    #[error("{adapter} falls short of WebGPU's limits: {problem}")]
    Device { adapter: String, problem: String },
    #[error("the device was lost: {reason}")]
    Lost { reason: String },
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
    /// Whether the device is gone for good: everything on it must be made anew, here or on the CPU.
    pub fn is_lost(&self) -> bool {
        matches!(self, Self::Lost { .. } | Self::OutOfMemory { .. })
    }
}
