//! The program while it runs: what it says, signals to it, and how it ends.
#![cfg(unix)]

use std::fs::File;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Nothing takes so long but what hangs.
const LONGEST: Duration = Duration::from_secs(120);

/// A process of which nothing is left when the value goes.
pub struct Running {
    child: Child,
    folder: PathBuf,
    name: String,
    signalled: Option<Instant>,
}

pub struct Ended {
    pub status: ExitStatus,
    pub stdout: String,
    pub stderr: String,
    /// Since the last signal.
    pub took: Duration,
}

/// Starts `command`; what it says goes into files `NAME.out` and `NAME.err` of `folder`.
pub fn start(mut command: Command, folder: &Path, name: &str) -> Running {
    let file = |ending: &str| File::create(folder.join(format!("{name}.{ending}"))).unwrap();
    command.stdin(Stdio::null()).stdout(file("out")).stderr(file("err"));
    let child = command.spawn().unwrap_or_else(|e| panic!("{command:?}: {e}"));
    Running { child, folder: folder.to_owned(), name: name.to_owned(), signalled: None }
}

impl Running {
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    fn said(&self, ending: &str) -> String {
        let path = self.folder.join(format!("{}.{ending}", self.name));
        String::from_utf8_lossy(&std::fs::read(path).unwrap()).into_owned()
    }

    pub fn stderr(&self) -> String {
        self.said("err")
    }

    /// Waits for what must come while the process runs.
    pub fn until(&mut self, what: &str, mut is_so: impl FnMut() -> bool) {
        let started = Instant::now();
        while !is_so() {
            let ended = self.child.try_wait().unwrap();
            let (name, said) = (&self.name, self.stderr());
            assert!(ended.is_none() || is_so(), "{name} ended before {what}: {ended:?}\n{said}");
            assert!(started.elapsed() < LONGEST, "{name} hangs before {what}:\n{said}");
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    pub fn until_said(&mut self, words: &str) {
        let path = self.folder.join(format!("{}.err", self.name));
        self.until(words, || {
            String::from_utf8_lossy(&std::fs::read(&path).unwrap()).contains(words)
        });
    }

    /// `-INT`, `-KILL`, ..
    pub fn signal(&mut self, signal: &str) {
        self.send(signal, &self.id().to_string());
    }

    /// To the process and all that it has started; it must lead a group.
    pub fn signal_group(&mut self, signal: &str) {
        self.send(signal, &format!("-{}", self.id()));
    }

    fn send(&mut self, signal: &str, to: &str) {
        self.signalled = Some(Instant::now());
        let sent = Command::new("kill").args([signal, "--", to]).status();
        assert!(sent.expect("there is a kill program").success(), "{}: {signal}", self.name);
    }

    /// Waits for the end.
    pub fn end(mut self) -> Ended {
        let started = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            let said = self.stderr();
            assert!(started.elapsed() < LONGEST, "{} does not end:\n{said}", self.name);
            std::thread::sleep(Duration::from_millis(2));
        };
        let took = self.signalled.map_or(Duration::ZERO, |at| at.elapsed());
        let (stdout, stderr) = (self.said("out"), self.said("err"));
        assert!(!stderr.contains("panicked"), "{}: {stderr}", self.name);
        Ended { status, stdout, stderr, took }
    }
}

impl Drop for Running {
    /// Both fail for a process that has ended.
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Ended {
    /// As a shell would give it.
    pub fn code(&self) -> i32 {
        self.status.code().or(self.status.signal().map(|n| 128 + n)).expect("one of both")
    }

    pub fn succeeded(&self) -> &Self {
        assert!(self.status.success(), "{}: {}", self.status, self.stderr);
        self
    }

    /// By the signal itself, as shells want it for ending a script.
    pub fn ended_by(&self, signal: i32) -> &Self {
        assert_eq!(self.status.signal(), Some(signal), "{}: {}", self.status, self.stderr);
        self
    }

    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.stdout)
            .unwrap_or_else(|e| panic!("one JSON value: {e}: {}\n{}", self.stdout, self.stderr))
    }

    /// The line of standard error with these words.
    pub fn line(&self, words: &str) -> &str {
        let found = self.stderr.lines().find(|line| line.contains(words));
        found.unwrap_or_else(|| panic!("'{words}' was not said:\n{}", self.stderr))
    }
}

/// What a process may take that has `bound` to itself: where more are ready to run than there are cores, it gets a
/// share of them.
pub fn on_this_machine(bound: Duration) -> Duration {
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let ready = load.split(' ').next().and_then(|n| n.parse().ok()).unwrap_or(0.0);
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    bound.mul_f64((ready / cores as f64).max(1.0))
}

/// Lines of a file that are no comments; 0 where there is none.
pub fn lines(path: &Path) -> usize {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    text.lines().filter(|line| !line.starts_with('#')).count()
}
