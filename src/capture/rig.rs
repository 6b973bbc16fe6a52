//! From decoded pictures to delivered ones: metres, rectified, registered, one camera.

use super::calibration::{Calibration, CameraModel, Disparity, PoseOwner};
use super::photometry::LightCorrector;
use super::rectify::Rectifier;
use super::registration::Registration;
use crate::image::{Image, Size};
use crate::math::{Pinhole, Pose};
use rayon::prelude::*;

#[derive(Debug)]
pub(super) struct Rig {
    pub camera: Pinhole,
    pub color_size: Size,
    pub depth_size: Size,
    pub depth_factor: f64,
    invalid_depth: Vec<u16>,
    /// The depth of each stored value, where that is a disparity.
    depth_from_disparity_m: Option<Vec<f32>>,
    corrector: Option<LightCorrector>,
    rectifier: Option<Rectifier>,
    registration: Option<Registration>,
    /// Where recorded poses are those of the depth camera.
    depth_from_color: Option<Pose>,
    /// Depth as recorded; only where it is registered afterwards.
    recorded_m: Image<f32>,
}

impl Rig {
    /// The calibration must have been checked. Sizes are those of the recorded pictures; a calibration
    /// for another size of the same aspect is scaled, with a warning.
    pub fn new(
        calibration: &Calibration,
        color_size: Size,
        depth_size: Size,
        depth_factor: f64,
        warnings: &mut Vec<String>,
    ) -> Result<Self, String> {
        let mut fit = |camera: &CameraModel, size: Size, which: &str| {
            let fitted = camera.scaled_to(size).ok_or_else(|| {
                let calibrated = camera.size();
                format!("{which} pictures are {size}, the calibration is for {calibrated} and cannot be scaled")
            })?;
            if camera.size() != size {
                warnings
                    .push(format!("{which} calibration scaled from {} to {size}", camera.size()));
            }
            Ok::<_, String>(fitted)
        };
        let color = fit(&calibration.color, color_size, "colour")?;
        let camera = color.pinhole();
        let registration = if calibration.registered && color_size == depth_size {
            None
        } else if calibration.registered {
            // The same view at another resolution: registration resamples it.
            let depth = fit(&calibration.color, depth_size, "depth")?;
            Some(Registration::new(&depth, camera, &Pose::identity()))
        } else {
            let depth = calibration.depth.as_ref().ok_or("the calibration has no depth camera")?;
            let depth = fit(depth, depth_size, "depth")?;
            let transform = calibration.color_from_depth.and_then(|r| r.pose());
            let transform = transform.ok_or("the calibration has no color_from_depth")?;
            check_pair(&color, &depth)?;
            Some(Registration::new(&depth, camera, &transform))
        };
        let of_depth = calibration.poses_of == PoseOwner::Depth;
        let color_from_depth = calibration.color_from_depth.filter(|_| of_depth);
        Ok(Self {
            camera,
            color_size,
            depth_size,
            depth_factor,
            invalid_depth: calibration.invalid_depth.clone(),
            depth_from_disparity_m: calibration.disparity.map(|d| disparity_table(&d)),
            corrector: LightCorrector::new(&calibration.photometry, color_size),
            rectifier: Rectifier::new(&color)?,
            registration,
            depth_from_color: color_from_depth.and_then(|r| r.pose()).map(|p| p.inverse()),
            recorded_m: Image::default(),
        })
    }

    pub fn undistorts(&self) -> bool {
        self.rectifier.is_some()
    }

    pub fn corrects_light(&self) -> bool {
        self.corrector.is_some()
    }

    pub fn world_from_camera(&self, recorded: &Pose) -> Pose {
        match &self.depth_from_color {
            Some(depth_from_color) => recorded * depth_from_color,
            None => *recorded,
        }
    }

    /// Reads and processes both pictures side by side. The first error is returned.
    pub fn frame<E: Send + From<String>>(
        &mut self,
        color: impl FnOnce() -> Result<Image<[u8; 3]>, E> + Send,
        depth: impl FnOnce() -> Result<Image<u16>, E> + Send,
    ) -> Result<(Image<[u8; 3]>, Image<f32>), E> {
        let (color_size, depth_size) = (self.color_size, self.depth_size);
        let (rectifier, registration) = (self.rectifier.as_ref(), self.registration.as_mut());
        let (corrector, invalid) = (self.corrector.as_ref(), self.invalid_depth.as_slice());
        let units = match &self.depth_from_disparity_m {
            Some(table) => Units::Disparity(table),
            None => Units::PerMetre(self.depth_factor as f32),
        };
        let recorded_m = &mut self.recorded_m;
        let (color, depth) = rayon::join(
            || {
                let mut recorded = color()?;
                same_size("colour", recorded.size(), color_size)?;
                if let Some(corrector) = corrector {
                    corrector.correct(&mut recorded);
                }
                match rectifier {
                    Some(rectifier) => rectifier.color(recorded).map_err(E::from),
                    None => Ok(recorded),
                }
            },
            || {
                let stored = depth()?;
                same_size("depth", stored.size(), depth_size)?;
                let mut out = Image::default();
                match (registration, rectifier) {
                    (Some(registration), _) => {
                        metres_from_stored(&stored, units, invalid, recorded_m);
                        registration.register(recorded_m, &mut out);
                    }
                    (None, Some(rectifier)) => {
                        metres_from_stored(&stored, units, invalid, recorded_m);
                        out = rectifier.depth(recorded_m);
                    }
                    (None, None) => metres_from_stored(&stored, units, invalid, &mut out),
                }
                Ok::<_, E>(out)
            },
        );
        Ok((color?, depth?))
    }
}

/// Depth pixels are drawn as large as the colour camera sees them: work grows with the square of the ratio of
/// focal lengths. Where one camera sees ten times as far to each side as the other, that is 100 pictures.
fn check_pair(color: &CameraModel, depth: &CameraModel) -> Result<(), String> {
    const MOST_PICTURES: f64 = 100.0;
    let scale = (color.fx / depth.fx).max(color.fy / depth.fy);
    let pictures = scale * scale * depth.size().pixels() as f64 / color.size().pixels() as f64;
    if pictures <= MOST_PICTURES {
        return Ok(());
    }
    Err(format!(
        "focal lengths of colour ({} {}) and depth ({} {}) cannot be those of one sensor",
        color.fx, color.fy, depth.fx, depth.fy
    ))
}

fn same_size(which: &str, found: Size, sequence: Size) -> Result<(), String> {
    if found == sequence {
        return Ok(());
    }
    Err(format!("{which} picture is {found}, the sequence has {sequence}"))
}

/// What stored depth values are.
#[derive(Clone, Copy)]
enum Units<'a> {
    PerMetre(f32),
    /// The depth of each value.
    Disparity(&'a [f32]),
}

fn disparity_table(disparity: &Disparity) -> Vec<f32> {
    (0..=u16::MAX).map(|d| disparity.depth_m(f64::from(d)) as f32).collect()
}

fn metres_from_stored(stored: &Image<u16>, units: Units, invalid: &[u16], out: &mut Image<f32>) {
    out.reshape(stored.size(), 0.0);
    out.par_rows_mut().for_each(|(y, row)| {
        for (metres, &value) in row.iter_mut().zip(stored.row(y)) {
            *metres = match units {
                _ if invalid.contains(&value) => 0.0,
                // Not times the inverse: the result is the f32 nearest to the stored depth.
                Units::PerMetre(factor) => f32::from(value) / factor,
                Units::Disparity(depth_m) => depth_m[usize::from(value)],
            };
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::calibration::built_in;
    use crate::capture::made_sequences::Made;
    use crate::capture::{CaptureOptions, open_sequence};

    #[test]
    fn invalid_values_are_missing_and_others_exact() {
        let stored = Image::from_vec(Size::new(4, 1), vec![0u16, 1234, 2047, 65535]);
        let mut out = Image::default();
        metres_from_stored(&stored, Units::PerMetre(1000.0), &[0, 2047], &mut out);
        assert_eq!(out.as_slice(), [0.0, 1.234, 0.0, 65.535]);
    }

    #[test]
    fn cameras_that_cannot_be_of_one_sensor_are_refused() {
        // A Kinect's own, and a time-of-flight camera of 120 degrees beside a 4K telephoto lens.
        let model = |width, height, f| CameraModel {
            width,
            height,
            fx: f,
            fy: f,
            cx: 0.5 * width as f64,
            cy: 0.5 * height as f64,
            distortion: Default::default(),
        };
        check_pair(&model(640, 480, 520.0), &model(640, 480, 570.0)).unwrap();
        check_pair(&model(3840, 2160, 3300.0), &model(160, 120, 46.0)).unwrap();
        let mut narrow = model(640, 480, 570.0);
        for f in [10.0, 1e-30] {
            narrow.fy = f;
            assert!(check_pair(&model(640, 480, 520.0), &narrow).unwrap_err().contains("focal"));
        }
    }

    #[test]
    fn disparities_become_depth_and_those_of_no_point_are_missing() {
        let disparity = Disparity { c0: 3.0, c1: -0.0025 };
        let stored = Image::from_vec(Size::new(4, 1), vec![400u16, 800, 1200, 2047]);
        let mut out = Image::default();
        let table = disparity_table(&disparity);
        metres_from_stored(&stored, Units::Disparity(&table), &[2047], &mut out);
        assert_eq!(out.as_slice(), [0.5, 1.0, 0.0, 0.0]);
        assert!((disparity.of_depth(0.5) - 400.0).abs() < 1e-9);
    }

    #[test]
    fn a_recording_of_disparities_is_delivered_in_metres_unless_a_factor_is_given() {
        let made = Made::new();
        let size = Size::new(160, 120);
        made.color("rgb/0.png", size);
        // Stored as 800.
        made.depth("depth/0.png", &Image::new(size, 0.8), 1000.0);
        made.write("rgb.txt", "0.0 rgb/0.png\n");
        made.write("depth.txt", "0.0 depth/0.png\n");
        let mut calibration = built_in("kinect_v1").unwrap();
        calibration.color = calibration.color.scaled_to(size).unwrap();
        calibration.disparity = Some(Disparity { c0: 3.0, c1: -0.0025 });
        made.write("calibration.toml", calibration.to_toml().unwrap());
        let mut sequence = made.open().unwrap();
        assert!(sequence.info().depth_factor_from.contains("disparities"));
        assert_eq!(sequence.frame(0).unwrap().depth_m[(80, 60)], 1.0);
        let options = CaptureOptions { depth_factor: Some(1000.0), ..CaptureOptions::default() };
        let mut sequence = open_sequence(made.path(), &options).unwrap();
        assert!(sequence.info().warnings.iter().any(|w| w.contains("not as disparities")));
        assert_eq!(sequence.frame(0).unwrap().depth_m[(80, 60)], 0.8);
    }
}
