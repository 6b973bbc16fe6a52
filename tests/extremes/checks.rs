//! What holds for every frame, whatever the frame was.

use kinlight::capture::RawFrame;
use kinlight::geometry::GBuffer;
use kinlight::lighting::{LightEstimate, ShLight};
use kinlight::math::sh;
use kinlight::pipeline::{Backend, Buffer, BufferValues, FrameOutcome, Pipeline};
use kinlight::tracking::Tracking;
use kinlight::transfer::TransferMap;

const BUFFERS: [Buffer; 7] = [
    Buffer::SensorDepth,
    Buffer::ModelDepth,
    Buffer::Depth,
    Buffer::Normals,
    Buffer::Origin,
    Buffer::Shading,
    Buffer::VirtualShading,
];

/// Normals are normalised in f32, and on the GPU packed as octahedra of two 16-bit halves: 1e-4 radians.
const UNIT: f32 = 1e-3;

/// Of the mean visible cosine: the sum of up to 1024 f32 weights that add up to 1.
const VISIBLE: f32 = 1e-4;

/// Rules that were broken.
#[derive(Clone, Debug, Default)]
pub struct Broken {
    pub count: usize,
    /// The first of them.
    pub first: Option<String>,
}

impl Broken {
    pub fn rule(&mut self, holds: bool, what: impl FnOnce() -> String) {
        self.values(usize::from(!holds), what);
    }

    /// So many values break a rule.
    pub fn values(&mut self, count: usize, what: impl FnOnce() -> String) {
        self.count += count;
        if count > 0 && self.first.is_none() {
            self.first = Some(what());
        }
    }

    fn each<'a, T: 'a + std::fmt::Debug>(
        &mut self,
        values: impl IntoIterator<Item = &'a T>,
        holds: impl Fn(&T) -> bool,
        what: &str,
    ) {
        let mut bad = values.into_iter().filter(|v| !holds(v)).peekable();
        let first = bad.peek().map(|v| format!("{v:?}"));
        let count = bad.count();
        self.values(count, || format!("{what}: {}", first.unwrap_or_default()));
    }
}

/// Everything that a frame left behind. `has_objects`: whether a virtual object may change the picture.
pub fn check(
    broken: &mut Broken,
    backend: &dyn Backend,
    raw: &RawFrame,
    outcome: &FrameOutcome,
    has_objects: bool,
) {
    let frame = outcome.index;
    check_tracking(broken, frame, &outcome.tracking);
    check_light(broken, frame, &outcome.light, raw.color.size().pixels());
    let in_use = backend.settings().transfer.bands;
    broken.rule(outcome.light.light.bands <= in_use, || {
        format!("frame {frame}: {} bands", outcome.light.light.bands)
    });
    for which in BUFFERS {
        let what = format!("frame {frame}, {which:?}");
        match backend.buffer(which) {
            Ok(Some(values)) => check_buffer(broken, &what, &values),
            Ok(None) => {
                let may_lack = !outcome.composed || which == Buffer::SensorDepth;
                broken.rule(may_lack, || format!("{what}: none of a composed frame"));
            }
            Err(error) => broken.rule(false, || format!("{what}: {error}")),
        }
    }
    let composed = backend.composed();
    broken.rule(composed.size() == raw.color.size(), || {
        format!("frame {frame}: a picture of {}", composed.size())
    });
    if !has_objects || !outcome.composed {
        let pairs = composed.as_slice().iter().zip(raw.color.as_slice());
        broken.values(pairs.filter(|(a, b)| a != b).count(), || {
            format!("frame {frame}: not the camera's picture, and nothing virtual in it")
        });
    }
    if let Some(pipeline) = backend.on_host() {
        check_stages(broken, frame, pipeline);
    }
}

fn check_tracking(broken: &mut Broken, frame: usize, tracking: &Tracking) {
    let pose = tracking.world_from_camera;
    broken.each(pose.translation.vector.iter(), |v| v.is_finite(), &format!("frame {frame}, pose"));
    broken.rule((pose.rotation.coords.norm() - 1.0).abs() < 1e-6, || {
        format!("frame {frame}: {:?} is no rotation", pose.rotation.coords)
    });
    for share in [tracking.inlier_share, tracking.overlap] {
        broken.rule((0.0..=1.0).contains(&share), || format!("frame {frame}: a share of {share}"));
    }
    broken.rule(tracking.rms_m.is_finite() && tracking.rms_m >= 0.0, || {
        format!("frame {frame}: a residual of {} m", tracking.rms_m)
    });
    let Tracking { condition, rank, .. } = *tracking;
    let sane = condition >= 0.0 && (condition.is_finite() || rank < 6) && rank <= 6;
    broken.rule(sane, || format!("frame {frame}: condition {condition} at rank {rank}"));
}

fn check_light(broken: &mut Broken, frame: usize, estimate: &LightEstimate, pixels: usize) {
    let LightEstimate { light, condition, rank, residual, deviation, .. } = estimate;
    let n = sh::coefficients(light.bands);
    check_sh(broken, &format!("frame {frame}, light"), light);
    let somewhere = estimate.field.at(Some(glam::Vec3::new(0.3, -0.2, 0.5)));
    for field in [estimate.field.at(None), somewhere] {
        check_sh(broken, &format!("frame {frame}, light field"), &field);
    }
    broken.each(deviation, |d| d.is_finite() && *d >= 0.0, &format!("frame {frame}, deviation"));
    broken.rule(deviation.len() == n, || format!("frame {frame}: {} deviations", deviation.len()));
    broken.rule(residual.is_finite() && *residual >= 0.0, || {
        format!("frame {frame}: residual {residual}")
    });
    broken.rule((1.0..=1e16).contains(condition) && *rank <= n, || {
        format!("frame {frame}: condition {condition} of the light at rank {rank}")
    });
    broken.rule(estimate.pixels <= pixels, || format!("frame {frame}: {} pixels", estimate.pixels));
    let aged = estimate.valid() == (estimate.age_frames == 0);
    broken.rule(aged, || format!("frame {frame}: valid, and {} frames old", estimate.age_frames));
    if let Some(direction) = light.dominant_direction() {
        broken.rule((direction.length() - 1.0).abs() < 1e-5, || {
            format!("frame {frame}: direction {direction}")
        });
    }
}

fn check_sh(broken: &mut Broken, what: &str, light: &ShLight) {
    let n = sh::coefficients(light.bands);
    broken.rule(light.coefficients.len() == n, || {
        format!("{what}: {} coefficients of {} bands", light.coefficients.len(), light.bands)
    });
    broken.each(light.coefficients.as_flattened(), |c| c.is_finite(), what);
}

fn check_buffer(broken: &mut Broken, what: &str, values: &BufferValues) {
    match values {
        BufferValues::DepthM(depth_m) => {
            broken.each(depth_m.as_slice(), |d| d.is_finite() && *d >= 0.0, what);
        }
        BufferValues::Normals(normals) => {
            let [x, y, z] = [&normals.x, &normals.y, &normals.z].map(|plane| plane.as_slice());
            let squares = x.iter().zip(y).zip(z).map(|((x, y), z)| x * x + y * y + z * z);
            let squares: Vec<f32> = squares.collect();
            broken.each(&squares, |s| *s == 0.0 || (s.sqrt() - 1.0).abs() < UNIT, what);
        }
        BufferValues::Origins(_) => {}
        BufferValues::Light(light) => {
            broken.each(light.as_slice().as_flattened(), |v| v.is_finite(), what);
        }
    }
}

/// What only the CPU's pipeline has in the host's memory.
fn check_stages(broken: &mut Broken, frame: usize, pipeline: &Pipeline) {
    let Some(stages) = pipeline.stages() else { return };
    let at = |what: &str| format!("frame {frame}, {what}");
    check_transfer(broken, &at("transfer"), stages.real_transfer);
    check_geometry(broken, &at("model"), stages.model);
    check_geometry(broken, &at("G_r"), stages.real);
    for side in stages.auxiliary {
        check_geometry(broken, &at("side view"), side);
    }
    let color = stages.frame.color.as_slice().as_flattened();
    broken.each(color, |c| (0.0..=1.0).contains(c), &at("linear colour"));
    let Some(objects) = stages.with_objects else { return };
    check_transfer(broken, &at("transfer with objects"), objects.transfer);
    check_geometry(broken, &at("G_r with objects"), objects.main);
    for side in objects.auxiliary {
        check_geometry(broken, &at("side view with objects"), side);
    }
    let coverage = objects.layer.coverage.as_slice();
    broken.each(coverage, |c| (0.0..=1.0).contains(c), &at("coverage"));
    if let Some(indirect) = objects.indirect {
        let rgb = indirect.rgb.as_flattened();
        broken.each(rgb, |v| v.is_finite() && *v >= 0.0, &at("bounce"));
    }
    if let Some((main, sides)) = objects.radiance {
        for radiance in std::iter::once(main).chain(sides) {
            let rgb = radiance.as_slice().as_flattened();
            broken.each(rgb, |v| v.is_finite() && *v >= 0.0, &at("radiance"));
        }
    }
}

fn check_geometry(broken: &mut Broken, what: &str, buffer: &GBuffer) {
    check_buffer(broken, what, &BufferValues::DepthM(buffer.depth_m.clone()));
    check_buffer(broken, what, &BufferValues::Normals(buffer.normals.clone()));
}

/// K lies in [0, 1], so the mean visible cosine (band 0 over Y_00) does; and what is taken from the lobe of an
/// open surface is a mean of Y over directions, no longer than Y itself.
fn check_transfer(broken: &mut Broken, what: &str, map: &TransferMap) {
    let n = sh::coefficients(map.bands);
    let y00 = sh::basis(glam::Vec3::Z, 1)[0];
    let open = sh::unoccluded_transfer(glam::Vec3::Z, map.bands);
    let lobe = open.iter().map(|c| c * c).sum::<f32>().sqrt();
    let longest = lobe + (n as f32 / (4.0 * std::f32::consts::PI)).sqrt() + VISIBLE;
    let points = map.coefficients.chunks_exact(n);
    let bad = points.filter(|t| {
        let length = t.iter().map(|c| c * c).sum::<f32>().sqrt();
        !(-VISIBLE..=1.0 + VISIBLE).contains(&(t[0] / y00)) || length.is_nan() || length > longest
    });
    let bad: Vec<&[f32]> = bad.collect();
    broken.values(bad.len(), || format!("{what}: {:?}", bad[0]));
}
