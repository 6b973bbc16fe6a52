use super::*;

/// Differences of a cast buffer from the scene's exact one, where the exact depth lies in the
/// volume and away from edges.
#[derive(Debug)]
struct Difference {
    compared: usize,
    found: usize,
    rms_depth_voxels: f64,
    p99_depth_voxels: f64,
    median_normal_deg: f64,
    p95_normal_deg: f64,
}

fn compare(volume: &TsdfVolume, scene: &AnalyticScene, view: &View, inset_m: f32) -> Difference {
    let (truth, out) = (scene.render(view), cast(volume, view));
    let size = view.size();
    let world_from_view = view.world_from_view_f32();
    let (low, high) = volume.bounds();
    let (mut compared, mut depths, mut angles) = (0, Vec::new(), Vec::new());
    for y in 4..size.height - 4 {
        for x in 4..size.width - 4 {
            let (depth, normal) = (truth.depth_m[(x, y)], truth.normals.at(x, y));
            let point = world_from_view
                .transform_point3(view.unproject(glam::Vec2::new(x as f32, y as f32), depth));
            let inside = point.cmpgt(low + inset_m).all() && point.cmplt(high - inset_m).all();
            let flat = (0..9).all(|i| {
                let (nx, ny) = (x + i % 3 * 4 - 4, y + i / 3 * 4 - 4);
                let near = (truth.depth_m[(nx, ny)] - depth).abs() < 0.05;
                near && truth.normals.at(nx, ny).dot(normal) > 0.9
            });
            if depth == 0.0 || !inside || !flat {
                continue;
            }
            compared += 1;
            if out.depth_m[(x, y)] == 0.0 {
                continue;
            }
            // distance from the surface, not along the ray
            let towards = world_from_view
                .transform_vector3(view.towards_eye(glam::Vec2::new(x as f32, y as f32)));
            let along_z = (out.depth_m[(x, y)] - depth) / volume.voxel_m();
            depths.push(f64::from(along_z * towards.dot(normal).abs()).abs());
            angles.push(f64::from(out.normals.at(x, y).angle_between(normal).to_degrees()));
        }
    }
    let found = depths.len();
    depths.sort_by(f64::total_cmp);
    angles.sort_by(f64::total_cmp);
    let rank = |v: &[f64], share: f64| v[(share * (v.len() - 1) as f64) as usize];
    Difference {
        compared,
        found,
        rms_depth_voxels: (depths.iter().map(|d| d * d).sum::<f64>() / found as f64).sqrt(),
        p99_depth_voxels: rank(&depths, 0.99),
        median_normal_deg: rank(&angles, 0.5),
        p95_normal_deg: rank(&angles, 0.95),
    }
}

#[test]
fn cast_depth_and_normals_are_those_of_the_scene() {
    let scene = AnalyticScene::corner();
    let mut volume = volume(256);
    integrate_arc(&mut volume, &scene, (640, 480), 12);
    let perspective = View::perspective(camera(320, 240), arc(5).nth(2).unwrap());
    let top = orthographic(256, 2.0, look_at(Vec3::new(0.3, -0.3, 1.6), Vec3::new(-0.1, 0.1, 0.0)));
    for view in [perspective, top] {
        println!("{:?}", compare(&volume, &scene, &view, 0.05));
    }
}
