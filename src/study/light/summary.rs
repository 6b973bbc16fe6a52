//! What a light study found, as tables.

use super::record::{LightRun, LightStudy, StepResponse};
use super::table::{Table, number};
use super::{REFERENCE, REFERENCE_ALONE};
use crate::eval::light::angle_deg;
use crate::math::{median, quantile};
use glam::{DVec3, Vec3};

/// Markdown, with columns that line up on a terminal too.
pub fn summary(study: &LightStudy) -> String {
    let parts = [
        ("Error over all frames", all_runs(study)),
        ("Angle to the true dominant direction by scene, exact depth (median, degrees)", {
            by_scene(study, false)
        }),
        ("Angle to the true dominant direction by scene, Kinect depth (median, degrees)", {
            by_scene(study, true)
        }),
        ("Worst runs", worst_runs(study)),
        ("Lamp switched: frames until the light stays within 10 % of its final value", {
            steps(study)
        }),
        ("Nothing moves: change of the light from frame to frame", jitter(study)),
        ("Time a frame (median over runs, ms)", times(study)),
    ];
    let mut text = String::new();
    for (title, table) in parts.iter().filter(|(_, table)| !table.is_empty()) {
        text += &format!("### {title}\n\n{table}\n");
    }
    text += &caption(study);
    text
}

fn caption(study: &LightStudy) -> String {
    let machine = &study.machine;
    format!(
        "{} frames a run after {} that are not counted; {} scenes, {} runs. \
         `{REFERENCE}`: a grey ball in the room as a light probe, `{REFERENCE_ALONE}`: the same ball \
         without the room; same solver, exact normals, no depth. Measured on {} ({} threads, {}), \
         version {}:\n\n```\n{}\n```\n",
        study.frames_per_run,
        study.warm_up,
        study.scenes.len(),
        study.runs.len(),
        machine.cpu,
        machine.threads,
        machine.backend,
        machine.version,
        study.command,
    )
}

const NOISES: [bool; 2] = [false, true];

pub(super) fn noise_name(sensor_noise: bool) -> &'static str {
    if sensor_noise { "kinect" } else { "exact" }
}

fn runs<'a>(
    study: &'a LightStudy,
    method: &'a str,
    sensor_noise: bool,
) -> impl Iterator<Item = &'a LightRun> + Clone {
    study.runs.iter().filter(move |r| r.method == method && r.sensor_noise == sensor_noise)
}

impl LightRun {
    pub(super) fn angles_deg(&self) -> impl Iterator<Item = f64> {
        self.frames.iter().filter_map(|f| f.angle_deg)
    }

    /// Median over the frames that have a dominant direction.
    pub fn median_deg(&self) -> Option<f64> {
        median(self.angles_deg())
    }

    pub fn median_relative_l2(&self) -> Option<f64> {
        median(self.frames.iter().map(|f| f.relative_l2))
    }

    /// Mean direction of the frames.
    fn direction(&self) -> Option<Vec3> {
        let sum: DVec3 = self.frames.iter().filter_map(|f| f.direction).map(DVec3::from).sum();
        sum.try_normalize().map(|d| d.as_vec3())
    }

    /// Angle of each frame to what the light probe found under the same light.
    fn to_probe_deg(&self, study: &LightStudy) -> Vec<f64> {
        let same = |r: &&LightRun| r.scene == self.scene && r.light == self.light;
        let probe = runs(study, REFERENCE, false).find(same).and_then(LightRun::direction);
        let Some(probe) = probe else { return Vec::new() };
        let directions = self.frames.iter().filter_map(|f| f.direction);
        directions.filter_map(|d| angle_deg(DVec3::from(d).as_vec3(), probe)).collect()
    }
}

fn all_runs(study: &LightStudy) -> Table {
    let head = [
        "method",
        "depth",
        "angle, median (deg)",
        "95 %",
        "largest",
        "to the light probe, median (deg)",
        "relative L2, median",
        "frames",
        "without light",
    ];
    let mut table = Table::new(2, head);
    for method in &study.methods {
        for sensor_noise in NOISES {
            let runs = runs(study, method, sensor_noise);
            if runs.clone().next().is_none() {
                continue;
            }
            let angles = || runs.clone().flat_map(LightRun::angles_deg);
            let to_probe = runs.clone().flat_map(|r| r.to_probe_deg(study));
            let l2 = runs.clone().flat_map(|r| r.frames.iter().map(|f| f.relative_l2));
            table.push(vec![
                method.clone(),
                depth_name(method, sensor_noise).to_owned(),
                number(median(angles()), 1),
                number(quantile(angles(), 0.95), 1),
                number(quantile(angles(), 1.0), 1),
                number(median(to_probe), 1),
                number(median(l2), 3),
                runs.clone().map(|r| r.frames.len()).sum::<usize>().to_string(),
                runs.map(|r| r.invalid).sum::<usize>().to_string(),
            ]);
        }
    }
    table
}

fn depth_name(method: &str, sensor_noise: bool) -> &'static str {
    match method {
        REFERENCE | REFERENCE_ALONE => "none",
        _ => noise_name(sensor_noise),
    }
}

/// Median over the frames of all lights.
fn by_scene(study: &LightStudy, sensor_noise: bool) -> Table {
    let has_runs = |m: &&String| runs(study, m, sensor_noise).next().is_some();
    let methods: Vec<&String> = study.methods.iter().filter(has_runs).collect();
    let names = methods.iter().map(|m| m.as_str());
    let mut table = Table::new(1, ["scene"].into_iter().chain(names));
    if methods.is_empty() {
        return table;
    }
    for scene in &study.scenes {
        let cell = |method: &&String| {
            let runs = runs(study, method, sensor_noise).filter(|r| r.scene == *scene);
            number(median(runs.flat_map(LightRun::angles_deg)), 1)
        };
        table.push([scene.clone()].into_iter().chain(methods.iter().map(cell)).collect());
    }
    table
}

fn worst_runs(study: &LightStudy) -> Table {
    let head = ["method", "depth", "scene", "light", "angle, median (deg)", "95 %", "relative L2"];
    let mut table = Table::new(3, head);
    for method in &study.methods {
        for sensor_noise in NOISES {
            let medians =
                runs(study, method, sensor_noise).filter_map(|r| Some((r, r.median_deg()?)));
            let Some((worst, angle)) = medians.max_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
            table.push(vec![
                method.clone(),
                depth_name(method, sensor_noise).to_owned(),
                worst.scene.clone(),
                worst.light.to_string(),
                number(Some(angle), 1),
                number(quantile(worst.angles_deg(), 0.95), 1),
                number(worst.median_relative_l2(), 3),
            ]);
        }
    }
    table
}

fn steps(study: &LightStudy) -> Table {
    let head = ["method", "depth", "scene", "settled after", "angle before (deg)", "at the end"];
    let mut table = Table::new(3, head);
    for step in &study.steps {
        let settled = step.settled_after.map_or_else(|| "never".to_owned(), |n| n.to_string());
        table.push(vec![
            step.method.clone(),
            noise_name(step.sensor_noise).to_owned(),
            step.scene.clone(),
            settled,
            number(angle_before(step), 1),
            number(step.trace.last().and_then(|t| t.angle_deg), 1),
        ]);
    }
    table
}

/// Of the last frame under the old light.
fn angle_before(step: &StepResponse) -> Option<f64> {
    step.trace.iter().rfind(|t| t.frame < step.switch_frame)?.angle_deg
}

fn jitter(study: &LightStudy) -> Table {
    let head = ["method", "depth", "scene", "median (deg)", "largest (deg)", "relative L2, median"];
    let mut table = Table::new(3, head);
    for jitter in &study.jitter {
        table.push(vec![
            jitter.method.clone(),
            noise_name(jitter.sensor_noise).to_owned(),
            jitter.scene.clone(),
            number(Some(jitter.median_deg), 2),
            number(Some(jitter.max_deg), 2),
            number(Some(jitter.relative_l2), 4),
        ]);
    }
    table
}

fn times(study: &LightStudy) -> Table {
    const ROWS: [&str; 3] = ["Update", "RadTransfer", "LightEst"];
    let mut table = Table::new(1, ["method"].into_iter().chain(ROWS));
    for method in &study.methods {
        let over_runs = |row: &&str| {
            let of_method = study.runs.iter().filter(|r| r.method == *method);
            median(of_method.filter_map(|r| r.stage_ms.get(*row).copied()))
        };
        let cells: Vec<_> = ROWS.iter().map(over_runs).collect();
        if cells.iter().any(Option::is_some) {
            let cells = cells.into_iter().map(|ms| number(ms, 1));
            table.push([method.clone()].into_iter().chain(cells).collect());
        }
    }
    table
}
