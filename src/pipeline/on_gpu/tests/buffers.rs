//! Intermediate buffers are those of the CPU, and come back only when they are asked for.

use super::*;
use crate::pipeline::{Buffer, BufferValues};

const ALL: [Buffer; 7] = [
    Buffer::SensorDepth,
    Buffer::ModelDepth,
    Buffer::Depth,
    Buffer::Normals,
    Buffer::Origin,
    Buffer::Shading,
    Buffer::VirtualShading,
];

/// As numbers, one after the other.
fn numbers(values: BufferValues) -> Vec<f32> {
    match values {
        BufferValues::DepthM(depth_m) => depth_m.into_vec(),
        BufferValues::Normals(normals) => {
            [normals.x.into_vec(), normals.y.into_vec(), normals.z.into_vec()].concat()
        }
        BufferValues::Origins(origins) => {
            origins.as_slice().iter().map(|&origin| f32::from(origin as u8)).collect()
        }
        BufferValues::Light(rgb) => rgb.as_slice().as_flattened().to_vec(),
    }
}

fn compare(both: &Both, what: &str) {
    for buffer in ALL {
        let cpu = both.cpu.buffer(buffer).map(numbers);
        let gpu = both.gpu.buffer(buffer).expect("it comes back").map(numbers);
        assert_eq!(cpu.is_some(), gpu.is_some(), "{what}: {buffer:?}");
        let (Some(cpu), Some(gpu)) = (cpu, gpu) else { continue };
        assert_eq!(cpu.len(), gpu.len(), "{what}: {buffer:?}");
        let apart = cpu.iter().zip(&gpu).filter(|(a, b)| (*a - *b).abs() > 0.01).count();
        // single pixels at rims of surfaces, where poses differ by micrometres
        assert!(apart * 200 <= cpu.len(), "{what}: {buffer:?}, {apart} of {}", cpu.len());
        assert!(cpu.iter().any(|&v| v != cpu[0]), "{what}: {buffer:?} shows nothing");
    }
}

#[test]
fn all_buffers_are_those_of_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let mut source = sequence();
    let objects = scene(&source);
    let mut both = Both::new(&gpu, &settings(&[]), &source, &objects);
    assert!(ALL[1..].iter().all(|&b| both.gpu.buffer(b).expect("nothing fails").is_none()));
    let first = source.frame(0).expect("a frame");
    for index in 0..2 {
        both.process(&source.frame(index).expect("a frame"));
        compare(&both, "with objects");
    }
    // objects out of sight, where no buffer is drawn into
    both.cpu.scene.translate(glam::Vec3::X * 50.0);
    both.gpu.scene.translate(glam::Vec3::X * 50.0);
    both.process(&source.frame(2).expect("a frame"));
    assert_eq!(both.gpu.composed().as_slice(), source.frame(2).unwrap().color.as_slice());
    compare(&both, "without objects");
    // a frame that is not composed has no buffers but the sensor's and the map's
    let mut covered = first;
    covered.depth_m.as_mut_slice()[1..].fill(0.0);
    both.process(&covered);
    assert!(both.gpu.buffer(Buffer::SensorDepth).expect("it comes back").is_some());
    assert!(both.gpu.buffer(Buffer::Depth).expect("nothing fails").is_none());
    assert!(both.gpu.buffer(Buffer::Shading).expect("nothing fails").is_none());
}
