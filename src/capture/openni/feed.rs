//! Depth and colour of one device, live or recorded, as finished frames.

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

/// Both streams, in the order in which arrays hold them.
const DEPTH: usize = 0;
const COLOR: usize = 1;

/// The streams of an open device.
pub struct Streams {
    pub depth: Stream,
    pub color: Stream,
}

impl Streams {
    pub fn new(device: &Arc<Device>) -> Result<Self, String> {
        let stream = |sensor, name| {
            Stream::new(device, sensor).map_err(|why| format!("no {name} stream: {why}"))
        };
        Ok(Self { depth: stream(Sensor::Depth, "depth")?, color: stream(Sensor::Color, "colour")? })
    }

    /// Video modes as they are now, depth first.
    pub fn modes(&self) -> Result<[VideoMode; 2], String> {
        let mode = |stream: &Stream, name| {
            stream.mode().ok_or_else(|| format!("the {name} stream does not say its video mode"))
        };
        Ok([mode(&self.depth, "depth")?, mode(&self.color, "colour")?])
    }

    fn both(&self) -> [&Stream; 2] {
        [&self.depth, &self.color]
    }
}

impl Drop for Streams {
    /// Both stop before either is destroyed: the library regroups synchronised streams that still run.
    fn drop(&mut self) {
        self.both().into_iter().for_each(Stream::stop);
    }
}

/// Frames from running streams.
pub struct Feed {
    streams: Streams,
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
    next_index: usize,
}

impl Feed {
    pub fn new(streams: Streams, setup: Setup, live: bool) -> Result<Self, String> {
        let modes = streams.modes()?;
        let fastest = modes.iter().map(|m| m.fps).max().unwrap_or(0).max(1);
        let period_s = 1.0 / f64::from(fastest);
        Ok(Self {
            sizes: [camera::size(&modes[DEPTH]), camera::size(&modes[COLOR])],
            mirrored: streams.both().map(Stream::is_mirrored),
            clock: DeviceClock::new(period_s),
            pairing: Pairing::new(period_s),
            setup,
            live,
            last: [None; 2],
            highest: [0; 2],
            started_over: false,
            jumps_s: Vec::new(),
            next_index: 0,
            streams,
        })
    }

    pub fn camera(&self) -> Pinhole {
        self.setup.rig.camera
    }

    pub fn streams(&self) -> [&Stream; 2] {
        self.streams.both()
    }

    /// Frames that found no partner.
    pub fn alone(&self) -> usize {
        self.pairing.alone
    }

    pub fn start(&self) -> Result<(), String> {
        self.streams.depth.start().map_err(|why| format!("depth does not start: {why}"))?;
        self.streams.color.start().map_err(|why| format!("colour does not start: {why}"))
    }

    /// Reads one frame of either stream; `false` where none came in time. A frame that is no good is an
    /// error, and gone.
    pub fn read(&mut self, timeout: Duration) -> Result<bool, DeviceError> {
        let Some(which) = Stream::wait_any(self.streams.both(), timeout)? else { return Ok(false) };
        let stream = self.streams.both()[which];
        let frame = stream.read()?;
        let header = frame.header();
        let index = usize::try_from(header.index).unwrap_or(0);
        if !self.live && index <= self.highest[which] {
            self.started_over = true;
            return Ok(true);
        }
        self.highest[which] = self.highest[which].max(index);
        let now = Instant::now();
        let elapsed = self.last[which].replace(now).map(|last| now - last).filter(|_| self.live);
        let tick = self.clock.tick(which, header.timestamp_us, elapsed);
        self.jumps_s.extend(tick.jump_s);
        let (size, mirrored) = (self.sizes[which], self.mirrored[which]);
        if which == DEPTH {
            self.pairing.add_depth(tick.seconds, picture::depth(&frame, size, mirrored)?);
        } else {
            self.pairing.add_color(tick.seconds, picture::color(&frame, size, mirrored)?);
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
