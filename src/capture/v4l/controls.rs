//! Exposure, gain and white balance: automatic, or held as they are.

use super::node::{Node, zeroed};
use std::io;
use v4l::v4l_sys as sys;
use v4l::v4l2::vidioc;

/// A camera's controls by their numbers.
pub trait Controls {
    fn get(&self, id: u32) -> io::Result<i32>;
    fn set(&self, id: u32, value: i32) -> io::Result<()>;
}

impl Controls for Node {
    fn get(&self, id: u32) -> io::Result<i32> {
        let mut control = sys::v4l2_control { id, ..zeroed() };
        self.call(vidioc::VIDIOC_G_CTRL, &mut control).map(|()| control.value)
    }

    fn set(&self, id: u32, value: i32) -> io::Result<()> {
        let mut control = sys::v4l2_control { id, value };
        self.call(vidioc::VIDIOC_S_CTRL, &mut control)
    }
}

/// Something that a camera can do by itself.
struct Automatic {
    name: &'static str,
    switch: u32,
    /// Values of the switch for "by itself", the usual first.
    on: &'static [i32],
    off: i32,
    /// What the camera sets meanwhile.
    value: u32,
    /// A camera without this control has it elsewhere, or not at all.
    optional: bool,
}

const AUTOMATIC: [Automatic; 3] = [
    Automatic {
        name: "exposure",
        switch: sys::V4L2_CID_EXPOSURE_AUTO,
        on: &[
            sys::v4l2_exposure_auto_type_V4L2_EXPOSURE_APERTURE_PRIORITY as i32,
            sys::v4l2_exposure_auto_type_V4L2_EXPOSURE_AUTO as i32,
        ],
        off: sys::v4l2_exposure_auto_type_V4L2_EXPOSURE_MANUAL as i32,
        value: sys::V4L2_CID_EXPOSURE_ABSOLUTE,
        optional: false,
    },
    Automatic {
        name: "gain",
        switch: sys::V4L2_CID_AUTOGAIN,
        on: &[1],
        off: 0,
        value: sys::V4L2_CID_GAIN,
        optional: true,
    },
    Automatic {
        name: "white balance",
        switch: sys::V4L2_CID_AUTO_WHITE_BALANCE,
        on: &[1],
        off: 0,
        value: sys::V4L2_CID_WHITE_BALANCE_TEMPERATURE,
        optional: false,
    },
];

/// All that can be is automatic: cameras keep what the program before them has set.
pub fn release(camera: &impl Controls) {
    for automatic in &AUTOMATIC {
        let Ok(now) = camera.get(automatic.switch) else { continue };
        let on = automatic.on.contains(&now)
            || automatic.on.iter().any(|&on| camera.set(automatic.switch, on).is_ok());
        if !on {
            log::debug!("{} cannot be made automatic", automatic.name);
        }
    }
}

/// All stay as they are.
///
/// # Errors
/// Says which cannot be held.
pub fn hold(camera: &impl Controls) -> Result<(), String> {
    let mut free = Vec::new();
    for automatic in &AUTOMATIC {
        match hold_one(camera, automatic) {
            Ok(()) => log::debug!("{} is held", automatic.name),
            Err(_) if automatic.optional && camera.get(automatic.switch).is_err() => {}
            Err(why) => {
                log::debug!("{} cannot be held: {why}", automatic.name);
                free.push(automatic.name);
            }
        }
    }
    match free.as_slice() {
        [] => Ok(()),
        [one] => Err((*one).to_owned()),
        [first @ .., last] => Err(format!("{} and {last}", first.join(", "))),
    }
}

fn hold_one(camera: &impl Controls, automatic: &Automatic) -> io::Result<()> {
    camera.get(automatic.switch)?;
    // Where the camera shows what it has set: switched off it may go back to what was set by hand before.
    let value = camera.get(automatic.value);
    camera.set(automatic.switch, automatic.off)?;
    if camera.get(automatic.switch)? != automatic.off {
        return Err(io::Error::other("the camera does not keep it"));
    }
    if let Ok(value) = value
        && let Err(error) = camera.set(automatic.value, value)
    {
        log::debug!("{} of {value} is not taken: {error}", automatic.name);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;
    use std::collections::BTreeMap;

    /// Controls and their values; of some, the values that they take.
    #[derive(Default)]
    struct Camera {
        values: RefCell<BTreeMap<u32, i32>>,
        menus: BTreeMap<u32, Vec<i32>>,
        /// Set without an error, and nothing happens.
        deaf: bool,
        /// Values go back to this when their switch is set.
        by_hand: BTreeMap<u32, (u32, i32)>,
    }

    impl Controls for Camera {
        fn get(&self, id: u32) -> io::Result<i32> {
            self.values.borrow().get(&id).copied().ok_or(io::ErrorKind::InvalidInput.into())
        }

        fn set(&self, id: u32, value: i32) -> io::Result<()> {
            self.get(id)?;
            if self.menus.get(&id).is_some_and(|menu| !menu.contains(&value)) {
                return Err(io::ErrorKind::InvalidInput.into());
            }
            if !self.deaf {
                self.values.borrow_mut().insert(id, value);
                if let Some(&(other, value)) = self.by_hand.get(&id) {
                    self.values.borrow_mut().insert(other, value);
                }
            }
            Ok(())
        }
    }

    const EXPOSURE: u32 = sys::V4L2_CID_EXPOSURE_AUTO;
    const EXPOSURE_TIME: u32 = sys::V4L2_CID_EXPOSURE_ABSOLUTE;
    const WHITE: u32 = sys::V4L2_CID_AUTO_WHITE_BALANCE;
    const GAIN: u32 = sys::V4L2_CID_AUTOGAIN;

    fn camera(values: &[(u32, i32)]) -> Camera {
        let values = RefCell::new(values.iter().copied().collect());
        Camera { values, ..Camera::default() }
    }

    #[test]
    fn what_the_camera_had_set_is_kept() {
        let mut webcam = camera(&[(EXPOSURE, 3), (EXPOSURE_TIME, 157), (WHITE, 1)]);
        webcam.menus.insert(EXPOSURE, vec![1, 3]);
        webcam.by_hand.insert(EXPOSURE, (EXPOSURE_TIME, 3));
        assert_eq!(hold(&webcam), Ok(()));
        assert_eq!(webcam.get(EXPOSURE).unwrap(), 1);
        assert_eq!(webcam.get(EXPOSURE_TIME).unwrap(), 157);
        assert_eq!(webcam.get(WHITE).unwrap(), 0);
        release(&webcam);
        assert_eq!((webcam.get(EXPOSURE).unwrap(), webcam.get(WHITE).unwrap()), (3, 1));
    }

    #[test]
    fn release_takes_what_the_menu_has_and_leaves_what_is_automatic() {
        let mut other = camera(&[(EXPOSURE, 1)]);
        other.menus.insert(EXPOSURE, vec![0, 1]);
        release(&other);
        assert_eq!(other.get(EXPOSURE).unwrap(), 0);
        release(&other);
        assert_eq!(other.get(EXPOSURE).unwrap(), 0);
        release(&camera(&[]));
    }

    #[test]
    fn what_cannot_be_held_is_said() {
        assert_eq!(hold(&camera(&[])), Err("exposure and white balance".into()));
        assert_eq!(hold(&camera(&[(GAIN, 1)])), Err("exposure and white balance".into()));
        assert_eq!(hold(&camera(&[(EXPOSURE, 0), (GAIN, 1)])), Err("white balance".into()));
        let deaf = Camera { deaf: true, ..camera(&[(EXPOSURE, 0), (GAIN, 1), (WHITE, 1)]) };
        assert_eq!(hold(&deaf), Err("exposure, gain and white balance".into()));
    }
}
