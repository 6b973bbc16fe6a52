//! The one device of all tests: its pipelines are compiled once.

use super::FramePictures;
use crate::capture::RgbdFrame;
use crate::gpu::{AdapterChoice, Gpu};
use std::sync::OnceLock;

/// The device; `None`, said out loud, where this machine has none. `KINLIGHT_REQUIRE_GPU=1` makes that
/// a failure.
pub fn gpu() -> Option<&'static Gpu> {
    static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
    crate::gpu::test_log::fail_on_warnings();
    let gpu = GPU.get_or_init(|| match Gpu::open(&AdapterChoice::Best) {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var_os("KINLIGHT_REQUIRE_GPU").is_some() => {
            panic!("KINLIGHT_REQUIRE_GPU is set, and: {error}")
        }
        Err(error) => {
            eprintln!("SKIPPED: {error}");
            None
        }
    });
    gpu.as_ref()
}

/// A prepared frame on the device, as the Input stage leaves it.
pub fn upload_frame(gpu: &Gpu, frame: &RgbdFrame) -> FramePictures {
    let pictures = FramePictures::new(gpu, frame.depth_m.size()).unwrap();
    pictures.upload(gpu, frame);
    pictures
}
