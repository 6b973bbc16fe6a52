//! Which of a camera's modes is used.

use crate::capture::pixel_formats::PixelFormat;
use crate::image::Size;
use std::fmt;

/// What is asked of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    pub size: Size,
    pub rate_hz: f64,
}

impl Wanted {
    /// What is not asked for is VGA at 30 pictures a second: the resolution of the sensors' depth.
    pub fn new(size: Option<[usize; 2]>, fps: Option<u32>) -> Self {
        let [width, height] = size.unwrap_or([640, 480]);
        Self { size: Size::new(width, height), rate_hz: fps.map_or(30.0, f64::from) }
    }
}

/// A format that a camera offers, by its four letters, and the sizes and rates that it has it in.
#[derive(Clone, Debug, PartialEq)]
pub struct Offered {
    pub fourcc: [u8; 4],
    pub name: String,
    pub sizes: Vec<(Sizes, Vec<Rates>)>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sizes {
    One(Size),
    Steps { least: Size, most: Size, step: Size },
}

/// Pictures a second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rates {
    One(f64),
    Between(f64, f64),
}

impl Sizes {
    pub fn nearest(&self, wanted: Size) -> Size {
        let Self::Steps { least, most, step } = *self else {
            let Self::One(size) = *self else { return wanted };
            return size;
        };
        let along = |wanted: usize, least: usize, most: usize, step: usize| {
            let inside = wanted.clamp(least, most.max(least));
            let step = step.max(1);
            let below = least + (inside - least) / step * step;
            let above = below + step;
            if above <= most && above - inside < inside - below { above } else { below }
        };
        Size::new(
            along(wanted.width, least.width, most.width, step.width),
            along(wanted.height, least.height, most.height, step.height),
        )
    }
}

impl Rates {
    fn nearest(self, wanted_hz: f64) -> f64 {
        match self {
            Self::One(hz) => hz,
            Self::Between(least, most) => wanted_hz.min(most).max(least),
        }
    }
}

/// What a camera may be set to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    pub format: PixelFormat,
    pub size: Size,
    /// `None` where the driver lists no rates.
    pub rate_hz: Option<f64>,
}

impl Mode {
    /// Least is best: size counts more than rate, and rate, to the hertz, more than the format.
    fn cost(&self, wanted: &Wanted, formats: &[PixelFormat]) -> (usize, u64, Option<usize>) {
        let size = self.size.width.abs_diff(wanted.size.width)
            + self.size.height.abs_diff(wanted.size.height);
        let rate = self.rate_hz.map_or(0.0, |hz| (hz - wanted.rate_hz).abs().round());
        (size, rate as u64, formats.iter().position(|f| *f == self.format))
    }
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.size, self.format)?;
        match self.rate_hz {
            Some(hz) => write!(f, ", {}/s", Hz(hz)),
            None => Ok(()),
        }
    }
}

/// What there is in these formats, the nearest to what is wanted first.
///
/// # Errors
/// There is nothing; says what there is in other formats.
pub fn ranked(
    offered: &[Offered],
    formats: &[PixelFormat],
    wanted: &Wanted,
) -> Result<Vec<Mode>, String> {
    let mut modes = Vec::new();
    for offer in offered {
        let Some(format) = PixelFormat::from_fourcc(offer.fourcc).filter(|f| formats.contains(f))
        else {
            continue;
        };
        let unlisted = [(Sizes::One(wanted.size), Vec::new())];
        let sizes = if offer.sizes.is_empty() { &unlisted[..] } else { &offer.sizes };
        for (sizes, rates) in sizes {
            let size = sizes.nearest(wanted.size);
            let mode = |rate_hz| Mode { format, size, rate_hz };
            if rates.is_empty() {
                modes.push(mode(None));
            }
            modes.extend(rates.iter().map(|rate| mode(Some(rate.nearest(wanted.rate_hz)))));
        }
    }
    modes.sort_by_key(|mode| mode.cost(wanted, formats));
    if modes.is_empty() { Err(none_of(offered, formats)) } else { Ok(modes) }
}

fn none_of(offered: &[Offered], formats: &[PixelFormat]) -> String {
    let read: Vec<_> = formats.iter().map(ToString::to_string).collect();
    let there: Vec<_> = offered.iter().map(ToString::to_string).collect();
    let there = if there.is_empty() { "none".to_owned() } else { there.join("; ") };
    format!("no mode in a format that is read ({}); there are: {there}", read.join(", "))
}

/// 30, but 29.97.
struct Hz(f64);

impl fmt::Display for Hz {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", (self.0 * 100.0).round() / 100.0)
    }
}

impl fmt::Display for Sizes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::One(size) => size.fmt(f),
            Self::Steps { least, most, step } => write!(f, "{least} to {most} in steps of {step}"),
        }
    }
}

impl fmt::Display for Rates {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::One(hz) => Hz(*hz).fmt(f),
            Self::Between(least, most) => write!(f, "{} to {}", Hz(*least), Hz(*most)),
        }
    }
}

/// A size with its rates.
pub fn in_words((sizes, rates): &(Sizes, Vec<Rates>)) -> String {
    if rates.is_empty() {
        return sizes.to_string();
    }
    let rates: Vec<_> = rates.iter().map(ToString::to_string).collect();
    format!("{sizes} at {}/s", rates.join(", "))
}

impl fmt::Display for Offered {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", String::from_utf8_lossy(&self.fourcc).trim_end())?;
        let sizes: Vec<_> = self.sizes.iter().map(in_words).collect();
        if sizes.is_empty() { Ok(()) } else { write!(f, " {}", sizes.join(", ")) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(width: usize, height: usize, rates: &[f64]) -> (Sizes, Vec<Rates>) {
        let rates = rates.iter().map(|&hz| Rates::One(hz)).collect();
        (Sizes::One(Size::new(width, height)), rates)
    }

    fn offered(fourcc: &[u8; 4], sizes: Vec<(Sizes, Vec<Rates>)>) -> Offered {
        Offered { fourcc: *fourcc, name: String::new(), sizes }
    }

    /// As many webcams are: large pictures are fast only when they are compressed.
    fn webcam() -> Vec<Offered> {
        vec![
            offered(
                b"MJPG",
                vec![
                    one(1280, 720, &[30.0, 15.0]),
                    one(640, 480, &[60.0, 30.0]),
                    one(640, 360, &[]),
                ],
            ),
            offered(b"YUYV", vec![one(1280, 720, &[10.0]), one(640, 480, &[29.97, 15.0])]),
            offered(b"H264", vec![one(800, 600, &[30.0])]),
        ]
    }

    fn best(offered: &[Offered], size: Option<[usize; 2]>, fps: Option<u32>) -> String {
        ranked(offered, &PixelFormat::ALL, &Wanted::new(size, fps)).unwrap()[0].to_string()
    }

    #[test]
    fn the_nearest_is_taken_and_what_was_not_compressed_where_it_is_as_good() {
        let offered = webcam();
        assert_eq!(best(&offered, None, None), "640x480 YUYV, 29.97/s");
        assert_eq!(best(&offered, None, Some(60)), "640x480 MJPG, 60/s");
        assert_eq!(best(&offered, None, Some(15)), "640x480 YUYV, 15/s");
        assert_eq!(best(&offered, Some([1280, 720]), None), "1280x720 MJPG, 30/s");
        assert_eq!(best(&offered, Some([1280, 720]), Some(10)), "1280x720 YUYV, 10/s");
        assert_eq!(best(&offered, Some([800, 600]), None), "640x480 YUYV, 29.97/s");
        assert_eq!(best(&offered, Some([640, 360]), None), "640x360 MJPG");
        let only = [PixelFormat::Mjpeg];
        let modes = ranked(&offered, &only, &Wanted::new(None, None)).unwrap();
        assert_eq!(modes[0].to_string(), "640x480 MJPG, 30/s");
        assert_eq!(modes.len(), 5);
    }

    #[test]
    fn sizes_and_rates_in_steps_are_met_as_nearly_as_they_can() {
        let sizes = Sizes::Steps {
            least: Size::new(16, 16),
            most: Size::new(1920, 1080),
            step: Size::new(16, 2),
        };
        let nearest = |width, height| {
            let size = sizes.nearest(Size::new(width, height));
            (size.width, size.height)
        };
        assert_eq!(nearest(640, 480), (640, 480));
        assert_eq!(nearest(650, 481), (656, 480));
        assert_eq!(nearest(1, 9999), (16, 1080));
        let offered = [offered(b"NV12", vec![(sizes, vec![Rates::Between(1.0, 25.0)])])];
        assert_eq!(best(&offered, None, None), "640x480 NV12, 25/s");
        assert_eq!(best(&offered, Some([650, 481]), Some(5)), "656x480 NV12, 5/s");
        // What a driver must not say, and must not break anything either.
        let odd = Sizes::Steps {
            least: Size::new(64, 64),
            most: Size::new(32, 0),
            step: Size::new(0, 0),
        };
        assert_eq!(odd.nearest(Size::new(640, 480)), Size::new(64, 64));
        assert_eq!(Rates::Between(30.0, 5.0).nearest(20.0), 30.0);
    }

    #[test]
    fn where_nothing_fits_all_that_is_there_is_said() {
        let offered = [
            offered(b"H264", vec![one(800, 600, &[30.0, 29.97])]),
            offered(
                b"Y16 ",
                vec![(
                    Sizes::Steps {
                        least: Size::new(16, 16),
                        most: Size::new(64, 48),
                        step: Size::new(2, 2),
                    },
                    vec![Rates::Between(1.0, 60.0)],
                )],
            ),
        ];
        let error = ranked(&offered, &PixelFormat::ALL, &Wanted::new(None, None)).unwrap_err();
        assert!(error.contains("RGB3, BGR3, YUYV, UYVY, NV12, MJPG"), "{error}");
        let there = "H264 800x600 at 30, 29.97/s; Y16 16x16 to 64x48 in steps of 2x2 at 1 to 60/s";
        assert!(error.ends_with(there), "{error}");
        let none = ranked(&[], &PixelFormat::ALL, &Wanted::new(None, None)).unwrap_err();
        assert!(none.ends_with("there are: none"), "{none}");
    }

    #[test]
    fn a_driver_that_lists_no_sizes_is_asked_for_the_wanted_one() {
        let offered = [offered(b"RGB3", Vec::new())];
        assert_eq!(best(&offered, Some([320, 240]), None), "320x240 RGB3");
    }
}
