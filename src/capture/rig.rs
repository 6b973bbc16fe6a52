//! From decoded pictures to delivered ones: metres, rectified, registered, one camera.

use super::calibration::{Calibration, PoseOwner};
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
        let mut fit = |camera: &super::calibration::CameraModel, size: Size, which: &str| {
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
            Some(Registration::new(&depth, camera, &Pose::identity())?)
        } else {
            let depth = calibration.depth.as_ref().ok_or("the calibration has no depth camera")?;
            let depth = fit(depth, depth_size, "depth")?;
            let transform = calibration.color_from_depth.and_then(|r| r.pose());
            let transform = transform.ok_or("the calibration has no color_from_depth")?;
            Some(Registration::new(&depth, camera, &transform)?)
        };
        let of_depth = calibration.poses_of == PoseOwner::Depth;
        let color_from_depth = calibration.color_from_depth.filter(|_| of_depth);
        Ok(Self {
            camera,
            color_size,
            depth_size,
            depth_factor,
            invalid_depth: calibration.invalid_depth.clone(),
            rectifier: Rectifier::new(&color)?,
            registration,
            depth_from_color: color_from_depth.and_then(|r| r.pose()).map(|p| p.inverse()),
            recorded_m: Image::default(),
        })
    }

    pub fn undistorts(&self) -> bool {
        self.rectifier.is_some()
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
        let (factor, invalid) = (self.depth_factor as f32, self.invalid_depth.as_slice());
        let recorded_m = &mut self.recorded_m;
        let (color, depth) = rayon::join(
            || {
                let recorded = color()?;
                same_size("colour", recorded.size(), color_size)?;
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
                        metres_from_stored(&stored, factor, invalid, recorded_m);
                        registration.register(recorded_m, &mut out);
                    }
                    (None, Some(rectifier)) => {
                        metres_from_stored(&stored, factor, invalid, recorded_m);
                        out = rectifier.depth(recorded_m);
                    }
                    (None, None) => metres_from_stored(&stored, factor, invalid, &mut out),
                }
                Ok::<_, E>(out)
            },
        );
        Ok((color?, depth?))
    }
}

fn same_size(which: &str, found: Size, sequence: Size) -> Result<(), String> {
    if found == sequence {
        return Ok(());
    }
    Err(format!("{which} picture is {found}, the sequence has {sequence}"))
}

/// Division, not multiplication by the inverse: the result is the f32 nearest to the stored depth.
fn metres_from_stored(stored: &Image<u16>, factor: f32, invalid: &[u16], out: &mut Image<f32>) {
    out.reshape(stored.size(), 0.0);
    out.par_rows_mut().for_each(|(y, row)| {
        for (metres, &value) in row.iter_mut().zip(stored.row(y)) {
            let missing = invalid.contains(&value);
            *metres = if missing { 0.0 } else { f32::from(value) / factor };
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_values_are_missing_and_others_exact() {
        let stored = Image::from_vec(Size::new(4, 1), vec![0u16, 1234, 2047, 65535]);
        let mut out = Image::default();
        metres_from_stored(&stored, 1000.0, &[0, 2047], &mut out);
        assert_eq!(out.as_slice(), [0.0, 1.234, 0.0, 65.535]);
    }
}
