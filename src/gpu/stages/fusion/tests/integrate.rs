use super::*;
use crate::fusion::stored::StoredBlock;
use crate::parity::tolerances::FUSION_DISTANCE;

/// How two volumes differ.
#[derive(Debug, Default)]
pub(super) struct VoxelDifferences {
    voxels: usize,
    /// Blocks that just one of them has.
    pub blocks: usize,
    /// Voxels whose weights or colours differ, and those whose distances differ by more than one step.
    pub weights: usize,
    pub colors: usize,
    pub distances: usize,
    /// Voxels whose distances differ by one step.
    rounded: usize,
}

impl VoxelDifferences {
    pub fn of(cpu: &TsdfVolume, gpu: &TsdfVolume) -> Self {
        let (cpu, gpu) = (cpu.stored_blocks(), gpu.stored_blocks());
        let mut found = Self::default();
        let mut other = gpu.iter().peekable();
        for a in &cpu {
            found.blocks += std::iter::from_fn(|| other.next_if(|b| b.index < a.index)).count();
            match other.next_if(|b| b.index == a.index) {
                Some(b) => found.add(a, b),
                None => found.blocks += 1,
            }
        }
        found.blocks += other.count();
        found
    }

    fn add(&mut self, a: &StoredBlock, b: &StoredBlock) {
        self.voxels += a.tsdf.len();
        for (a, b) in a.tsdf.iter().zip(&b.tsdf) {
            self.distances += usize::from(a.abs_diff(*b) > 1);
            self.rounded += usize::from(a.abs_diff(*b) == 1);
        }
        self.weights += a.weight.iter().zip(&b.weight).filter(|(a, b)| a != b).count();
        let colors = a.color.iter().zip(&b.color);
        self.colors +=
            colors.flat_map(|(a, b)| a.iter().zip(b.iter())).filter(|(a, b)| a != b).count();
    }
}

impl Pair<'_> {
    /// Blocks, voxels and colours are those of the CPU; crossings are those of these voxels.
    pub fn assert_equal(&mut self, case: &str) {
        let volume = self.on_device.download(self.gpu).unwrap();
        let found = VoxelDifferences::of(&self.cpu, &volume);
        let case = format!("{case}: {} blocks, {found:?}", self.cpu.allocated_blocks());
        assert_eq!(self.on_device.allocated_blocks(self.gpu).unwrap(), volume.allocated_blocks());
        let rim = (found.voxels as f64 * FUSION_DISTANCE.on(self.gpu).share) as usize;
        let beyond = [512 * found.blocks, found.weights, found.colors, found.distances];
        assert!(found.voxels > 0 && beyond.iter().all(|&voxels| voxels <= rim), "{case}");
        let crossings = self.on_device.crossings().download(self.gpu).unwrap();
        let crossings: Vec<u64> =
            crossings.iter().map(|c| u64::from(c[0]) | u64::from(c[1]) << 32).collect();
        assert_eq!(crossings, volume.crossings(), "{case}");
    }
}

#[test]
fn pictures_of_a_room_are_averaged_as_on_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let scene = AnalyticScene::corner();
    for (width, height, resolution) in [(67, 43, 64), (160, 120, 128), (1, 1, 8)] {
        let mut pair = Pair::new(gpu, &volume_params(resolution));
        for pose in arc(3) {
            let view = View::perspective(camera(width, height), pose);
            pair.integrate(&colored(render(&scene, &view)), &view);
        }
        pair.assert_equal(&format!("{width}x{height} into {resolution}"));
        assert!(pair.cpu.allocated_blocks() > 0);
    }
}

#[test]
fn an_orthographic_picture_is_averaged_as_on_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let mut pair = Pair::new(gpu, &VolumeParams { color: false, ..volume_params(64) });
    let pose = look_at(Vec3::new(0.2, -2.0, 1.5), Vec3::ZERO);
    let view = orthographic(67, 1.7, pose);
    let mut frame = colored(render(&AnalyticScene::corner(), &view));
    // nothing of these may enter
    for (i, bad) in [0.0, -1.0, f32::INFINITY, f32::NEG_INFINITY, 1e30].into_iter().enumerate() {
        frame.depth_m[(20 + 3 * i, 30)] = bad;
    }
    pair.integrate(&frame, &view);
    pair.integrate(&frame, &view);
    pair.assert_equal("orthographic");
}

#[test]
fn blocks_that_became_free_are_released_and_taken_again() {
    let Some(gpu) = gpu() else { return };
    let params = VolumeParams { max_weight: 4, free_weight: 2, ..volume_params(64) };
    let mut pair = Pair::new(gpu, &params);
    let pose = look_at(Vec3::new(0.0, -1.5, 0.41), Vec3::new(0.0, 1.0, 0.4));
    let view = View::perspective(camera(67, 43), pose);
    let wall = |depth_m: f32| {
        colored(RgbdFrame { depth_m: Image::new(view.size(), depth_m), ..RgbdFrame::default() })
    };
    let mut most = 0;
    for (round, depth_m) in [1.0, 2.0, 1.2, 2.1].into_iter().enumerate() {
        for _ in 0..20 {
            pair.integrate(&wall(depth_m), &view);
            most = most.max(pair.cpu.allocated_blocks());
        }
        pair.assert_equal(&format!("round {round}"));
    }
    assert!(pair.cpu.allocated_blocks() < most, "no block was released");
    let counters = pair.on_device.counters.download(gpu).unwrap()[0];
    assert!((counters.used as usize) < 2 * most, "slots are not taken again: {counters:?}");
}

#[test]
fn a_full_pool_is_an_error() {
    let Some(gpu) = gpu() else { return };
    let params = volume_params(64);
    let lattice = Lattice::new(&params, Vec3::new(0.0, 0.0, 0.4)).unwrap();
    let mut volume = GpuVolume::with_blocks(gpu, &params, lattice, 10).unwrap();
    let view = View::perspective(camera(67, 43), arc(1).next().unwrap());
    let pictures = upload_frame(gpu, &colored(render(&AnalyticScene::corner(), &view)));
    let integrate = |volume: &mut GpuVolume| {
        let mut commands = gpu.commands();
        volume.integrate(&mut commands, &pictures, 0, &view).map(|()| commands.submit().unwrap())
    };
    integrate(&mut volume).unwrap();
    let error = integrate(&mut volume).unwrap_err();
    assert!(matches!(error, FusionError::Full { blocks: 10, refused: 1.. }), "{error}");
    assert!(volume.allocated_blocks(gpu).is_err());
    // what there is room for is there
    assert_eq!(volume.download(gpu).unwrap().allocated_blocks(), 10);
}

#[test]
fn the_finest_volume_fits_what_a_shader_may_bind() {
    let Some(gpu) = gpu() else { return };
    let mut pair = Pair::new(gpu, &VolumeParams { color: false, ..volume_params(512) });
    assert_eq!((pair.on_device.pool.most() + 1) * 512 * 4, 128 << 20);
    assert!(pair.on_device.voxels().len() * 4 <= 1 << 20, "taken before it is needed");
    let view = View::perspective(camera(5, 3), arc(1).next().unwrap());
    pair.integrate(&colored(render(&AnalyticScene::corner(), &view)), &view);
    pair.assert_equal("512");
}

#[test]
fn a_frame_that_does_not_fit_is_refused() {
    let Some(gpu) = gpu() else { return };
    let mut pair = Pair::new(gpu, &volume_params(8));
    let view = View::perspective(camera(67, 43), arc(1).next().unwrap());
    let pictures = upload_frame(gpu, &colored(render(&AnalyticScene::corner(), &view)));
    let other = View::perspective(camera(66, 43), view.world_from_view);
    let mut nowhere = view;
    nowhere.world_from_view.translation.x = f64::NAN;
    let mut commands = gpu.commands();
    let mut integrate =
        |view: &View| pair.on_device.integrate(&mut commands, &pictures, 7, view).unwrap_err();
    assert!(matches!(integrate(&other), FusionError::Size { frame: 7, .. }));
    assert!(matches!(integrate(&nowhere), FusionError::Pose { frame: 7 }));
}

#[test]
fn a_restart_leaves_nothing_of_the_past() {
    let Some(gpu) = gpu() else { return };
    let params = volume_params(64);
    let mut pair = Pair::new(gpu, &params);
    let scene = AnalyticScene::corner();
    let views: Vec<View> = arc(2).map(|pose| View::perspective(camera(67, 43), pose)).collect();
    pair.integrate(&colored(render(&scene, &views[0])), &views[0]);
    let centre = Vec3::new(0.1, 0.1, 0.5);
    let lattice = Lattice::new(&params, centre).unwrap();
    let mut commands = gpu.commands();
    pair.on_device.restart(&mut commands, lattice);
    commands.submit().unwrap();
    pair.cpu = TsdfVolume::new(&params, centre).unwrap();
    // as often as the mesh wants it
    for _ in 0..params.mesh_min_weight {
        pair.integrate(&colored(render(&scene, &views[1])), &views[1]);
    }
    pair.assert_equal("after a restart");
    let mesh = pair.on_device.mesh(gpu).unwrap();
    assert_eq!(mesh.positions, pair.cpu.mesh().positions);
    assert!(mesh.triangles.len() > 100);
}
