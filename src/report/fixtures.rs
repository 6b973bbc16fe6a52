//! Made-up records in the shape of real ones, for tests of the page alone.

use crate::math::random::Rng;
use crate::output::{FrameTiming, TimingRecorder, TimingSummary};
use crate::study::Machine;
use crate::study::composite::{CompositeFrame, CompositeRun, CompositeStudy};
use crate::study::light::{Jitter, LightFrame, LightRun, LightStudy, StepResponse, StepTrace};
use crate::study::tradeoff::{TradePoint, Tradeoff};
use crate::timing::{Stage, StageTimes};
use crate::tracking::TrackingState;
use glam::DVec3;
use std::time::Duration;

pub const METHODS: [&str; 4] = ["ours", "ours-fast", "gr12", "reference-sphere"];
const SCENES: [&str; 6] = ["sphere", "boxes", "colours", "desk", "shelf", "room"];

pub fn machine() -> Machine {
    Machine {
        cpu: "made-up processor <test>".into(),
        threads: 2,
        system: "linux".into(),
        backend: "cpu".into(),
        version: "0.0.0".into(),
    }
}

/// On a half circle, 50 degrees above the horizon.
fn lamp(light: usize) -> DVec3 {
    let around = std::f64::consts::PI * (0.125 + 0.25 * light as f64);
    let up = 50f64.to_radians();
    DVec3::new(around.cos() * up.cos(), around.sin() * up.cos(), up.sin())
}

pub fn light_study() -> LightStudy {
    let mut runs = Vec::new();
    for (s, scene) in SCENES.iter().enumerate() {
        for light in 0..4 {
            for sensor_noise in [false, true] {
                for (m, method) in METHODS.iter().enumerate() {
                    let words = [s as u32, light as u32, u32::from(sensor_noise), m as u32];
                    runs.push(light_run(scene, light, sensor_noise, method, &mut Rng::new(&words)));
                }
            }
        }
    }
    LightStudy {
        machine: machine(),
        command: "kinlight study light --out 'a & b'".into(),
        scenes: SCENES.map(String::from).to_vec(),
        methods: METHODS.map(String::from).to_vec(),
        frames_per_run: 24,
        warm_up: 4,
        runs,
        steps: steps(),
        jitter: jitter(),
    }
}

fn light_run(
    scene: &str,
    light: usize,
    sensor_noise: bool,
    method: &str,
    rng: &mut Rng,
) -> LightRun {
    let truth = lamp(light);
    let normal = |rng: &mut Rng| f64::from(rng.normal());
    let spread = if method.starts_with("reference") { 0.04 } else { 0.1 };
    let spread = if sensor_noise { 1.6 * spread } else { spread };
    let bias = DVec3::new(normal(rng), normal(rng), normal(rng)) * spread;
    let frames = (4..24).map(|frame| {
        let off = DVec3::new(normal(rng), normal(rng), normal(rng)) * 0.4 * spread;
        let direction = (truth + bias + off).normalize();
        let angle_deg = Some(direction.dot(truth).clamp(-1.0, 1.0).acos().to_degrees());
        let relative_l2 = 0.15 + spread + 0.02 * normal(rng).abs();
        LightFrame { frame, direction: Some(direction.to_array()), angle_deg, relative_l2 }
    });
    LightRun {
        scene: scene.into(),
        light,
        sensor_noise,
        method: method.into(),
        true_direction: truth.to_array(),
        frames: frames.collect(),
        invalid: 0,
        stage_ms: [("Update".to_owned(), 100.0)].into(),
    }
}

fn steps() -> Vec<StepResponse> {
    let mut all = Vec::new();
    for scene in ["boxes", "desk", "room"] {
        for (m, method) in METHODS[..3].iter().enumerate() {
            let rate = 0.5 - 0.13 * m as f64;
            let trace = (0..30).map(|frame| {
                let since = frame as f64 - 10.0;
                let distance = if since < 0.0 { 0.9 } else { 0.9 * (1.0 - rate).powf(since + 1.0) };
                StepTrace { frame, distance, angle_deg: Some(40.0 * distance) }
            });
            let trace: Vec<StepTrace> = trace.collect();
            let settled = trace.iter().find(|t| t.distance < 0.1).map(|t| t.frame - 10);
            all.push(StepResponse {
                scene: scene.into(),
                method: (*method).into(),
                sensor_noise: false,
                switch_frame: 10,
                settled_after: settled.filter(|_| scene != "room" || m != 2),
                trace,
            });
        }
    }
    all
}

fn jitter() -> Vec<Jitter> {
    let of = |(m, method): (usize, &&str)| Jitter {
        scene: "desk".into(),
        method: (*method).into(),
        sensor_noise: true,
        frames: 40,
        median_deg: 0.05 + 0.03 * m as f64,
        max_deg: 0.4,
        relative_l2: 0.002,
    };
    METHODS[..3].iter().enumerate().map(of).collect()
}

pub fn composite_study() -> CompositeStudy {
    let variants: [(&str, &str, &[&str], f64); 5] = [
        ("ours", "ours", &[], 0.40),
        ("ours-fast", "ours-fast", &[], 0.43),
        ("gr12", "gr12", &[], 0.38),
        ("ours", "chi as printed", &["transfer.chi=printed"], 0.46),
        ("ours", "no indirect light", &["bounce.strength=0"], 0.39),
    ];
    let mut runs = Vec::new();
    for (s, sequence) in ["desk", "room"].iter().enumerate() {
        for (o, object) in ["diffuse", "coloured", "bright-dark"].iter().enumerate() {
            for (preset, variant, changes, error) in variants {
                let error = error + 0.02 * s as f64 + 0.01 * o as f64;
                let frame = |frame: usize| CompositeFrame {
                    frame,
                    psnr_db: 36.0 - 10.0 * error,
                    ssim: 0.99 - 0.02 * error,
                    flip: 0.02 * error,
                    changed_rmse: error + 0.002 * frame as f64,
                    object_rmse: 0.5 * error,
                    shadow_found: 0.9,
                    spill: 0.5,
                    noise_rmse: 0.05,
                    changed_pixels: 4000,
                    light_deg: 5.0,
                    implied_albedo: 0.5,
                };
                runs.push(CompositeRun {
                    sequence: (*sequence).into(),
                    object: (*object).into(),
                    sensor_noise: false,
                    folder: (*sequence).into(),
                    preset: preset.into(),
                    key: variant.into(),
                    variant: variant.into(),
                    changes: changes.iter().map(|c| (*c).to_owned()).collect(),
                    frames: (0..5).map(frame).collect(),
                    update_ms: 300.0 * error,
                });
            }
        }
    }
    CompositeStudy { machine: machine(), command: "kinlight study composite".into(), runs }
}

pub fn tradeoff() -> Tradeoff {
    let mut points = Vec::new();
    for (p, preset) in ["ours", "ours-fast"].iter().enumerate() {
        for (i, directions) in [32, 8, 16, 24, 48, 64].into_iter().enumerate() {
            for bands in [4, 2, 3] {
                let mut rng = Rng::new(&[p as u32, i as u32, bands]);
                let cost = f64::from(directions) * f64::from(bands);
                let update_ms = 60.0 + cost * if p == 0 { 1.9 } else { 0.17 };
                let error = 6.0
                    + 300.0 / (cost + 20.0)
                    + 3.0 * f64::from(rng.uniform())
                    + if p == 0 { 0.0 } else { 1.0 };
                let plain = i == 0 && bands == 4;
                let changes = [
                    format!("transfer.directions={directions}"),
                    format!("transfer.bands={bands}"),
                ];
                points.push(TradePoint {
                    name: match plain {
                        true => (*preset).to_owned(),
                        false => format!("{directions} directions, {bands} bands"),
                    },
                    preset: (*preset).into(),
                    changes: if plain { vec![] } else { changes.to_vec() },
                    stage_ms: [("Update".to_owned(), update_ms)].into(),
                    update_ms,
                    light_angle_deg: Some(error),
                    light_relative_l2: Some(0.03 * error),
                    transfer_error: None,
                    composite_error: Some(0.05 * error),
                    volume_mib: 12.0,
                    on_front: false,
                });
            }
        }
    }
    Tradeoff {
        machine: machine(),
        command: "kinlight tradeoff".into(),
        sequences: vec!["desk".into(), "room".into()],
        warm_up: 5,
        points,
    }
}

/// Stages in milliseconds, in the order of [`Stage::ALL`].
pub fn timings(stages_ms: [f64; 7]) -> TimingSummary {
    let frame = |frame: usize| {
        let mut stages = StageTimes::default();
        for (stage, ms) in Stage::ALL.into_iter().zip(stages_ms) {
            let ms = ms * (1.0 + 0.01 * frame as f64);
            stages.add(stage, Duration::from_secs_f64(1e-3 * ms));
        }
        FrameTiming {
            frame,
            timestamp_s: frame as f64 / 30.0,
            duration: stages.update(),
            age: None,
            stages,
            position_m: [0.0; 3],
            state: TrackingState::Tracking,
            setting: "ours".to_owned(),
        }
    };
    let mut recorder = TimingRecorder::new(1);
    (0..9).map(frame).for_each(|timing| recorder.push(&timing));
    recorder.summary().expect("frames are left")
}

pub const STAGES_MS: [(&str, [f64; 7]); 3] = [
    ("ours", [3.3, 14.5, 32.1, 6.1, 222.5, 4.8, 18.4]),
    ("ours-fast", [2.7, 14.2, 31.9, 5.9, 20.8, 2.4, 16.2]),
    ("gr12", [3.2, 14.4, 12.0, 0.0, 860.0, 4.7, 18.1]),
];
