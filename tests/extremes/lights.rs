//! Light of all strengths and from all sides, and transfer of all resolutions.

use crate::frames::{SIZE, at_corner, seen};
use crate::models::on_floor;
use crate::runs::{run, settings};
use crate::table::{Device, Found, On, Outcome, Table};
use glam::Vec3;
use kinlight::capture::RawFrame;
use kinlight::image::Image;
use kinlight::lighting::{LightEstimator, ShLight};
use kinlight::math::sh;
use kinlight::pipeline::{Buffer, BufferValues, Pipeline};
use kinlight::scene::analytic::AnalyticScene;
use kinlight::timing::StageTimes;

fn corner(index: usize) -> RawFrame {
    seen(&AnalyticScene::corner(), SIZE, at_corner(), index)
}

/// A lamp and ambient light, times `scale`.
fn light(towards: Vec3, bands: usize, scale: f32) -> ShLight {
    let basis = sh::basis(towards.normalize(), bands);
    let ambient = |i: usize| if i == 0 { 0.6 } else { 0.0 };
    let coefficients =
        (0..sh::coefficients(bands)).map(|i| [scale * (0.8 * basis[i] + ambient(i)); 3]);
    ShLight { bands, coefficients: coefficients.collect() }
}

fn above(bands: usize, scale: f32) -> ShLight {
    light(Vec3::new(0.4, -0.5, 0.8), bands, scale)
}

fn under(on: Device<'_>, light: ShLight, changes: &[(&str, &str)]) -> Outcome {
    let settings = settings(changes)?;
    let frames = [corner(0), corner(1)];
    let mut run = run(on, &settings, on_floor(), &frames[..1])?;
    run.set_light(Some(light));
    run.frame(&frames[1]).map_err(|e| e.to_string())?;
    run.broken.rule(run.outcomes[1].composed, || "it is not composed".to_owned());
    run.finish()
}

pub fn cases(table: &mut Table) {
    for scale in [0.0, 1e-38, 1e-20, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e20, 1e38] {
        table.case("light", format!("given, {scale:e} times as strong"), On::Both, move |on| {
            under(on, above(4, scale), &[])
        });
    }
    for (name, light) in [
        ("from below the floor", light(-Vec3::Z, 4, 1.0)),
        ("from behind the wall", light(Vec3::new(-1.0, 1.0, -0.1), 4, 1.0)),
        ("negative", above(4, -1.0)),
        ("of NaN", above(4, f32::NAN)),
        ("infinite", above(4, f32::INFINITY)),
        ("of 6 bands, 4 in use", above(6, 1.0)),
        ("of 1 band, 4 in use", above(1, 1.0)),
        ("without coefficients", ShLight::default()),
        ("with fewer coefficients than its bands have", ShLight { bands: 4, ..above(2, 1.0) }),
    ] {
        table.case("light", format!("given, {name}"), On::Both, move |on| {
            under(on, light.clone(), &[])
        });
    }
    for albedo in ["1e-6", "1e-3", "1.0"] {
        for compositor in ["ratio", "difference"] {
            let name = format!("light.mean_albedo {albedo}, compositor {compositor}");
            table.case("light", name, On::Both, move |on| {
                let changes =
                    [("light.mean_albedo", albedo), ("compositing.compositor", compositor)];
                under(on, above(4, 1.0), &changes)
            });
        }
    }
    for bands in 1..=sh::MAX_BANDS {
        table.case("light", format!("estimated in {bands} bands"), On::Both, move |on| {
            let settings = settings(&[("transfer.bands", &bands.to_string())])?;
            let mut run = run(on, &settings, on_floor(), &[corner(0), corner(1), corner(2)])?;
            let light = &run.outcomes[2].light;
            let (valid, direction) = (light.valid(), light.light.dominant_direction());
            run.broken.rule(valid && direction.is_some() == (bands > 1), || {
                format!("valid {valid}, from {direction:?}")
            });
            run.finish()
        });
    }
    visibility(table);
    scales(table);
}

/// Under light of 1 from everywhere R is the mean visible cosine.
fn visibility(table: &mut Table) {
    let image_space = [
        ("4", "1", "4"),
        ("16", "3", "4"),
        ("1024", "1", "4"),
        ("32", "16", "6"),
        ("32", "3", "1"),
    ];
    let image_space = image_space.map(|(n, samples, bands)| (n, samples, bands, "image-space"));
    let traced = [("4", "1", "4", "ray-traced"), ("1024", "1", "2", "ray-traced")];
    for (directions, samples, bands, method) in image_space.into_iter().chain(traced) {
        let name = format!("{method}, {directions} directions, {samples} samples, {bands} bands");
        table.case("transfer", name, On::Both, move |on| {
            let settings = settings(&[
                ("transfer.method", method),
                ("bounce.enabled", if method == "ray-traced" { "false" } else { "true" }),
                ("transfer.directions", directions),
                ("transfer.samples", samples),
                ("transfer.bands", bands),
                ("transfer.subsampling", "1"),
            ])?;
            let bands = settings.transfer.bands;
            let mut coefficients = vec![[0.0; 3]; sh::coefficients(bands)];
            coefficients[0] = [1.0 / sh::basis(Vec3::Z, 1)[0]; 3];
            let mut run = run(on, &settings, on_floor(), &[corner(0)])?;
            run.set_light(Some(ShLight { bands, coefficients }));
            run.frame(&corner(1)).map_err(|e| e.to_string())?;
            for which in [Buffer::Shading, Buffer::VirtualShading] {
                let values = run.backend().buffer(which).map_err(|e| e.to_string())?;
                let Some(BufferValues::Light(shading)) = values else {
                    return Err("no R".to_owned());
                };
                let (mut least, mut most) = (f32::MAX, 0f32);
                for &v in shading.as_slice().as_flattened() {
                    (least, most) = (least.min(v), most.max(v));
                }
                // R is not below 8 % of the mean light (compositing::grid); a sum of up to 1024 weights
                let holds = least > 0.079 && most < 1.0 + 1e-4;
                run.broken.rule(holds, || format!("{which:?} from {least} to {most}"));
                run.broken.rule(least < 0.9, || format!("{which:?}: nothing is hidden anywhere"));
            }
            run.finish()
        });
    }
}

/// A picture of linear light that is stronger by a power of two has a light that is stronger by as much.
fn scales(table: &mut Table) {
    for power in [-40, -20, -10, 10, 20, 40] {
        let name = format!("estimated from linear light times 2^{power}");
        table.case("light", name, On::Host, move |_| {
            let settings = settings(&[])?;
            let camera = crate::frames::camera(SIZE);
            let text = |e: kinlight::pipeline::PipelineError| e.to_string();
            let mut pipeline =
                Pipeline::new(settings.clone(), camera, Default::default()).map_err(text)?;
            pipeline.process(corner(0), StageTimes::default()).map_err(text)?;
            let stages = pipeline.stages().ok_or("not composed")?;
            let estimate = |scale: f32| {
                let mut frame = stages.frame.clone();
                let scaled = frame.color.as_slice().iter().map(|rgb| rgb.map(|c| scale * c));
                frame.color = Image::from_vec(SIZE, scaled.collect());
                let mut estimator = LightEstimator::new(&settings.light);
                estimator.estimate(&frame, stages.real, stages.real_transfer, None)
            };
            let scale = 2f32.powi(power);
            let (one, scaled) = (estimate(1.0), estimate(scale));
            if !(one.valid() && scaled.valid()) {
                return Err(format!("{:?} and {:?}", one.rejection, scaled.rejection));
            }
            let pairs = one.light.coefficients.as_flattened().iter();
            let pairs = pairs.zip(scaled.light.coefficients.as_flattened());
            let (mut apart, mut whole) = (0.0, 0.0);
            for (&a, &b) in pairs {
                apart += f64::from(a - b / scale).powi(2);
                whole += f64::from(a).powi(2);
            }
            // Powers of two are exact: every step is, unless a threshold is absolute.
            let what = "relative difference of the light; powers of two are exact";
            Ok(Found::new((apart / whole).sqrt(), 1e-6, what))
        });
    }
}
