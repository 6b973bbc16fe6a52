//! Pictures of all sizes.

use crate::frames::{at_corner, blank, camera, picture, seen};
use crate::models::on_floor;
use crate::runs::{Run, run, settings};
use crate::table::Device;
use crate::table::{Found, On, Table};
use kinlight::image::{Image, Size};
use kinlight::math::Pinhole;
use kinlight::pipeline::{GpuPipeline, Pipeline};
use kinlight::scene::VirtualScene;
use kinlight::scene::analytic::AnalyticScene;

pub fn cases(table: &mut Table) {
    for (width, height) in
        [(1, 1), (3, 1), (1, 3), (2, 2), (5, 4), (16, 1), (1, 64), (17, 16), (67, 43)]
    {
        for poses in ["recorded", "track"] {
            table.case("size", format!("{width}x{height}, poses {poses}"), On::Both, |on| {
                let settings = settings(&[("tracking.mode", poses)])?;
                let frame =
                    |i| seen(&AnalyticScene::corner(), Size::new(width, height), at_corner(), i);
                run(on, &settings, on_floor(), &[frame(0), frame(1), frame(2)])?.finish()
            });
        }
    }
    table.case("size", "67x43, transfer on every 8th pixel", On::Both, |on| {
        let settings = settings(&[("transfer.subsampling", "8")])?;
        let frame = |i| seen(&AnalyticScene::corner(), Size::new(67, 43), at_corner(), i);
        run(on, &settings, on_floor(), &[frame(0), frame(1)])?.finish()
    });
    table.case("size", "1920x1080, one frame", On::Both, |on| {
        let settings = settings(&[("transfer.subsampling", "8"), ("light.stride", "8")])?;
        let frame = seen(&AnalyticScene::corner(), Size::new(1920, 1080), at_corner(), 0);
        let mut run = run(on, &settings, on_floor(), &[frame])?;
        run.broken.rule(run.outcomes[0].composed, || "it is not composed".to_owned());
        run.finish()
    });
    // A binding holds 128 MiB, and 48 bytes are kept of a pixel.
    table.case("size", "2048x2048 is refused on the GPU", On::Gpu, |on| {
        let Device::Gpu(gpu) = on else { return Err("no GPU".to_owned()) };
        let (camera, scene) = (camera(Size::new(2048, 2048)), VirtualScene::default());
        refused(GpuPipeline::new(gpu.clone(), settings(&[])?, camera, scene).err(), "memory")
    });
    cameras(table);
    mismatched(table);
}

/// An error that names what was wrong.
fn refused(error: Option<impl std::fmt::Display>, word: &str) -> Result<Found, String> {
    let text = error.ok_or("it was taken")?.to_string();
    Ok(Found::broken(usize::from(!text.contains(word)), text))
}

/// Cameras that are none.
fn cameras(table: &mut Table) {
    let whole = camera(Size::new(64, 48));
    let broken = [
        ("without pixels", Pinhole { width: 0, height: 0, ..whole }, "0x0"),
        ("without rows", Pinhole { height: 0, ..whole }, "64x0"),
        ("of focal length 0", Pinhole { fx: 0.0, ..whole }, "focal"),
        ("of negative focal length", Pinhole { fy: -50.0, ..whole }, "focal"),
        ("of focal length NaN", Pinhole { fx: f32::NAN, ..whole }, "focal"),
        ("of infinite focal length", Pinhole { fy: f32::INFINITY, ..whole }, "focal"),
        ("of centre NaN", Pinhole { cx: f32::NAN, ..whole }, "principal"),
        ("of infinite centre", Pinhole { cy: f32::INFINITY, ..whole }, "principal"),
    ];
    for (name, camera, word) in broken {
        table.case("size", format!("a camera {name} is refused"), On::Both, |on| {
            let (settings, scene) = (settings(&[])?, VirtualScene::default());
            match on {
                Device::Cpu => refused(Pipeline::new(settings, camera, scene).err(), word),
                Device::Gpu(gpu) => {
                    refused(GpuPipeline::new(gpu.clone(), settings, camera, scene).err(), word)
                }
            }
        });
    }
    let odd = [
        ("of focal length 1e-3", Pinhole { fx: 1e-3, fy: 1e-3, ..whole }),
        ("of focal length 1e6", Pinhole { fx: 1e6, fy: 1e6, ..whole }),
        ("of focal lengths 1 and 1000", Pinhole { fx: 1.0, fy: 1000.0, ..whole }),
        ("of a centre 1e5 pixels away", Pinhole { cx: 1e5, cy: -1e5, ..whole }),
    ];
    for (name, camera) in odd {
        table.case("size", format!("a camera {name}"), On::Both, |on| {
            let settings = settings(&[])?;
            let mut run = Run::new(on, &settings, camera, on_floor()).map_err(|e| e.to_string())?;
            for index in 0..2 {
                let mut frame = blank(camera.size(), index, Some(at_corner()));
                frame.depth_m.fill(1.5);
                run.frame(&frame).map_err(|e| e.to_string())?;
            }
            run.finish()
        });
    }
}

/// Frames that do not fit the camera, or themselves.
fn mismatched(table: &mut Table) {
    let (size, other) = (Size::new(64, 48), Size::new(32, 24));
    table.case("size", "depth of another size than colour is an error", On::Both, |on| {
        let settings = settings(&[])?;
        let mut run =
            Run::new(on, &settings, camera(size), on_floor()).map_err(|e| e.to_string())?;
        let mut frame = seen(&AnalyticScene::corner(), size, at_corner(), 0);
        run.frame(&frame).map_err(|e| e.to_string())?;
        frame.depth_m = Image::new(other, 1.0);
        refused(run.frame(&frame).err(), "32x24")
    });
    for poses in ["track", "recorded", "static"] {
        table.case(
            "size",
            format!("a frame of another size mid-run, poses {poses}"),
            On::Both,
            |on| {
                let settings = settings(&[("tracking.mode", poses)])?;
                let mut run =
                    Run::new(on, &settings, camera(size), on_floor()).map_err(|e| e.to_string())?;
                let frame = |size, index| seen(&AnalyticScene::corner(), size, at_corner(), index);
                run.frame(&frame(size, 0)).map_err(|e| e.to_string())?;
                let small = run.frame(&frame(other, 1)).map(|outcome| outcome.composed);
                match small {
                    // tracked: lost, and the camera's picture
                    Ok(composed) => run.broken.rule(!composed, || "it is composed".to_owned()),
                    Err(error) => {
                        let text = error.to_string();
                        run.broken.rule(text.contains("32x24"), || text);
                    }
                }
                run.frame(&frame(size, 2)).map_err(|e| e.to_string())?;
                run.finish()
            },
        );
    }
    table.case("size", "colour of noise, depth of one row", On::Both, |on| {
        let settings = settings(&[])?;
        let mut frame = seen(&AnalyticScene::corner(), size, at_corner(), 0);
        frame.depth_m = picture(size, |_, v| if v == 24 { 1.0 } else { 0.0 });
        run(on, &settings, on_floor(), &[frame])?.finish()
    });
}
