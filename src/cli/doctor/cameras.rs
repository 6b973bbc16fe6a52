//! Cameras, for people.

use kinlight::capture::openni::SensorDetail;
use kinlight::diagnosis::{
    CameraReport, DriverFile, Fate, OpenniReport, SensorReport, UsbCamera, VideoNode,
};

pub fn describe(report: &CameraReport) -> String {
    let mut lines = Vec::new();
    openni(&report.openni, &mut lines);
    list(&mut lines, "USB", "no depth camera that is known to us", &report.usb, usb);
    list(&mut lines, "video devices (V4L2)", "none", &report.video_nodes, video_node);
    lines.join("\n")
}

fn list<T>(
    lines: &mut Vec<String>,
    title: &str,
    none: &str,
    items: &[T],
    describe: impl Fn(&T) -> String,
) {
    lines.push(if items.is_empty() { format!("{title}: {none}") } else { title.to_owned() });
    lines.extend(items.iter().map(|item| format!("  {}", describe(item))));
}

fn openni(report: &OpenniReport, lines: &mut Vec<String>) {
    let Some(library) = &report.library else {
        lines.push("OpenNI2: not usable".to_owned());
        return;
    };
    let version = report.version.as_deref().unwrap_or("of an unknown version");
    lines.push(format!("OpenNI2 {version}: {}", library.display()));
    if let Some(folder) = &report.drivers_folder {
        lines.push(format!("  drivers in {}", folder.display()));
    }
    lines.extend(report.drivers.iter().map(|d| format!("    {}", driver(d))));
    match (&report.devices, &report.devices_error) {
        (Some(devices), _) => list(lines, "sensors", "none is announced", devices, sensor),
        (None, Some(failure)) => lines.push(format!("sensors: {failure}")),
        (None, None) => {}
    }
}

fn driver(driver: &DriverFile) -> String {
    let file = &driver.file;
    match &driver.fate {
        Fate::Loads => format!("{file}: loads"),
        Fate::Ignored => format!("{file}: ignored"),
        Fate::Fails { why } => format!("{file}: does not load: {why}"),
    }
}

fn sensor(sensor: &SensorReport) -> String {
    let found = &sensor.found;
    let mut text = format!("openni:{}: {} {}", found.uri, found.vendor, found.name);
    match (&sensor.detail, &sensor.error) {
        (Some(detail), _) => text += &sensor_detail(detail),
        (None, Some(failure)) => text += &format!("\n    {failure}"),
        (None, None) => {}
    }
    text
}

fn sensor_detail(detail: &SensorDetail) -> String {
    let yes = |on| if on { "yes" } else { "no" };
    let modes = |modes: &[String]| match modes {
        [] => "none".to_owned(),
        modes => modes.join("; "),
    };
    let after = |ms: Option<u64>| ms.map_or("none".to_owned(), |ms| format!("after {ms} ms"));
    let mut text = format!("\n    depth: {}", modes(&detail.depth_modes));
    text += &format!("\n    colour: {}", modes(&detail.color_modes));
    let synchronises = detail.synchronises.map_or("not known", yes);
    text += &format!(
        "\n    registers depth to colour: {}; synchronises them: {synchronises}",
        yes(detail.registers)
    );
    let (depth, color) = (after(detail.first_depth_ms), after(detail.first_color_ms));
    text += &format!("\n    first frames: depth {depth}, colour {color}");
    if let Some(why) = &detail.stream_error {
        text += &format!("\n    {why}");
    }
    text
}

fn usb(camera: &UsbCamera) -> String {
    let mut text = camera.to_string();
    if let Some(speed) = camera.speed_mbit_s {
        text += &format!(", {speed} Mbit/s");
    }
    if let Some(node) = &camera.node {
        text += &match &camera.node_error {
            None => format!(", {}", node.display()),
            Some(error) => format!(", {}: {error}", node.display()),
        };
    }
    if !camera.kernel_drivers.is_empty() {
        text += &format!(", taken by {}", camera.kernel_drivers.join(", "));
    }
    text
}

fn video_node(node: &VideoNode) -> String {
    let name = node.name.as_deref().unwrap_or("without a name");
    match &node.error {
        None => format!("{}: {name}", node.path.display()),
        Some(error) => format!("{}: {name}: {error}", node.path.display()),
    }
}
