//! The virtual machine from inside: its camera, the camera's buttons, its kernel module.

use super::common::skipped;
use kinlight::capture::live::{ColorCamera, ColorDriver, ColorPicture};
use kinlight::capture::v4l::{V4lDriver, V4lOptions};
use kinlight::image::Image;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Once;
use std::time::{Duration, Instant};
use v4l::control::{Control, Description, Value};

pub const NODE: &str = "/dev/video0";

/// Set where vivid's module file is, by run.sh's init.
const MODULE: &str = "KINLIGHT_VIVID_MODULE";

/// Whether this is the virtual machine; says once where it is not.
pub fn in_guest() -> bool {
    static SAID: Once = Once::new();
    let inside = std::env::var_os(MODULE).is_some();
    if !inside {
        SAID.call_once(|| skipped("V4L2 is tested in a virtual machine: tests/vivid/run.sh"));
    }
    inside
}

/// Opens the camera at its usual size; one that was just plugged in may not be there at once.
pub fn open(options: V4lOptions) -> Box<dyn ColorCamera> {
    V4lDriver::new(Some(NODE.into()), options).open().expect("vivid is there")
}

pub fn next(camera: &mut dyn ColorCamera) -> ColorPicture {
    let patience = Instant::now() + super::SOON;
    while Instant::now() < patience {
        if let Some(picture) = camera.wait(Duration::from_millis(100)).expect("no error") {
            return picture;
        }
    }
    panic!("no picture came");
}

/// In the middle of each of the eight bars that the camera shows, white first.
pub fn bars(picture: &Image<[u8; 3]>) -> [[u8; 3]; 8] {
    let (width, height) = (picture.width(), picture.height());
    std::array::from_fn(|bar| picture[((2 * bar + 1) * width / 16, height / 2)])
}

/// The camera's controls, by their names, through a handle of its own.
pub struct Vivid {
    device: v4l::Device,
    controls: Vec<Description>,
}

impl Vivid {
    pub fn new() -> Self {
        let device = v4l::Device::with_path(NODE).unwrap();
        let controls = device.query_controls().unwrap();
        Self { device, controls }
    }

    fn id(&self, name: &str) -> u32 {
        let names = || self.controls.iter().map(|c| c.name.as_str()).collect::<Vec<_>>();
        let found = self.controls.iter().find(|c| c.name == name);
        found.unwrap_or_else(|| panic!("no control {name} among {:?}", names())).id
    }

    pub fn press(&self, name: &str) {
        let id = self.id(name);
        self.device.set_control(Control { id, value: Value::None }).unwrap();
    }

    pub fn choose(&self, name: &str, value: i64) {
        let id = self.id(name);
        self.device.set_control(Control { id, value: Value::Integer(value) }).unwrap();
    }

    pub fn value(&self, name: &str) -> i64 {
        match self.device.control(self.id(name)).unwrap().value {
            Value::Integer(value) => value,
            Value::Boolean(value) => value.into(),
            other => panic!("{other:?}"),
        }
    }
}

fn busybox(args: &[&str]) {
    let output = Command::new("/bin/busybox").args(args).output().expect("busybox is there");
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// Once its last user has closed it.
pub fn remove_module() {
    let patience = Instant::now() + super::SOON;
    loop {
        let output = Command::new("/bin/busybox").args(["rmmod", "vivid"]).output().unwrap();
        if output.status.success() {
            return;
        }
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(Instant::now() < patience, "rmmod: {said}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

pub fn insert_module() {
    let module = std::env::var(MODULE).unwrap();
    busybox(&["insmod", &module, "n_devs=1"]);
}

/// Where the virtual sensor reads its script.
pub fn sensor_folder() -> PathBuf {
    std::env::var_os("KINLIGHT_VIRTUAL_SENSOR").expect("set by run.sh").into()
}
