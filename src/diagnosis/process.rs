//! Another process, for a limited time, however it ends.

use std::io::{self, Read};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

/// More than this of what a process prints is not kept.
const MOST_BYTES: usize = 1 << 20;

/// A process that was killed is waited for this long; one that hangs in the kernel does not even die.
const DYING: Duration = Duration::from_secs(1);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    Exited(i32),
    Signal(i32),
    /// It was killed at the end of its time.
    OutOfTime,
}

#[derive(Debug)]
pub struct Finished {
    pub ended: Ended,
    /// Standard output and error, as far as they came.
    output: Vec<u8>,
    errors: Vec<u8>,
}

impl Finished {
    pub fn lines(&self) -> impl Iterator<Item = &str> {
        // A driver may print what is no text between lines that are.
        self.output.split(|&b| b == b'\n').filter_map(|line| std::str::from_utf8(line).ok())
    }

    /// The last line on standard error.
    pub fn last_error(&self) -> Option<String> {
        let text = String::from_utf8_lossy(&self.errors);
        text.lines().map(str::trim).rfind(|line| !line.is_empty()).map(str::to_owned)
    }
}

/// Runs a program to its end, or kills it at the end of `limit`.
pub fn run(command: &mut Command, limit: Duration) -> io::Result<Finished> {
    let mut child =
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
    let output = child.stdout.take().map(drain);
    let errors = child.stderr.take().map(drain);
    let ended = match wait(&mut child, limit)? {
        Some(status) => how(status),
        None => {
            child.kill()?;
            wait(&mut child, DYING)?;
            Ended::OutOfTime
        }
    };
    Ok(Finished { ended, output: collected(output), errors: collected(errors) })
}

fn wait(child: &mut Child, limit: Duration) -> io::Result<Option<ExitStatus>> {
    let deadline = Instant::now() + limit;
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        if Instant::now() >= deadline {
            return Ok(None);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn how(status: ExitStatus) -> Ended {
    #[cfg(unix)]
    if let Some(signal) = std::os::unix::process::ExitStatusExt::signal(&status) {
        return Ended::Signal(signal);
    }
    Ended::Exited(status.code().unwrap_or(-1))
}

/// Reads in a thread: a full pipe would stop the process.
fn drain(mut pipe: impl Read + Send + 'static) -> Receiver<Vec<u8>> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        let mut buffer = [0; 4096];
        while let Ok(count @ 1..) = pipe.read(&mut buffer) {
            if sender.send(buffer[..count].to_vec()).is_err() {
                return;
            }
        }
    });
    receiver
}

/// What came; a process of the process's own that holds the pipe open keeps nobody waiting for long.
fn collected(pipe: Option<Receiver<Vec<u8>>>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let Some(pipe) = pipe else { return bytes };
    while bytes.len() < MOST_BYTES
        && let Ok(more) = pipe.recv_timeout(Duration::from_millis(200))
    {
        bytes.extend(more);
    }
    bytes
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    const LONG: Duration = Duration::from_secs(60);

    fn shell(script: &str, limit: Duration) -> Finished {
        run(Command::new("sh").args(["-c", script]), limit).expect("there is a shell")
    }

    #[test]
    fn output_and_exit_code_are_the_processes() {
        let done = shell("echo one; echo two; echo odd >&2; exit 3", LONG);
        assert_eq!(done.ended, Ended::Exited(3));
        assert_eq!(done.lines().collect::<Vec<_>>(), ["one", "two", ""]);
        assert_eq!(done.last_error().as_deref(), Some("odd"));
    }

    #[test]
    fn a_signal_is_told_and_what_came_before_it_is_kept() {
        let done = shell("echo before; kill -SEGV $$", LONG);
        assert_eq!(done.ended, Ended::Signal(11));
        assert_eq!(done.lines().next(), Some("before"));
    }

    #[test]
    fn a_process_that_hangs_is_killed_also_with_a_child_that_holds_its_output() {
        let started = Instant::now();
        let done = shell("echo before; sleep 1000 & wait", Duration::from_millis(500));
        assert_eq!(done.ended, Ended::OutOfTime);
        assert_eq!(done.lines().next(), Some("before"));
        // The sleep of 1000 s was not waited for.
        assert!(started.elapsed() < Duration::from_secs(500), "{:?}", started.elapsed());
    }

    #[test]
    fn a_flood_of_output_stops_neither() {
        let done = shell("head -c 3000000 /dev/zero; echo; echo end", LONG);
        assert_eq!(done.ended, Ended::Exited(0));
        assert!(done.output.len() >= MOST_BYTES, "{}", done.output.len());
    }

    #[test]
    fn a_program_that_is_not_there_is_an_error() {
        assert!(run(&mut Command::new("/no/such/program"), LONG).is_err());
    }
}
