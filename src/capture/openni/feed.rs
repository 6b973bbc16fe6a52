//! Depth and colour, live or recorded, as finished frames.

use super::beside::Beside;
use super::camera::{self, Setup};
use super::clock::DeviceClock;
use super::device_handle::{Device, Sensor, Stream};
use super::ffi::VideoMode;
use super::pairing::Pairing;
use super::picture;
use crate::capture::RawFrame;
use crate::capture::live::DeviceError;
use crate::image::{Image, Size};
use crate::math::Pinhole;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Comes first wherever there is a value for depth and one for colour.
const DEPTH: usize = 0;

/// The streams of an open device.
pub struct Streams {
    pub depth: Stream,
    pub color: Stream,
}

impl Streams {
    pub fn new(device: &Arc<Device>) -> Result<Self, String> {
        let color =
            Stream::new(device, Sensor::Color).map_err(|why| format!("no colour stream: {why}"))?;
        Ok(Self { depth: depth_stream(device)?, color })
    }

    /// Video modes as they are now, depth first.
    pub fn modes(&self) -> Result<[VideoMode; 2], String> {
        Ok([mode(&self.depth, "depth")?, mode(&self.color, "colour")?])
    }
}

pub fn depth_stream(device: &Arc<Device>) -> Result<Stream, String> {
    Stream::new(device, Sensor::Depth).map_err(|why| format!("no depth stream: {why}"))
}

pub fn mode(stream: &Stream, name: &str) -> Result<VideoMode, String> {
    stream.mode().ok_or_else(|| format!("the {name} stream does not say its video mode"))
}

/// Where colour comes from.
pub enum ColorSource {
    Sensor(Stream),
    Beside(Beside),
}

/// Frames from running streams.
pub struct Feed {
    depth: Stream,
    color: ColorSource,
    sizes: [Size; 2],
    mirrored: [bool; 2],
    clock: DeviceClock,
    pairing: Pairing<Image<u16>, Image<[u8; 3]>>,
    setup: Setup,
    live: bool,
    /// When the last frame of each stream came.
    last: [Option<Instant>; 2],
    /// The highest frame number of each stream.
    pub highest: [usize; 2],
    /// A recording's frame came a second time: its player starts over where a file was cut off.
    pub started_over: bool,
    /// By how much the device's clock has jumped since this was last emptied.
    pub jumps_s: Vec<f64>,
    held: Option<Result<(), String>>,
    next_index: usize,
}

impl Drop for Feed {
    /// All stop before one is destroyed: the library regroups synchronised streams that still run.
    fn drop(&mut self) {
        self.streams().into_iter().for_each(Stream::stop);
    }
}

impl Feed {
    pub fn new(
        depth: Stream,
        color: ColorSource,
        setup: Setup,
        live: bool,
    ) -> Result<Self, String> {
        let depth_mode = mode(&depth, "depth")?;
        let depth_hz = f64::from(depth_mode.fps.max(1));
        let (color_size, color_hz, mirrored) = match &color {
            ColorSource::Sensor(stream) => {
                let mode = mode(stream, "colour")?;
                (camera::size(&mode), f64::from(mode.fps), stream.is_mirrored())
            }
            ColorSource::Beside(beside) => (beside.size(), beside.rate_hz(), false),
        };
        let period_s = 1.0 / depth_hz.max(color_hz);
        if let ColorSource::Beside(beside) = &color {
            beside.check(period_s)?;
        }
        Ok(Self {
            sizes: [camera::size(&depth_mode), color_size],
            mirrored: [depth.is_mirrored(), mirrored],
            clock: DeviceClock::new(period_s),
            pairing: Pairing::new(period_s),
            setup,
            live,
            last: [None; 2],
            highest: [0; 2],
            started_over: false,
            jumps_s: Vec::new(),
            held: None,
            next_index: 0,
            depth,
            color,
        })
    }

    pub fn camera(&self) -> Pinhole {
        self.setup.rig.camera
    }

    pub fn color(&self) -> &ColorSource {
        &self.color
    }

    /// Those of the device, depth first.
    pub fn streams(&self) -> Vec<&Stream> {
        match &self.color {
            ColorSource::Sensor(color) => vec![&self.depth, color],
            ColorSource::Beside(_) => vec![&self.depth],
        }
    }

    /// Exposure and white balance shall stay as they are; [`held`](Self::held) says what came of it.
    pub fn hold_exposure(&mut self) {
        match &self.color {
            ColorSource::Sensor(stream) => self.held = Some(stream.lock_exposure()),
            ColorSource::Beside(beside) => beside.capture().hold_exposure(),
        }
    }

    /// Once, when the camera has answered; else which of them cannot be held.
    pub fn held(&mut self) -> Option<Result<(), String>> {
        match &self.color {
            ColorSource::Sensor(_) => self.held.take(),
            ColorSource::Beside(beside) => beside.capture().held(),
        }
    }

    /// Frames that found no partner.
    pub fn alone(&self) -> usize {
        self.pairing.alone
    }

    pub fn start(&self) -> Result<(), String> {
        for (stream, name) in self.streams().into_iter().zip(["depth", "colour"]) {
            stream.start().map_err(|why| format!("{name} does not start: {why}"))?;
        }
        Ok(())
    }

    /// Reads one frame of either stream; `false` where none came in time. A frame that is no good is an
    /// error, and gone.
    pub fn read(&mut self, timeout: Duration) -> Result<bool, DeviceError> {
        let mut wait = timeout;
        if let ColorSource::Beside(beside) = &self.color {
            if let Some((taken_s, pixels)) = beside.take()? {
                self.pairing.add_color(taken_s, pixels);
                return Ok(true);
            }
            wait = wait.min(Beside::LOOK_EVERY);
        }
        let streams = self.streams();
        let Some(which) = Stream::wait_any(&streams, wait)? else { return Ok(false) };
        let now = Instant::now();
        let frame = streams[which].read()?;
        let header = frame.header();
        let index = usize::try_from(header.index).unwrap_or(0);
        let timestamp_us = header.timestamp_us;
        let (size, mirrored) = (self.sizes[which], self.mirrored[which]);
        let picture = match which {
            DEPTH => picture::depth(&frame, size, mirrored).map(Picture::Depth),
            _ => picture::color(&frame, size, mirrored).map(Picture::Color),
        };
        drop(frame);
        if !self.live && index <= self.highest[which] {
            self.started_over = true;
            return Ok(true);
        }
        self.highest[which] = self.highest[which].max(index);
        let elapsed = self.last[which].replace(now).map(|last| now - last).filter(|_| self.live);
        let tick = self.clock.tick(which, timestamp_us, elapsed);
        self.jumps_s.extend(tick.jump_s);
        match picture? {
            Picture::Depth(depth) => {
                let time_s = match &mut self.color {
                    ColorSource::Sensor(_) => tick.seconds,
                    ColorSource::Beside(beside) => beside.host_s(&tick, now),
                };
                self.pairing.add_depth(time_s, depth);
            }
            Picture::Color(color) => self.pairing.add_color(tick.seconds, color),
        }
        Ok(true)
    }

    /// The next pair of those read so far, finished. Without `process` it is only counted.
    pub fn take(&mut self, process: bool) -> Result<Option<RawFrame>, String> {
        let Some((timestamp_s, depth, color)) = self.pairing.take() else { return Ok(None) };
        let index = self.next_index;
        self.next_index += 1;
        if !process {
            return Ok(Some(RawFrame {
                index,
                timestamp_s,
                color,
                depth_m: Image::default(),
                world_from_camera: None,
                exposure_s: None,
            }));
        }
        let (color, depth_m) = self.setup.rig.frame::<String>(|| Ok(color), || Ok(depth))?;
        let (world_from_camera, exposure_s) = (None, None);
        Ok(Some(RawFrame { index, timestamp_s, color, depth_m, world_from_camera, exposure_s }))
    }
}

enum Picture {
    Depth(Image<u16>),
    Color(Image<[u8; 3]>),
}
