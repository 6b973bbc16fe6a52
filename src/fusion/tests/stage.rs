use super::*;
use crate::fusion::{SurfaceParams, SurfaceStage};

fn filled() -> (TsdfVolume, View, RgbdFrame) {
    let scene = AnalyticScene::corner();
    let mut volume = volume(64);
    let view = View::perspective(camera(160, 120), arc(1).next().unwrap());
    let frame = render(&scene, &view);
    volume.integrate(&frame, &view).unwrap();
    (volume, view, frame)
}

fn params(warm_up_updates: u64) -> SurfaceParams {
    SurfaceParams {
        auxiliary_resolution: 64,
        left: true,
        right: true,
        warm_up_updates,
        ..SurfaceParams::default()
    }
}

/// Which auxiliary buffers an update wrote.
fn redone(
    stage: &mut SurfaceStage,
    volume: &TsdfVolume,
    view: View,
    light: Option<Vec3>,
) -> Vec<usize> {
    for buffer in &mut stage.auxiliary {
        buffer.depth_m.fill(f32::NAN);
    }
    let before = stage.auxiliary.len();
    stage.update(volume, view, light);
    (0..stage.auxiliary.len())
        .filter(|&i| {
            i >= before || stage.auxiliary[i].depth_m.as_slice().iter().all(|d| !d.is_nan())
        })
        .collect()
}

#[test]
fn buffers_are_redone_in_turn_and_only_when_out_of_date() {
    let (mut volume, view, frame) = filled();
    let mut stage = SurfaceStage::new(&volume, view, &params(2));
    let light = Some(Vec3::new(0.3, -0.5, 0.8).normalize());
    assert_eq!(redone(&mut stage, &volume, view, light), [0, 1, 2, 3]);
    assert_eq!(redone(&mut stage, &volume, view, light), [0; 0], "nothing changed");
    let mut turns = Vec::new();
    for _ in 0..8 {
        volume.integrate(&frame, &view).unwrap();
        turns.push(redone(&mut stage, &volume, view, light));
    }
    assert_eq!(turns, [[0], [1], [2], [3], [0], [1], [2], [3]]);
}

#[test]
fn the_lights_buffer_follows_the_light() {
    let (volume, view, _) = filled();
    let mut stage = SurfaceStage::new(&volume, view, &params(0));
    // before the first cast nothing waits its turn
    assert_eq!(redone(&mut stage, &volume, view, None), [0, 1, 2]);
    let light =
        |degrees: f32| Some(Vec3::new(degrees.to_radians().sin(), 0.0, degrees.to_radians().cos()));
    assert_eq!(redone(&mut stage, &volume, view, light(0.0)), [3]);
    assert_eq!(redone(&mut stage, &volume, view, light(1.9)), [0; 0], "within the tolerance");
    assert_eq!(redone(&mut stage, &volume, view, light(2.1)), [3]);
    assert_eq!(redone(&mut stage, &volume, view, light(1.0)), [0; 0]);
    assert_eq!(redone(&mut stage, &volume, view, None), [0; 0], "kept");
    assert_eq!(redone(&mut stage, &volume, view, Some(Vec3::NAN)), [0; 0], "no direction");
}

#[test]
fn the_top_view_sees_the_floor_where_it_is() {
    let (volume, view, _) = filled();
    let mut stage = SurfaceStage::new(&volume, view, &params(0));
    stage.update(&volume, view, None);
    let top = &stage.auxiliary[2];
    let world_from_view = top.view.world_from_view_f32();
    let mut floor = 0;
    for y in 0..64 {
        for x in 0..64 {
            let depth = top.depth_m[(x, y)];
            if depth == 0.0 {
                continue;
            }
            let p = top.view.unproject(glam::Vec2::new(x as f32, y as f32), depth);
            let p = world_from_view.transform_point3(p);
            floor += usize::from(p.z.abs() < 0.25 * volume.voxel_m());
        }
    }
    assert!(floor > 300, "{floor}");
}
