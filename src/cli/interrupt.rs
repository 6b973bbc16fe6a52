//! Ctrl-C, termination and hang-up, alike for all commands that take long.
//!
//! The first one ends a command as its last frame would: results until then are written. The second ends the
//! program at once. Commands that do not ask for this are ended by the first, as programs are by default.

use super::CliError;
use kinlight::stop::{Stop, signals};

/// What an interrupt ends, from now on.
pub fn stop_on_interrupt() -> Result<Stop, CliError> {
    let stop = Stop::default();
    let asked = stop.clone();
    on_interrupt(move || asked.ask())?;
    Ok(stop)
}

/// Runs `end` at the first interrupt, on a thread of its own. To be called once a process.
pub fn on_interrupt(end: impl FnOnce() + Send + 'static) -> Result<(), CliError> {
    signals::catch(move || {
        log::info!("ending: what belongs to the end is written now (again: stop at once)");
        end();
    })
    .map_err(|error| CliError::Run(format!("Ctrl-C cannot be caught: {error}")))
}
