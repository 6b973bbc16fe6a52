//! A folder with OpenNI2 and the virtual sensor in it, and tests that run in processes of their own:
//! OpenNI2 is one per process.

use super::recording::Recording;
use super::{skipped, text};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

const LIBRARY: &str = "libOpenNI2.so.0";
const PLACES: [&str; 5] = [
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/usr/lib64",
    "/usr/lib",
    "/usr/local/lib",
];
/// The calibration of a sensor of 32x24 without registration, and of a camera of 64x48 beside it.
pub const TWO_CAMERAS: &str = include_str!("two_cameras.toml");
/// Names the scenario that a process is for.
const SCENARIO: &str = "KINLIGHT_TEST_SCENARIO";
const FOLDER: &str = "KINLIGHT_TEST_FOLDER";
/// Nothing takes so long but what hangs.
const LONGEST: Duration = Duration::from_secs(120);

/// What the sensor plays: frames of depth as stored and colour.
pub struct Played {
    /// Of depth and of colour: width, height.
    pub depth_size: [usize; 2],
    pub color_size: [usize; 2],
    pub frames: Vec<(Vec<u16>, Vec<[u8; 3]>)>,
}

impl Played {
    /// Values without any pattern: an exchange of pixels, rows or frames cannot go unnoticed.
    pub fn noise(depth_size: [usize; 2], color_size: [usize; 2], count: usize) -> Self {
        let mut rng = kinlight::math::random::Rng::new(&[5, count as u32]);
        let mut frame = || {
            let depth =
                (0..depth_size[0] * depth_size[1]).map(|_| (rng.next_u32() % 10_000) as u16);
            let depth = depth.collect();
            let color = (0..color_size[0] * color_size[1]).map(|_| {
                let [r, g, b, _] = rng.next_u32().to_le_bytes();
                [r, g, b]
            });
            (depth, color.collect())
        };
        let frames = (0..count).map(|_| frame()).collect();
        Self { depth_size, color_size, frames }
    }

    /// As a sensor that measures in millimetres would give it.
    pub fn of(recording: &Recording) -> Self {
        let size = [recording.camera.width, recording.camera.height];
        let frames = recording.frames.iter().map(|frame| {
            let mm = frame.depth_m.as_slice().iter().map(|d| (d * 1000.0).round() as u16);
            (mm.collect(), frame.color.as_slice().to_vec())
        });
        Self { depth_size: size, color_size: size, frames: frames.collect() }
    }

    /// Writes `sensor.txt` and `frames.bin`.
    pub fn write(&self, folder: &Path, script: &str) {
        let ([dw, dh], [cw, ch]) = (self.depth_size, self.color_size);
        let script = format!("depth {dw} {dh}\ncolor {cw} {ch}\n{script}\n");
        fs::write(folder.join("sensor.txt"), script).unwrap();
        let mut bytes = Vec::new();
        for (depth, color) in &self.frames {
            bytes.extend(depth.iter().flat_map(|d| d.to_le_bytes()));
            bytes.extend_from_slice(color.as_flattened());
        }
        fs::write(folder.join("frames.bin"), bytes).unwrap();
    }
}

/// Builds the driver once a process; gives its file.
fn driver() -> &'static Path {
    static DRIVER: OnceLock<PathBuf> = OnceLock::new();
    DRIVER.get_or_init(|| {
        // target/PROFILE/deps/THIS
        let exe = std::env::current_exe().unwrap();
        let target = exe.ancestors().nth(3).unwrap();
        let built = Command::new(env!("CARGO"))
            .args(["build", "--quiet", "--locked", "--package"])
            .args(["kinlight-virtual-sensor", "--target-dir", text(target)])
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .status()
            .expect("cargo starts");
        assert!(built.success(), "the virtual sensor does not build");
        target.join("debug/libkinlight_virtual_sensor.so")
    })
}

/// The folder of the installed OpenNI2; `None`, said aloud, where there is none.
pub fn installed() -> Option<&'static Path> {
    let found = PLACES.map(Path::new).into_iter().find(|p| p.join(LIBRARY).is_file());
    if found.is_none() {
        let required = std::env::var("KINLIGHT_REQUIRE_OPENNI").is_ok_and(|v| v == "1");
        assert!(!required, "KINLIGHT_REQUIRE_OPENNI=1, and {LIBRARY} is not installed");
        skipped("libOpenNI2 is not installed (apt install libopenni2-0)");
    }
    found
}

/// Puts the library, its player of recordings and the virtual sensor into `folder`.
pub fn equip(folder: &Path, installed: &Path) {
    let drivers = folder.join("OpenNI2/Drivers");
    fs::create_dir_all(&drivers).unwrap();
    fs::copy(installed.join(LIBRARY), folder.join(LIBRARY)).unwrap();
    let player = "libOniFile.so.0";
    fs::copy(installed.join("OpenNI2/Drivers").join(player), drivers.join(player)).unwrap();
    // Only files of this ending are taken for drivers.
    fs::copy(driver(), drivers.join("libKinlightVirtual.so.0")).unwrap();
}

/// A new folder with all of that.
pub fn equipped(installed: &Path) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    equip(folder.path(), installed);
    folder
}

/// A command whose OpenNI2 is that of `folder`.
pub fn with_sensor(program: &Path, folder: &Path) -> Command {
    let mut command = Command::new(program);
    command.env("KINLIGHT_OPENNI2", folder).env("KINLIGHT_VIRTUAL_SENSOR", folder);
    command
}

/// Runs the test `name` again in a process of its own with a sensor that `prepare` has written; there, and
/// only there, `body` runs. A process that does not end is ended, and that is a failure.
pub fn scenario(name: &str, prepare: impl Fn(&Path), body: impl Fn(&Path)) {
    if std::env::var(SCENARIO).is_ok_and(|s| s == name) {
        body(Path::new(&std::env::var_os(FOLDER).expect("set by the parent")));
        return;
    }
    let Some(installed) = installed() else { return };
    let folder = equipped(installed);
    prepare(folder.path());
    let mut child = with_sensor(&std::env::current_exe().unwrap(), folder.path())
        .args([name, "--exact", "--nocapture"])
        .env(SCENARIO, name)
        .env(FOLDER, folder.path())
        .stdout(Stdio::null())
        .spawn()
        .expect("this test starts");
    let started = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if started.elapsed() > LONGEST {
            child.kill().unwrap();
            panic!("{name} hangs");
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    assert!(status.success(), "{name}: {status}; what failed is said above");
}
