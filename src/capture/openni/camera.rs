//! The camera of delivered frames: from a calibration, else from what the device says of its lens.

use super::ffi;
use super::ffi::VideoMode;
use crate::capture::calibration::{self, Calibration, CameraModel, Distortion, KINECT_V1};
use crate::capture::rig::Rig;
use crate::image::Size;
use std::path::Path;

pub fn size(mode: &VideoMode) -> Size {
    Size::new(mode.width.max(0) as usize, mode.height.max(0) as usize)
}

/// Depth units per metre.
pub fn depth_factor(mode: &VideoMode) -> f64 {
    if mode.pixel_format == ffi::DEPTH_100_UM { 10_000.0 } else { 1_000.0 }
}

/// What is known about a device's cameras.
pub struct Known<'a> {
    pub depth: VideoMode,
    pub color_size: Size,
    pub color_fov: Option<[f32; 2]>,
    /// Depth comes as the colour camera sees it; `None` where no one says.
    pub registered: Option<bool>,
    pub calibration: Option<&'a Path>,
    pub depth_factor: Option<f64>,
}

/// How frames are processed, and where its numbers are from.
pub struct Setup {
    pub rig: Rig,
    pub camera_from: String,
    pub registered: bool,
    pub notes: Vec<String>,
}

const UNREGISTERED: &str = "depth is not registered to colour: the device does not offer it, and without a calibration with \
     [depth] and [color_from_depth] the distance between the cameras stays as an error";

pub fn set_up(known: &Known) -> Result<Setup, String> {
    let mut notes = Vec::new();
    let (color_size, depth_size) = (known.color_size, size(&known.depth));
    let (mut calibration, camera_from) = match known.calibration {
        Some(path) => {
            let read = Calibration::read(path, Some(color_size)).map_err(|e| e.to_string())?;
            (read, path.display().to_string())
        }
        None => without_calibration(known, color_size, &mut notes)?,
    };
    if known.registered == Some(true) {
        calibration.registered = true;
    }
    notes.push(match (known.registered, calibration.registered, known.calibration) {
        (Some(true), ..) => "depth is registered to colour by the device".into(),
        (_, false, _) => format!("depth is registered to colour here, by {camera_from}"),
        (_, true, Some(_)) => {
            format!("depth counts as registered to colour: {camera_from} says so")
        }
        (Some(false), ..) => UNREGISTERED.into(),
        (None, ..) => {
            "the recording does not say whether depth is registered to colour: it is taken as \
                       it is"
                .into()
        }
    });
    let factor = known.depth_factor.unwrap_or_else(|| depth_factor(&known.depth));
    let registered = calibration.registered;
    let rig = Rig::new(&calibration, color_size, depth_size, factor, &mut notes)
        .map_err(|problem| format!("calibration ({camera_from}): {problem}"))?;
    Ok(Setup { rig, camera_from, registered, notes })
}

/// Of a colour camera that is none of the device's: only a calibration says how the two stand.
pub fn set_up_beside(
    depth: &VideoMode,
    color_size: Size,
    calibration: Option<&Path>,
) -> Result<Setup, String> {
    let path = calibration.ok_or(
        "a colour camera beside the sensor needs a calibration with [color], [depth] and \
         [color_from_depth]: give its file",
    )?;
    let camera_from = path.display().to_string();
    let mut calibration = Calibration::read(path, Some(color_size)).map_err(|e| e.to_string())?;
    let parts = [
        ("[depth]", calibration.depth.is_none()),
        ("[color_from_depth]", calibration.color_from_depth.is_none()),
    ];
    let missing: Vec<_> = parts.iter().filter(|(_, missing)| *missing).map(|p| p.0).collect();
    if !missing.is_empty() {
        let missing = missing.join(" and ");
        return Err(format!(
            "{camera_from} has no {missing}: without it no one knows how the colour camera stands \
             beside the sensor"
        ));
    }
    let mut notes = vec![format!("depth is registered to colour here, by {camera_from}")];
    if std::mem::replace(&mut calibration.registered, false) {
        notes.push(format!(
            "{camera_from} counts depth as registered, which it is not to a camera beside the sensor"
        ));
    }
    let factor = depth_factor(depth);
    let rig = Rig::new(&calibration, color_size, size(depth), factor, &mut notes)
        .map_err(|problem| format!("calibration ({camera_from}): {problem}"))?;
    Ok(Setup { rig, camera_from, registered: false, notes })
}

fn without_calibration(
    known: &Known,
    color_size: Size,
    notes: &mut Vec<String>,
) -> Result<(Calibration, String), String> {
    if let Some(model) = known.color_fov.and_then(|fov| from_fov(color_size, fov)) {
        let from = "the device's field of view";
        return Ok((Calibration::registered("openni2", model), from.into()));
    }
    let kinect =
        calibration::built_in(KINECT_V1).filter(|k| k.color.scaled_to(color_size).is_some());
    let kinect = kinect.ok_or_else(|| {
        format!(
            "the device does not say its field of view at {color_size}: give a calibration file"
        )
    })?;
    notes.push("the device does not say its field of view: a nominal Kinect v1 is assumed".into());
    Ok((kinect, format!("assumed {KINECT_V1}")))
}

/// A pinhole in the middle of the picture. `None` where an angle makes no picture.
fn from_fov(size: Size, fov: [f32; 2]) -> Option<CameraModel> {
    let focal = |pixels: usize, angle: f32| {
        let f = 0.5 * pixels as f64 / (0.5 * f64::from(angle)).tan();
        (angle > 0.01 && angle < 3.1 && f.is_finite()).then_some(f)
    };
    Some(CameraModel {
        width: size.width,
        height: size.height,
        fx: focal(size.width, fov[0])?,
        fy: focal(size.height, fov[1])?,
        cx: 0.5 * (size.width as f64 - 1.0),
        cy: 0.5 * (size.height as f64 - 1.0),
        distortion: Distortion::None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn field_of_view_and_focal_length_agree() {
        let model = from_fov(Size::new(640, 480), [1.0, 0.8]).unwrap();
        // From the left edge of the first pixel to the right edge of the last.
        let angle = 2.0 * (320.0 / model.fx).atan();
        assert!((angle - 1.0).abs() < 1e-7, "{angle}");
        assert_eq!((model.cx, model.cy), (319.5, 239.5));
        for broken in [0.0, -1.0, f32::NAN, 3.2, f32::INFINITY] {
            assert!(from_fov(Size::new(640, 480), [broken, 0.8]).is_none(), "{broken}");
        }
    }

    fn known(color_fov: Option<[f32; 2]>) -> Known<'static> {
        let pixel_format = ffi::DEPTH_1_MM;
        Known {
            depth: VideoMode { pixel_format, width: 640, height: 480, fps: 30 },
            color_size: Size::new(640, 480),
            color_fov,
            registered: Some(false),
            calibration: None,
            depth_factor: None,
        }
    }

    #[test]
    fn what_is_assumed_is_said() {
        let setup = set_up(&known(None)).unwrap();
        assert!(setup.notes.iter().any(|n| n.contains("nominal Kinect")), "{:?}", setup.notes);
        let setup = set_up(&known(Some([1.0, 0.8]))).unwrap();
        assert!(setup.notes.iter().any(|n| n.contains("not registered")), "{:?}", setup.notes);
        let odd = Known { color_size: Size::new(67, 43), ..known(None) };
        let error = set_up(&odd).err().expect("no such Kinect");
        assert!(error.contains("give a calibration"), "{error}");
    }
}
