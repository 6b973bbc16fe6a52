//! Distances of 16 bits and weights of 16 bits at their ends, for a long time.

use crate::frames::{SIZE, ball, camera, look, seen};
use crate::runs::{run, settings};
use crate::table::{Device, Found, On, Outcome, Table};
use glam::Vec3;
use kinlight::capture::{InputParams, InputStage, RawFrame, RgbdFrame};
use kinlight::fusion::{Lattice, TsdfVolume, VolumeParams};
use kinlight::gpu::stages::{FramePictures, GpuVolume};
use kinlight::image::Size;
use kinlight::math::{Pose, View};
use kinlight::mesh::TriangleMesh;
use kinlight::scene::VirtualScene;
use kinlight::scene::analytic::{AnalyticScene, Shape};

const PICTURE: Size = Size::new(32, 24);

/// A plane through the middle of the volume, seen askew.
const NORMAL: Vec3 = Vec3::new(0.8, 0.0, 0.6);

fn pose() -> Pose {
    look(Vec3::new(1.0, -0.2, 0.5), Vec3::ZERO)
}

fn plane(offset: f32) -> RgbdFrame {
    prepared(seen(
        &AnalyticScene::new([Shape::Plane { normal: NORMAL, offset }]),
        PICTURE,
        pose(),
        0,
    ))
}

fn prepared(raw: RawFrame) -> RgbdFrame {
    let mut out = RgbdFrame::default();
    InputStage::new(&InputParams::default()).prepare(raw, &mut out);
    out
}

/// Of 16^3 voxels of 25 mm, with the largest weight there is.
fn params() -> VolumeParams {
    VolumeParams {
        side_m: 0.4,
        resolution: 16,
        max_weight: 1024,
        free_weight: 1024,
        centre: Some([0.0; 3]),
        ..VolumeParams::default()
    }
}

/// A volume that frames go into in turn; meshes after the second and the last.
fn integrated(
    on: Device<'_>,
    frames: &[RgbdFrame],
    count: usize,
) -> Result<[TriangleMesh; 2], String> {
    let view = View::perspective(camera(PICTURE), pose());
    let lattice = Lattice::new(&params(), Vec3::ZERO).map_err(|e| e.to_string())?;
    match on {
        Device::Cpu => {
            let mut volume = TsdfVolume::new(&params(), Vec3::ZERO).map_err(|e| e.to_string())?;
            let mut early = TriangleMesh::default();
            for index in 0..count {
                let frame = &frames[index % frames.len()];
                volume.integrate(frame, &view).map_err(|e| e.to_string())?;
                if index == 1 {
                    early = volume.mesh();
                }
            }
            Ok([early, volume.mesh()])
        }
        Device::Gpu(gpu) => {
            let text = |e: kinlight::gpu::GpuError| e.to_string();
            let mut volume = GpuVolume::new(gpu, &params(), lattice).map_err(text)?;
            let mut pictures = Vec::new();
            for frame in frames {
                let picture = FramePictures::new(gpu, PICTURE).map_err(text)?;
                picture.upload(gpu, frame);
                pictures.push(picture);
            }
            let mut early = TriangleMesh::default();
            for index in 0..count {
                let mut commands = gpu.commands();
                let picture = &pictures[index % pictures.len()];
                volume
                    .integrate(&mut commands, picture, index, &view)
                    .map_err(|e| e.to_string())?;
                commands.submit().map_err(text)?;
                if index == 1 {
                    early = volume.mesh(gpu).map_err(text)?;
                }
            }
            Ok([early, volume.mesh(gpu).map_err(text)?])
        }
    }
}

/// Of a mesh's vertices from the plane through the origin.
fn farthest(mesh: &TriangleMesh) -> f64 {
    let distances = mesh.positions.iter().map(|&p| f64::from(NORMAL.dot(p.into()).abs()));
    distances.fold(0.0, f64::max)
}

/// So many on the CPU, a hundredth on the GPU, where software is slow.
fn rounds(on: Device<'_>, count: usize) -> usize {
    match on {
        Device::Cpu => count,
        Device::Gpu(_) => count / 100,
    }
}

pub fn cases(table: &mut Table) {
    table.case("storage", "one frame integrated for ever (CPU 100000, GPU 1000)", On::Both, |on| {
        let [early, late] = integrated(on, &[plane(0.0)], rounds(on, 100_000))?;
        same_mesh(&early, &late)
    });
    table.case("storage", "two frames 2 mm apart in turn (CPU 50000, GPU 500)", On::Both, |on| {
        let [one, _] = integrated(on, &[plane(0.0)], 2)?;
        let frames = [plane(-0.001), plane(0.001)];
        let [_, late] = integrated(on, &frames, rounds(on, 50_000))?;
        if late.positions.is_empty() {
            return Err("no mesh".to_owned());
        }
        // Between the two, as exactly as one of them is met.
        let bound = 0.001 + farthest(&one);
        Ok(Found::new(farthest(&late), bound, "metres from the plane between the two"))
    });
    table.case("storage", "free space for ever, then a surface", On::Both, |on| {
        let mut frames = vec![plane(-1.0); rounds(on, 2000)];
        // as many as the largest weight: the mean of both is at half the way
        frames.resize(frames.len() + 3 * 1024, plane(0.0));
        let [_, late] = integrated(on, &frames, frames.len())?;
        if late.positions.is_empty() {
            return Err("no mesh".to_owned());
        }
        // What was free is forgotten to e^-3 of the truncation distance, 0.1 m; and a voxel.
        let bound = 0.1 * (-3f64).exp() + 0.025;
        Ok(Found::new(farthest(&late), bound, "metres from the surface that came"))
    });
    table.case("storage", "light samples packed in 16 bits, ball of all normals", On::Gpu, |on| {
        let settings = settings(&[("light.stride", "1"), ("transfer.subsampling", "1")])?;
        let pose = look(Vec3::new(1.0, -0.6, 0.9), Vec3::new(-0.1, 0.1, 0.15));
        let frames = [0, 1, 2].map(|index| seen(&ball(), SIZE, pose, index));
        let run = run(on, &settings, VirtualScene::default(), &frames)?;
        let degrees = run.light_apart_deg();
        let found = run.finish()?;
        // as that of the demo in the tests of both pipelines
        Ok(found.worse(Found::new(degrees, 0.5, "degrees from the light of the CPU")))
    });
}

/// Largest distance of a vertex from where it was.
fn same_mesh(early: &TriangleMesh, late: &TriangleMesh) -> Outcome {
    if early.positions.is_empty() || early.positions.len() != late.positions.len() {
        let [a, b] = [early, late].map(|mesh| mesh.positions.len());
        return Err(format!("{a} vertices became {b}"));
    }
    let pairs = early.positions.as_flattened().iter().zip(late.positions.as_flattened());
    let drift = pairs.map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max);
    Ok(Found::new(drift, 0.0, format!("metres of drift of {} vertices", late.positions.len())))
}
