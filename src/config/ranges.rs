//! What each setting may be.

use super::Settings;
use crate::pipeline::FARTHEST_M;

/// Everything that is out of range, each with its name and what is allowed. NaN is in no range.
pub(super) fn problems(settings: &Settings) -> Vec<String> {
    let mut problems = Vec::new();
    let mut need = |ok: bool, text: &str| {
        if !ok {
            problems.push(text.to_owned());
        }
    };
    let (i, s, g) = (&settings.input, &settings.surface, &settings.dyn_geo);
    need(
        i.min_depth_m >= 0.0 && i.max_depth_m > i.min_depth_m && i.max_depth_m <= 65.535,
        "input.min_depth_m and max_depth_m: 0 <= min < max <= 65.535",
    );
    tracking(settings, &mut need);
    need(place(settings.volume.centre), "volume.centre: three numbers within 1000 km");
    need((8..=2048).contains(&s.auxiliary_resolution), "surface.auxiliary_resolution: 8 to 2048");
    need(not_negative(s.light_tolerance_deg), "surface.light_tolerance_deg: 0 or more");
    for (name, window) in [
        ("merge_window", g.merge_window),
        ("smooth_window", g.smooth_window),
        ("denoise_window", g.denoise_window),
    ] {
        need((1..=64).contains(&window), &format!("dyn_geo.{name}: 1 to 64"));
    }
    need((1..=5).contains(&g.taps), "dyn_geo.taps: 1 to 5");
    need(positive(g.intensity_threshold), "dyn_geo.intensity_threshold: above 0");
    need(positive(g.depth_threshold_m), "dyn_geo.depth_threshold_m: above 0");
    if let Err(error) = settings.transfer.check() {
        need(false, &error.to_string());
    }
    if let Err(error) = settings.bounce.check_with(&settings.transfer) {
        need(false, &error.to_string());
    }
    need(
        matches!(settings.transfer.subsampling, 1 | 2 | 4 | 8),
        "transfer.subsampling: 1, 2, 4 or 8",
    );
    light(settings, &mut need);
    compositing(settings, &mut need);
    problems.extend(settings.volume.problems().into_iter().map(|p| format!("volume.{p}")));
    problems
}

fn tracking(settings: &Settings, need: &mut impl FnMut(bool, &str)) {
    let t = &settings.tracking;
    need(
        (1..=5).contains(&t.iterations.len()) && t.iterations.iter().all(|&n| n <= 100),
        "tracking.iterations: 1 to 5 levels of at most 100",
    );
    need(t.filter_radius <= 32, "tracking.filter_radius: at most 32");
    need(positive(t.filter_sigma_px), "tracking.filter_sigma_px: above 0");
    need(positive(t.filter_sigma_m), "tracking.filter_sigma_m: above 0");
    need(positive(t.max_distance_m), "tracking.max_distance_m: above 0");
    need(positive(t.max_angle_rad), "tracking.max_angle_rad: above 0");
    need(t.convergence >= 0.0 && t.convergence.is_finite(), "tracking.convergence: 0 or more");
    need((0.0..=1.0).contains(&t.min_inlier_share), "tracking.min_inlier_share: 0 to 1");
    need((0.0..=1.0).contains(&t.min_overlap), "tracking.min_overlap: 0 to 1");
    need(positive(t.max_rms_m), "tracking.max_rms_m: above 0");
    need((0.0..=1.0).contains(&t.min_eigenvalue_ratio), "tracking.min_eigenvalue_ratio: 0 to 1");
    need(positive(t.max_step_m), "tracking.max_step_m: above 0");
    need(positive(t.max_step_rad), "tracking.max_step_rad: above 0");
}

fn light(settings: &Settings, need: &mut impl FnMut(bool, &str)) {
    let l = &settings.light;
    need(l.tikhonov >= 0.0 && l.tikhonov.is_finite(), "light.tikhonov: 0 or more");
    need((-10.0..=10.0).contains(&l.band_power), "light.band_power: -10 to 10");
    need((0.0..1.0).contains(&l.memory), "light.memory: 0 up to, not including, 1");
    need(
        0.0 <= l.min_encoded && l.min_encoded < l.max_encoded && l.max_encoded.is_finite(),
        "light.min_encoded and max_encoded: 0 <= min < max",
    );
    need((0.0..1.0).contains(&l.min_cosine), "light.min_cosine: 0 up to, not including, 1");
    need((1..=256).contains(&l.stride), "light.stride: 1 to 256");
    need(not_negative(l.huber), "light.huber: 0 or more");
    need(positive(l.change_threshold), "light.change_threshold: above 0");
    need((0.0..=1.0).contains(&l.hidden_radiance), "light.hidden_radiance: 0 to 1");
    need(place(l.at), "light.at: three numbers within 1000 km");
    need(l.mean_albedo > 0.0 && l.mean_albedo <= 1.0, "light.mean_albedo: above 0, at most 1");
}

fn compositing(settings: &Settings, need: &mut impl FnMut(bool, &str)) {
    let c = &settings.compositing;
    need(c.gauss_radius <= 64, "compositing.gauss_radius: at most 64");
    need(positive(c.depth_tolerance), "compositing.depth_tolerance: above 0");
    need((0.0..=1000.0).contains(&c.normal_exponent), "compositing.normal_exponent: 0 to 1000");
    need(c.key > 0.0 && c.key <= 1000.0, "compositing.key: above 0, at most 1000");
}

fn positive(v: f32) -> bool {
    v > 0.0 && v.is_finite()
}

fn not_negative(v: f32) -> bool {
    v >= 0.0 && v.is_finite()
}

fn place(point: Option<[f64; 3]>) -> bool {
    point.is_none_or(|point| point.iter().all(|v| v.abs() <= FARTHEST_M))
}
