use super::tests::support::*;
use super::*;
use crate::scene::analytic::{AnalyticScene, Shape};
use glam::Vec3;
use rayon::prelude::*;

pub fn wall() -> AnalyticScene {
    AnalyticScene::new([
        Shape::Plane { normal: Vec3::Z, offset: 0.0 },
        Shape::Box { min: Vec3::new(-1.0, 0.3, 0.0), max: Vec3::new(1.0, 0.4, 0.8) },
    ])
}
pub fn desk() -> AnalyticScene {
    AnalyticScene::new([
        Shape::Plane { normal: Vec3::Z, offset: 0.0 },
        Shape::Box { min: Vec3::new(-0.4, -0.1, 0.0), max: Vec3::new(-0.1, 0.25, 0.3) },
        Shape::Sphere { centre: Vec3::new(0.3, 0.1, 0.22), radius: 0.22 },
        Shape::Box { min: Vec3::new(0.0, -0.3, 0.0), max: Vec3::new(0.05, -0.25, 0.25) },
    ])
}

pub fn room() -> AnalyticScene {
    let mut s = desk();
    s.shapes.push(Shape::Box { min: Vec3::new(-0.9, 0.5, 0.0), max: Vec3::new(0.6, 0.55, 0.6) });
    s.shapes.push(Shape::Box { min: Vec3::new(-0.7, -0.7, 0.0), max: Vec3::new(-0.65, 0.5, 0.5) });
    s.shapes.push(Shape::Box { min: Vec3::new(-0.4, -0.1, 0.5), max: Vec3::new(0.2, 0.25, 0.52) });
    s
}
#[test]
#[ignore]
fn study() {
    for (name, scene) in [("wall", wall()), ("desk", desk()), ("room", room())] {
        let view = camera(96, 72);
        let main = scene.render(&view);
        let aux: Vec<_> = auxiliary_views(256).iter().map(|v| scene.render(v)).collect();
        let wfv = view.world_from_view_f32();
        let truth: Vec<[f32; 36]> = (0..main.size().pixels())
            .into_par_iter()
            .map(|p| {
                let (x, y) = (p % 96, p / 96);
                let d = main.depth_m[(x, y)];
                if d <= 0.0 {
                    return [0.0; 36];
                }
                let n = main.normals.at(x, y);
                let pos = wfv
                    .transform_point3(view.unproject(glam::Vec2::new(x as f32, y as f32), d))
                    + n * 1e-4;
                reference::traced_transfer(|o, w| scene.hit(o, w).is_some(), pos, n, 4, 500)
            })
            .collect();
        for chi in [ChiReading::Text, ChiReading::Neighbour, ChiReading::Printed] {
            for n in [32] {
                for samples in [1, 2] {
                    for bias_m in [0.0f32, 0.005, 0.01, 0.02] {
                        for radius in [1.0] {
                            for (buffers, aux) in [("all", &aux[..])] {
                                let params = TransferParams {
                                    directions: n,
                                    radius_m: radius,
                                    chi,
                                    samples,
                                    bias_m,
                                    ..Default::default()
                                };
                                let mut stage =
                                    RadianceTransfer::new(&params, &Default::default()).unwrap();
                                let mut out = TransferMap::default();
                                stage.transfer(&main, aux, &mut out);
                                // tile averages as well
                                let (mut e, mut e0, mut t2, mut bias, mut hid, mut cnt) =
                                    (0f64, 0f64, 0f64, 0f64, 0f64, 0);
                                let mut eo = 0f64;
                                for p in 0..truth.len() {
                                    let (x, y) = (p % 96, p / 96);
                                    if main.depth_m[(x, y)] <= 0.0 {
                                        continue;
                                    }
                                    let un = crate::math::sh::unoccluded_transfer(
                                        main.normals.at(x, y),
                                        4,
                                    );
                                    let a = out.at(x, y);
                                    for k in 0..16 {
                                        e += f64::from(a[k] - truth[p][k]).powi(2);
                                        eo += f64::from(un[k] - truth[p][k]).powi(2);
                                        t2 += f64::from(truth[p][k]).powi(2);
                                    }
                                    e0 += 0.0;
                                    let s = std::f64::consts::PI.sqrt() * 2.0;
                                    bias += f64::from(a[0] - truth[p][0]) * s;
                                    hid += 1.0 - f64::from(truth[p][0]) * s;
                                    cnt += 1;
                                }
                                let _ = e0;
                                println!(
                                    "S {name} {chi:?} N {n} m {samples} b {bias_m} R {radius} {buffers}: rel L2 {:.3} (no occlusion {:.3}) mean hidden {:.3} found {:.3}",
                                    (e / t2).sqrt(),
                                    (eo / t2).sqrt(),
                                    hid / f64::from(cnt),
                                    (hid - bias) / f64::from(cnt)
                                );
                            }
                        }
                    }
                }
            }
        }
    }
}
