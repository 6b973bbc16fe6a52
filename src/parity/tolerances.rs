//! How far results of the two backends may be apart, and why: one table for the report and for the tests of
//! each stage.
//!
//! A tolerance is what rounding explains: f32 sums in another order, numbers stored in fewer bits, a picture of
//! 8 bits. A share above zero is for values that a comparison decides: a ray that passes the rim of a surface,
//! a sample on an edge. There, the smallest difference gives quite another value.

use crate::gpu::Gpu;
use crate::gpu::parity::Difference;

/// What may differ, and by how much.
#[derive(Debug)]
pub struct Tolerance {
    /// The stage, and what of its result.
    pub stage: &'static str,
    pub quantity: &'static str,
    pub unit: &'static str,
    /// On a device that computes in software, which rounds every operation as the CPU backend does.
    pub software: Limit,
    /// On any other: it may fuse multiplications with additions, and need not divide exactly.
    pub hardware: Limit,
    pub reason: &'static str,
}

/// Values may differ by `largest`, and a `share` of them by more.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Limit {
    pub largest: f64,
    pub share: f64,
}

impl Tolerance {
    /// On this kind of device.
    pub fn limit(&self, software: bool) -> Limit {
        if software { self.software } else { self.hardware }
    }

    pub fn on(&self, gpu: &Gpu) -> Limit {
        self.limit(gpu.summary().is_software())
    }

    /// Results of both backends, value by value, and whether that is within the tolerance.
    ///
    /// # Panics
    /// As [`Difference::of`].
    pub fn compare(&self, gpu: &Gpu, on_cpu: &[f32], on_gpu: &[f32]) -> (Difference, bool) {
        let limit = self.on(gpu);
        let found = Difference::of(on_cpu, on_gpu, limit.largest);
        (found, found.is_within(limit.share))
    }
}

const fn limit(largest: f64, share: f64) -> Limit {
    Limit { largest, share }
}

const fn new(
    [stage, quantity, unit]: [&'static str; 3],
    [software, hardware]: [Limit; 2],
    reason: &'static str,
) -> Tolerance {
    Tolerance { stage, quantity, unit, software, hardware, reason }
}

const EQUAL: [Limit; 2] = [limit(0.0, 0.0); 2];

pub static INPUT_DEPTH: Tolerance = new(["input", "depth", "m"], EQUAL, "kept or dropped");

/// Nine table values below 1 in the same order, unless the driver contracts them: 1 ulp each.
pub static INPUT_COLOR: Tolerance = new(
    ["input", "linear colour", ""],
    [limit(9.0 * f32::EPSILON as f64, 0.0); 2],
    "f32 sum of nine",
);

/// The root's place in 1024 steps moves by 1024 * 4 ulp, the curve rises by less than 1 a step beyond the first
/// (12.92 * 255 / 1024^2 * 2 * place below it).
pub static INPUT_INTENSITY: Tolerance =
    new(["input", "intensity", "1/255"], [limit(5e-4, 0.0); 2], "f32 place in a table");

/// Far below what the alignment itself errs.
pub static TRACKING_POSITION: Tolerance =
    new(["tracking", "camera position", "mm"], [limit(0.1, 0.0); 2], "f32 sums, other order");
pub static TRACKING_ROTATION: Tolerance =
    new(["tracking", "camera rotation", "deg"], [limit(0.01, 0.0); 2], "f32 sums, other order");

/// Where a device rounds differently, a voxel may fall on the other side of a pixel's or an edge's rim, or of
/// the band's: seldom.
const VOXELS_AT_A_RIM: f64 = 1e-3;
pub static FUSION_DISTANCE: Tolerance = new(
    ["fusion", "voxel distance", "1/32767"],
    [limit(1.0, 0.0), limit(1.0, VOXELS_AT_A_RIM)],
    "16 bits; voxels at a rim",
);
pub static FUSION_WEIGHT: Tolerance = new(
    ["fusion", "voxel weight", "frames"],
    [limit(0.0, 0.0), limit(0.0, VOXELS_AT_A_RIM)],
    "voxels at a rim",
);
pub static FUSION_COLOR: Tolerance = new(
    ["fusion", "voxel colour", "1/255"],
    [limit(0.0, 0.0), limit(0.0, VOXELS_AT_A_RIM)],
    "voxels at a rim",
);

/// Same operations in the same order give the same depths, up to a rounding of the tiles' ranges. 1e-6 m are
/// 1.3e-4 of a voxel of 8 mm; within a voxel, where a surface is creased or little seen, the gradient may turn
/// altogether, and so a normal by as much, on either side.
///
/// The search for a crossing ends at 0.01 voxels from it. As many as one in 8000 trials, were they spread evenly
/// over a voxel, are so near that limit that 6e-5 voxels of rounding decide, and then the depth is another by
/// up to 0.03 voxels.
const TRIALS_AT_THE_LIMIT: f64 = 1.2e-4;
/// A device that fuses multiplications with additions or divides less exactly ends the search elsewhere more
/// often, and may miss a surface at its rim.
const RAYS_AT_A_RIM: f64 = 5e-3;
pub static RAYCAST_DEPTH: Tolerance = new(
    ["ray-cast", "depth of G_v", "m"],
    [limit(1e-6, TRIALS_AT_THE_LIMIT), limit(1e-3, RAYS_AT_A_RIM)],
    "f32 steps; end of search, rims",
);
pub static RAYCAST_NORMAL: Tolerance = new(
    ["ray-cast", "normals of G_v", ""],
    [limit(3e-4, TRIALS_AT_THE_LIMIT), limit(0.05, RAYS_AT_A_RIM)],
    "f32 place in a voxel; end of search, rims",
);

/// Medians choose one of the given values, so that nothing is rounded.
pub static DYNGEO_DEPTH: Tolerance =
    new(["dyngeo", "depth of G_r", "m"], EQUAL, "medians choose a value");
pub static DYNGEO_ORIGIN: Tolerance =
    new(["dyngeo", "origin", "kind"], EQUAL, "medians choose a value");
/// Differences of points near 1 m, some mm apart: 2^-23 of 1 m over 2 mm.
pub static DYNGEO_NORMAL: Tolerance =
    new(["dyngeo", "normals of G_r", ""], [limit(1e-4, 0.0); 2], "f32 points mm apart");

/// A value rounds by 2^-24; a place in a view, some metres off, by 2^-22. The cosine of a surface at 5 cm then
/// rounds by 1e-5 at most, K by 1e-5 / chi = 1e-4, and a direction has at most a fifth of all shares.
const TRANSFER_ROUNDING: f64 = 2e-5;
/// Samples at the rim of a pixel or just at a depth limit are hidden or not as they are rounded. With one
/// driver that is so at none of the points of the tests, and at one of 2881 where depth has no noise; it changes
/// all coefficients there. On recordings, with a software device, 3e-5 of the values are beyond rounding; a quarter
/// of the share for others allows the one point of the tests.
const SAMPLES_AT_A_RIM: f64 = 2e-3;
const IMAGE_SPACE: [Limit; 2] =
    [limit(TRANSFER_ROUNDING, SAMPLES_AT_A_RIM / 4.0), limit(TRANSFER_ROUNDING, SAMPLES_AT_A_RIM)];
pub static TRANSFER: Tolerance =
    new(["transfer", "coefficients", ""], IMAGE_SPACE, "f32 places; samples at a rim");
pub static MERGED_TRANSFER: Tolerance =
    new(["objects", "transfer", ""], IMAGE_SPACE, "f32 places; samples at a rim");
pub static BOUNCE: Tolerance =
    new(["objects", "bounced light", ""], IMAGE_SPACE, "f32 places; samples at a rim");

/// A coefficient is a sum of some ten products below 1, each rounded by 2^-24; that of a hidden direction that
/// only one side sees is far beyond it: 1/20 at 32 directions. Measured with a software device: 6e-8.
///
/// Rays that pass the rim of a surface meet it or not as they are rounded, and a device that fuses
/// multiplications with additions steps elsewhere. A ray changes all coefficients of its point. With a
/// software device none differs of 12 000 that are stopped.
const TRACED: [Limit; 2] = [limit(2e-6, 2e-3), limit(2e-6, 0.02)];
pub static TRACED_TRANSFER: Tolerance =
    new(["transfer", "coefficients, traced", ""], TRACED, "f32 sums; rays at a rim");
pub static TRACED_MERGED_TRANSFER: Tolerance =
    new(["objects", "transfer, traced", ""], TRACED, "f32 sums; rays at a rim");

pub static LIGHT_PIXELS: Tolerance =
    new(["light", "usable pixels", "pixels"], EQUAL, "the same are picked");
/// The required agreement of runs. Transfer comes back in 16 bits: the fit has thresholds, which let that turn
/// the light of six made scenes by 0.0003 to 0.15 degrees, and so did scaling it by 1 + 1e-6.
pub static LIGHT_DIRECTION: Tolerance = new(
    ["light", "dominant direction", "deg"],
    [limit(0.1, 0.0); 2],
    "16-bit transfer, robust fit",
);

/// Both compute depth and normal from the same corners in f32. Pixel coordinates are good to 1e-4 pixel, and
/// faces up to 0.1 m deep a pixel: 1e-5 m, twice for two roundings. Normals are off by some 2^-23; 1e-4 is
/// what 1e-4 pixel makes of a sphere of a pixel's width. Colours: 1e-4 pixel times a step from black to white
/// between texels, ten of them in a pixel.
///
/// Corners are rounded to 1/256 pixel from coordinates that are themselves rounded, in one place more on the
/// device (clip space). Which side of an edge a sample is on may change with that, for one in 256 of those on
/// edges: less than one pixel in a thousand, and one sample of it.
const SAMPLES_ON_EDGES: f64 = 1e-3;
/// Of an object's own pixels many more are on edges, between its triangles. A corner is rounded to another
/// 1/256 pixel for one in twenty of its coordinates (an error of 1e-4 pixel on either side of the middle), so
/// for one in five edges, which then passes one of eight samples in 8/256 of the pixels: 6e-3 of them.
const SAMPLES_ON_INNER_EDGES: f64 = 6e-3;
const fn drawn(
    quantity: &'static str,
    unit: &'static str,
    (largest, share): (f64, f64),
) -> Tolerance {
    let limits = [limit(largest, share); 2];
    new(["objects", quantity, unit], limits, "f32; samples on edges")
}
pub static RASTER_DEPTH: Tolerance = drawn("depth", "m", (2e-5, SAMPLES_ON_EDGES));
pub static RASTER_NORMAL: Tolerance = drawn("normals", "", (1e-4, SAMPLES_ON_EDGES));
pub static RASTER_ORIGIN: Tolerance = drawn("origin", "kind", (0.0, SAMPLES_ON_EDGES));
pub static RASTER_COVERAGE: Tolerance = drawn("coverage", "", (0.0, SAMPLES_ON_EDGES));
pub static RASTER_COLOR: Tolerance = drawn("base colour", "", (1e-3, SAMPLES_ON_INNER_EDGES));

/// Up to 2.4, of nine roundings of 2^-24 each.
pub static EXITANT: Tolerance =
    new(["objects", "exitant radiance", ""], [limit(2e-6, 0.0); 2], "nine f32 roundings");

/// One step where a value lies between two codes. Near the least summed weight a pixel may take the nearest
/// grid point in place of the mean.
const PICTURE: [Limit; 2] = [limit(1.0, 1e-3); 2];
pub static COMPOSITING: Tolerance =
    new(["compositing", "picture", "1/255"], PICTURE, "8 bits; weights near 0");

/// The required agreement of whole runs: of poses and light in each frame, of pictures over all frames.
pub static RUN_POSITION: Tolerance =
    new(["run", "camera position", "mm"], [limit(0.1, 0.0); 2], "required");
pub static RUN_ROTATION: Tolerance =
    new(["run", "camera rotation", "deg"], [limit(0.01, 0.0); 2], "required");
pub static RUN_LIGHT: Tolerance =
    new(["run", "light direction", "deg"], [limit(0.1, 0.0); 2], "required");
/// Of the values of pictures, those that differ by more than one step, over all frames.
pub static RUN_PICTURES: Tolerance =
    new(["run", "values beyond 1/255", "%"], [limit(0.1, 0.0); 2], "required");
/// The same of the worst frame. A grid point that sees past a rim on one side alone, as 5e-4 of them may for each
/// of two transfers, shades four times its share of the pixels.
pub static RUN_PICTURE: Tolerance =
    new(["run", "... in one frame", "%"], [limit(0.4, 0.0); 2], "rims, up-sampled");
pub static RUN_JUDGEMENT: Tolerance =
    new(["run", "state, validity", "differ"], EQUAL, "the same decisions");

/// All stages, in the order of the data flow.
pub static STAGES: [&Tolerance; 27] = [
    &INPUT_DEPTH,
    &INPUT_COLOR,
    &INPUT_INTENSITY,
    &TRACKING_POSITION,
    &TRACKING_ROTATION,
    &FUSION_DISTANCE,
    &FUSION_WEIGHT,
    &FUSION_COLOR,
    &RAYCAST_DEPTH,
    &RAYCAST_NORMAL,
    &DYNGEO_DEPTH,
    &DYNGEO_NORMAL,
    &DYNGEO_ORIGIN,
    &TRANSFER,
    &TRACED_TRANSFER,
    &LIGHT_PIXELS,
    &LIGHT_DIRECTION,
    &RASTER_DEPTH,
    &RASTER_NORMAL,
    &RASTER_ORIGIN,
    &RASTER_COVERAGE,
    &RASTER_COLOR,
    &EXITANT,
    &MERGED_TRANSFER,
    &TRACED_MERGED_TRANSFER,
    &BOUNCE,
    &COMPOSITING,
];
