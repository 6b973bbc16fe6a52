//! The files of a light study.

use super::record::{LightRun, LightStudy};
use super::summary::{noise_name, quantile, summary};
use super::table::number;
use crate::output::atomic_write;
use crate::study::StudyError;
use std::path::Path;

/// Writes `study.json`, `runs.csv`, `frames.csv` and `summary.md`.
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
    Ok(())
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
