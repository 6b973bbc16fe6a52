use super::*;
use crate::fusion::block::{ONE, UNSEEN};
use crate::math::random::Rng;
use crate::scene::analytic::Shape;

/// Everything the volume holds, in table order.
fn contents(volume: &TsdfVolume) -> Vec<(u32, Vec<i16>, Vec<u16>)> {
    let slots = volume.store.table.iter();
    slots
        .map(|&slot| {
            let block = &volume.store.blocks[slot as usize];
            (slot, block.tsdf.to_vec(), block.weight.to_vec())
        })
        .collect()
}

#[test]
fn a_repeated_frame_leaves_the_volume_unchanged() {
    let scene = AnalyticScene::corner();
    let view = View::perspective(camera(21, 15), arc(1).next().unwrap());
    let frame = render(&scene, &view);
    let mut volume = volume(16);
    for _ in 0..200 {
        volume.integrate(&frame, &view).unwrap();
    }
    let before = contents(&volume);
    let weights = before.iter().flat_map(|(_, _, weights)| weights);
    assert!(weights.clone().any(|&w| w == volume.params.max_weight));
    for _ in 0..100_000 {
        volume.integrate(&frame, &view).unwrap();
    }
    assert!(before == contents(&volume));
}

#[test]
fn noise_does_not_bias_the_average() {
    // A wall straight ahead with 5 mm of noise: the mean of 2000 frames at weight 128 has a
    // standard deviation of 5 mm / sqrt(2 * 128) = 0.3 mm a voxel, less over many voxels. Rounding
    // towards zero instead would pull every distance to the surface by half a step a frame.
    let view = View::perspective(
        camera(64, 48),
        look_at(Vec3::new(0., -1.1, 0.4), Vec3::new(0., 0., 0.4)),
    );
    let mut volume = volume(64);
    let mut frame = frame_of(Image::new(view.size(), 0.0));
    for i in 0..2000 {
        let mut rng = Rng::new(&[i]);
        frame.depth_m.as_mut_slice().iter_mut().for_each(|d| *d = 1.1 + 0.005 * rng.normal());
        volume.integrate(&frame, &view).unwrap();
    }
    let out = cast(&volume, &view);
    let seen: Vec<f64> =
        out.depth_m.as_slice().iter().filter(|&&d| d > 0.0).map(|&d| f64::from(d)).collect();
    assert!(seen.len() > 2500, "{}", seen.len());
    let mean = seen.iter().sum::<f64>() / seen.len() as f64;
    // some hundred independent voxels: 0.3 mm / 10, five of those
    assert!((mean - 1.1).abs() < 1.5e-4, "{mean}");
}

#[test]
fn a_moved_object_vanishes() {
    let mut shapes = vec![Shape::Plane { normal: Vec3::Z, offset: 0.0 }];
    let empty = AnalyticScene::new(shapes.clone());
    shapes.push(Shape::Sphere { centre: Vec3::new(0.0, 0.0, 0.3), radius: 0.15 });
    let scene = AnalyticScene::new(shapes);
    let view = View::perspective(
        camera(320, 240),
        look_at(Vec3::new(0.9, -0.9, 1.0), Vec3::new(0., 0., 0.1)),
    );
    let mut volume = volume(128);
    for _ in 0..200 {
        volume.integrate(&render(&scene, &view), &view).unwrap();
    }
    let centre = (160, 105);
    let ball = render(&scene, &view).depth_m[centre];
    let floor = render(&empty, &view).depth_m[centre];
    assert!(floor - ball > 0.2);
    assert!((cast(&volume, &view).depth_m[centre] - ball).abs() < 0.01);
    let blocks = volume.allocated_blocks();
    let frame = render(&empty, &view);
    let vanished = (1..).find(|_| {
        volume.integrate(&frame, &view).unwrap();
        (cast(&volume, &view).depth_m[centre] - floor).abs() < 0.01
    });
    // The deepest voxel holds -1 at weight 128, cut to 32: n frames of +1 against 32 of -1 turn
    // its sign after 33. Without the cut it would take 129.
    assert!(vanished.unwrap() <= 40, "{vanished:?}");
    for _ in 0..200 {
        volume.integrate(&frame, &view).unwrap();
    }
    assert!(volume.allocated_blocks() < blocks, "free blocks are given back");
}

#[test]
fn results_do_not_depend_on_threads() {
    let scene = AnalyticScene::corner();
    let view = View::perspective(camera(163, 121), arc(1).next().unwrap());
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut volume = volume(128);
            integrate_arc(&mut volume, &scene, (163, 121), 5);
            let out = cast(&volume, &view);
            (contents(&volume), out.depth_m, out.normals, volume.mesh())
        })
    };
    let one = run(1);
    for threads in [2, 5] {
        assert!(one == run(threads), "{threads} threads");
    }
}

#[test]
fn weights_and_distances_keep_to_their_ranges() {
    let scene = AnalyticScene::corner();
    let params = VolumeParams { resolution: 64, max_weight: 3, ..VolumeParams::default() };
    let mut volume = TsdfVolume::new(&params, Vec3::ZERO).unwrap();
    integrate_arc(&mut volume, &scene, (67, 43), 8);
    for block in volume.store.blocks.iter().filter(|b| b.live) {
        for (&tsdf, &weight) in block.tsdf.iter().zip(&block.weight) {
            assert!(weight <= 3);
            assert_eq!(tsdf == UNSEEN, weight == 0);
        }
        assert_eq!(
            block.lowest,
            block.tsdf.iter().copied().filter(|&t| t != UNSEEN).min().unwrap_or(ONE)
        );
    }
}
