//! A recording that is written while its camera goes on.

use super::{EncodedFrame, FrameEncoder, FrameRef, TumWriter};
use crate::capture::{CaptureError, RawFrame};
use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Frames that may wait for their files: some 50 MB at 640x480.
const MOST_WAITING: usize = 24;

/// A frame that waits longer than this holds up all that come: a program that is killed loses no more.
const LONGEST_WAIT: Duration = Duration::from_millis(700);

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct RecorderCounts {
    pub written: usize,
    /// Frames for which encoders or the disk had no time.
    pub dropped: usize,
}

/// Encodes frames on threads of its own and writes them in order.
///
/// ```text
/// offer -> jobs -> encoders (some) -> promises, in order -> writer (one)
/// ```
pub struct Recorder {
    jobs: Option<Sender<Job>>,
    promises: Option<Sender<Receiver<Encoded>>>,
    encoders: Vec<JoinHandle<()>>,
    writer: Option<JoinHandle<TumWriter>>,
    progress: Arc<Progress>,
    /// When each frame that is not yet written was taken.
    waiting: VecDeque<Instant>,
    taken: usize,
    dropped: usize,
}

type Encoded = Result<EncodedFrame, CaptureError>;

struct Job {
    frame: RawFrame,
    done: Sender<Encoded>,
}

#[derive(Default)]
struct Progress {
    state: Mutex<Written>,
    changed: Condvar,
}

#[derive(Default)]
struct Written {
    frames: usize,
    /// What ended the recording; taken out when it is told.
    error: Option<CaptureError>,
}

impl Recorder {
    /// With this many encoders (at least one).
    pub fn new(writer: TumWriter, encoders: usize) -> Result<Self, CaptureError> {
        let (jobs, to_encode) = channel();
        let (promises, in_order) = channel();
        let to_encode = Arc::new(Mutex::new(to_encode));
        let progress = Arc::new(Progress::default());
        let encoders = (0..encoders.max(1)).map(|_| {
            let (encoder, jobs) = (writer.encoder(), to_encode.clone());
            start("encoder", move || encode_all(&encoder, &jobs))
        });
        let encoders = encoders.collect::<Result<_, _>>()?;
        let written = progress.clone();
        let writer = start("recorder", move || write_all(writer, &in_order, &written))?;
        Ok(Self {
            jobs: Some(jobs),
            promises: Some(promises),
            encoders,
            writer: Some(writer),
            progress,
            waiting: VecDeque::new(),
            taken: 0,
            dropped: 0,
        })
    }

    /// Takes a frame, or drops it where those before it take too long; does not wait.
    ///
    /// # Errors
    /// What ended the recording, once; what was written until then stays.
    pub fn offer(&mut self, frame: RawFrame) -> Result<(), CaptureError> {
        self.look()?;
        let late = self.waiting.front().is_some_and(|taken| taken.elapsed() > LONGEST_WAIT);
        if late || self.waiting.len() >= MOST_WAITING {
            self.dropped += 1;
            return Ok(());
        }
        self.take(frame);
        Ok(())
    }

    /// Takes a frame as soon as there is room.
    ///
    /// # Errors
    /// As [`Self::offer`].
    pub fn push(&mut self, frame: RawFrame) -> Result<(), CaptureError> {
        self.look()?;
        while self.waiting.len() >= MOST_WAITING {
            let state = lock(&self.progress);
            // The writer tells of every frame; the limit is for one that is no more.
            let limit = Duration::from_millis(100);
            drop(self.progress.changed.wait_timeout(state, limit));
            self.look()?;
        }
        self.take(frame);
        Ok(())
    }

    pub fn counts(&self) -> RecorderCounts {
        RecorderCounts { written: lock(&self.progress).frames, dropped: self.dropped }
    }

    /// Waits until all frames are written.
    ///
    /// # Errors
    /// What ended the recording before that.
    pub fn finish(mut self) -> Result<(TumWriter, RecorderCounts), CaptureError> {
        let writer = self.join();
        self.look()?;
        let writer =
            writer.ok_or_else(|| CaptureError::Sequence("the recorder panicked".into()))?;
        Ok((writer, self.counts()))
    }

    fn take(&mut self, frame: RawFrame) {
        let (done, promise) = channel();
        // Where nobody receives any more, `look` says why.
        if let (Some(jobs), Some(promises)) = (&self.jobs, &self.promises) {
            let _ = jobs.send(Job { frame, done });
            let _ = promises.send(promise);
        }
        self.taken += 1;
        self.waiting.push_back(Instant::now());
    }

    /// Forgets what is written by now, and tells what went wrong.
    fn look(&mut self) -> Result<(), CaptureError> {
        let mut state = lock(&self.progress);
        if let Some(error) = state.error.take() {
            return Err(error);
        }
        if self.promises.is_some() && self.writer.as_ref().is_none_or(JoinHandle::is_finished) {
            return Err(CaptureError::Sequence("the recording has ended before".into()));
        }
        let left = self.taken - state.frames;
        self.waiting.drain(..self.waiting.len().saturating_sub(left));
        Ok(())
    }

    fn join(&mut self) -> Option<TumWriter> {
        self.jobs = None;
        self.promises = None;
        let writer = self.writer.take()?.join();
        self.encoders.drain(..).for_each(|encoder| drop(encoder.join()));
        writer.ok()
    }
}

/// What was taken is written.
impl Drop for Recorder {
    fn drop(&mut self) {
        self.join();
    }
}

fn start<T: Send + 'static>(
    name: &str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<JoinHandle<T>, CaptureError> {
    std::thread::Builder::new()
        .name(name.to_owned())
        .spawn(work)
        .map_err(|error| CaptureError::Sequence(format!("no {name} thread: {error}")))
}

fn lock(progress: &Progress) -> std::sync::MutexGuard<'_, Written> {
    progress.state.lock().unwrap_or_else(PoisonError::into_inner)
}

fn encode_all(encoder: &FrameEncoder, jobs: &Mutex<Receiver<Job>>) {
    loop {
        let job = jobs.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok(Job { frame, done }) = job else { return };
        let encoded = encoder.encode(&FrameRef {
            timestamp_s: frame.timestamp_s,
            color: &frame.color,
            depth_m: &frame.depth_m,
            second_depth_m: None,
            world_from_camera: frame.world_from_camera.as_ref(),
        });
        let _ = done.send(encoded); // the writer may have ended
    }
}

/// Until there are no more frames or one cannot be written.
fn write_all(
    mut writer: TumWriter,
    in_order: &Receiver<Receiver<Encoded>>,
    progress: &Progress,
) -> TumWriter {
    let panicked = || Err(CaptureError::Sequence("the encoder panicked".into()));
    while let Ok(promise) = in_order.recv() {
        let encoded = promise.recv().unwrap_or_else(|_| panicked());
        let written = encoded.and_then(|frame| writer.add(&frame));
        let mut state = lock(progress);
        match written {
            Ok(()) => state.frames += 1,
            Err(error) => {
                state.error = Some(error);
                break;
            }
        }
        drop(state);
        progress.changed.notify_all();
    }
    writer
}
