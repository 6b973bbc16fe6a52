//! Timings, printed on request:
//! `cargo test --release --lib time_transfer -- --ignored --nocapture`.

use super::test_support::{auxiliary_views, camera, paint_virtual};
use super::*;
use crate::image::Image;
use crate::scene::analytic::{AnalyticScene, Shape};
use glam::Vec3;
use std::time::Instant;

fn best_ms(runs: usize, mut work: impl FnMut()) -> f64 {
    (0..runs)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64() * 1e3
        })
        .fold(f64::INFINITY, f64::min)
}

#[test]
#[ignore = "a timing, to be run in release"]
fn time_transfer_640x480() {
    let real = AnalyticScene::corner();
    let mut merged = real.clone();
    merged.shapes.push(Shape::Sphere { centre: Vec3::new(0.1, -0.35, 0.1), radius: 0.1 });
    let view = camera(640, 480);
    let views = auxiliary_views(256);
    let real_main = real.render(&view);
    let real_auxiliary: Vec<_> = views.iter().map(|v| real.render(v)).collect();
    let merged_main = paint_virtual(&real_main, merged.render(&view));
    let merged_auxiliary: Vec<_> = (views.iter().zip(&real_auxiliary))
        .map(|(v, before)| paint_virtual(before, merged.render(v)))
        .collect();
    let radiance = Image::new(merged_main.size(), [0.5; 3]);
    let auxiliary_radiance: Vec<_> =
        merged_auxiliary.iter().map(|b| Image::new(b.size(), [0.5; 3])).collect();
    for (samples, step) in [(1, 1), (1, 4), (2, 1), (2, 2), (2, 4)] {
        let params = TransferParams { samples, subsampling: step, ..TransferParams::default() };
        let mut stage = RadianceTransfer::new(&params, &BounceParams::default()).unwrap();
        let mut out = TransferMap::default();
        let alone = best_ms(15, || stage.transfer(&real_main, &[], &mut out));
        let all = best_ms(15, || stage.transfer(&real_main, &real_auxiliary, &mut out));
        let (mut both, mut indirect) = (TransferMap::default(), IndirectMap::default());
        let mut with_virtual = |radiance: Option<Radiance>| {
            best_ms(15, || {
                stage.transfer_and_bounce(
                    (&real_main, &real_auxiliary),
                    (&merged_main, &merged_auxiliary),
                    radiance,
                    &out,
                    &mut both,
                    &mut indirect,
                );
            })
        };
        let unlit = with_virtual(None);
        let bounce = with_virtual(Some((&radiance, &auxiliary_radiance)));
        println!(
            "{samples} samples, step {step}: transfer {alone:.2} ms alone, {all:.2} ms with 4 auxiliary buffers; \
             with virtual {unlit:.2} ms, and with the bounce {bounce:.2} ms"
        );
    }
}
