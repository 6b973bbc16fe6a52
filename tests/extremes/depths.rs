//! What a depth picture may hold.

use crate::frames::{SIZE, at_corner, blank, in_front, picture, seen};
use crate::models::{boxed, standing};
use crate::runs::{run, settings};
use crate::table::{Device, Found, On, Outcome, Table};
use kinlight::image::Image;
use kinlight::scene::VirtualScene;
use kinlight::scene::analytic::AnalyticScene;

/// The same picture twice, without and with an object a little before the middle of what a camera sees.
/// `composed`: whether the second frame is.
fn shown(device: Device<'_>, depth_m: Image<f32>, composed: bool) -> Outcome {
    let pose = at_corner();
    let frames = [0, 1].map(|index| kinlight::capture::RawFrame {
        depth_m: depth_m.clone(),
        ..blank(SIZE, index, Some(pose))
    });
    let with_object = standing(&boxed(1), in_front(&pose, 0.7), 1.0);
    let mut worst = Found::broken(0, "");
    for scene in [VirtualScene::default(), with_object] {
        let mut run = run(device, &settings(&[])?, scene, &frames)?;
        let found = run.outcomes[1].composed;
        run.broken.rule(found == composed, || format!("composed: {found}"));
        let found = run.finish()?;
        worst = if worst.what.is_empty() { found } else { worst.worse(found) };
    }
    Ok(worst)
}

pub fn cases(table: &mut Table) {
    let at = |x: usize, y: usize, value: f32| {
        move |u: usize, v: usize| {
            if (u, v) == (x, y) { value } else { 0.0 }
        }
    };
    let mut case = |name: &str, composed: bool, depth: &dyn Fn(usize, usize) -> f32| {
        let depth_m = picture(SIZE, depth);
        table.case("depth", name, On::Both, |on| shown(on, depth_m.clone(), composed));
    };
    case("all missing (0.0)", false, &|_, _| 0.0);
    case("negative zero", false, &|_, _| -0.0);
    // One depth does not place a volume.
    case("one pixel valid, 1 m", false, &at(31, 23, 1.0));
    case("the last pixel valid, 1 m", false, &at(63, 47, 1.0));
    // Below input.min_depth_m all is missing, and beyond max_depth_m.
    for metres in [1e-45, f32::MIN_POSITIVE, 1e-6, 0.199] {
        case(&format!("all {metres:.3e} m, below the least"), false, &|_, _| metres);
    }
    for metres in [0.2, 0.4, 1.0, 8.0] {
        case(&format!("all {metres} m"), true, &|_, _| metres);
    }
    for metres in [8.001, 65.535, 1e9, f32::MAX] {
        case(&format!("all {metres:.3e} m, beyond the most"), false, &|_, _| metres);
    }
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, f32::MIN] {
        case(&format!("all {value:e}"), false, &|_, _| value);
    }
    let odd = |u: usize| u % 2 == 1;
    case("chequered, 1 m and missing", true, &|u, v| if odd(u + v) { 1.0 } else { 0.0 });
    case("columns, 1 m and missing", true, &|u, _| if odd(u) { 1.0 } else { 0.0 });
    case("rows, 1 m and missing", true, &|_, v| if odd(v) { 1.0 } else { 0.0 });
    case("chequered, 0.4 m and 8 m", true, &|u, v| if odd(u + v) { 0.4 } else { 8.0 });
    case("chequered, 1 m and NaN", true, &|u, v| if odd(u + v) { 1.0 } else { f32::NAN });
    case("random from 0.2 m to 8 m", true, &|u, v| {
        0.2 + 7.8
            * kinlight::math::random::unit_f32(kinlight::math::random::hash((u * 97 + v) as u32))
    });
    case("a cliff of 0.2 m to 8 m down the middle", true, &|u, _| if u < 32 { 0.2 } else { 8.0 });
    case("a slope through the camera's plane", true, &|u, _| 0.05 * u as f32 - 0.5);

    for (name, value) in [("to 65.535", "65.535"), ("to 0.21", "0.21")] {
        table.case("depth", format!("input.max_depth_m {name}, all at that"), On::Both, |on| {
            let depth_m: f32 = value.parse().map_err(|e| format!("{e}"))?;
            let mut frame = blank(SIZE, 0, Some(at_corner()));
            frame.depth_m.fill(depth_m);
            let settings = settings(&[("input.max_depth_m", value), ("volume.side_m", "20.0")])?;
            let scene = standing(&boxed(1), in_front(&at_corner(), 0.5), 1.0);
            run(on, &settings, scene, &[frame])?.finish()
        });
    }
    table.case("depth", "seen, all missing, seen again: the map stays", On::Both, |on| {
        let corner = |index| seen(&AnalyticScene::corner(), SIZE, at_corner(), index);
        let frames = [corner(0), corner(1), blank(SIZE, 2, Some(at_corner())), corner(3)];
        let settings = settings(&[("tracking.mode", "track"), ("tracking.on_lost", "hold")])?;
        let mut run = run(on, &settings, crate::models::on_floor(), &frames)?;
        let composed: Vec<bool> = run.outcomes.iter().map(|o| o.composed).collect();
        run.broken.rule(composed[..3] == [true, true, false], || format!("composed: {composed:?}"));
        run.finish()
    });
}
