//! The thread that reads a colour camera, so that neither of two devices waits for the other.

use super::{ColorCamera, ColorPicture, DeviceError};
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Pictures that may wait to be taken: of more, the oldest goes.
const MOST_WAITING: usize = 4;

/// How long the camera may wait for a picture before its thread looks whether it should stop.
const WAIT: Duration = Duration::from_millis(100);

/// How long the end waits for the driver before it leaves the thread behind.
const PATIENCE: Duration = Duration::from_secs(1);

/// A colour camera whose newest pictures can be taken at any time.
pub(in crate::capture) struct ColorCapture {
    shared: Arc<Shared>,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    left: Condvar,
}

#[derive(Default)]
struct State {
    /// Oldest first; what is no good is an error.
    waiting: VecDeque<Result<ColorPicture, String>>,
    /// The camera gives nothing more.
    ended: Option<DeviceError>,
    hold: bool,
    held: Option<Result<(), String>>,
    stopped: bool,
    left: bool,
}

impl Shared {
    /// A thread that panicked while it held the lock (none should) leaves a state that is still whole.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ColorCapture {
    pub fn start(camera: Box<dyn ColorCamera>) -> Result<Self, DeviceError> {
        let shared = Arc::<Shared>::default();
        let leaving = Leaving(Arc::clone(&shared));
        std::thread::Builder::new()
            .name("colour".into())
            .spawn(move || {
                capture(&leaving.0, camera);
                drop(leaving);
            })
            .map_err(|error| DeviceError::Lost(format!("no thread for the camera: {error}")))?;
        Ok(Self { shared })
    }

    /// The oldest picture that waits, if one does.
    ///
    /// # Errors
    /// A picture that is no good, or, once all are taken, why there will be none any more.
    pub fn take(&self) -> Result<Option<ColorPicture>, DeviceError> {
        let mut state = self.shared.lock();
        match state.waiting.pop_front() {
            Some(Ok(picture)) => Ok(Some(picture)),
            Some(Err(why)) => Err(DeviceError::BadFrame(why)),
            None => state.ended.clone().map_or(Ok(None), Err),
        }
    }

    /// Asks the camera to hold exposure and white balance; [`held`](Self::held) says what came of it.
    pub fn hold_exposure(&self) {
        self.shared.lock().hold = true;
    }

    /// Once, when the camera has answered.
    pub fn held(&self) -> Option<Result<(), String>> {
        self.shared.lock().held.take()
    }
}

/// Until the camera is lost or no longer wanted; it is closed before this returns.
fn capture(shared: &Shared, mut camera: Box<dyn ColorCamera>) {
    loop {
        let hold = {
            let mut state = shared.lock();
            if state.stopped {
                return;
            }
            std::mem::take(&mut state.hold)
        };
        if hold {
            let held = camera.hold_exposure();
            shared.lock().held = Some(held);
        }
        let picture = match camera.wait(WAIT) {
            Ok(None) => continue,
            Ok(Some(picture)) => Ok(picture),
            Err(DeviceError::BadFrame(why)) => Err(why),
            Err(error) => {
                shared.lock().ended = Some(error);
                return;
            }
        };
        let bad = picture.is_err();
        {
            let mut state = shared.lock();
            if state.waiting.len() >= MOST_WAITING {
                state.waiting.pop_front();
            }
            state.waiting.push_back(picture);
        }
        if bad {
            // A driver that gives nothing else must not take a core.
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

/// Says that the thread has left, also where the driver panicked.
struct Leaving(Arc<Shared>);

impl Drop for Leaving {
    fn drop(&mut self) {
        let mut state = self.0.lock();
        if std::thread::panicking() {
            state.ended = Some(DeviceError::Lost("the colour camera's driver panicked".into()));
        }
        state.left = true;
        drop(state);
        self.0.left.notify_all();
    }
}

/// Stops the thread; where the driver does not return, it is left behind.
impl Drop for ColorCapture {
    fn drop(&mut self) {
        let deadline = Instant::now() + PATIENCE;
        let mut state = self.shared.lock();
        state.stopped = true;
        while !state.left {
            let Some(left) = deadline.checked_duration_since(Instant::now()) else {
                log::warn!("the colour camera's driver does not return; its thread is left behind");
                return;
            };
            (state, _) =
                self.shared.left.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::live::DeviceInfo;
    use crate::image::{Image, Size};
    use std::sync::atomic::{AtomicBool, Ordering::SeqCst};

    type Step = Box<dyn FnOnce() -> Result<Option<ColorPicture>, DeviceError> + Send>;

    /// Does one step after another, then is silent.
    struct Camera {
        steps: VecDeque<Step>,
        info: DeviceInfo,
        closed: Arc<AtomicBool>,
    }

    impl ColorCamera for Camera {
        fn info(&self) -> &DeviceInfo {
            &self.info
        }
        fn size(&self) -> Size {
            Size::new(1, 1)
        }
        fn rate_hz(&self) -> f64 {
            30.0
        }
        fn wait(&mut self, timeout: Duration) -> Result<Option<ColorPicture>, DeviceError> {
            match self.steps.pop_front() {
                Some(step) => step(),
                None => {
                    std::thread::sleep(timeout.min(Duration::from_millis(5)));
                    Ok(None)
                }
            }
        }
        fn hold_exposure(&mut self) -> Result<(), String> {
            Err("white balance".into())
        }
    }

    impl Drop for Camera {
        fn drop(&mut self) {
            self.closed.store(true, SeqCst);
        }
    }

    fn start(steps: Vec<Step>) -> (ColorCapture, Arc<AtomicBool>) {
        let closed = Arc::<AtomicBool>::default();
        let camera = Camera {
            steps: steps.into(),
            info: DeviceInfo::default(),
            closed: Arc::clone(&closed),
        };
        (ColorCapture::start(Box::new(camera)).unwrap(), closed)
    }

    fn picture(value: u8) -> Step {
        let pixels = Image::new(Size::new(1, 1), [value; 3]);
        Box::new(move || Ok(Some(ColorPicture { taken: Instant::now(), pixels })))
    }

    fn fail(error: DeviceError) -> Step {
        Box::new(move || Err(error))
    }

    fn until<T>(mut ask: impl FnMut() -> Option<T>) -> T {
        let patience = Instant::now() + Duration::from_secs(20);
        loop {
            match ask() {
                Some(answer) => return answer,
                None if Instant::now() > patience => panic!("it never came"),
                None => std::thread::sleep(Duration::from_millis(1)),
            }
        }
    }

    #[test]
    fn only_the_newest_wait_and_the_loss_is_told_behind_them() {
        let mut steps: Vec<Step> = (0..50).map(picture).collect();
        steps.push(fail(DeviceError::BadFrame("half".into())));
        steps.push(picture(50));
        steps.push(fail(DeviceError::Lost("unplugged".into())));
        let (capture, closed) = start(steps);
        until(|| closed.load(SeqCst).then_some(()));
        let mut seen = Vec::new();
        let end = loop {
            match capture.take() {
                Ok(Some(picture)) => seen.push(i32::from(picture.pixels[(0, 0)][0])),
                Ok(None) => panic!("the loss was not told"),
                Err(DeviceError::BadFrame(why)) => {
                    assert_eq!(why, "half");
                    seen.push(-1);
                }
                Err(error) => break error,
            }
        };
        assert_eq!(seen, [48, 49, -1, 50]);
        assert!(matches!(end, DeviceError::Lost(why) if why == "unplugged"));
        assert!(capture.take().is_err(), "and again");
    }

    #[test]
    fn what_cannot_be_held_is_said_once() {
        let (capture, _) = start(Vec::new());
        assert!(capture.held().is_none());
        capture.hold_exposure();
        assert_eq!(until(|| capture.held()), Err("white balance".into()));
        assert!(capture.held().is_none());
    }

    #[test]
    fn a_driver_that_panics_is_a_lost_camera() {
        let (capture, closed) = start(vec![Box::new(|| panic!("as the script says"))]);
        let error = until(|| capture.take().err());
        assert!(error.to_string().contains("panicked"), "{error}");
        until(|| closed.load(SeqCst).then_some(()));
    }

    #[test]
    fn the_end_closes_the_camera_and_leaves_behind_one_that_hangs() {
        let (capture, closed) = start(Vec::new());
        drop(capture);
        assert!(closed.load(SeqCst));

        let released = Arc::<AtomicBool>::default();
        let hangs = Arc::<AtomicBool>::default();
        let (waiting, reached) = (Arc::clone(&released), Arc::clone(&hangs));
        let hang: Step = Box::new(move || {
            reached.store(true, SeqCst);
            until(|| waiting.load(SeqCst).then_some(()));
            Ok(None)
        });
        let (capture, closed) = start(vec![hang]);
        until(|| hangs.load(SeqCst).then_some(()));
        let started = Instant::now();
        drop(capture);
        // Not a measure of speed: without an end to its patience it waits for the 20 s above.
        assert!(started.elapsed() < Duration::from_secs(10));
        assert!(!closed.load(SeqCst));
        released.store(true, SeqCst);
        until(|| closed.load(SeqCst).then_some(()));
    }
}
