//! A virtual sensor in real time, the program before it, and what came of its frames.

use crate::common::process::{self, Running, lines};
use crate::common::recording::{Recording, small_demo};
use crate::common::text;
use crate::common::virtual_sensor::{Played, equip, installed, with_sensor};
use kinlight::capture::{CaptureOptions, FrameSource, open_sequence};
use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// The sensor plays so many frames, and then stalls; opened again, it plays them from the first.
pub const FRAMES: usize = 60;

/// Half of the usual rate, so that busy machines keep up.
const FPS: u32 = 15;
pub const PERIOD_MS: f64 = 1000.0 / FPS as f64;

/// The demo at 160x120.
fn demo() -> &'static Recording {
    static DEMO: OnceLock<Recording> = OnceLock::new();
    DEMO.get_or_init(|| small_demo(FRAMES))
}

/// As the sensor has it.
pub fn played() -> &'static Played {
    static PLAYED: OnceLock<Played> = OnceLock::new();
    PLAYED.get_or_init(|| Played::of(demo()))
}

/// Where the camera is at a frame in the axes of the camera at another, metres.
pub fn true_position_m(first: usize, frame: usize) -> [f64; 3] {
    let pose = |k: usize| demo().frames[k].world_from_camera.expect("the demo has poses");
    pose(first).inv_mul(&pose(frame)).translation.vector.into()
}

/// Horizontal and vertical, radians.
fn field_of_view() -> [f32; 2] {
    let camera = demo().camera;
    let angle = |size: usize, focal: f32| 2.0 * (size as f32 / 2.0 / focal).atan();
    [angle(camera.width, camera.fx), angle(camera.height, camera.fy)]
}

/// What the sensor's log says. Microseconds since 1970.
#[derive(Clone, Debug)]
pub struct Event {
    pub at_us: i64,
    pub what: String,
    pub frame: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Does {
    Record,
    Stream,
}

impl Does {
    pub fn name(self) -> &'static str {
        match self {
            Does::Record => "record",
            Does::Stream => "stream",
        }
    }
}

/// A frame that reached a recording or the pipeline.
#[derive(Clone, Debug)]
pub struct Seen {
    pub time_s: f64,
    /// Which of the played frames it is, bit for bit.
    pub played: usize,
    /// Of streams: the tracker's state, and the camera's position where it is trusted.
    pub state: String,
    pub position_m: Option<[f64; 3]>,
}

pub struct Rig {
    folder: tempfile::TempDir,
    pub does: Does,
}

impl Rig {
    /// A sensor with these faults; `None`, said aloud, where there is no OpenNI2.
    pub fn new(does: Does, script: &str) -> Option<Self> {
        let installed = installed()?;
        let folder = tempfile::tempdir().unwrap();
        equip(folder.path(), installed);
        let [h, v] = field_of_view();
        let script = format!("fov {h} {v}\nfps {FPS}\nregistration yes\nlog yes\n{script}\n");
        played().write(folder.path(), &script);
        Some(Self { folder, does })
    }

    pub fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn out(&self) -> PathBuf {
        self.at("out")
    }

    /// Starts the command on the sensor.
    pub fn start(&self, extra: &[&str]) -> Running {
        let out = self.out();
        let common = [self.does.name(), "--device", "openni", "--json", "--out", text(&out)];
        // Without an object the composed picture is the camera's.
        let stream =
            ["--preset", "ours-fast-mobile", "--backend", "cpu", "--no-object", "--frames-out"];
        let own = if self.does == Does::Stream { &stream[..] } else { &[] };
        self.run(&[&common, own, extra].concat(), self.does.name())
    }

    /// Any command.
    pub fn run(&self, args: &[&str], name: &str) -> Running {
        let mut command =
            with_sensor(Path::new(env!("CARGO_BIN_EXE_kinlight")), self.folder.path());
        command.args(args);
        process::start(command, self.folder.path(), name)
    }

    pub fn log(&self) -> Vec<Event> {
        let text = fs::read_to_string(self.at("log.txt")).unwrap_or_default();
        // The last line may be in the making.
        let whole = text.rfind('\n').map_or("", |end| &text[..end]);
        let event = |line: &str| {
            let words: Vec<&str> = line.split(' ').collect();
            let [at_us, what, frame] = words[..] else { panic!("{line}") };
            let (at_us, frame) = (at_us.parse().unwrap(), frame.parse().unwrap());
            Event { at_us, what: what.to_owned(), frame }
        };
        whole.lines().map(event).collect()
    }

    pub fn happened(&self, what: &str, frame: usize) -> bool {
        self.log().iter().any(|e| e.what == what && e.frame == frame)
    }

    /// Frames that are written by now.
    pub fn written(&self) -> usize {
        lines(&self.out().join(match self.does {
            Does::Record => "associations.txt",
            Does::Stream => "light.jsonl",
        }))
    }

    /// Every file by its name.
    pub fn files(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut found = BTreeMap::new();
        let mut folders = vec![self.out()];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                let hidden = path.file_name().unwrap().to_string_lossy().starts_with('.');
                if path.is_dir() {
                    folders.push(path);
                } else if !hidden {
                    let bytes = fs::read(&path).unwrap();
                    found.insert(path, bytes);
                }
            }
        }
        found
    }

    /// What was written until `before` was taken is there now, and logs have only grown.
    pub fn still_has(&self, before: &BTreeMap<PathBuf, Vec<u8>>) {
        let now = self.files();
        for (path, bytes) in before {
            let log = ["txt", "jsonl", "csv"].iter().any(|e| path.extension().unwrap() == *e);
            let same = |now: &Vec<u8>| if log { now.starts_with(bytes) } else { now == bytes };
            assert!(now.get(path).is_some_and(same), "{} was lost or changed", path.display());
        }
    }

    /// All frames that came through, in order; each must be one that the sensor played, bit for bit.
    pub fn seen(&self) -> Vec<Seen> {
        let seen = match self.does {
            Does::Record => self.recorded(),
            Does::Stream => self.streamed(),
        };
        assert!(seen.windows(2).all(|w| w[0].time_s < w[1].time_s), "times rise: {seen:?}");
        seen
    }

    fn recorded(&self) -> Vec<Seen> {
        let mut source = open_sequence(&self.out(), &CaptureOptions::default()).unwrap();
        let mut seen = Vec::new();
        while let Some(frame) = source.next_frame().unwrap() {
            let played = which(frame.color.as_slice().as_flattened());
            let depth = &self::played().frames[played].0;
            let same = |(read_m, &mm): (&f32, &u16)| *read_m == f32::from(mm) / 1000.0;
            let whole = frame.depth_m.as_slice().iter().zip(depth).all(same);
            assert!(whole, "depth of the frame at {} s", frame.timestamp_s);
            let (state, position_m) = (String::new(), None);
            seen.push(Seen { time_s: frame.timestamp_s, played, state, position_m });
        }
        assert_eq!(source.skipped(), []);
        seen
    }

    fn streamed(&self) -> Vec<Seen> {
        let read = |name: &str| fs::read_to_string(self.out().join(name)).unwrap();
        let (timings, trajectory) = (read("timings.csv"), read("trajectory.txt"));
        assert_eq!(lines(&self.out().join("light.jsonl")), timings.lines().count() - 1);
        for line in read("light.jsonl").lines() {
            serde_json::from_str::<serde_json::Value>(line).expect("whole lines");
        }
        let mut positions = HashMap::new();
        for line in trajectory.lines().filter(|line| !line.starts_with('#')) {
            let words: Vec<&str> = line.split(' ').collect();
            assert_eq!(words.len(), 8, "{line}");
            let position = [1, 2, 3].map(|i| words[i].parse::<f64>().unwrap());
            positions.insert(words[0].to_owned(), position);
        }
        let column =
            |name: &str| timings.lines().next().unwrap().split(',').position(|c| c == name);
        let (time, state) = (column("timestamp").unwrap(), column("state").unwrap());
        let frame = |(i, line): (usize, &str)| {
            let words: Vec<&str> = line.split(',').collect();
            let picture = image::open(self.out().join(format!("frames/{i:06}.png"))).unwrap();
            Seen {
                time_s: words[time].parse().unwrap(),
                played: which(picture.into_rgb8().as_raw()),
                state: words[state].to_owned(),
                position_m: positions.get(words[time]).copied(),
            }
        };
        timings.lines().skip(1).enumerate().map(frame).collect()
    }
}

/// The played frame with this colour picture.
fn which(color: &[u8]) -> usize {
    static BY_COLOR: OnceLock<HashMap<&'static [u8], usize>> = OnceLock::new();
    let by_color = BY_COLOR.get_or_init(|| {
        let frames = played().frames.iter().enumerate();
        let by_color: HashMap<_, _> = frames.map(|(k, f)| (f.1.as_flattened(), k)).collect();
        assert_eq!(by_color.len(), FRAMES, "no two frames are alike");
        by_color
    });
    *by_color.get(color).expect("a frame that was played, bit for bit")
}
