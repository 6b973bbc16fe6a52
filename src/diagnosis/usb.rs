//! Depth cameras on USB: how fast, who may open them, and what holds them.

use super::known::{self, Driver, Part};
use super::machine::{attribute, entries, file_name};
use super::openni::OpenniReport;
use super::{Machine, Problem};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// High speed. Depth and colour at 640x480 take some 300 of it.
const NEEDED_MBIT_S: f64 = 480.0;

/// A part of a depth camera that is plugged in.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct UsbCamera {
    /// Vendor and product, as `lsusb` prints them.
    pub id: String,
    pub name: &'static str,
    pub part: Part,
    pub driver: Driver,
    pub speed_mbit_s: Option<f64>,
    pub bus: Option<u32>,
    /// `/dev/bus/usb/BUS/DEVICE`, and why it cannot be written, where it cannot.
    pub node: Option<PathBuf>,
    pub node_error: Option<String>,
    #[serde(skip)]
    denied: bool,
    /// Drivers of the kernel that have taken its interfaces.
    pub kernel_drivers: Vec<String>,
}

impl std::fmt::Display for UsbCamera {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({})", self.name, self.id)
    }
}

pub(super) fn find(machine: &Machine) -> Vec<UsbCamera> {
    let all = entries(&machine.sys.join("bus/usb/devices"));
    all.iter().filter_map(|device| camera(device, &all, machine)).collect()
}

fn camera(device: &Path, all: &[PathBuf], machine: &Machine) -> Option<UsbCamera> {
    let id = |name| u16::from_str_radix(&attribute(device, name)?, 16).ok();
    let (vendor, product) = (id("idVendor")?, id("idProduct")?);
    let known = known::find(vendor, product)?;
    let number = |name| attribute(device, name)?.parse::<u32>().ok();
    let bus = number("busnum");
    let node = bus.zip(number("devnum"));
    let node = node.map(|(bus, dev)| machine.dev.join(format!("bus/usb/{bus:03}/{dev:03}")));
    let error = node.as_ref().and_then(|node| (machine.open)(node).err());
    // Its interfaces are entries beside it: "1-2" has "1-2:1.0".
    let prefix = format!("{}:", file_name(device));
    let interfaces = all.iter().filter(|path| file_name(path).starts_with(&prefix));
    let drivers = interfaces.filter_map(|path| path.join("driver").read_link().ok());
    Some(UsbCamera {
        id: format!("{vendor:04x}:{product:04x}"),
        name: known.name,
        part: known.part,
        driver: known.driver,
        speed_mbit_s: attribute(device, "speed").and_then(|text| text.parse().ok()),
        bus,
        node,
        denied: error.as_ref().is_some_and(|e| e.kind() == ErrorKind::PermissionDenied),
        node_error: error.map(|e| e.to_string()),
        kernel_drivers: drivers.map(|path| file_name(&path)).collect(),
    })
}

pub(super) fn problems(
    cameras: &[UsbCamera],
    machine: &Machine,
    openni: &OpenniReport,
) -> Vec<Problem> {
    let mut problems = Vec::new();
    let of_depth = || cameras.iter().filter(|c| c.part == Part::Depth);
    for camera in of_depth() {
        problems.extend(slow(camera));
        problems.extend(without_driver(camera, openni));
        problems.extend(taken_by_kernel(camera, machine));
    }
    // A motor has a node of its own, which the driver opens, too. The V4L2 node of a colour camera counts.
    let opened = |c: &&UsbCamera| matches!(c.part, Part::Depth | Part::Motor);
    problems.extend(cameras.iter().filter(opened).filter_map(closed));
    problems.extend(without_power(cameras));
    problems.extend(crowded(of_depth()));
    problems
}

fn slow(camera: &UsbCamera) -> Option<Problem> {
    let speed = camera.speed_mbit_s.filter(|&speed| speed < NEEDED_MBIT_S)?;
    Some(Problem::new(
        format!("{camera} is connected at {speed} Mbit/s, and depth needs {NEEDED_MBIT_S}"),
        "plug it into another port, without a hub between and with another cable",
    ))
}

fn closed(camera: &UsbCamera) -> Option<Problem> {
    let (node, error) = (camera.node.as_ref()?.display(), camera.node_error.as_ref()?);
    let (vendor, product) = camera.id.split_once(':')?;
    let fix = if camera.denied {
        format!(
            "put the line SUBSYSTEM==\"usb\", ATTR{{idVendor}}==\"{vendor}\", ATTR{{idProduct}}==\"{product}\", \
             MODE=\"0666\" into /etc/udev/rules.d/60-depth-camera.rules and plug the camera in again"
        )
    } else {
        "close other programs that use it, and in a container pass /dev/bus/usb on to it".into()
    };
    Some(Problem::new(format!("{camera}: {node} cannot be opened ({error})"), fix))
}

/// The kernel's webcam driver for Kinects takes their camera before OpenNI2 can.
fn taken_by_kernel(camera: &UsbCamera, machine: &Machine) -> Option<Problem> {
    let module = "gspca_kinect";
    // It names itself "kinect" where it is bound.
    let bound = camera.kernel_drivers.iter().any(|d| d == "kinect" || d == module);
    let loaded = camera.driver == Driver::Freenect && machine.has_module(module);
    (bound || loaded).then(|| {
        Problem::new(
            format!("{camera} is taken by the kernel's module {module}"),
            format!(
                "run `sudo modprobe -r {module}`, and to keep it away put `blacklist {module}` into \
                 /etc/modprobe.d/kinect.conf"
            ),
        )
    })
}

fn without_driver(camera: &UsbCamera, openni: &OpenniReport) -> Option<Problem> {
    let folder = openni.drivers_folder.as_ref()?;
    if openni.working_drivers().any(|file| camera.driver.is_in(file)) {
        return None;
    }
    // One that is there and does not work has a problem of its own.
    if openni.drivers.iter().any(|driver| camera.driver.is_in(&driver.file)) {
        return None;
    }
    Some(Problem::new(
        format!("OpenNI2 has no driver for {camera} in {}", folder.display()),
        format!("put {} there, as lib*{}", camera.driver.package(), openni.driver_ending),
    ))
}

/// A Kinect's motor runs on USB's power, its camera does not.
fn without_power(cameras: &[UsbCamera]) -> Option<Problem> {
    let of_kinect =
        |part| cameras.iter().find(move |c| c.driver == Driver::Freenect && c.part == part);
    let motor = of_kinect(Part::Motor)?;
    of_kinect(Part::Depth).is_none().then(|| {
        Problem::new(
            format!("{motor} is there without its camera"),
            "plug in the Kinect's own power supply",
        )
    })
}

fn crowded<'a>(cameras: impl Iterator<Item = &'a UsbCamera>) -> Vec<Problem> {
    let mut by_bus = BTreeMap::<u32, Vec<&UsbCamera>>::new();
    for camera in cameras {
        // Faster buses carry several.
        let shared = camera.speed_mbit_s.is_some_and(|speed| speed <= NEEDED_MBIT_S);
        if let Some(bus) = camera.bus.filter(|_| shared) {
            by_bus.entry(bus).or_default().push(camera);
        }
    }
    let crowds = by_bus.into_iter().filter(|(_, cameras)| cameras.len() > 1);
    let problem = |(bus, cameras): (u32, Vec<&UsbCamera>)| {
        let names: Vec<_> = cameras.iter().map(ToString::to_string).collect();
        Problem::new(
            format!("{} share USB bus {bus}, which has room for one", names.join(" and ")),
            "plug them into ports of different USB controllers (`lsusb -t` says which share one)",
        )
    };
    crowds.map(problem).collect()
}
