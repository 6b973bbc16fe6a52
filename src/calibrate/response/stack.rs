//! What a stack of exposures must be, and what users get wrong about it.

use super::Exposure;
use crate::calibrate::CalibrateError;

/// A code changes by less without a change of light.
pub(super) const NOISE: u8 = 8;

/// Sizes and times.
pub(super) fn check(stack: &[Exposure]) -> Result<(), CalibrateError> {
    let refuse = |problem: String| Err(CalibrateError::Options(problem));
    let Some(first) = stack.first() else { return refuse("no exposures".into()) };
    let size = first.picture.size();
    if let Some(other) = stack.iter().find(|e| e.picture.size() != size) {
        return refuse(format!(
            "exposures differ in size: {} has {size} pixels, {} has {}",
            first.name,
            other.name,
            other.picture.size()
        ));
    }
    if let Some(e) = stack.iter().find(|e| !(e.time > 0.0 && e.time.is_finite())) {
        return refuse(format!("{}: an exposure time of {} is not positive", e.name, e.time));
    }
    let times = || stack.iter().map(|e| e.time);
    let (low, high) = (times().fold(f64::INFINITY, f64::min), times().fold(0.0, f64::max));
    if high < 1.5 * low {
        return refuse("exposure times must differ, by a factor of 1.5 at least".into());
    }
    Ok(())
}

/// Shares of black, of saturated and of all other codes of a picture.
fn shares(exposure: &Exposure, places: &[usize]) -> [f64; 3] {
    let mut counts = [0usize; 3];
    for code in places.iter().flat_map(|&i| exposure.picture.as_slice()[i]) {
        counts[match code {
            0 => 0,
            255 => 1,
            _ => 2,
        }] += 1;
    }
    counts.map(|count| count as f64 / (3 * places.len()).max(1) as f64)
}

/// Whether the pictures, by their times, grow lighter. `order` is by time.
pub(super) fn check_order(order: &[&Exposure], places: &[usize]) -> Result<(), CalibrateError> {
    // A percent of usable codes says next to nothing.
    const USABLE: f64 = 0.01;
    let mut said = Vec::new();
    for exposure in order {
        let [black, saturated, usable] = shares(exposure, places);
        if usable < USABLE {
            let all = if black > saturated { "black" } else { "saturated" };
            log::warn!("{} says nothing: it is {all}", exposure.name);
            said.push(format!("{} is {all}", exposure.name));
        }
    }
    if said.len() + 1 >= order.len() && !said.is_empty() {
        let problem = format!("too few exposures show anything: {}", said.join(", "));
        return Err(CalibrateError::Data(problem));
    }
    for pair in order.windows(2) {
        let (short, long) = (pair[0], pair[1]);
        let (mut darker, mut lighter, mut differ) = (0usize, 0usize, false);
        for &i in places {
            let (a, b) = (short.picture.as_slice()[i], long.picture.as_slice()[i]);
            differ |= a != b;
            darker += a.iter().zip(b).filter(|(a, b)| b.saturating_add(NOISE) < **a).count();
            lighter += a.iter().zip(b).filter(|(a, b)| a.saturating_add(NOISE) < *b).count();
        }
        let both = format!("{} ({} s) and {} ({} s)", short.name, short.time, long.name, long.time);
        if darker > lighter {
            let problem = format!(
                "of {both} the longer exposure is the darker one: are their times swapped, or the whole \
                 list's in the wrong order?"
            );
            return Err(CalibrateError::Data(problem));
        }
        let shows = shares(short, places)[2] >= USABLE;
        if shows && !differ && long.time > 1.1 * short.time {
            let problem = format!("{both} are the same picture");
            return Err(CalibrateError::Data(problem));
        }
    }
    Ok(())
}
