//! The files of a light study.

use super::record::{LightRun, LightStudy};
use super::summary::{noise_name, summary};
use super::table::number;
use crate::image::Image;
use crate::math::color::{luminance, srgb8_from_linear};
use crate::math::quantile;
use crate::output::{atomic_write, write_color_png};
use crate::study::StudyError;
use crate::synth::{SynthOptions, environment_picture};
use std::collections::BTreeSet;
use std::path::Path;

/// Of the pictures of the environment, pixels.
const ENVIRONMENT_WIDTH: usize = 512;

/// Writes `study.json`, `runs.csv`, `frames.csv`, `summary.md`, and `environment_lightN.png`: the true
/// light of each lamp around the first scene's centre, lat-long with +z up, tone mapped.
pub fn write(study: &LightStudy, out: &Path) -> Result<(), StudyError> {
    atomic_write(&out.join("study.json"), |w| {
        serde_json::to_writer_pretty(&mut *w, study)?;
        writeln!(w)
    })?;
    atomic_write(&out.join("runs.csv"), |w| {
        writeln!(
            w,
            "scene,light,noise,method,median_deg,p95_deg,median_l2,frames,invalid,update_ms,\
             radtransfer_ms"
        )?;
        study.runs.iter().try_for_each(|run| writeln!(w, "{}", run_line(run)))
    })?;
    atomic_write(&out.join("frames.csv"), |w| {
        writeln!(w, "scene,light,noise,method,frame,angle_deg,relative_l2,x,y,z")?;
        for run in &study.runs {
            for line in frame_lines(run) {
                writeln!(w, "{line}")?;
            }
        }
        Ok(())
    })?;
    atomic_write(&out.join("summary.md"), |w| w.write_all(summary(study).as_bytes()))?;
    write_environments(study, out)
}

fn write_environments(study: &LightStudy, out: &Path) -> Result<(), StudyError> {
    let Some(scene) = study.scenes.first() else { return Ok(()) };
    let lights: BTreeSet<usize> = study.runs.iter().map(|r| r.light).collect();
    for light in lights {
        let options = SynthOptions {
            scene: scene.clone(),
            frames: 1,
            light: Some(light),
            ..SynthOptions::default()
        };
        let radiance = environment_picture(&options, 0, ENVIRONMENT_WIDTH)?;
        let mapped = radiance.as_slice().iter().map(|&rgb| tone_mapped(rgb)).collect();
        let picture = Image::from_vec(radiance.size(), mapped);
        write_color_png(&out.join(format!("environment_light{light}.png")), &picture)?;
    }
    Ok(())
}

/// Brings the ambient light of the made scenes, about 0.12, to middle grey in `tone_mapped`; their
/// lamps, about 20, stay below white.
pub const ENVIRONMENT_EXPOSURE: f32 = 4.0;

/// By luminance (Reinhard et al. 2002), without a white point: lamp and walls are both to be seen.
fn tone_mapped(rgb: [f32; 3]) -> [u8; 3] {
    let scale = ENVIRONMENT_EXPOSURE / (1.0 + ENVIRONMENT_EXPOSURE * luminance(rgb));
    rgb.map(|v| srgb8_from_linear(v * scale))
}

fn identity(run: &LightRun) -> String {
    let noise = noise_name(run.sensor_noise);
    format!("{},{},{noise},{}", run.scene, run.light, run.method)
}

/// Empty where there is none.
fn cell(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(String::new, |v| number(Some(v), decimals))
}

fn run_line(run: &LightRun) -> String {
    let ms = |stage: &str| cell(run.stage_ms.get(stage).copied(), 3);
    [
        identity(run),
        cell(run.median_deg(), 4),
        cell(quantile(run.angles_deg(), 0.95), 4),
        cell(run.median_relative_l2(), 6),
        run.frames.len().to_string(),
        run.invalid.to_string(),
        ms("Update"),
        ms("RadTransfer"),
    ]
    .join(",")
}

fn frame_lines(run: &LightRun) -> impl Iterator<Item = String> {
    run.frames.iter().map(|frame| {
        let axis = |i: usize| cell(frame.direction.map(|d| d[i]), 6);
        [
            identity(run),
            frame.frame.to_string(),
            cell(frame.angle_deg, 4),
            cell(Some(frame.relative_l2), 6),
            axis(0),
            axis(1),
            axis(2),
        ]
        .join(",")
    })
}
