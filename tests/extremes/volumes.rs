//! Volumes of all sizes.

use crate::frames::{EYE, SIZE, at_corner, look, seen};
use crate::models::on_floor;
use crate::runs::{QUICK, run, settings};
use crate::table::{Found, On, Table};
use glam::Vec3;
use kinlight::config::Settings;
use kinlight::scene::analytic::{AnalyticScene, Shape};

pub fn cases(table: &mut Table) {
    for side_m in [0.01, 2.0, 50.0] {
        for resolution in [8, 64, 512] {
            let name = format!("{resolution}^3 voxels over {side_m} m");
            table.case("volume", name, On::Both, move |on| {
                let settings = settings(&[
                    ("volume.side_m", &format!("{side_m:?}")),
                    ("volume.resolution", &resolution.to_string()),
                ])?;
                let frame = |index| seen(&AnalyticScene::corner(), SIZE, at_corner(), index);
                run(on, &settings, on_floor(), &[frame(0), frame(1)])?.finish()
            });
        }
    }
    table.case("volume", "64^3 voxels over 1 cm, all of them seen", On::Both, |on| {
        // a wall 30 cm before the camera, across the volume
        let wall = AnalyticScene::new([Shape::Plane { normal: Vec3::X, offset: EYE.x - 0.3 }]);
        let pose = look(EYE, EYE - Vec3::X);
        let settings = settings(&[("volume.side_m", "0.01")])?;
        let frame = |index| seen(&wall, SIZE, pose, index);
        let mut run = run(on, &settings, on_floor(), &[frame(0), frame(1), frame(2)])?;
        let mesh = run.backend().mesh().map_err(|e| e.to_string())?;
        // The depths of two pixels 5 mm apart are interpolated.
        let bad = mesh.positions.iter().filter(|p| (p[0] - (EYE.x - 0.3)).abs() > 1e-4).count();
        run.broken.rule(!mesh.positions.is_empty(), || "no mesh".to_owned());
        run.broken.values(bad, || "vertices beside the wall".to_owned());
        run.finish()
    });
    truncation(table);
}

/// A voxel's diagonal is the least: nearer, a surface between voxels may have none of either sign beside it.
fn truncation(table: &mut Table) {
    // 2 m over 64 voxels: a diagonal of 54 mm
    for (truncation, taken) in [
        ("0.01", false),
        ("0.0541", false),
        ("0.0542", true),
        ("0.5", true),
        ("2.0", true),
        ("2.1", false),
    ] {
        let name = format!("truncation of {truncation} m, voxels of 31 mm");
        if !taken {
            table.case("volume", format!("{name}, is refused"), On::Host, move |_| {
                let mut settings = Settings::preset("ours-mobile").map_err(|e| e.to_string())?;
                settings.set("volume.truncation_m", truncation).map_err(|e| e.to_string())?;
                let text = settings.validate().err().ok_or("it is taken")?.to_string();
                Ok(Found::broken(usize::from(!text.contains("truncation_m")), text))
            });
            continue;
        }
        table.case("volume", name, On::Both, move |on| {
            let settings = settings(&[("volume.truncation_m", truncation)])?;
            let frame = |index| seen(&AnalyticScene::corner(), SIZE, at_corner(), index);
            let mut run = run(on, &settings, on_floor(), &[frame(0), frame(1)])?;
            run.broken.rule(run.outcomes[1].composed, || "it is not composed".to_owned());
            run.finish()
        });
    }
    for (name, changes) in [
        ("weights of 1", [("volume.max_weight", "1"), ("volume.free_weight", "1")]),
        ("weights of 1024", [("volume.max_weight", "1024"), ("volume.free_weight", "65535")]),
    ] {
        table.case("volume", name, On::Both, move |on| {
            let changes: Vec<_> = QUICK.into_iter().chain(changes).collect();
            let frame = |index| seen(&AnalyticScene::corner(), SIZE, at_corner(), index);
            let frames: Vec<_> = (0..4).map(frame).collect();
            run(on, &settings(&changes)?, on_floor(), &frames)?.finish()
        });
    }
}
