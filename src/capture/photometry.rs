//! From a camera's own codes to sRGB, at the door: all that follows, on any device, sees a camera
//! whose codes mean what sRGB says.

use super::calibration::Photometry;
use crate::compositing::SRGB;
use crate::image::{Image, Size};
use crate::math::color::LINEAR_FROM_SRGB8;
use rayon::prelude::*;

/// Undoes response, vignetting and colour primaries of recorded pictures.
#[derive(Debug)]
pub(super) struct LightCorrector {
    size: Size,
    linear_from_code: [[f32; 256]; 3],
    /// What each pixel is multiplied by.
    gain: Vec<f32>,
    srgb_from_camera: [[f32; 3]; 3],
}

impl LightCorrector {
    /// `None` where there is nothing to undo. `size` is that of the recorded pictures.
    pub fn new(photometry: &Photometry, size: Size) -> Option<Self> {
        if photometry.is_none() {
            return None;
        }
        let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let matrix = photometry.color_matrix.unwrap_or(identity);
        Some(Self {
            size,
            linear_from_code: linear_from_code(photometry),
            gain: (0..size.pixels())
                .into_par_iter()
                .map(|i| gain(photometry, i % size.width, i / size.width, size) as f32)
                .collect(),
            srgb_from_camera: matrix.map(|row| row.map(|v| v as f32)),
        })
    }

    /// A channel at its upper end stays there: how much light it was is not known, and what rejects
    /// saturated pixels must find it. `picture` has the size that was given.
    pub fn correct(&self, picture: &mut Image<[u8; 3]>) {
        assert_eq!(picture.size(), self.size, "picture of another camera");
        let width = self.size.width;
        picture.par_rows_mut().with_min_len(16).for_each(|(y, row)| {
            for (pixel, &gain) in row.iter_mut().zip(&self.gain[y * width..]) {
                *pixel = self.pixel(*pixel, gain);
            }
        });
    }

    #[inline(always)]
    fn pixel(&self, codes: [u8; 3], gain: f32) -> [u8; 3] {
        let light: [f32; 3] =
            std::array::from_fn(|c| gain * self.linear_from_code[c][usize::from(codes[c])]);
        std::array::from_fn(|c| {
            let [r, g, b] = self.srgb_from_camera[c];
            let corrected = SRGB.encode(r * light[0] + g * light[1] + b * light[2]);
            if codes[c] == 255 { 255 } else { corrected }
        })
    }
}

/// Linear light of each code, in the camera's own primaries.
pub(crate) fn linear_from_code(photometry: &Photometry) -> [[f32; 256]; 3] {
    match &photometry.response {
        Some(response) => response
            .channels()
            .map(|curve| std::array::from_fn(|code| curve.get(code).map_or(1.0, |v| *v as f32))),
        None => [*LINEAR_FROM_SRGB8; 3],
    }
}

/// What light at a pixel of a recorded picture is multiplied by to undo the vignetting.
pub(crate) fn gain(photometry: &Photometry, x: usize, y: usize, size: Size) -> f64 {
    photometry
        .vignetting
        .map_or(1.0, |v| 1.0 / v.share(v.radius2(x as f64, y as f64, size.width, size.height)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::Calibration;
    use crate::capture::calibration::{Response, Vignetting, built_in};
    use crate::capture::made_sequences::Made;

    const SIZE: Size = Size::new(67, 43);

    fn photometry() -> Photometry {
        let curve = |gamma: f64| (0..256).map(|i| (f64::from(i) / 255.0).powf(gamma)).collect();
        Photometry {
            color_matrix: Some([[1.3, -0.2, -0.1], [-0.1, 1.2, -0.1], [0.0, -0.3, 1.3]]),
            vignetting: Some(Vignetting { center: [0.45, 0.55], falloff: [-0.4, -0.1, 0.02] }),
            response: Some(Response { red: curve(2.0), green: curve(2.2), blue: curve(1.8) }),
        }
    }

    #[test]
    fn a_picture_taken_with_the_faults_comes_out_without_them() {
        let p = photometry();
        let m = nalgebra::Matrix3::from_fn(|i, j| p.color_matrix.unwrap()[i][j]);
        let camera_from_srgb = m.try_inverse().unwrap();
        let mut worst = 0;
        let mut picture = Image::new(SIZE, [0u8; 3]);
        let truth = |x: usize, y: usize| [40 + x as u8, 60 + y as u8, 80 + (x + y) as u8 / 2];
        for (x, y) in (0..SIZE.pixels()).map(|i| (i % SIZE.width, i / SIZE.width)) {
            let light = truth(x, y).map(|c| f64::from(LINEAR_FROM_SRGB8[usize::from(c)]));
            let light = camera_from_srgb * nalgebra::Vector3::from(light) / gain(&p, x, y, SIZE);
            let code = |c: usize, gamma: f64| (255.0 * light[c].powf(1.0 / gamma)).round() as u8;
            picture.row_mut(y)[x] = [code(0, 2.0), code(1, 2.2), code(2, 1.8)];
        }
        LightCorrector::new(&p, SIZE).unwrap().correct(&mut picture);
        for (x, y) in (0..SIZE.pixels()).map(|i| (i % SIZE.width, i / SIZE.width)) {
            for (found, true_code) in picture.row(y)[x].iter().zip(truth(x, y)) {
                worst = worst.max(found.abs_diff(true_code));
            }
        }
        // Half a code of each recorded channel, times matrix and gain (at most 1.3 + 0.3 and 1.7 of a
        // curve as steep as sRGB's): 1.4, and half a code of the result.
        assert!(worst <= 2, "{worst}");
    }

    #[test]
    fn a_recording_is_delivered_as_its_calibration_says() {
        let made = Made::new();
        let size = Size::new(160, 120);
        made.color("rgb/0.png", size);
        made.flat_depth("depth/0.png");
        made.write("rgb.txt", "0.0 rgb/0.png\n");
        made.write("depth.txt", "0.0 depth/0.png\n");
        let mut calibration = built_in("kinect_v1").unwrap();
        calibration.color = calibration.color.scaled_to(size).unwrap();
        let frame = |calibration: &Calibration| {
            made.write("calibration.toml", calibration.to_toml().unwrap());
            let mut sequence = made.open().unwrap();
            assert_eq!(sequence.info().light_corrected, !calibration.photometry.is_none());
            sequence.frame(0).unwrap().color
        };
        let plain = frame(&calibration);
        let swap = [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
        calibration.photometry.color_matrix = Some(swap);
        let swapped = frame(&calibration);
        assert_eq!(plain[(9, 50)], [9, 50, 77]);
        for (a, b) in plain.as_slice().iter().zip(swapped.as_slice()) {
            assert_eq!([a[1], a[0], a[2]], *b);
        }
    }

    #[test]
    fn saturated_channels_stay_so_and_nothing_to_undo_is_no_corrector() {
        let mut picture = Image::new(SIZE, [255u8, 10, 255]);
        LightCorrector::new(&photometry(), SIZE).unwrap().correct(&mut picture);
        assert!(picture.as_slice().iter().all(|p| p[0] == 255 && p[2] == 255));
        assert!(LightCorrector::new(&Photometry::default(), SIZE).is_none());
        let neutral = Photometry {
            color_matrix: Some([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
            ..Photometry::default()
        };
        let corrector = LightCorrector::new(&neutral, Size::new(256, 1)).unwrap();
        let codes: Vec<_> = (0..=255u8).map(|c| [c; 3]).collect();
        let mut picture = Image::from_vec(Size::new(256, 1), codes.clone());
        corrector.correct(&mut picture);
        assert_eq!(picture.as_slice(), codes);
    }
}
