//! Transfer errors of the whole pipeline on a made scene.

use super::{SurfaceRays, TransferError, TransferErrorOptions, transfer_error};
use crate::capture::FrameSource;
use crate::config::Settings;
use crate::pipeline::Pipeline;
use crate::scene::VirtualScene;
use crate::stop::Stop;
use crate::study::{each_frame, open_made};
use crate::synth::{SynthOptions, TrueWorld, generate, true_world};
use glam::Vec3;
use std::path::Path;

const LAST: usize = 7;

fn options(width: usize, height: usize) -> SynthOptions {
    SynthOptions {
        scene: "desk".into(),
        frames: LAST + 1,
        width,
        height,
        samples: 1,
        bounces: 1,
        kinect_noise: true,
        ..SynthOptions::default()
    }
}

/// The newest frame's transfer against true rays from the map's own points (unlimited, and as long as the
/// stage's radius), from the true points, and against rays through the pipeline's own mesh.
struct Measured {
    unlimited: TransferError,
    near: TransferError,
    with_geometry: TransferError,
    own_mesh: TransferError,
}

fn measure(folder: &Path, truth: &TrueWorld, settings: Settings, rays: usize) -> Measured {
    let mut source = open_made(folder, true).expect("a sequence");
    let (step, radius_m) = (settings.transfer.subsampling, settings.transfer.radius_m);
    let mut pipeline = Pipeline::new(settings, source.camera(), VirtualScene::default()).unwrap();
    each_frame(&mut source, &mut pipeline, &Stop::default(), &mut |_, _| Ok(())).expect("frames");
    let map = pipeline.transfer().expect("the newest frame's transfer");
    let (real, _) = pipeline.geometry().expect("the newest frame's geometry");
    let own = SurfaceRays::new(&pipeline.mesh());
    let true_rays = |p: Vec3, d: Vec3| truth.occluded(p, d, f32::INFINITY);
    let options = TransferErrorOptions { rays, every: 8 / step, ..Default::default() };
    let exact = TransferErrorOptions { lift_m: 1e-4, ..options };
    Measured {
        unlimited: transfer_error(map, real, true_rays, &options).expect("surfaces"),
        near: transfer_error(map, real, |p, d| truth.occluded(p, d, radius_m), &options)
            .expect("surfaces"),
        with_geometry: transfer_error(map, &truth.seen_in(&truth.view), true_rays, &exact)
            .expect("surfaces"),
        own_mesh: transfer_error(map, real, |p, d| own.occluded(p, d, f32::INFINITY), &options)
            .expect("surfaces"),
    }
}

fn settings(directions: usize, step: usize) -> Settings {
    let mut settings = Settings::default();
    settings.transfer.directions = directions;
    settings.transfer.subsampling = step;
    settings
}

/// The figures are those of the default settings, with a tenth to spare.
#[test]
fn error_of_the_default_on_a_made_desk_is_as_measured() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("desk");
    let options = options(160, 120);
    generate(&options, &path, &|_, _| {}).expect("a free folder");
    let truth = true_world(&options, LAST).expect("the last frame");
    let found = measure(&path, &truth, settings(32, 4), 128);
    println!("{:?}\n{:?}", found.unlimited, found.near);
    println!("{:?}\n{:?}", found.with_geometry, found.own_mesh);
    // A wall 3 m high stands behind the desk, of which the volume holds the lowest metre: without
    // occlusion the first would be 0.72, against the own mesh 0.33.
    let below = |error: TransferError, measured: f64| {
        assert!(error.relative_l2 < 1.1 * measured, "{measured}: {error:?}");
        assert!(error.hidden_relative_l2.is_some_and(|e| e < 0.9), "{error:?}");
    };
    below(found.unlimited, 0.553);
    below(found.near, 0.226);
    below(found.with_geometry, 0.596);
    below(found.own_mesh, 0.222);
}

/// The trade of directions and step, printed.
#[test]
#[ignore = "minutes; prints a table"]
fn table_of_directions_and_steps() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("desk");
    let options = options(320, 240);
    generate(&options, &path, &|_, _| {}).expect("a free folder");
    let truth = true_world(&options, LAST).expect("the last frame");
    println!(
        "N step | unlimited rays: error, open | as long as the radius: error, open, bias | true points | own mesh"
    );
    for directions in [8, 32, 128] {
        for step in [1, 4] {
            let m = measure(&path, &truth, settings(directions, step), 256);
            let (far, near) = (m.unlimited, m.near);
            println!(
                "{directions:3} {step} | {:.3} {:.3} | {:.3} {:.3} {:+.3} of {:.3} | {:.3} {:.3} | {:.3} {:.3}",
                far.relative_l2,
                far.open_relative_l2,
                near.relative_l2,
                near.open_relative_l2,
                near.dc_bias,
                near.hidden_share,
                m.with_geometry.relative_l2,
                m.with_geometry.open_relative_l2,
                m.own_mesh.relative_l2,
                m.own_mesh.open_relative_l2,
            );
        }
    }
}
