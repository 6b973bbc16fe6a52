//! The device: its streams, and how a frame gets from the script to the library.

use crate::abi::*;
use crate::script::{Fault, Script};
use std::ffi::{c_int, c_void};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::SeqCst};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

pub const URI: &str = "virtual://kinlight";

/// An address of the library's, given to threads.
#[derive(Clone, Copy)]
pub struct Address(pub *mut c_void);
// SAFETY: the library documents its callbacks, services and cookies as callable from a driver's threads.
unsafe impl Send for Address {}

/// Whom to tell that the device came or went.
pub struct Announcer {
    pub connected: DeviceCallback,
    pub disconnected: DeviceCallback,
    pub cookie: Address,
}

pub static ANNOUNCER: Mutex<Option<Announcer>> = Mutex::new(None);
pub static SCRIPT: Mutex<Option<Arc<Script>>> = Mutex::new(None);
/// The device is there.
pub static PLUGGED: AtomicBool = AtomicBool::new(false);
/// It was unplugged already: that happens once.
static UNPLUGGED_ONCE: AtomicBool = AtomicBool::new(false);
/// So does a stall.
static STALLED_ONCE: AtomicBool = AtomicBool::new(false);

/// No code of this library panics with a lock held; if it did, its data would still be whole.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn info() -> DeviceInfo {
    DeviceInfo {
        uri: field(URI),
        vendor: field("kinlight"),
        name: field("Virtual sensor"),
        usb_vendor: 0,
        usb_product: 0,
    }
}

pub fn announce(plugged: bool) {
    PLUGGED.store(plugged, SeqCst);
    // Not under the lock: the library may call back.
    let call = lock(&ANNOUNCER)
        .as_ref()
        .map(|a| (if plugged { a.connected } else { a.disconnected }, a.cookie));
    if let Some((callback, cookie)) = call {
        callback(&info(), cookie.0);
    }
}

#[derive(Clone, Copy)]
struct Sink {
    callback: NewFrameCallback,
    cookie: Address,
    services: *mut StreamServices,
    stream: Address,
}
// SAFETY: as `Address`; the services outlive the stream.
unsafe impl Send for Sink {}

/// What of a stream its device's frames depend on.
#[derive(Default)]
pub struct Port {
    sink: Option<Sink>,
    fps: c_int,
    mirrored: bool,
    started: bool,
}

pub struct Stream {
    pub sensor: c_int,
    pub device: Arc<Shared>,
    pub services: *mut StreamServices,
    pub new_frame: Option<(NewFrameCallback, Address)>,
    pub property: Option<(PropertyCallback, Address)>,
    automatic: [c_int; 2],
}

pub struct Shared {
    pub script: Arc<Script>,
    /// Depth, colour.
    ports: Mutex<[Port; 2]>,
    next: AtomicUsize,
    stalled: AtomicBool,
    clock: Mutex<Option<JoinHandle<()>>>,
    stop: AtomicBool,
}

pub struct Device {
    pub shared: Arc<Shared>,
    pub sensors: Vec<SensorInfo>,
    /// What `sensors` points to; never changed.
    _modes: Vec<[VideoMode; 2]>,
    pub registration: c_int,
    pub property: Option<(PropertyCallback, Address)>,
}

fn side(sensor: c_int) -> usize {
    usize::from(sensor == COLOR)
}

impl Device {
    pub fn new(script: Arc<Script>) -> Self {
        let ports = [0, 1].map(|_| Port { fps: script.fps, ..Port::default() });
        let shared = Arc::new(Shared {
            script,
            ports: Mutex::new(ports),
            next: AtomicUsize::new(0),
            stalled: AtomicBool::new(false),
            clock: Mutex::new(None),
            stop: AtomicBool::new(false),
        });
        let both = |sensor| {
            let full = shared.mode_at(sensor, shared.script.fps);
            [full, VideoMode { fps: full.fps / 2, ..full }]
        };
        let mut modes = vec![both(DEPTH), both(COLOR)];
        let sensors = [DEPTH, COLOR]
            .into_iter()
            .zip(&mut modes)
            .map(|(sensor, m)| SensorInfo { sensor, mode_count: 2, modes: m.as_mut_ptr() })
            .take(shared.streams())
            .collect();
        Self { shared, sensors, _modes: modes, registration: 0, property: None }
    }
}

impl Shared {
    fn mode_at(&self, sensor: c_int, fps: c_int) -> VideoMode {
        let depth = sensor == DEPTH;
        let [width, height] =
            if depth { self.script.depth } else { self.script.color }.map(|v| v as c_int);
        let format = match (depth, self.script.tenths_of_mm) {
            (false, _) => RGB888,
            (true, false) => DEPTH_1_MM,
            (true, true) => DEPTH_100_UM,
        };
        VideoMode { format, width, height, fps }
    }

    pub fn mode(&self, sensor: c_int) -> VideoMode {
        self.mode_at(sensor, lock(&self.ports)[side(sensor)].fps)
    }

    /// Depth comes first.
    fn streams(&self) -> usize {
        1 + usize::from(self.script.has_color())
    }

    /// Gives the library the next frame of every started stream; `false` when there is none.
    fn emit(&self) -> bool {
        let frame = self.next.load(SeqCst);
        let unplug = self.script.faults.iter().find_map(|f| match f {
            Fault::Unplug(k, back) if *k == frame => Some(*back),
            _ => None,
        });
        if let Some(back_ms) = unplug
            && !UNPLUGGED_ONCE.swap(true, SeqCst)
        {
            self.script.note("unplug", frame);
            announce(false);
            if let Some(ms) = back_ms {
                let script = Arc::clone(&self.script);
                std::thread::spawn(move || {
                    std::thread::sleep(Duration::from_millis(ms));
                    script.note("plug", frame);
                    announce(true);
                });
            }
        }
        if !PLUGGED.load(SeqCst) || self.silent(frame) {
            return false;
        }
        self.next.store(frame + 1, SeqCst);
        self.script.note("frame", frame);
        for (side, sensor) in [DEPTH, COLOR].into_iter().enumerate() {
            if sensor == COLOR && self.script.has(Fault::NoColor(frame)) {
                continue;
            }
            let port = {
                let ports = lock(&self.ports);
                ports[side].sink.filter(|_| ports[side].started).map(|s| (s, ports[side].mirrored))
            };
            // Not under the lock: recorders ask for properties.
            if let Some((sink, mirrored)) = port {
                self.deliver(&sink, sensor, frame, mirrored);
            }
        }
        true
    }

    /// The frames are over, or this is the device that stalls.
    fn silent(&self, frame: usize) -> bool {
        if self.script.stalls(frame) && !STALLED_ONCE.swap(true, SeqCst) {
            self.stalled.store(true, SeqCst);
        }
        self.stalled.load(SeqCst) || frame >= self.script.frame_count()
    }

    fn deliver(&self, sink: &Sink, sensor: c_int, number: usize, mirrored: bool) {
        let (mode, depth) = (self.mode(sensor), sensor == DEPTH);
        let picture = self.script.picture(number, depth);
        let pixel = if depth { 2 } else { 3 };
        let row = pixel * mode.width as usize;
        let late = if depth { 0 } else { self.script.color_offset_us };
        let time = 1_000_000
            + number as i64 * 1_000_000 / i64::from(mode.fps)
            + late
            + self.script.clock_error_us(number);
        // SAFETY: the library's services are valid while the stream exists, and a frame that was acquired
        // has room for as many bytes as `oniDriverStreamGetRequiredFrameSize` said: a whole picture.
        unsafe {
            let services = &*sink.services;
            let frame = (services.acquire)(services.me);
            if frame.is_null() {
                return;
            }
            let target = std::slice::from_raw_parts_mut((*frame).data.cast::<u8>(), picture.len());
            for (to, from) in target.chunks_exact_mut(row).zip(picture.chunks_exact(row)) {
                to.copy_from_slice(from);
                if mirrored {
                    reverse(to, pixel);
                }
            }
            let half = depth && self.script.has(Fault::Half(number));
            let wide = depth && self.script.has(Fault::Stride(number));
            (*frame).data_size = (picture.len() >> usize::from(half)) as c_int;
            (*frame).sensor = sensor;
            (*frame).timestamp_us = time.max(0) as u64;
            (*frame).index = number as c_int + 1;
            ((*frame).width, (*frame).height) = (mode.width, mode.height);
            (*frame).mode = mode;
            ((*frame).cropping, (*frame).crop_x, (*frame).crop_y) = (0, 0, 0);
            (*frame).stride = row as c_int + if wide { 6 } else { 0 };
            (sink.callback)(sink.stream.0, frame, sink.cookie.0);
            (services.release)(services.me, frame);
        }
    }

    /// The reader waits and has nothing.
    pub fn poked(&self) {
        let ready = lock(&self.ports).iter().take(self.streams()).all(|p| p.started);
        if !self.script.by_clock && ready {
            self.emit();
        }
    }

    fn start_clock(self: &Arc<Self>) {
        let mut clock = lock(&self.clock);
        if !self.script.by_clock || clock.is_some() {
            return;
        }
        self.stop.store(false, SeqCst);
        let shared = Arc::clone(self);
        *clock = Some(std::thread::spawn(move || {
            let fps = shared.mode(DEPTH).fps.max(1) as u32;
            let mut due = Instant::now();
            while !shared.stop.load(SeqCst) {
                if Instant::now() < due {
                    std::thread::sleep(Duration::from_millis(1));
                } else {
                    due += Duration::from_secs(1) / fps;
                    shared.emit();
                }
            }
        }));
    }
}

fn reverse(row: &mut [u8], pixel: usize) {
    row.reverse();
    row.chunks_exact_mut(pixel).for_each(<[u8]>::reverse);
}

impl Stream {
    pub fn new(sensor: c_int, device: Arc<Shared>) -> Self {
        lock(&device.ports)[side(sensor)].mirrored = true; // as PrimeSense's sensors start
        Self {
            sensor,
            device,
            services: std::ptr::null_mut(),
            new_frame: None,
            property: None,
            automatic: [1; 2],
        }
    }

    pub fn start(&mut self, me: *mut c_void) -> c_int {
        let Some((callback, cookie)) = self.new_frame else { return ERROR };
        let mut ports = lock(&self.device.ports);
        let port = &mut ports[side(self.sensor)];
        port.sink = Some(Sink { callback, cookie, services: self.services, stream: Address(me) });
        port.started = true;
        let all = ports.iter().take(self.device.streams()).all(|p| p.started);
        drop(ports);
        if all {
            self.device.start_clock();
        }
        OK
    }

    /// Waits for the thread: the library may be unloaded right after.
    pub fn stop(&mut self) {
        lock(&self.device.ports)[side(self.sensor)].started = false;
        self.device.stop.store(true, SeqCst);
        let thread = lock(&self.device.clock).take();
        if let Some(thread) = thread {
            // A thread that panicked has said so on standard error.
            let _ = thread.join();
        }
    }

    pub fn has(&self, property: c_int) -> bool {
        match property {
            HORIZONTAL_FOV | VERTICAL_FOV => self.device.script.fov.is_some(),
            AUTO_WHITE_BALANCE | AUTO_EXPOSURE => self.device.script.lock && self.sensor == COLOR,
            _ => (CROPPING..=MIRRORING).contains(&property),
        }
    }

    /// # Safety
    /// `data` points to `*size` writable bytes.
    pub unsafe fn get(&self, property: c_int, data: *mut c_void, size: *mut c_int) -> c_int {
        if !self.has(property) {
            return NOT_IMPLEMENTED;
        }
        let mode = self.device.mode(self.sensor);
        let depth = self.sensor == DEPTH;
        let fov = self.device.script.fov.unwrap_or_default();
        let mirrored = lock(&self.device.ports)[side(self.sensor)].mirrored;
        let whole = Cropping { enabled: 0, x: 0, y: 0, width: mode.width, height: mode.height };
        // SAFETY: the caller's promise.
        unsafe {
            match property {
                CROPPING => put(whole, data, size),
                HORIZONTAL_FOV => put(fov[0], data, size),
                VERTICAL_FOV => put(fov[1], data, size),
                VIDEO_MODE => put(mode, data, size),
                MAX_VALUE => put(if depth { 10_000 } else { 255 } as c_int, data, size),
                MIN_VALUE => put(0 as c_int, data, size),
                STRIDE => put(mode.width * if depth { 2 } else { 3 }, data, size),
                MIRRORING => put(c_int::from(mirrored), data, size),
                _ => put(self.automatic[(property - AUTO_WHITE_BALANCE) as usize], data, size),
            }
        }
    }

    /// # Safety
    /// `data` points to `size` readable bytes.
    pub unsafe fn set(&mut self, property: c_int, data: *const c_void, size: c_int) -> c_int {
        // SAFETY: the caller's promise, in both branches.
        let number = unsafe { take::<c_int>(data, size) };
        let mode = unsafe { take::<VideoMode>(data, size) };
        let mut ports = lock(&self.device.ports);
        let port = &mut ports[side(self.sensor)];
        match (property, number, mode) {
            (MIRRORING, Some(value), _) if !self.device.script.mirror_stuck => {
                port.mirrored = value != 0;
                OK
            }
            (AUTO_WHITE_BALANCE | AUTO_EXPOSURE, Some(value), _) if self.has(property) => {
                self.automatic[(property - AUTO_WHITE_BALANCE) as usize] = value;
                OK
            }
            (VIDEO_MODE, _, Some(mode)) => {
                let fps = self.device.script.fps;
                if mode != self.device.mode_at(self.sensor, mode.fps)
                    || ![fps, fps / 2].contains(&mode.fps)
                {
                    return BAD_PARAMETER;
                }
                port.fps = mode.fps;
                OK
            }
            (MIRRORING | VIDEO_MODE, ..) => BAD_PARAMETER,
            _ => NOT_IMPLEMENTED,
        }
    }
}
