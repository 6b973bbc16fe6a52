//! Ending a long job early.

#[cfg(unix)]
pub mod signals;
#[cfg(not(unix))]
#[path = "other_signals.rs"]
pub mod signals;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Asks a job to end after the frame that it is at. Clones ask the same job.
#[derive(Clone, Debug, Default)]
pub struct Stop(Arc<AtomicBool>);

/// The job was asked to stop, and is not done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("interrupted")]
pub struct Stopped;

impl Stop {
    pub fn ask(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    pub fn is_asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// # Errors
    /// [`Stopped`], once it is asked.
    pub fn check(&self) -> Result<(), Stopped> {
        if self.is_asked() { Err(Stopped) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clones_ask_the_same_job() {
        let stop = Stop::default();
        assert_eq!((stop.check(), Stop::default().check()), (Ok(()), Ok(())));
        stop.clone().ask();
        assert_eq!((stop.is_asked(), stop.check()), (true, Err(Stopped)));
    }
}
