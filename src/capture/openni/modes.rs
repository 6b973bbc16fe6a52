//! Which of a sensor's video modes is used.

use super::ffi::{self, VideoMode};

/// What is asked of a camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    pub size: Option<[usize; 2]>,
    pub fps: Option<u32>,
}

/// What is best where nothing is asked: the resolution of the sensors' depth, in real time.
const USUAL_PIXELS: i64 = 640 * 480;
const USUAL_FPS: i64 = 30;

/// The mode of a format in `formats`, the first preferred, that is what is wanted, else as near to VGA at
/// 30 frames a second as there is.
pub fn choose(offered: &[VideoMode], formats: &[i32], wanted: Wanted) -> Result<VideoMode, String> {
    let fits = |mode: &&VideoMode| {
        let size = [mode.width, mode.height].map(|v| usize::try_from(v).unwrap_or(0));
        formats.contains(&mode.pixel_format)
            && size.iter().all(|&v| v > 0)
            && mode.fps > 0
            && wanted.size.is_none_or(|w| w == size)
            && wanted.fps.is_none_or(|w| i64::from(w) == i64::from(mode.fps))
    };
    let cost = |mode: &&VideoMode| {
        let pixels = i64::from(mode.width) * i64::from(mode.height);
        let format = formats.iter().position(|&f| f == mode.pixel_format);
        ((pixels - USUAL_PIXELS).abs(), (i64::from(mode.fps) - USUAL_FPS).abs(), format)
    };
    let best = offered.iter().filter(fits).min_by_key(cost).copied();
    best.ok_or_else(|| {
        let all: Vec<_> = offered.iter().map(describe).collect();
        format!("no such mode; there are: {}", all.join(", "))
    })
}

pub fn describe(mode: &VideoMode) -> String {
    let format = match mode.pixel_format {
        ffi::DEPTH_1_MM => "depth in mm".to_owned(),
        ffi::DEPTH_100_UM => "depth in 0.1 mm".to_owned(),
        ffi::RGB888 => "RGB".to_owned(),
        other => format!("format {other}"),
    };
    format!("{}x{} {format}, {}/s", mode.width, mode.height, mode.fps)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mode(pixel_format: i32, width: i32, height: i32, fps: i32) -> VideoMode {
        VideoMode { pixel_format, width, height, fps }
    }

    #[test]
    fn vga_at_thirty_unless_something_else_is_wanted() {
        let offered = [
            mode(201, 640, 480, 30),
            mode(ffi::RGB888, 1280, 1024, 30),
            mode(ffi::RGB888, 640, 480, 60),
            mode(ffi::RGB888, 640, 480, 30),
            mode(ffi::RGB888, 320, 240, 30),
            mode(ffi::RGB888, 0, 0, 30),
        ];
        let choose = |size, fps| choose(&offered, &[ffi::RGB888], Wanted { size, fps });
        assert_eq!(choose(None, None), Ok(offered[3]));
        assert_eq!(choose(None, Some(60)), Ok(offered[2]));
        assert_eq!(choose(Some([320, 240]), None), Ok(offered[4]));
        let none = choose(Some([800, 600]), None).unwrap_err();
        assert!(none.contains("1280x1024 RGB, 30/s") && none.contains("format 201"), "{none}");
        assert!(choose(Some([0, 0]), None).is_err());
    }
}
