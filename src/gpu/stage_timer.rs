//! Stage times on the device's own clock.

use super::{Commands, Gpu, GpuBuffer, GpuError, ReadBack};
use crate::timing::{Stage, StageTimes};
use std::time::Duration;
use wgpu::{BufferUsages, ComputePassTimestampWrites, RenderPassTimestampWrites};

/// Passes that are measured in one frame; those beyond are not.
const MOST_PASSES: usize = 256;

/// Timestamp queries at both ends of every pass of a frame, whose submissions may be many.
pub struct StageTimer {
    queries: wgpu::QuerySet,
    resolved: GpuBuffer<u64>,
    read_back: ReadBack<u64>,
    /// Of the frames that are not collected yet, the oldest first: the stage of each pass.
    under_way: std::collections::VecDeque<Vec<Stage>>,
}

impl StageTimer {
    /// `None` where the device has no timestamps.
    pub fn new(gpu: &Gpu) -> Result<Option<Self>, GpuError> {
        if !gpu.has_timestamps() {
            return Ok(None);
        }
        let queries = gpu.device().create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("pass times"),
            ty: wgpu::QueryType::Timestamp,
            count: 2 * MOST_PASSES as u32,
        });
        let more = BufferUsages::QUERY_RESOLVE;
        Ok(Some(Self {
            queries,
            resolved: GpuBuffer::with_usage(gpu, "pass times", 2 * MOST_PASSES, more)?,
            read_back: ReadBack::new(gpu, "pass times", 2 * MOST_PASSES)?,
            under_way: Default::default(),
        }))
    }

    /// What [`Commands`] needs to measure its passes.
    pub(super) fn marks(&self) -> PassMarks {
        PassMarks { queries: self.queries.clone(), passes: Vec::new(), paused: false }
    }

    /// Ends the measurement; called before the last commands are submitted.
    pub(super) fn finish(&mut self, marks: PassMarks, commands: &mut Commands<'_>) {
        let count = 2 * marks.passes.len();
        if count == 0 {
            return;
        }
        let resolved = self.resolved.raw();
        commands.encoder.resolve_query_set(&self.queries, 0..count as u32, resolved, 0);
        self.read_back.request(commands, &self.resolved, count);
        self.under_way.push_back(marks.passes);
    }

    /// Times of the oldest frame that was measured; waits for it. `None` where there is none.
    pub fn take(&mut self, gpu: &Gpu) -> Result<Option<StageTimes>, GpuError> {
        let Some(passes) = self.under_way.pop_front() else { return Ok(None) };
        let ticks = self.read_back.take(gpu)?.unwrap_or_default();
        let period_ns = f64::from(gpu.queue().get_timestamp_period());
        let mut times = StageTimes::default();
        for (stage, ends) in passes.iter().zip(ticks.chunks_exact(2)) {
            // clocks may be reset between two reads when a device changes its power state
            let nanoseconds = ends[1].saturating_sub(ends[0]) as f64 * period_ns;
            times.add(*stage, Duration::from_nanos(nanoseconds as u64));
        }
        Ok(Some(times))
    }
}

/// The passes of a frame that is being recorded.
pub(super) struct PassMarks {
    queries: wgpu::QuerySet,
    passes: Vec<Stage>,
    /// Passes that begin now are left out.
    pub paused: bool,
}

impl PassMarks {
    pub fn next(&mut self, stage: Stage) -> Option<ComputePassTimestampWrites<'_>> {
        let first = self.reserve(stage)?;
        Some(ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        })
    }

    pub fn next_drawing(&mut self, stage: Stage) -> Option<RenderPassTimestampWrites<'_>> {
        let first = self.reserve(stage)?;
        Some(RenderPassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        })
    }

    /// The first of a pass's two queries.
    fn reserve(&mut self, stage: Stage) -> Option<u32> {
        let first = 2 * self.passes.len() as u32;
        if self.paused || self.passes.len() == MOST_PASSES {
            return None;
        }
        self.passes.push(stage);
        Some(first)
    }
}
