//! Real recordings: skipped, visibly, where they are not there.

use super::plausibility::residual;
use super::*;
use std::path::PathBuf;

fn data(name: &str) -> Option<PathBuf> {
    let root = std::env::var("KINLIGHT_DATA").map(PathBuf::from);
    let root =
        root.unwrap_or_else(|_| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"));
    let folder = root.join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: no recording {}", folder.display());
    None
}

/// Median over frame pairs `gap` apart of the median reprojection error, millimetres.
fn reprojection_mm(sequence: &mut Sequence, gap: usize, step: usize) -> f64 {
    let camera = sequence.camera();
    let mut found: Vec<f64> = (0..sequence.pairs() - gap)
        .step_by(step)
        .map(|i| {
            let (a, b) = (sequence.frame(i).unwrap(), sequence.frame(i + gap).unwrap());
            let (from, to) = (a.world_from_camera.unwrap(), b.world_from_camera.unwrap());
            let moved = residual(&camera, &a.depth_m, &b.depth_m, &(to.inverse() * from), 1.0);
            1e3 * moved.unwrap().median_m
        })
        .collect();
    found.sort_by(f64::total_cmp);
    found[found.len() / 2]
}

#[test]
fn print_reports() {
    for name in [
        "7scenes_redkitchen",
        "rgbd_dataset_freiburg1_rpy",
        "dynamic_hands_cup",
        "open3d_rgbd",
        "mitsuba-sample",
    ] {
        let Some(folder) = data(name) else { continue };
        let start = std::time::Instant::now();
        println!("{}", inspect(&folder, &CaptureOptions::default()).unwrap());
        println!("{:?}", start.elapsed());
        let mut s = open_sequence(&folder, &CaptureOptions::default()).unwrap();
        for gap in [1, 4, 5, 10, 15, 30] {
            if s.pairs() > gap && s.info().poses_from.is_some() {
                println!("gap {gap}: {:.2} mm", reprojection_mm(&mut s, gap, 7));
            }
        }
    }
}
