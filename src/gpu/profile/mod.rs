//! What each pass takes, and what it does: for benchmarks, on devices opened with [`Gpu::open_for_profile`].
//!
//! While times are measured every pass is submitted alone. While work is counted every shader
//! is replaced by one that counts, see [`instrument`]: the results are the same, the times mean nothing.

mod instrument;
mod operations;
#[cfg(test)]
mod tests;

pub(super) use instrument::{Counted, instrument};

use super::roofline::Work;
use super::{Commands, Gpu, GpuBuffer, GpuError, ReadBack, Shader};
use crate::timing::Stage;
use instrument::{MOST_STRETCHES, SECTOR_BYTES, WORDS_OF_BITS};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use wgpu::BufferUsages;

/// What is measured of every pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measure {
    Time,
    Work,
}

/// One pass that ran.
#[derive(Clone, Debug)]
pub struct PassRecord {
    /// `None` for copies and clears between passes.
    pub shader: Option<Shader>,
    pub stage: Stage,
    /// As dispatched, 1 where the device decides; of drawing, pixels of the window.
    pub groups: [u32; 3],
    pub time: Option<Duration>,
    pub work: Option<Work>,
}

/// Storage buffers that a shader of WebGPU binds at most, and the one that counts.
pub(super) const STORAGE_BUFFERS: u32 = 9;

pub(super) struct Profile {
    measures: Mutex<Option<Measure>>,
    records: Mutex<Vec<PassRecord>>,
    counting: Mutex<Counting>,
    /// Bound by shaders that count.
    counts: GpuBuffer<u32>,
    clock: Option<DeviceClock>,
}

struct Counting {
    read_back: ReadBack<u32>,
}

/// Timestamps at both ends of one pass.
struct DeviceClock {
    queries: wgpu::QuerySet,
    resolved: GpuBuffer<u64>,
    read_back: Mutex<ReadBack<u64>>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Profile {
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let most = Counted { stretches: Vec::new(), buffers: STORAGE_BUFFERS as usize - 1 };
        // timestamps of software devices are not taken when compute passes run
        let has_clock = gpu.has_timestamps() && !gpu.summary().is_software();
        Ok(Self {
            measures: Mutex::new(None),
            records: Mutex::default(),
            counting: Mutex::new(Counting {
                read_back: ReadBack::new(gpu, "counts", most.words())?,
            }),
            counts: GpuBuffer::new(gpu, "counts", most.words())?,
            clock: has_clock.then(|| DeviceClock::new(gpu)).transpose()?,
        })
    }

    pub fn measures(&self) -> Option<Measure> {
        *locked(&self.measures)
    }

    pub fn counts(&self) -> &GpuBuffer<u32> {
        &self.counts
    }

    /// Of the pass that is measured, where the device tells the time.
    pub fn queries(&self) -> Option<&wgpu::QuerySet> {
        match self.measures() {
            Some(Measure::Time) => self.clock.as_ref().map(|clock| &clock.queries),
            _ => None,
        }
    }

    /// What was recorded before a pass runs first.
    pub fn before(&self, commands: &mut Commands<'_>) -> Result<(), GpuError> {
        let start = Instant::now();
        commands.flush_and_wait()?;
        if let Some(copies) = commands.copies.take() {
            let is_timed = self.measures() == Some(Measure::Time);
            self.add(PassRecord {
                shader: None,
                stage: commands.stage,
                groups: [1; 3],
                time: is_timed.then(|| start.elapsed()),
                work: (!is_timed).then_some(copies),
            });
        }
        if self.measures() == Some(Measure::Work) {
            commands.encoder.clear_buffer(self.counts.raw(), 0, None);
        }
        Ok(())
    }

    /// Runs the pass that has been recorded.
    pub fn after(
        &self,
        commands: &mut Commands<'_>,
        shader: &Shader,
        groups: [u32; 3],
        counted: Result<&Counted, Work>,
    ) -> Result<(), GpuError> {
        let (time, work) = match (self.measures(), counted) {
            (Some(Measure::Work), Ok(counted)) => (None, Some(self.count(commands, counted)?)),
            (Some(Measure::Work), Err(work)) => {
                commands.flush_and_wait()?;
                (None, Some(work))
            }
            _ => (Some(self.time(commands)?), None),
        };
        let (stage, shader) = (commands.stage, Some(shader.clone()));
        self.add(PassRecord { shader, stage, groups, time, work });
        Ok(())
    }

    fn add(&self, record: PassRecord) {
        locked(&self.records).push(record);
    }

    fn time(&self, commands: &mut Commands<'_>) -> Result<Duration, GpuError> {
        if let Some(clock) = &self.clock {
            return clock.time(commands);
        }
        let start = Instant::now();
        commands.flush_and_wait()?;
        Ok(start.elapsed())
    }

    fn count(&self, commands: &mut Commands<'_>, counted: &Counted) -> Result<Work, GpuError> {
        let read_back = &mut locked(&self.counting).read_back;
        read_back.request(commands, &self.counts, counted.words());
        commands.copies = None;
        commands.flush_and_wait()?;
        let counts = read_back.take(commands.gpu())?.unwrap_or_default();
        Ok(work_of(&counts, counted))
    }
}

/// What the counting buffer says.
fn work_of(counts: &[u32], counted: &Counted) -> Work {
    let mut work =
        Work { invocations: u64::from(counts.first().copied().unwrap_or(0)), ..Work::default() };
    for (cost, &runs) in counted.stretches.iter().zip(counts) {
        let times = |n: u64| n * u64::from(runs);
        work.float_operations += times(cost.float_operations);
        work.other_operations += times(cost.other_operations);
        work.bytes_loaded += times(cost.loaded);
        work.bytes_stored += times(cost.stored);
        work.atomics += times(cost.atomics);
        // a texel of the only texture is a word, and read once
        work.bytes_read += times(4 * cost.texture_loads);
    }
    let bits = counts.get(MOST_STRETCHES..).unwrap_or(&[]);
    for (region, words) in bits.chunks(WORDS_OF_BITS).enumerate() {
        let sectors: u64 = words.iter().map(|word| u64::from(word.count_ones())).sum();
        let bytes = sectors * u64::from(SECTOR_BYTES);
        match region % 2 {
            0 => work.bytes_read += bytes,
            _ => work.bytes_written += bytes,
        }
    }
    work
}

impl DeviceClock {
    fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let queries = gpu.device().create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("time of a pass"),
            ty: wgpu::QueryType::Timestamp,
            count: 2,
        });
        Ok(Self {
            queries,
            resolved: GpuBuffer::with_usage(gpu, "time of a pass", 2, BufferUsages::QUERY_RESOLVE)?,
            read_back: Mutex::new(ReadBack::new(gpu, "time of a pass", 2)?),
        })
    }

    fn time(&self, commands: &mut Commands<'_>) -> Result<Duration, GpuError> {
        let (gpu, read_back) = (commands.gpu(), &mut locked(&self.read_back));
        commands.encoder.resolve_query_set(&self.queries, 0..2, self.resolved.raw(), 0);
        read_back.request(commands, &self.resolved, 2);
        commands.copies = None;
        commands.flush_and_wait()?;
        let ticks = read_back.take(gpu)?.unwrap_or_default();
        let ticks =
            ticks.last().zip(ticks.first()).map_or(0, |(end, start)| end.saturating_sub(*start));
        let nanoseconds = ticks as f64 * f64::from(gpu.queue().get_timestamp_period());
        Ok(Duration::from_nanos(nanoseconds as u64))
    }
}

impl Gpu {
    /// From here on every pass is measured, or none. A device that was not opened for it ignores this.
    pub fn measure_passes(&self, measure: Option<Measure>) {
        if let Some(profile) = self.profile.get() {
            *locked(&profile.measures) = measure;
        }
    }

    /// Passes that were measured since the last call.
    pub fn take_passes(&self) -> Vec<PassRecord> {
        self.profile.get().map_or_else(Vec::new, |p| std::mem::take(&mut *locked(&p.records)))
    }

    /// Whether times of passes are the device's own.
    pub fn tells_pass_times(&self) -> bool {
        self.profile.get().is_some_and(|p| p.clock.is_some())
    }

    /// Where passes are measured now.
    pub(super) fn profiling(&self) -> Option<&Profile> {
        self.profile.get().filter(|p| p.measures().is_some())
    }

    pub(super) fn counts_work(&self) -> bool {
        self.profile.get().is_some_and(|p| p.measures() == Some(Measure::Work))
    }
}
