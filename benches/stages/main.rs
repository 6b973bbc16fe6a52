//! Every stage at 640x480 with 256 voxels a side, on the demo sequence, beside what the machine can
//! do at most. Run from the project's folder: `cargo bench --bench stages`.
//!
//! Each benchmark counts the bytes that must move, or the f32 additions, multiplications and
//! comparisons that must be made, if nothing but the result's definition were to be obeyed. That
//! count over the rate measured by `machine::copy_bandwidth` or `machine::operation_rate` is the
//! stage's floor; the quotient of the two throughputs that are printed is how far away it is.

mod fixture;
mod machine;

use divan::Bencher;
use divan::counter::{BytesCount, ItemsCount};
use fixture::{FIXTURE, FrameStages, GBUFFER_BYTES, LitStep, TSDF_BYTES, VOXEL_BYTES};
use kinlight::capture::{InputStage, RgbdFrame};
use kinlight::compositing::{CompositingStage, VirtualLayer};
use kinlight::config::Settings;
use kinlight::geometry::{DynGeo, GBuffer};
use kinlight::image::Image;
use kinlight::lighting::LightEstimator;
use kinlight::scene::Rasteriser;
use kinlight::tracking::Tracker;
use kinlight::transfer::{IndirectMap, RayTracedTransfer, TransferMap};

fn main() {
    divan::main();
}

/// Read: colour (3 B) and depth (4 B). Written: depth (4 B), linear colour (12 B), intensity (4 B).
#[divan::bench]
fn input(bencher: Bencher) {
    let fixture = &*FIXTURE;
    let mut stage = InputStage::new(&fixture.settings.input);
    let mut out = RgbdFrame::default();
    bencher
        .counter(BytesCount::new(fixture.pixels() * 27))
        .with_inputs(|| fixture.raw.clone())
        .bench_local_values(|raw| stage.prepare(raw, &mut out));
}

/// Bilateral filter of 7x7 taps, 8 operations each: difference, square, 3 for an exponential that is
/// a polynomial or table, product with the value, two sums. Then the iterations that this frame
/// takes at the finest level, per pixel: transform of point and normal (33), projection (6), residual
/// and gates (20), cross product (9), 27 sums of products (54).
#[divan::bench]
fn reconstruct_tracking(bencher: Bencher) {
    const FILTER: usize = 49 * 8;
    const ITERATION: usize = 33 + 6 + 20 + 9 + 54;
    let fixture = &*FIXTURE;
    let mut tracker = Tracker::new(&fixture.settings.tracking, fixture.camera);
    let iterations = fixture.finest_iterations();
    bencher
        .counter(ItemsCount::new(fixture.pixels() * (FILTER + iterations * ITERATION)))
        .bench_local(|| fixture.track(&mut tracker));
}

/// The blocks that the band around this depth passes through (distance, weight and colour) are read
/// and written, depth (4 B) and colour (3 B) are read. Blocks of older frames that it sees are not
/// counted.
#[divan::bench]
fn reconstruct_integrate(bencher: Bencher) {
    let fixture = &*FIXTURE;
    let mut volume = fixture.fused();
    let bytes = fixture.band_voxels() * 2 * VOXEL_BYTES + fixture.pixels() * 7;
    bencher.counter(BytesCount::new(bytes)).bench_local(|| {
        volume.integrate(&fixture.frame, &fixture.view).expect("a frame of the view's size");
    });
}

/// The distances near this frame's surfaces are read once, the geometry buffer is written.
#[divan::bench]
fn surface_main(bencher: Bencher) {
    let fixture = &*FIXTURE;
    let volume = fixture.fused();
    let mut out = GBuffer::empty(fixture.view);
    let bytes = fixture.band_voxels() * TSDF_BYTES + fixture.pixels() * GBUFFER_BYTES;
    bencher.counter(BytesCount::new(bytes)).bench_local(|| volume.raycast(&fixture.view, &mut out));
}

/// The left auxiliary view, 256x256; counted as the main view.
#[divan::bench]
fn surface_side(bencher: Bencher) {
    let fixture = &*FIXTURE;
    let volume = fixture.fused();
    let view = fixture.stages.auxiliary[0].view;
    let mut out = GBuffer::empty(view);
    let bytes = fixture.band_voxels() * TSDF_BYTES + view.size().pixels() * GBUFFER_BYTES;
    bencher.counter(BytesCount::new(bytes)).bench_local(|| volume.raycast(&view, &mut out));
}

/// D': one comparison of sensor and model (4). D'': 25 taps of the guide (difference, magnitude,
/// comparison) and the best known median network of 25 values (99 exchanges, a minimum and a maximum
/// each). D''': that of 9 values (19 exchanges). Normals are not counted, nor holes.
#[divan::bench]
fn dyn_geo(bencher: Bencher) {
    const PER_PIXEL: usize = 4 + 25 * 3 + 99 * 2 + 19 * 2;
    let fixture = &*FIXTURE;
    let mut stage = DynGeo::new(&fixture.settings.dyn_geo);
    let mut out = GBuffer::empty(fixture.view);
    bencher
        .counter(ItemsCount::new(fixture.pixels() * PER_PIXEL))
        .bench_local(|| stage.run(&fixture.frame, &fixture.model, &mut out));
}

/// For each point with a surface: half of the directions x samples x geometry buffers look-ups, see
/// [`fixture::LOOK_UP_OPERATIONS`]. What a hidden sample costs beyond its look-up is not counted.
#[divan::bench(args = [1, 4])]
fn transfer_real(bencher: Bencher, step: usize) {
    let fixture = &*FIXTURE;
    let FrameStages { real, auxiliary, .. } = &fixture.stages;
    let mut stage = fixture.radiance_transfer(step);
    let mut out = TransferMap::default();
    let points = fixture.lit(step).points;
    bencher
        .counter(ItemsCount::new(points * fixture.operations_per_point()))
        .bench_local(|| stage.transfer(real, auxiliary, &mut out));
}

/// Twice the same, for light and for the bounce, for the points whose transfer virtual objects change, and for
/// no other. With `false` without the bounce, and so once.
#[divan::bench(args = [1, 4], consts = [true, false])]
fn transfer_and_bounce<const BOUNCES: bool>(bencher: Bencher, step: usize) {
    let fixture = &*FIXTURE;
    let FrameStages { real, auxiliary, merged, merged_auxiliary, .. } = &fixture.stages;
    let FrameStages { radiance, auxiliary_radiance, .. } = &fixture.stages;
    let LitStep { real_transfer, changed_points, .. } = fixture.lit(step);
    let mut stage = fixture.radiance_transfer(step);
    stage.transfer(real, auxiliary, &mut TransferMap::default());
    let (mut out, mut indirect) = (TransferMap::default(), IndirectMap::default());
    let operations = changed_points * fixture.operations_per_point();
    bencher.counter(ItemsCount::new(operations * (1 + usize::from(BOUNCES)))).bench_local(|| {
        stage.transfer_and_bounce(
            (real, auxiliary),
            (merged, merged_auxiliary),
            BOUNCES.then_some((radiance, auxiliary_radiance)),
            real_transfer,
            &mut out,
            &mut indirect,
        );
    });
}

/// Rays through the volume instead of samples in buffers, on the model alone: half of the directions
/// at each grid point. Counted are rays, so the quotient of two rows' throughputs means nothing; their
/// times compare with [`transfer_real`].
#[divan::bench(args = ["gr12", "gr14"])]
fn transfer_traced(bencher: Bencher, preset: &str) {
    let fixture = &*FIXTURE;
    let params = Settings::preset(preset).expect("a preset").transfer;
    let mut stage = RayTracedTransfer::new(&params).expect("valid settings");
    let (volume, main) = (fixture.fused(), &fixture.model);
    let mut out = TransferMap::default();
    let points = main.depth_m.as_slice().iter().filter(|&&d| d > 0.0).count();
    let rays = points / params.subsampling.pow(2) * params.directions / 2;
    bencher.counter(ItemsCount::new(rays)).bench_local(|| stage.transfer(&volume, main, &mut out));
}

/// The same with virtual objects: rays against triangles near these, and from virtual surfaces.
#[divan::bench(args = ["gr12", "gr14"])]
fn transfer_traced_with_virtual(bencher: Bencher, preset: &str) {
    let fixture = &*FIXTURE;
    let params = Settings::preset(preset).expect("a preset").transfer;
    let mut stage = RayTracedTransfer::new(&params).expect("valid settings");
    let (volume, real) = (fixture.fused(), &fixture.model);
    let mut merged = GBuffer::empty(fixture.view);
    Rasteriser::default().draw(&fixture.scene, real, &mut merged, &mut VirtualLayer::default());
    let (mut before, mut out) = (TransferMap::default(), TransferMap::default());
    stage.transfer(&volume, real, &mut before);
    bencher.bench_local(|| {
        stage.transfer_with_virtual(&volume, &fixture.scene, (real, &merged), &before, &mut out);
    });
}

#[divan::bench(args = [2, 4])]
fn light_est(bencher: Bencher, stride: usize) {
    let fixture = &*FIXTURE;
    let params = kinlight::lighting::LightParams { stride, ..fixture.settings.light.clone() };
    let transfer = &fixture.lit(if stride == 4 { 4 } else { 1 }).real_transfer;
    let mut stage = LightEstimator::new(&params);
    let real = &fixture.stages.real;
    bencher.bench_local(|| stage.estimate(&fixture.frame, real, transfer, None));
}

/// The geometry buffer is read and written; albedo (12 B) and coverage (4 B) are written.
#[divan::bench]
fn rendering_rasterise(bencher: Bencher) {
    let fixture = &*FIXTURE;
    let mut rasteriser = Rasteriser::default();
    let mut merged = GBuffer::empty(fixture.view);
    let mut layer = VirtualLayer::default();
    bencher.counter(BytesCount::new(fixture.pixels() * (2 * GBUFFER_BYTES + 16))).bench_local(
        || rasteriser.draw(&fixture.scene, &fixture.stages.real, &mut merged, &mut layer),
    );
}

/// Read once a grid point: both transfers (128 B) and the bounce (12 B). A pixel: the picture is read
/// and written (6 B); depth, origin and coverage are read (9 B).
#[divan::bench(args = [1, 4])]
fn rendering_compose(bencher: Bencher, step: usize) {
    let fixture = &*FIXTURE;
    let mut stage = CompositingStage::new(&fixture.settings.compositing);
    let mut out = Image::default();
    let input = fixture.compose_input(step);
    let grid = input.real_transfer.grid.pixels();
    bencher
        .counter(BytesCount::new(grid * 140 + fixture.pixels() * 15))
        .bench_local(|| stage.compose(&input, &mut out));
}
