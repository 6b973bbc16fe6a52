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
    /// Whether a device could be opened; `None` where that was not tried.
    pub opens: Option<Result<(), GpuError>>,
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

    /// With its device, where it is fit to compute.
    fn open(adapter: &wgpu::Adapter, summary: &AdapterSummary) -> (Self, Option<Gpu>) {
        let opened = Gpu::open_adapter(adapter, summary);
        let (gpu, opens) = match opened {
            Ok(gpu) => (Some(gpu), Ok(())),
            Err(error) => (None, Err(error)),
        };
        let report = Self { opens: Some(opens), ..Self::unopened(summary) };
        let gpu = gpu.filter(|_| report.is_fit());
        (report, gpu)
    }

    fn unopened(summary: &AdapterSummary) -> Self {
        let short_of = short_of(&summary.limits);
        Self { summary: summary.clone(), short_of, opens: None }
    }

    fn is_fit(&self) -> bool {
        self.short_of.is_empty() && matches!(self.opens, Some(Ok(())))
    }

    /// What is wrong with a device that was tried.
    fn obstacle(&self) -> Option<String> {
        match (self.short_of.first(), &self.opens) {
            (_, Some(Err(error))) => Some(error.to_string()),
            (Some((limit, has, needed)), Some(Ok(()))) => {
                let name = &self.summary.name;
                Some(format!("{name} falls short of WebGPU's {limit}: {has} of {needed}"))
            }
            _ => None,
        }
    }
}

/// What would compute, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// The adapter's name; `None` for the CPU backend.
    pub adapter: Option<String>,
    pub because: String,
}

/// What computes.
pub enum Taken {
    Gpu(Box<Gpu>),
    Cpu { because: String },
}

/// Opens all adapters and judges them; a choice by name leaves the others out.
pub fn diagnose(choice: &AdapterChoice) -> Result<(Vec<AdapterReport>, Verdict), GpuError> {
    let adapters = Adapters::find();
    let wanted = adapters.wanted(choice)?;
    let reports: Vec<_> = wanted.into_iter().map(|(a, s)| AdapterReport::open(a, s).0).collect();
    let verdict = judge(&reports, *choice != AdapterChoice::Best);
    Ok((reports, verdict))
}

/// What [`diagnose`] would take, ready to compute. Opens no adapter that cannot be taken, and none after it.
pub fn take(choice: &AdapterChoice) -> Result<Taken, GpuError> {
    let adapters = Adapters::find();
    let asked_for = *choice != AdapterChoice::Best;
    let mut reports = Vec::new();
    for (adapter, summary) in adapters.wanted(choice)? {
        if !may_be_taken(summary, asked_for) {
            reports.push(AdapterReport::unopened(summary));
            continue;
        }
        let (report, gpu) = AdapterReport::open(adapter, summary);
        if let Some(gpu) = gpu {
            return Ok(Taken::Gpu(gpu.into()));
        }
        reports.push(report);
    }
    Ok(Taken::Cpu { because: judge(&reports, asked_for).because })
}

/// A software device only where it was asked for by name: it is right, but the CPU backend is many times
/// faster on the same processor.
fn may_be_taken(summary: &AdapterSummary, asked_for: bool) -> bool {
    asked_for || !summary.is_software()
}

fn judge(reports: &[AdapterReport], asked_for: bool) -> Verdict {
    let candidates = || reports.iter().filter(|r| may_be_taken(&r.summary, asked_for));
    if let Some(fit) = candidates().find(|r| r.is_fit()) {
        let reason = if asked_for { "it was asked for" } else { "it is the best that was found" };
        return Verdict { adapter: Some(fit.summary.name.clone()), because: reason.into() };
    }
    let because = if let Some(obstacle) = candidates().find_map(AdapterReport::obstacle) {
        format!("no adapter is fit: {obstacle}")
    } else if reports.is_empty() {
        "no adapter was found".to_owned()
    } else {
        "all adapters compute in software, and the CPU backend is faster than that".to_owned()
    };
    Verdict { adapter: None, because }
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
        AdapterReport { opens: Some(Ok(())), ..AdapterReport::unopened(&summary) }
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

    /// A run takes what the diagnosis says, and opens no software device for that unasked.
    #[test]
    fn a_run_takes_what_the_diagnosis_names() {
        let Some(gpu) = crate::gpu::stages::test_support::gpu() else { return };
        let named = AdapterChoice::Named(gpu.summary().name.clone());
        for choice in [AdapterChoice::Best, named] {
            let (_, verdict) = diagnose(&choice).expect("there is an adapter");
            match take(&choice).expect("there is an adapter") {
                Taken::Gpu(gpu) => assert_eq!(Some(&gpu.summary().name), verdict.adapter.as_ref()),
                Taken::Cpu { because } => {
                    assert_eq!((because, None), (verdict.because, verdict.adapter))
                }
            }
        }
    }

    #[test]
    fn a_device_short_of_a_limit_is_not_fit() {
        let limits = Limits { max_storage_buffers_per_shader_stage: 4, ..Limits::default() };
        let weak = report(DeviceType::DiscreteGpu, limits);
        assert_eq!(weak.short_of, [("max_storage_buffers_per_shader_stage".to_owned(), 4, 8)]);
        let verdict = judge(std::slice::from_ref(&weak), false);
        assert_eq!(verdict.adapter, None);
        assert!(verdict.because.contains("max_storage_buffers_per_shader_stage: 4 of 8"));
        let (there, missing) = weak.features();
        assert_eq!((there, missing), (vec!["subgroups"], vec!["timestamps", "16-bit floats"]));
    }
}
