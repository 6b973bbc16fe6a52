use super::*;
use crate::fusion::{SurfaceParams, SurfaceStage};
use std::time::Instant;

/// Smallest and median time of `work`, ms.
fn time(name: &str, repeats: usize, mut work: impl FnMut()) {
    let mut times: Vec<f64> = (0..repeats)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    println!("{name:28} min {:7.2} ms, median {:7.2} ms", times[0], times[repeats / 2]);
}

/// `cargo test --release --lib time_fusion -- --ignored --nocapture`
#[test]
#[ignore = "prints times"]
fn time_fusion_640x480() {
    let scene = AnalyticScene::corner();
    for resolution in [64, 128, 256, 512] {
        let mut volume = volume(resolution);
        integrate_arc(&mut volume, &scene, (640, 480), 12);
        println!(
            "resolution {resolution}: {} blocks, {:.1} MB",
            volume.allocated_blocks(),
            volume.memory_bytes() as f64 / 1e6
        );
        let view = View::perspective(camera(640, 480), arc(1).next().unwrap());
        let frame = render(&scene, &view);
        time("integrate", 15, || volume.integrate(&frame, &view).unwrap());
        let mut out = GBuffer::empty(view);
        time("raycast 640x480", 15, || volume.raycast(&view, &mut out));
        let params = SurfaceParams {
            left: true,
            right: true,
            refresh_per_frame: 0,
            ..SurfaceParams::default()
        };
        let mut stage = SurfaceStage::new(&volume, view, &params);
        stage.update(&volume, view, Some(Vec3::new(0.2, -0.3, 0.9)));
        for (buffer, name) in stage.auxiliary.iter_mut().zip(["left", "right", "top", "light"]) {
            let view = buffer.view;
            time(&format!("raycast 256x256 {name}"), 15, || volume.raycast(&view, buffer));
        }
        time("mesh", 3, || {
            volume.mesh();
        });
    }
}
