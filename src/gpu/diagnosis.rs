//! Which adapters there are, what they can do, and which of them would be taken.

use super::{AdapterChoice, AdapterSummary, Adapters, Gpu, GpuError};
use wgpu::{Features, Limits};

/// Optional features that the backend has a use for.
const WELCOME: [(&str, Features); 3] = [
    ("timestamps", Features::TIMESTAMP_QUERY),
    ("subgroups", Features::SUBGROUP),
    ("16-bit floats", Features::SHADER_F16),
];

/// An adapter, looked at closely.
#[derive(Clone, Debug)]
pub struct AdapterReport {
    pub summary: AdapterSummary,
    /// WebGPU's limits that it falls short of: limit, its own, needed.
    pub short_of: Vec<(String, u64, u64)>,
    /// Whether a device could be opened.
    pub opens: Result<(), GpuError>,
}

impl AdapterReport {
    /// Names of the optional features that are there, and of those that are not.
    pub fn features(&self) -> (Vec<&'static str>, Vec<&'static str>) {
        let names = |there: bool| {
            let some = WELCOME.iter().filter(|(_, f)| self.summary.features.contains(*f) == there);
            some.map(|(name, _)| *name).collect()
        };
        (names(true), names(false))
    }

    /// Limits that decide what fits: name and value.
    pub fn limits(&self) -> [(&'static str, u64); 5] {
        let l = &self.summary.limits;
        [
            ("storage buffers a shader", l.max_storage_buffers_per_shader_stage.into()),
            ("bytes a binding", l.max_storage_buffer_binding_size),
            ("bytes a buffer", l.max_buffer_size),
            ("bytes a workgroup", l.max_compute_workgroup_storage_size.into()),
            ("invocations a workgroup", l.max_compute_invocations_per_workgroup.into()),
        ]
    }

    fn is_fit(&self) -> bool {
        self.short_of.is_empty() && self.opens.is_ok()
    }
}

/// What would compute, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// The adapter's name; `None` for the CPU backend.
    pub adapter: Option<String>,
    pub because: String,
}

/// Looks at all adapters; a choice by name leaves the others out.
pub fn diagnose(choice: &AdapterChoice) -> Result<(Vec<AdapterReport>, Verdict), GpuError> {
    let adapters = Adapters::find();
    let chosen = match choice {
        AdapterChoice::Best => None,
        AdapterChoice::Named(_) => Some(adapters.choose(choice)?.1.clone()),
    };
    let reports: Vec<_> = adapters
        .iter()
        .filter(|(_, summary)| chosen.as_ref().is_none_or(|c| c == *summary))
        .map(|(adapter, summary)| AdapterReport {
            summary: summary.clone(),
            short_of: short_of(&summary.limits),
            opens: Gpu::open_adapter(adapter, summary).map(|_| ()),
        })
        .collect();
    let verdict = judge(&reports, chosen.is_some());
    Ok((reports, verdict))
}

/// A software device is taken only where it was asked for by name: it is right, but the CPU backend is
/// many times faster on the same processor.
fn judge(reports: &[AdapterReport], asked_for: bool) -> Verdict {
    let cpu = |because: &str| Verdict { adapter: None, because: because.to_owned() };
    if reports.is_empty() {
        return cpu("no adapter was found");
    }
    let Some(fit) = reports.iter().find(|r| r.is_fit()) else {
        return cpu("no adapter is fit");
    };
    let adapter = Some(fit.summary.name.clone());
    match (fit.summary.is_software(), asked_for) {
        (_, true) => Verdict { adapter, because: "it was asked for".into() },
        (false, _) => Verdict { adapter, because: "it is the best that was found".into() },
        (true, false) => {
            cpu("all adapters compute in software, and the CPU backend is faster than that")
        }
    }
}

fn short_of(limits: &Limits) -> Vec<(String, u64, u64)> {
    let mut short = Vec::new();
    Limits::default().check_limits_with_fail_fn(limits, false, |name, needed, has| {
        short.push((name.to_owned(), has, needed));
    });
    short
}

#[cfg(test)]
mod tests {
    use super::*;
    use wgpu::DeviceType;

    fn report(device_type: DeviceType, limits: Limits) -> AdapterReport {
        let summary = AdapterSummary {
            name: format!("{device_type:?}"),
            driver: "driver 1.0".into(),
            api: "vulkan".into(),
            device_type,
            features: Features::SUBGROUP,
            limits: limits.clone(),
        };
        AdapterReport { summary, short_of: short_of(&limits), opens: Ok(()) }
    }

    #[test]
    fn software_is_never_taken_unasked() {
        let cpu = report(DeviceType::Cpu, Limits::default());
        let gpu = report(DeviceType::IntegratedGpu, Limits::default());
        assert_eq!(judge(&[], false).adapter, None);
        assert_eq!(judge(std::slice::from_ref(&cpu), false).adapter, None);
        assert_eq!(judge(std::slice::from_ref(&cpu), true).adapter.as_deref(), Some("Cpu"));
        assert_eq!(judge(&[gpu, cpu], false).adapter.as_deref(), Some("IntegratedGpu"));
    }

    #[test]
    fn a_device_short_of_a_limit_is_not_fit() {
        let limits = Limits { max_storage_buffers_per_shader_stage: 4, ..Limits::default() };
        let weak = report(DeviceType::DiscreteGpu, limits);
        assert_eq!(weak.short_of, [("max_storage_buffers_per_shader_stage".to_owned(), 4, 8)]);
        assert_eq!(judge(std::slice::from_ref(&weak), false).adapter, None);
        let (there, missing) = weak.features();
        assert_eq!((there, missing), (vec!["subgroups"], vec!["timestamps", "16-bit floats"]));
    }
}
