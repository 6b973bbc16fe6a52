//! Transfer errors of the whole pipeline on a made scene.

use super::{SurfaceRays, TransferError, TransferErrorOptions, transfer_error};
use crate::capture::FrameSource;
use crate::config::Settings;
use crate::pipeline::Pipeline;
use crate::scene::VirtualScene;
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

/// The newest frame's transfer against true rays from the map's own points, against the true points'
/// transfer, and against rays through the pipeline's own mesh.
struct Measured {
    visibility: TransferError,
    with_geometry: TransferError,
    own_mesh: TransferError,
}

fn measure(folder: &Path, truth: &TrueWorld, settings: Settings, rays: usize) -> Measured {
    let mut source = open_made(folder, true).expect("a sequence");
    let step = settings.transfer.subsampling;
    let mut pipeline = Pipeline::new(settings, source.camera(), VirtualScene::default()).unwrap();
    each_frame(&mut source, &mut pipeline, &mut |_, _| Ok(())).expect("frames");
    let map = pipeline.transfer().expect("the newest frame's transfer");
    let (real, _) = pipeline.geometry().expect("the newest frame's geometry");
    let own = SurfaceRays::new(&pipeline.mesh());
    let true_rays = |p: Vec3, d: Vec3| truth.occluded(p, d, f32::INFINITY);
    let options = TransferErrorOptions { rays, every: 8 / step, ..Default::default() };
    let exact = TransferErrorOptions { lift_m: 1e-4, ..options };
    Measured {
        visibility: transfer_error(map, real, true_rays, &options).expect("surfaces"),
        with_geometry: transfer_error(map, &truth.seen_in(&truth.view), true_rays, &exact)
            .expect("surfaces"),
        own_mesh: transfer_error(map, real, |p, d| own.occluded(p, d), &options).expect("surfaces"),
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
    println!("{:?}\n{:?}\n{:?}", found.visibility, found.with_geometry, found.own_mesh);
    let Measured { visibility, with_geometry, own_mesh } = found;
    assert!(visibility.relative_l2 < 1.1 * 0.2, "{visibility:?}");
    assert!(with_geometry.relative_l2 < 1.1 * 0.3, "{with_geometry:?}");
    assert!(own_mesh.relative_l2 < 1.1 * 0.2, "{own_mesh:?}");
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
    println!("N step | true rays: whole, hidden part, open, bias | + depth, normals | own mesh");
    for directions in [8, 32, 128] {
        for step in [1, 4] {
            let m = measure(&path, &truth, settings(directions, step), 256);
            let v = m.visibility;
            println!(
                "{directions:3} {step} | {:.3} {:.3} {:.3} {:+.3} of {:.3}, {} points | {:.3} {:.3} | {:.3} {:.3}",
                v.relative_l2,
                v.hidden_relative_l2.unwrap_or(0.0),
                v.open_relative_l2,
                v.dc_bias,
                v.hidden_share,
                v.points,
                m.with_geometry.relative_l2,
                m.with_geometry.open_relative_l2,
                m.own_mesh.relative_l2,
                m.own_mesh.open_relative_l2,
            );
        }
    }
}
