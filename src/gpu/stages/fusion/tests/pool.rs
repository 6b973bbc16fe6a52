//! The pool's growth, and its end.

use super::super::pool::Pool;
use super::integrate::VoxelDifferences;
use super::*;
use crate::gpu::AdapterChoice;

/// The corner, first through a slit and then as a whole.
fn frames() -> Vec<(RgbdFrame, View)> {
    let poses = arc(3);
    let mut frames: Vec<_> = poses
        .map(|pose| View::perspective(camera(67, 43), pose))
        .map(|view| (colored(render(&AnalyticScene::corner(), &view)), view))
        .collect();
    let (slit, view) = (frames[0].0.clone(), frames[0].1);
    let mut slit = slit;
    slit.depth_m.as_mut_slice()[3 * 67..].fill(0.0);
    frames.insert(0, (slit, view));
    frames
}

#[test]
fn slots_keep_what_they_hold_when_the_pool_grows() {
    let Some(gpu) = gpu() else { return };
    let mut pair = Pair::new(gpu, &volume_params(128));
    let mut slots = Vec::new();
    for (frame, view) in frames() {
        pair.integrate(&frame, &view);
        slots.push(pair.on_device.pool.slots());
    }
    // the first picture needs few blocks
    assert!(slots[0] < slots[3] && slots.is_sorted(), "{slots:?}");
    pair.assert_equal(&format!("{slots:?} slots"));
    let in_use = pair.cpu.allocated_blocks();
    assert!(slots[3] > in_use && slots[3] <= 4 * in_use + 512, "{slots:?} for {in_use} blocks");
    assert!(pair.on_device.memory_bytes() < slots[3] * 512 * 8 + (1 << 20));
}

/// Nothing makes up for what it missed, but the next picture finds room.
#[test]
fn a_picture_of_more_than_there_is_room_for_is_made_up_for() {
    let Some(gpu) = gpu() else { return };
    let mut pair = Pair::new(gpu, &volume_params(128));
    let frames = frames();
    pair.integrate(&frames[0].0, &frames[0].1);
    let in_use = pair.on_device.allocated_blocks(gpu).expect("they have room");
    pair.on_device.pool = Pool::with_slots(gpu, 4096, 0, true, 2 * in_use + 1).expect("memory");
    let mut commands = gpu.commands();
    let lattice = *pair.on_device.lattice();
    pair.on_device.restart(&mut commands, lattice);
    commands.submit().expect("no error");
    pair.cpu = TsdfVolume::new(&volume_params(128), Vec3::new(0.0, 0.0, 0.4)).unwrap();
    for (frame, view) in [&frames[0], &frames[1], &frames[1]] {
        pair.integrate(frame, view);
    }
    let volume = pair.on_device.download(gpu).expect("it can be read");
    assert_eq!(volume.allocated_blocks(), pair.cpu.allocated_blocks());
    let found = VoxelDifferences::of(&pair.cpu, &volume);
    assert!(found.blocks == 0 && found.weights > 0, "{found:?}");
}

#[test]
fn without_memory_to_grow_the_map_is_whole_but_for_blocks_that_are_counted() {
    if gpu().is_none() {
        return;
    }
    // of its own, as its memory is limited
    let gpu = &Gpu::open(&AdapterChoice::Best).expect("it opened before");
    let mut pair = Pair::new(gpu, &volume_params(128));
    let most = pair.on_device.pool.most();
    pair.on_device.pool = Pool::with_slots(gpu, most, 1000, true, 300).expect("there is memory");
    // for pictures, which are given back, and for nothing large
    gpu.limit_memory(gpu.memory_taken() + (1 << 20));
    let mut refused = None;
    for (frame, view) in frames() {
        let mut commands = gpu.commands();
        let pictures = upload_frame(gpu, &frame);
        match pair.on_device.integrate(&mut commands, &pictures, 0, &view) {
            Ok(()) => pair.cpu.integrate(&frame, &view).expect("it has room"),
            Err(error) => {
                refused = Some(error);
                break;
            }
        }
        commands.submit().expect("no error");
    }
    let Some(FusionError::Full { blocks, refused }) = refused else { panic!("{refused:?}") };
    gpu.limit_memory(u64::MAX);
    let volume = pair.on_device.download(gpu).expect("it can be read");
    assert_eq!((volume.allocated_blocks(), blocks), (299, 299));
    let found = VoxelDifferences::of(&pair.cpu, &volume);
    assert_eq!((found.blocks, found.distances), (refused, 0), "{found:?}");
    assert_eq!((found.weights, found.colors), (0, 0), "{found:?}");
    gpu.check().expect("the device is sound");
}
