use super::*;
use crate::fusion::SurfaceParams;
use crate::gpu::StageTimer;
use crate::gpu::stages::SurfacePass;
use crate::timing::Stage;

/// `cargo test --release --lib time_the_volume_on_the_device -- --ignored --nocapture`
#[test]
#[ignore = "prints times"]
fn time_the_volume_on_the_device() {
    let Some(gpu) = gpu() else { return };
    let Some(mut timer) = StageTimer::new(gpu).unwrap() else { return };
    println!("{}", gpu.summary());
    let scene = AnalyticScene::corner();
    for resolution in [128, 256] {
        let mut volume = Pair::new(gpu, &volume_params(resolution)).on_device;
        let views: Vec<View> =
            arc(8).map(|pose| View::perspective(camera(640, 480), pose)).collect();
        let params = SurfaceParams::default();
        let mut surface = SurfacePass::new(gpu, &volume, views[0], &params).unwrap();
        let mut times = [Vec::new(), Vec::new()];
        for view in &views {
            let pictures = upload_frame(gpu, &colored(render(&scene, view)));
            let mut commands = gpu.commands().timed(Some(&timer));
            volume.integrate(&mut commands, &pictures, 0, view).unwrap();
            surface.update(&mut commands, &volume, *view, Some(Vec3::Z)).unwrap();
            commands.submit_timed(Some(&mut timer)).unwrap();
            let taken = timer.take(gpu).unwrap().unwrap();
            times[0].push(taken.get(Stage::Reconstruct).as_secs_f64() * 1e3);
            times[1].push(taken.get(Stage::Surface).as_secs_f64() * 1e3);
        }
        let blocks = volume.allocated_blocks(gpu).unwrap();
        for (name, times) in ["integrate", "five views"].iter().zip(&mut times) {
            times.sort_by(f64::total_cmp);
            println!("{resolution}, {blocks} blocks: {name} {:.2} ms", times[times.len() / 2]);
        }
    }
}
