//! Which devices there are, and which of them is taken.

use super::GpuError;
use wgpu::{Backends, DeviceType, Features, InstanceFlags, Limits};

/// Which adapter is wanted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AdapterChoice {
    /// The most capable one, a software rasteriser only where there is nothing else.
    #[default]
    Best,
    /// The first whose name or driver contains this, in any case.
    Named(String),
}

/// What there is to say about an adapter.
#[derive(Clone, Debug, PartialEq)]
pub struct AdapterSummary {
    pub name: String,
    /// Driver and its version.
    pub driver: String,
    /// "vulkan", "metal", "dx12".
    pub api: String,
    pub device_type: DeviceType,
    pub features: Features,
    pub limits: Limits,
}

impl AdapterSummary {
    fn of(adapter: &wgpu::Adapter) -> Self {
        let info = adapter.get_info();
        Self {
            name: info.name,
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            api: info.backend.to_string(),
            device_type: info.device_type,
            features: adapter.features(),
            limits: adapter.limits(),
        }
    }

    /// Whether a CPU does the work: right, but slower than the CPU backend.
    pub fn is_software(&self) -> bool {
        self.device_type == DeviceType::Cpu
    }

    /// The higher the better; real hardware before software.
    fn rank(&self) -> u32 {
        match self.device_type {
            DeviceType::DiscreteGpu => 4,
            DeviceType::IntegratedGpu => 3,
            DeviceType::VirtualGpu => 2,
            DeviceType::Other => 1,
            DeviceType::Cpu => 0,
        }
    }

    fn is_called(&self, part: &str) -> bool {
        let part = part.to_lowercase();
        self.name.to_lowercase().contains(&part) || self.driver.to_lowercase().contains(&part)
    }
}

impl std::fmt::Display for AdapterSummary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({}, {}", self.name, self.api, self.driver)?;
        f.write_str(if self.is_software() { ", software)" } else { ")" })
    }
}

/// All adapters of this machine, the best first.
pub struct Adapters {
    found: Vec<(wgpu::Adapter, AdapterSummary)>,
}

impl Adapters {
    /// Asks Vulkan, Metal and D3D12, as far as this platform has them; `WGPU_BACKEND` may narrow that.
    /// Drivers' own messages and checks are for tests, and for `WGPU_DEBUG=1` and `WGPU_VALIDATION=1`: to
    /// them, a machine without a device is an error.
    pub fn find() -> Self {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
        descriptor.backends &= Backends::PRIMARY;
        if !cfg!(test) {
            descriptor.flags = InstanceFlags::VALIDATION_INDIRECT_CALL.with_env();
        }
        let backends = descriptor.backends;
        let instance = wgpu::Instance::new(descriptor);
        let adapters = pollster::block_on(instance.enumerate_adapters(backends));
        let mut found: Vec<_> = adapters
            .into_iter()
            .map(|a| (AdapterSummary::of(&a), a))
            .map(|(s, a)| (a, s))
            .collect();
        found.sort_by_key(|(_, summary)| std::cmp::Reverse(summary.rank()));
        Self { found }
    }

    pub fn iter(&self) -> impl Iterator<Item = (&wgpu::Adapter, &AdapterSummary)> {
        self.found.iter().map(|(adapter, summary)| (adapter, summary))
    }

    /// The adapter that the choice falls on.
    pub fn choose(
        &self,
        choice: &AdapterChoice,
    ) -> Result<(&wgpu::Adapter, &AdapterSummary), GpuError> {
        let chosen = match choice {
            AdapterChoice::Best => self.found.first().ok_or(GpuError::NoAdapter)?,
            AdapterChoice::Named(part) => {
                let named = self.found.iter().find(|(_, summary)| summary.is_called(part));
                named.ok_or_else(|| self.unknown(part))?
            }
        };
        Ok((&chosen.0, &chosen.1))
    }

    /// Those among which the choice is made, the best first.
    pub(super) fn wanted(
        &self,
        choice: &AdapterChoice,
    ) -> Result<Vec<(&wgpu::Adapter, &AdapterSummary)>, GpuError> {
        match choice {
            AdapterChoice::Best => Ok(self.iter().collect()),
            AdapterChoice::Named(_) => Ok(vec![self.choose(choice)?]),
        }
    }

    fn unknown(&self, asked: &str) -> GpuError {
        if self.found.is_empty() {
            return GpuError::NoAdapter;
        }
        let known = self.iter().map(|(_, s)| s.name.clone()).collect::<Vec<_>>().join(", ");
        GpuError::UnknownAdapter { asked: asked.to_owned(), known }
    }
}
