//! Made trees of `/sys`, `/dev` and `/proc`.

use super::known::{Driver, Part};
use super::openni::{DriverFile, Fate, OpenniReport};
use super::{Machine, Problem, UsbCamera, usb, video_nodes};
use std::fs;
use std::io;
use std::path::Path;
use tempfile::TempDir;

/// Opens nothing that has "locked" in it; tests may run as root, whom no permission stops.
fn open(path: &Path) -> io::Result<()> {
    match fs::read_to_string(path)?.as_str() {
        "locked" => Err(io::ErrorKind::PermissionDenied.into()),
        _ => Ok(()),
    }
}

struct Made {
    folder: TempDir,
    machine: Machine,
}

impl Made {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let machine = Machine { sys: at("sys"), dev: at("dev"), proc: at("proc"), open };
        Self { folder, machine }
    }

    fn write(&self, path: &str, content: &str) {
        let path = self.folder.path().join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }

    /// A device in port `port` of a bus; its number is the port's.
    fn plug(&self, bus: u32, port: u32, id: &str, speed: &str, node: &str) {
        let folder = format!("sys/bus/usb/devices/{bus}-{port}");
        let (vendor, product) = id.split_once(':').unwrap();
        let (bus_text, port_text) = (bus.to_string(), port.to_string());
        let attributes = [
            ("idVendor", vendor),
            ("idProduct", product),
            ("speed", speed),
            ("busnum", &bus_text),
            ("devnum", &port_text),
        ];
        for (name, value) in attributes {
            self.write(&format!("{folder}/{name}"), &format!("{value}\n"));
        }
        self.write(&format!("dev/bus/usb/{bus:03}/{port:03}"), node);
    }

    fn bind(&self, interface: &str, driver: &str) {
        #[cfg(unix)]
        {
            let folder = self.folder.path().join("sys/bus/usb/devices").join(interface);
            fs::create_dir_all(&folder).unwrap();
            let target = format!("../../../../bus/usb/drivers/{driver}");
            std::os::unix::fs::symlink(target, folder.join("driver")).unwrap();
        }
    }

    fn cameras(&self) -> Vec<UsbCamera> {
        usb::find(&self.machine)
    }

    fn problems(&self, drivers: &[&str]) -> Vec<Problem> {
        usb::problems(&self.cameras(), &self.machine, &library_with(drivers))
    }
}

/// A library whose drivers all load.
fn library_with(drivers: &[&str]) -> OpenniReport {
    let loads = |file: &&str| DriverFile { file: (*file).to_owned(), fate: Fate::Loads };
    OpenniReport {
        library: Some("/lib/libOpenNI2.so.0".into()),
        version: Some("2.2.0.33".into()),
        drivers_folder: Some("/lib/OpenNI2/Drivers".into()),
        driver_ending: ".so.0".into(),
        drivers: drivers.iter().map(loads).collect(),
        devices: Some(Vec::new()),
        library_error: None,
        devices_error: None,
    }
}

const XTION: &str = "1d27:0601";
const PS1080: &[&str] = &["libOniFile.so.0", "libPS1080.so.0"];
const FREENECT: &[&str] = &["libFreenectDriver.so.0"];

fn only(problems: &[Problem]) -> &Problem {
    assert_eq!(problems.len(), 1, "{problems:?}");
    &problems[0]
}

#[test]
fn a_camera_in_good_order_has_no_problem() {
    let made = Made::new();
    made.plug(2, 4, XTION, "480", "");
    made.plug(2, 5, "046d:c077", "1.5", "locked"); // a mouse
    made.write("sys/bus/usb/devices/usb2/idVendor", "1d6b\n"); // a root hub, without more
    let cameras = made.cameras();
    assert_eq!(cameras.len(), 1, "{cameras:?}");
    let camera = &cameras[0];
    assert_eq!((camera.id.as_str(), camera.part), (XTION, Part::Depth));
    assert_eq!((camera.speed_mbit_s, camera.bus), (Some(480.0), Some(2)));
    assert_eq!(camera.node.as_deref(), Some(&*made.machine.dev.join("bus/usb/002/004")));
    assert_eq!((&camera.node_error, &camera.kernel_drivers), (&None, &Vec::new()));
    assert_eq!(made.problems(PS1080), []);
    assert_eq!(Made::new().cameras(), [], "without a sysfs");
}

#[test]
fn a_slow_port_is_named_with_what_is_needed() {
    for speed in ["12", "1.5"] {
        let made = Made::new();
        made.plug(1, 2, XTION, speed, "");
        let problems = made.problems(PS1080);
        let problem = only(&problems);
        assert!(problem.what.contains(&format!("{speed} Mbit/s")), "{problem:?}");
        assert!(problem.what.contains("needs 480"), "{problem:?}");
    }
}

#[test]
fn two_cameras_on_one_bus_are_a_problem_and_on_two_are_none() {
    let made = Made::new();
    made.plug(1, 2, XTION, "480", "");
    made.plug(3, 2, "1d27:0609", "480", "");
    assert_eq!(made.problems(PS1080), []);
    made.plug(1, 3, "1d27:0600", "480", "");
    let problems = made.problems(PS1080);
    let what = &only(&problems).what;
    assert!(what.contains("share USB bus 1") && what.contains(XTION), "{what}");
    assert!(!what.contains("0609"), "{what}");
    // The bus of faster ports carries both.
    let fast = Made::new();
    fast.plug(4, 1, XTION, "5000", "");
    fast.plug(4, 2, "1d27:0609", "5000", "");
    assert_eq!(fast.problems(PS1080), []);
}

#[test]
fn a_node_that_may_not_be_written_gets_its_udev_rule() {
    let made = Made::new();
    made.plug(1, 2, XTION, "480", "locked");
    let problems = made.problems(PS1080);
    let problem = only(&problems);
    assert!(problem.what.contains("bus/usb/001/002"), "{problem:?}");
    let rule = "ATTR{idVendor}==\"1d27\", ATTR{idProduct}==\"0601\", MODE=\"0666\"";
    assert!(problem.fix.contains(rule), "{problem:?}");
    // In a container the node may be missing.
    fs::remove_file(made.machine.dev.join("bus/usb/001/002")).unwrap();
    let problems = made.problems(PS1080);
    assert!(only(&problems).fix.contains("container"), "{problems:?}");
}

#[test]
fn each_camera_needs_its_driver_and_is_told_where_it_is() {
    for (id, driver, package) in [
        (XTION, "libPS1080.so.0", "libopenni2-0"),
        ("2bc5:0401", "liborbbec.so.0", "SDK of Orbbec"),
        ("045e:02ae", "libFreenectDriver.so.0", "libfreenect"),
        ("045e:02bf", "libFreenectDriver.so.0", "libfreenect"),
    ] {
        let made = Made::new();
        made.plug(1, 2, id, "480", "");
        assert_eq!(made.problems(&[driver]), [], "{id}");
        let problems = made.problems(&["libOniFile.so.0"]);
        let problem = only(&problems);
        assert!(problem.what.contains(id), "{problem:?}");
        assert!(problem.fix.contains(package) && problem.fix.contains("lib*.so.0"), "{problem:?}");
    }
}

#[test]
fn a_driver_that_does_not_load_is_one_problem_and_not_two() {
    let made = Made::new();
    made.plug(1, 2, XTION, "480", "");
    let mut library = library_with(&[]);
    let fate = Fate::Fails { why: "no".into() };
    library.drivers.push(DriverFile { file: "libPS1080.so.0".into(), fate });
    assert_eq!(usb::problems(&made.cameras(), &made.machine, &library), []);
    let problems = library.problems();
    assert!(
        problems.iter().any(|p| p.what.contains("libPS1080.so.0 does not load")),
        "{problems:?}"
    );
}

#[cfg(unix)]
#[test]
fn the_kernels_module_that_holds_a_kinect_is_named() {
    let kinect = |bound: bool, loaded: bool| {
        let made = Made::new();
        made.plug(1, 2, "045e:02ae", "480", "");
        if bound {
            made.bind("1-2:1.0", "kinect");
        }
        let modules = if loaded { "gspca_kinect 16384 0 - Live 0x0\n" } else { "gspca_main 1 0\n" };
        made.write("proc/modules", modules);
        made.problems(FREENECT)
    };
    assert_eq!(kinect(false, false), []);
    for (bound, loaded) in [(true, true), (true, false), (false, true)] {
        let problems = kinect(bound, loaded);
        let problem = only(&problems);
        assert!(problem.what.contains("gspca_kinect"), "{problem:?}");
        assert!(problem.fix.contains("modprobe -r gspca_kinect"), "{problem:?}");
    }
    // The module does nothing to other cameras.
    let made = Made::new();
    made.plug(1, 2, XTION, "480", "");
    made.write("proc/modules", "gspca_kinect 16384 0 - Live 0x0\n");
    assert_eq!(made.problems(PS1080), []);
}

#[test]
fn a_kinect_without_power_shows_its_motor_only() {
    let made = Made::new();
    made.plug(1, 2, "045e:02b0", "12", "");
    let problems = made.problems(FREENECT);
    assert!(only(&problems).fix.contains("power supply"), "{problems:?}");
    made.plug(1, 3, "045e:02ae", "480", "");
    made.plug(1, 4, "045e:02ad", "480", "locked");
    assert_eq!(made.problems(FREENECT), [], "the motor is slow by nature, nobody opens the audio");
    assert!(made.cameras().iter().all(|c| c.driver == Driver::Freenect));
}

#[test]
fn video_nodes_have_names_numbers_and_permissions() {
    let made = Made::new();
    for (number, name, node) in [(10, "Astra RGB", ""), (2, "HD Webcam", "locked")] {
        made.write(&format!("sys/class/video4linux/video{number}/name"), &format!("{name}\n"));
        made.write(&format!("dev/video{number}"), node);
    }
    made.write("sys/class/video4linux/v4l-subdev0/name", "no video node\n");
    let nodes = video_nodes::find(&made.machine);
    let names: Vec<_> = nodes.iter().map(|n| n.name.as_deref().unwrap()).collect();
    assert_eq!(names, ["HD Webcam", "Astra RGB"]);
    let problems = video_nodes::problems(&nodes);
    let problem = only(&problems);
    assert!(problem.what.contains("video2") && problem.fix.contains("group video"), "{problem:?}");
}
