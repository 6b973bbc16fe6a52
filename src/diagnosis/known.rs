//! Depth cameras by their USB ids.

use serde::Serialize;

/// What a USB device is in its camera, which may be several.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Part {
    /// Depth, and colour where the camera has no part of its own for it.
    Depth,
    /// A camera of the UVC kind: a V4L2 node.
    Color,
    Motor,
    Audio,
}

/// Which of OpenNI2's drivers a camera needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Driver {
    PrimeSense,
    Orbbec,
    Freenect,
}

pub(super) struct Known {
    vendor: u16,
    products: std::ops::RangeInclusive<u16>,
    pub name: &'static str,
    pub part: Part,
    pub driver: Driver,
}

const fn known(
    vendor: u16,
    (first, last): (u16, u16),
    name: &'static str,
    part: Part,
    driver: Driver,
) -> Known {
    Known { vendor, products: first..=last, name, part, driver }
}

const ALL: [Known; 12] = [
    known(0x045e, (0x02ae, 0x02ae), "Kinect v1 camera", Part::Depth, Driver::Freenect),
    known(0x045e, (0x02b0, 0x02b0), "Kinect v1 motor", Part::Motor, Driver::Freenect),
    known(0x045e, (0x02ad, 0x02ad), "Kinect v1 audio", Part::Audio, Driver::Freenect),
    known(0x045e, (0x02bf, 0x02bf), "Kinect for Windows camera", Part::Depth, Driver::Freenect),
    known(0x045e, (0x02be, 0x02be), "Kinect for Windows audio", Part::Audio, Driver::Freenect),
    known(0x045e, (0x02c2, 0x02c2), "Kinect for Windows motor", Part::Motor, Driver::Freenect),
    known(0x1d27, (0x0600, 0x0600), "ASUS Xtion Pro", Part::Depth, Driver::PrimeSense),
    known(0x1d27, (0x0601, 0x0601), "ASUS Xtion Pro Live", Part::Depth, Driver::PrimeSense),
    known(0x1d27, (0x0609, 0x0609), "PrimeSense Carmine", Part::Depth, Driver::PrimeSense),
    known(0x1d27, (0x0200, 0x0500), "PrimeSense sensor", Part::Depth, Driver::PrimeSense),
    known(0x2bc5, (0x0400, 0x04ff), "Orbbec Astra", Part::Depth, Driver::Orbbec),
    known(0x2bc5, (0x0500, 0x05ff), "Orbbec Astra colour camera", Part::Color, Driver::Orbbec),
];

pub(super) fn find(vendor: u16, product: u16) -> Option<&'static Known> {
    ALL.iter().find(|known| known.vendor == vendor && known.products.contains(&product))
}

impl Driver {
    /// Whether a driver of this file name is one.
    pub fn is_in(self, file: &str) -> bool {
        let names: &[&str] = match self {
            Self::PrimeSense => &["ps1080", "pslink"],
            Self::Orbbec => &["orbbec"],
            Self::Freenect => &["freenect"],
        };
        let file = file.to_lowercase();
        names.iter().any(|name| file.contains(name))
    }

    /// Where it is to be had.
    pub fn package(self) -> &'static str {
        match self {
            Self::PrimeSense => "libPS1080, which Debian and Ubuntu have in libopenni2-0",
            Self::Orbbec => "liborbbec, which is in the OpenNI2 SDK of Orbbec",
            Self::Freenect => {
                "libFreenectDriver, which is in the sources of libfreenect (OpenNI2-FreenectDriver)"
            }
        }
    }
}
