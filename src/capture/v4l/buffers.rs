//! Buffers that a driver fills, mapped into this process.

#![allow(unsafe_code, reason = "calls of the kernel")]

use super::node::{CAPTURE, Node, Plain, zeroed};
use std::io;
use std::ptr::{NonNull, null_mut};
use std::sync::Arc;
use std::time::Duration;
use v4l::v4l_sys as sys;
use v4l::v4l2::{self, vidioc};

/// One is read while others are filled.
const BUFFERS: u32 = 4;

/// Streaming of pictures, stopped when dropped.
pub struct Buffers {
    mapped: Vec<Mapping>,
    node: Arc<Node>,
    /// What the driver says of its times.
    pub flags: u32,
}

/// A picture in its buffer.
pub struct Filled<'b> {
    pub bytes: &'b [u8],
    pub flags: u32,
    pub timestamp: sys::timeval,
    pub sequence: u32,
}

impl Buffers {
    pub fn start(node: &Arc<Node>) -> io::Result<Self> {
        let mut request = sys::v4l2_requestbuffers { count: BUFFERS, ..of_mapped() };
        node.call(vidioc::VIDIOC_REQBUFS, &mut request)?;
        let mut buffers = Self { mapped: Vec::new(), node: Arc::clone(node), flags: 0 };
        for index in 0..request.count {
            let mut buffer = sys::v4l2_buffer { index, ..of_mapped() };
            node.call(vidioc::VIDIOC_QUERYBUF, &mut buffer)?;
            buffers.flags = buffer.flags;
            buffers.mapped.push(Mapping::new(node, &buffer)?);
        }
        (0..request.count).try_for_each(|index| buffers.queue(index))?;
        node.call(vidioc::VIDIOC_STREAMON, &mut { CAPTURE })?;
        Ok(buffers)
    }

    fn queue(&self, index: u32) -> io::Result<()> {
        let mut buffer = sys::v4l2_buffer { index, ..of_mapped() };
        self.node.call(vidioc::VIDIOC_QBUF, &mut buffer)
    }

    /// Waits for a picture, has it read, and gives its buffer back to the driver. `None` where none came in
    /// time.
    pub fn next<T>(
        &mut self,
        timeout: Duration,
        read: impl FnOnce(Filled) -> T,
    ) -> io::Result<Option<T>> {
        let milliseconds = timeout.as_micros().div_ceil(1000).min(i32::MAX as u128) as i32;
        if !self.node.poll(milliseconds)? {
            return Ok(None);
        }
        let mut buffer: sys::v4l2_buffer = of_mapped();
        match self.node.call(vidioc::VIDIOC_DQBUF, &mut buffer) {
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                // It was announced and is not there: that must not take a core.
                std::thread::sleep(Duration::from_millis(1));
                return Ok(None);
            }
            done => done?,
        }
        let mapped = self.mapped.get(buffer.index as usize).ok_or_else(|| {
            io::Error::other(format!("the driver gave buffer {} of none", buffer.index))
        })?;
        let bytes = mapped.bytes();
        let result = read(Filled {
            bytes: &bytes[..bytes.len().min(buffer.bytesused as usize)],
            flags: buffer.flags,
            timestamp: buffer.timestamp,
            sequence: buffer.sequence,
        });
        self.queue(buffer.index)?;
        Ok(Some(result))
    }
}

impl Drop for Buffers {
    fn drop(&mut self) {
        // A device that was unplugged has stopped by itself.
        if let Err(error) = self.node.call(vidioc::VIDIOC_STREAMOFF, &mut { CAPTURE }) {
            log::debug!("{}: stopping: {error}", self.node.path.display());
        }
    }
}

/// Structures that name a kind of buffer.
trait OfMapped: Plain {
    fn set(&mut self, type_: u32, memory: u32);
}

impl OfMapped for sys::v4l2_requestbuffers {
    fn set(&mut self, type_: u32, memory: u32) {
        (self.type_, self.memory) = (type_, memory);
    }
}

impl OfMapped for sys::v4l2_buffer {
    fn set(&mut self, type_: u32, memory: u32) {
        (self.type_, self.memory) = (type_, memory);
    }
}

fn of_mapped<T: OfMapped>() -> T {
    let mut value: T = zeroed();
    value.set(CAPTURE, sys::v4l2_memory_V4L2_MEMORY_MMAP);
    value
}

/// Memory that the driver and this process share.
struct Mapping {
    start: NonNull<u8>,
    length: usize,
}

// SAFETY: the memory belongs to no thread.
unsafe impl Send for Mapping {}

impl Mapping {
    fn new(node: &Node, buffer: &sys::v4l2_buffer) -> io::Result<Self> {
        /// Readable, and shared with the driver; the same on every Linux.
        const PROT_READ: i32 = 1;
        const MAP_SHARED: i32 = 1;
        let length = buffer.length as usize;
        // SAFETY: the driver has answered for mapped memory, where this member is the one that counts.
        let offset = unsafe { buffer.m.offset };
        // SAFETY: a new mapping wherever the kernel has room; what the driver says is checked by the kernel.
        let start = unsafe {
            v4l2::mmap(null_mut(), length, PROT_READ, MAP_SHARED, node.fd(), offset as _)
        }?;
        let start =
            NonNull::new(start.cast()).ok_or_else(|| io::Error::other("mapped to nowhere"))?;
        Ok(Self { start, length })
    }

    /// Between taking the buffer from the driver and giving it back nothing writes to it.
    fn bytes(&self) -> &[u8] {
        // SAFETY: mapped for reading with this length until dropped.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), self.length) }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: mapped once, unmapped once; what was read borrowed it.
        if let Err(error) = unsafe { v4l2::munmap(self.start.as_ptr().cast(), self.length) } {
            log::warn!("a camera's buffer stays mapped: {error}");
        }
    }
}
