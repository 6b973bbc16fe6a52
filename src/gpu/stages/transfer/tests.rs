//! Both backends on the same scenes.

use super::*;
use crate::geometry::GBuffer;
use crate::gpu::GpuGBuffer;
use crate::gpu::parity::Difference;
use crate::gpu::stages::test_support::gpu;
use crate::transfer::test_support::{auxiliary_views, camera, desk, transferred};

/// A value rounds by 2^-24; a place in a view, some metres off, by 2^-22. The cosine of a surface at 5 cm then
/// by 1e-5, K by 1e-5 / chi, 1e-4, and a direction has at most a fifth of all shares.
const TOLERANCE: f64 = 2e-5;

/// Samples at the rim of a pixel or just at a depth limit are hidden or not as they are rounded.
const FLIPPED: f64 = 2e-3;

struct Scene {
    main: GBuffer,
    auxiliary: Vec<GBuffer>,
}

impl Scene {
    fn new(width: usize, height: usize, side_views: usize) -> Self {
        let views = auxiliary_views(48);
        Self {
            main: desk().render(&camera(width, height)),
            auxiliary: views[..side_views].iter().map(|v| desk().render(v)).collect(),
        }
    }
}

pub fn uploaded(gpu: &Gpu, buffer: &GBuffer) -> GpuGBuffer {
    let mut out = GpuGBuffer::empty(gpu, buffer.view).unwrap();
    out.upload(gpu, buffer);
    out
}

fn on_device(gpu: &Gpu, params: &TransferParams, scene: &Scene) -> Vec<f32> {
    let main = uploaded(gpu, &scene.main);
    let auxiliary: Vec<_> = scene.auxiliary.iter().map(|b| uploaded(gpu, b)).collect();
    let set = DirectionSet::new(params).unwrap();
    let mut pass = TransferPass::new(gpu, params, &BounceParams::default(), &set).unwrap();
    let out =
        GpuTransferMap::new(gpu, params.bands, params.subsampling, scene.main.size()).unwrap();
    let mut commands = gpu.commands();
    pass.transfer(&mut commands, (&main, &auxiliary), &out).unwrap();
    commands.submit().unwrap();
    out.coefficients.download(gpu).unwrap()
}

#[test]
fn real_transfer_is_that_of_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let params = |bands, directions, subsampling| TransferParams {
        bands,
        directions,
        subsampling,
        ..TransferParams::default()
    };
    let cases = [
        ((67, 43), 4, params(4, 32, 1)),
        ((67, 43), 3, params(2, 64, 1)),
        ((160, 120), 4, params(4, 16, 4)),
        ((67, 43), 0, params(3, 32, 4)),
        ((67, 43), 1, params(5, 32, 4)),
        ((67, 43), 2, TransferParams { samples: 1, jitter_tile: 3, ..params(6, 16, 2) }),
        ((1, 1), 4, params(4, 32, 1)),
        ((5, 2), 0, params(1, 32, 4)),
    ];
    for ((width, height), side_views, params) in cases {
        let scene = Scene::new(width, height, side_views);
        let cpu = transferred(&params, &scene.main, &scene.auxiliary).coefficients;
        let gpu = on_device(gpu, &params, &scene);
        let found = Difference::of(&cpu, &gpu, TOLERANCE);
        println!(
            "{width}x{height}, {side_views} side views, {} bands, {} directions, step {}: {found}",
            params.bands, params.directions, params.subsampling
        );
        assert!(found.is_within(FLIPPED), "{width}x{height} {params:?}: {found}");
    }
}
