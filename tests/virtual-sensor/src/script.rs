//! `sensor.txt`: what the sensor is and what goes wrong with it. `frames.bin`: what it sees.
//!
//! One `key value..` a line:
//!
//! ```text
//! color 64 48              size; 0 0 of a sensor without colour
//! depth 64 48
//! fps 30                   half of it is offered, too
//! depth-format 1mm         or 100um
//! fov 1.02 0.80            radians, of both cameras; without it the property is missing
//! pace read                a frame pair whenever the reader waits for one; or clock: in real time
//! offset-us 4000           colour later than depth
//! registration yes         offered in hardware
//! sync yes
//! mirror-stuck yes         mirroring cannot be turned off
//! reopen-ms 4000           opening the device again takes so long
//! log yes                  what happens goes to log.txt: microseconds since 1970, event, frame
//! lock yes                 exposure and white balance can be locked
//! fault absent | busy | unplug K [replug-ms] | stall K | half K | stride K | jump K us | no-color K
//! fault crash initialize | crash open | crash start | hang initialize | hang open | hang start
//! ```
//!
//! `frames.bin` holds, frame by frame, depth as 16-bit little-endian and colour as RGB, without padding.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    Absent,
    Busy,
    /// Before this frame; back after so many milliseconds. Once.
    Unplug(usize, Option<u64>),
    /// No frame from this one on, until the device is opened again. Once.
    Stall(usize),
    /// This depth frame has half of its bytes.
    Half(usize),
    /// This depth frame claims a stride that its data do not have.
    Stride(usize),
    /// The clock is off by so many microseconds from this frame on.
    Jump(usize, i64),
    /// Depth alone.
    NoColor(usize),
    /// The process is aborted.
    Crash(Moment),
    /// The call never returns.
    Hang(Moment),
}

/// Where a driver's call goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Moment {
    Initialize,
    Open,
    /// Of a stream.
    Start,
}

#[derive(Clone, Debug)]
pub struct Script {
    pub color: [usize; 2],
    pub depth: [usize; 2],
    pub fps: i32,
    pub tenths_of_mm: bool,
    pub fov: Option<[f32; 2]>,
    pub by_clock: bool,
    pub color_offset_us: i64,
    pub registration: bool,
    pub sync: bool,
    pub mirror_stuck: bool,
    pub lock: bool,
    pub reopen: Duration,
    pub log: bool,
    pub folder: PathBuf,
    pub faults: Vec<Fault>,
    pub frames: Vec<u8>,
}

impl Script {
    pub fn read(folder: &Path) -> Result<Self, String> {
        let text = std::fs::read_to_string(folder.join("sensor.txt")).map_err(|e| e.to_string())?;
        let mut script = Self {
            color: [0; 2],
            depth: [0; 2],
            fps: 30,
            tenths_of_mm: false,
            fov: None,
            by_clock: false,
            color_offset_us: 0,
            registration: false,
            sync: false,
            mirror_stuck: false,
            lock: false,
            reopen: Duration::ZERO,
            log: false,
            folder: folder.to_owned(),
            faults: Vec::new(),
            frames: std::fs::read(folder.join("frames.bin")).map_err(|e| e.to_string())?,
        };
        for line in text.lines().filter(|l| !l.trim().is_empty()) {
            let words: Vec<&str> = line.split_whitespace().collect();
            script.line(&words).ok_or_else(|| format!("sensor.txt: \"{line}\""))?;
        }
        if script.frame_bytes() == 0 || !script.frames.len().is_multiple_of(script.frame_bytes()) {
            return Err("frames.bin does not have the sizes of sensor.txt".into());
        }
        Ok(script)
    }

    fn line(&mut self, words: &[&str]) -> Option<()> {
        let yes = words.get(1) == Some(&"yes");
        match *words {
            ["color", w, h] => self.color = [w.parse().ok()?, h.parse().ok()?],
            ["depth", w, h] => self.depth = [w.parse().ok()?, h.parse().ok()?],
            ["fps", fps] => self.fps = fps.parse().ok()?,
            ["depth-format", format] => self.tenths_of_mm = format == "100um",
            ["fov", h, v] => self.fov = Some([h.parse().ok()?, v.parse().ok()?]),
            ["pace", pace] => self.by_clock = pace == "clock",
            ["offset-us", us] => self.color_offset_us = us.parse().ok()?,
            ["registration", _] => self.registration = yes,
            ["sync", _] => self.sync = yes,
            ["mirror-stuck", _] => self.mirror_stuck = yes,
            ["lock", _] => self.lock = yes,
            ["reopen-ms", ms] => self.reopen = Duration::from_millis(ms.parse().ok()?),
            ["log", _] => self.log = yes,
            ["fault", ref fault @ ..] => self.faults.push(Self::fault(fault)?),
            _ => return None,
        }
        Some(())
    }

    fn fault(words: &[&str]) -> Option<Fault> {
        Some(match *words {
            ["absent"] => Fault::Absent,
            ["busy"] => Fault::Busy,
            ["unplug", k] => Fault::Unplug(k.parse().ok()?, None),
            ["unplug", k, ms] => Fault::Unplug(k.parse().ok()?, Some(ms.parse().ok()?)),
            ["stall", k] => Fault::Stall(k.parse().ok()?),
            ["half", k] => Fault::Half(k.parse().ok()?),
            ["stride", k] => Fault::Stride(k.parse().ok()?),
            ["jump", k, us] => Fault::Jump(k.parse().ok()?, us.parse().ok()?),
            ["no-color", k] => Fault::NoColor(k.parse().ok()?),
            ["crash", moment] => Fault::Crash(Self::moment(moment)?),
            ["hang", moment] => Fault::Hang(Self::moment(moment)?),
            _ => return None,
        })
    }

    fn moment(word: &str) -> Option<Moment> {
        Some(match word {
            "initialize" => Moment::Initialize,
            "open" => Moment::Open,
            "start" => Moment::Start,
            _ => return None,
        })
    }

    /// Crashes or hangs where the script says so.
    pub fn go_wrong_at(&self, moment: Moment) {
        if self.has(Fault::Crash(moment)) {
            std::process::abort();
        }
        while self.has(Fault::Hang(moment)) {
            std::thread::park();
        }
    }

    /// Adds an event to the log. A test that misses it says so.
    pub fn note(&self, event: &str, frame: usize) {
        if !self.log {
            return;
        }
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let line = format!("{} {event} {frame}\n", now.as_micros());
        let file = OpenOptions::new().create(true).append(true).open(self.folder.join("log.txt"));
        if let Err(problem) = file.and_then(|mut file| file.write_all(line.as_bytes())) {
            eprintln!("virtual sensor: log.txt: {problem}");
        }
    }

    pub fn has(&self, fault: Fault) -> bool {
        self.faults.contains(&fault)
    }

    fn depth_bytes(&self) -> usize {
        2 * self.depth[0] * self.depth[1]
    }

    fn frame_bytes(&self) -> usize {
        self.depth_bytes() + 3 * self.color[0] * self.color[1]
    }

    pub fn has_color(&self) -> bool {
        self.color != [0; 2]
    }

    pub fn frame_count(&self) -> usize {
        self.frames.len() / self.frame_bytes()
    }

    pub fn picture(&self, frame: usize, depth: bool) -> &[u8] {
        let start = frame * self.frame_bytes();
        let middle = start + self.depth_bytes();
        if depth {
            &self.frames[start..middle]
        } else {
            &self.frames[middle..start + self.frame_bytes()]
        }
    }

    /// Whether the device's clock says something else from this frame on.
    pub fn clock_error_us(&self, frame: usize) -> i64 {
        let jumps = self.faults.iter().filter_map(|f| match f {
            Fault::Jump(k, us) if frame >= *k => Some(*us),
            _ => None,
        });
        jumps.sum()
    }

    pub fn stalls(&self, frame: usize) -> bool {
        self.faults.iter().any(|f| matches!(f, Fault::Stall(k) if frame >= *k))
    }
}
