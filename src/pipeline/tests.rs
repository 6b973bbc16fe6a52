//! What is left out because it would come out as before must come out as if nothing were left out.

use super::*;
use crate::compositing::VirtualLayer;
use crate::geometry::Origin;
use crate::image::Size;
use crate::lighting::exitant::{DominantLight, exitant_radiance};
use crate::math::sh;
use crate::scene::analytic::AnalyticScene;
use crate::scene::{Model, Similarity, VirtualObject};
use crate::tracking::PoseMode;
use glam::Vec3;
use std::sync::Arc;

const SIZE: Size = Size::new(67, 43);

/// The corner scene from a camera that moves a little; colours are arbitrary but not all the same.
fn frame(index: usize) -> RawFrame {
    let angle = 0.2 + 0.01 * index as f32;
    let eye = Vec3::new(1.6 * angle.cos(), -1.6 * angle.sin() - 0.3, 1.2);
    let z = (Vec3::new(-0.1, 0.2, 0.2) - eye).normalize();
    let x = z.cross(Vec3::Z).normalize();
    let q = glam::Quat::from_mat3(&glam::Mat3::from_cols(x, z.cross(x), z)).as_dquat();
    let pose =
        crate::math::pose_from_xyzw(eye.as_dvec3().to_array(), [q.x, q.y, q.z, q.w]).unwrap();
    let seen = AnalyticScene::corner().render(&View::perspective(camera(), pose));
    let color = (0..SIZE.pixels()).map(|i| {
        let n = seen.normals.at(i % SIZE.width, i / SIZE.width);
        n.to_array().map(|n| (120.0 + 90.0 * n) as u8)
    });
    RawFrame {
        index,
        timestamp_s: index as f64 / 30.0,
        color: Image::from_vec(SIZE, color.collect()),
        depth_m: seen.depth_m,
        world_from_camera: Some(pose),
        exposure_s: None,
    }
}

fn camera() -> Pinhole {
    Pinhole { width: SIZE.width, height: SIZE.height, fx: 55.0, fy: 55.0, cx: 33.0, cy: 21.0 }
}

fn settings() -> Settings {
    let mut settings = Settings::preset("ours-mobile").unwrap();
    settings.tracking.mode = PoseMode::Recorded;
    settings.surface.auxiliary_resolution = 64;
    (settings.surface.left, settings.surface.right) = (true, true);
    settings.surface.warm_up_updates = 2;
    settings.transfer.subsampling = 2;
    (settings.surface.left, settings.surface.right) = (true, true);
    settings
}

fn light_from(towards: Vec3) -> ShLight {
    let basis = sh::basis(towards.normalize(), 4);
    let ambient = |i: usize| if i == 0 { 0.6 } else { 0.0 };
    let coefficients = (0..16).map(|i| [1.0, 0.9, 0.8].map(|c| c * basis[i] + ambient(i)));
    ShLight { bands: 4, coefficients: coefficients.collect() }
}

fn pipeline() -> Pipeline {
    let mut pipeline = Pipeline::new(settings(), camera(), VirtualScene::default()).unwrap();
    pipeline.set_light(Some(light_from(Vec3::new(0.4, -0.5, 0.8))));
    pipeline
}

/// All objects, where the recording's world has `places`.
fn put(pipeline: &mut Pipeline, model: &Arc<Model>, places: &[Vec3]) {
    let origin = pipeline.origin.expect("after the first frame");
    pipeline.scene.objects = places
        .iter()
        .map(|place| {
            let at = origin.local_point(place.as_dvec3().to_array());
            let pose = Similarity::standing(at, Vec3::Z, 0.4, 1.0);
            VirtualObject::placed(model.clone(), pose)
        })
        .collect();
}

fn process(pipeline: &mut Pipeline, index: usize) {
    let outcome = pipeline.process(frame(index), StageTimes::default()).unwrap();
    assert!(outcome.composed, "frame {index}");
}

/// A view with everything drawn and every pixel's radiance.
struct Drawn {
    buffer: GBuffer,
    layer: VirtualLayer,
    radiance: Image<[f32; 3]>,
}

fn drawn(pipeline: &Pipeline, real: &GBuffer, color: Option<&Image<[f32; 3]>>) -> Drawn {
    let (mut buffer, mut layer) = (GBuffer::empty(real.view), VirtualLayer::default());
    Rasteriser::default().draw(&pipeline.scene, real, &mut buffer, &mut layer);
    let light = DominantLight::of(&pipeline.light().unwrap().light);
    let albedo = pipeline.settings.light.mean_albedo;
    let mut radiance = Image::default();
    exitant_radiance(&buffer, &layer, color, light, albedo, &mut radiance);
    Drawn { buffer, layer, radiance }
}

fn assert_same(a: &GBuffer, b: &GBuffer, what: &str) {
    assert!(a.view == b.view && a.depth_m == b.depth_m, "{what}");
    assert!(a.normals == b.normals && a.origin == b.origin, "{what}");
}

/// Redoes the newest frame's virtual part with new buffers and stages, and compares.
fn assert_complete(pipeline: &Pipeline, what: &str) {
    let settings = &pipeline.settings;
    let Map { volume, surface, sides } = pipeline.map.as_ref().unwrap();
    let FrameBuffers { frame, real, .. } = &pipeline.last;
    let main = drawn(pipeline, real, Some(&frame.color));
    let (buffers, radiance): (Vec<_>, Vec<_>) = (surface.auxiliary.iter())
        .map(|side| drawn(pipeline, side, None))
        .map(|drawn| (drawn.buffer, drawn.radiance))
        .unzip();
    let bounce = settings.bounce.enabled;
    let mut stage = TransferStage::new(&settings.transfer, &settings.bounce).unwrap();
    let scene = RealScene { volume, main: real, auxiliary: &surface.auxiliary };
    let with_virtual = MergedScene {
        objects: &pipeline.scene,
        main: &main.buffer,
        auxiliary: &buffers,
        radiance: bounce.then_some((&main.radiance, &radiance)),
    };
    let (mut real_transfer, mut transfer) = (TransferMap::default(), TransferMap::default());
    let mut indirect = IndirectMap::default();
    stage.transfer(scene, &mut real_transfer);
    stage.transfer_and_bounce(scene, with_virtual, &real_transfer, &mut transfer, &mut indirect);
    let input = ComposeInput {
        frame,
        real,
        merged: &main.buffer,
        layer: &main.layer,
        real_transfer: &real_transfer,
        merged_transfer: &transfer,
        indirect: bounce.then_some(&indirect),
        light: &pipeline.light().unwrap().light,
        mean_albedo: settings.light.mean_albedo,
    };
    let mut composed = Image::default();
    let mut compositor = CompositingStage::new(&settings.compositing);
    compositor.compose(&input, &mut composed);

    assert_eq!(pipeline.composed(), &composed, "{what}");
    assert_same(pipeline.geometry().unwrap().1, &main.buffer, what);
    let (shading, expected) = (pipeline.shading().unwrap(), compositor.shading_buffers(&input));
    assert!(shading.real == expected.real && shading.merged == expected.merged, "{what}");
    let last = &pipeline.last;
    if !last.changed {
        assert!(transfer == real_transfer, "{what}");
        assert!(indirect.rgb.iter().all(|&rgb| rgb == [0.0; 3]), "{what}");
        return;
    }
    assert!(last.merged_transfer == transfer && (!bounce || last.indirect == indirect), "{what}");
    if settings.transfer.method == TransferMethod::ImageSpace {
        assert_eq!(sides.buffers.len(), buffers.len(), "{what}");
        for (side, expected) in sides.buffers.iter().zip(&buffers) {
            assert_same(side, expected, what);
        }
        assert!(!bounce || sides.radiance == radiance, "{what}");
    }
}

fn shown_in_main(pipeline: &Pipeline) -> bool {
    pipeline.geometry().unwrap().1.origin.as_slice().contains(&Origin::Virtual)
}

/// On the floor in view; above what the camera sees but within the volume; out of everything.
const SEEN: Vec3 = Vec3::new(0.35, -0.35, 0.0);
const BESIDE: Vec3 = Vec3::new(0.5, 0.3, 1.07);
const AWAY: Vec3 = Vec3::new(50.0, 0.0, 0.0);

#[test]
fn objects_that_stand_move_and_vanish() {
    let model = Arc::new(crate::synth::virtual_object::model());
    let mut pipeline = pipeline();
    let shift = Vec3::new(0.03, -0.02, 0.0);
    // places, whether they change the picture, whether the camera sees them
    let script: [(&[Vec3], bool, bool); 12] = [
        (&[], false, false),
        (&[SEEN], true, true),
        (&[SEEN], true, true),
        (&[SEEN], true, true),
        (&[SEEN + shift], true, true),
        (&[BESIDE], true, false),
        (&[BESIDE], true, false),
        (&[AWAY], false, false),
        (&[SEEN], true, true),
        (&[], false, false),
        (&[BESIDE, SEEN], true, true),
        (&[SEEN], true, true),
    ];
    process(&mut pipeline, 0);
    assert_complete(&pipeline, "no objects at the start");
    for (index, (places, changes, seen)) in (1..).zip(script) {
        put(&mut pipeline, &model, places);
        process(&mut pipeline, index);
        assert_eq!(pipeline.last.changed, changes, "frame {index}");
        assert_eq!(shown_in_main(&pipeline), seen, "frame {index}");
        assert_complete(&pipeline, &format!("frame {index}"));
    }
}

#[test]
fn other_settings_light_and_map() {
    let model = Arc::new(crate::synth::virtual_object::model());
    let mut pipeline = pipeline();
    process(&mut pipeline, 0);
    put(&mut pipeline, &model, &[SEEN, BESIDE]);
    let script: [(&str, &[(&str, &str)]); 7] = [
        ("without the left view", &[("surface.left", "false")]),
        ("with it", &[("surface.left", "true")]),
        ("other sizes", &[("surface.auxiliary_resolution", "48")]),
        ("no bounce", &[("bounce.enabled", "false")]),
        ("ray-traced", &[("transfer.method", "ray-traced")]),
        ("image-space", &[("transfer.method", "image-space")]),
        ("with bounce", &[("bounce.enabled", "true")]),
    ];
    let mut index = 1;
    let mut run = |pipeline: &mut Pipeline, what: &str| {
        for turn in 0..3 {
            process(pipeline, index);
            assert!(pipeline.last.changed, "{what}");
            assert_complete(pipeline, &format!("{what}, turn {turn}"));
            index += 1;
        }
    };
    run(&mut pipeline, "at first");
    for (what, changes) in script {
        let mut settings = pipeline.settings.clone();
        for (key, value) in changes {
            settings.set(key, value).unwrap();
        }
        pipeline.reconfigure(settings).unwrap();
        run(&mut pipeline, what);
    }
    pipeline.set_light(Some(light_from(Vec3::new(-0.6, -0.2, 0.5))));
    run(&mut pipeline, "another light");
    pipeline.map = None;
    run(&mut pipeline, "a new map");
}

/// Side views drawn in a frame; all are filled with wrong values for that.
fn redrawn(pipeline: &mut Pipeline, index: usize) -> usize {
    fn sides(pipeline: &mut Pipeline) -> &mut Vec<GBuffer> {
        &mut pipeline.map.as_mut().unwrap().sides.buffers
    }
    sides(pipeline).iter_mut().for_each(|buffer| buffer.depth_m.fill(f32::NAN));
    process(pipeline, index);
    let is_new = |buffer: &&mut GBuffer| !buffer.depth_m.as_slice()[0].is_nan();
    sides(pipeline).iter_mut().filter(is_new).count()
}

#[test]
fn a_side_view_is_drawn_when_it_or_an_object_is_new() {
    let model = Arc::new(crate::synth::virtual_object::model());
    let mut pipeline = pipeline();
    (0..4).for_each(|index| process(&mut pipeline, index));
    put(&mut pipeline, &model, &[SEEN]);
    process(&mut pipeline, 4);
    assert_eq!(redrawn(&mut pipeline, 5), 1, "the one that is refreshed");
    put(&mut pipeline, &model, &[SEEN]);
    assert_eq!(redrawn(&mut pipeline, 6), 1, "put where it stands already");
    put(&mut pipeline, &model, &[SEEN + 0.01]);
    assert_eq!(redrawn(&mut pipeline, 7), 4, "moved");
    put(&mut pipeline, &model, &[]);
    assert_eq!(redrawn(&mut pipeline, 8), 0, "nothing to draw");
}
