use super::instrument::{Cost, MOST_STRETCHES, SECTOR_BYTES};
use super::{Measure, STORAGE_BUFFERS, instrument};
use crate::capture::{InputParams, RawFrame};
use crate::gpu::pipeline::{Reflection, parse};
use crate::gpu::roofline::Work;
use crate::gpu::stages::{FramePictures, InputPass, shaders};
use crate::gpu::{AdapterChoice, Gpu};
use crate::image::{Image, Size};
use naga::valid::{Capabilities, ValidationFlags, Validator};

fn stretches(text: &str) -> Vec<Cost> {
    let module = naga::front::wgsl::parse_str(text).unwrap();
    let (_, counted) = instrument(&module).unwrap();
    let spent = |cost: &&Cost| **cost != Cost::default();
    counted.stretches.iter().filter(spent).copied().collect()
}

#[test]
fn a_stretch_ends_where_control_may_leave() {
    let found = stretches(
        "struct Light { gain: f32, color: vec3f }
        @group(0) @binding(0) var<storage, read> lights: array<Light>;
        @group(0) @binding(1) var<storage, read_write> out: array<vec3f>;
        @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3u) {
            if id.x >= 1000u { return; }
            var sum = vec3f(0.0);
            for (var i = 0u; i < 8u; i++) {
                let light = lights[id.x + i].gain;
                if light < 0.5 { continue; }
                sum = sum + 2.0 * lights[i].color;
            }
            out[id.x] = normalize(sum) * dot(sum, sum);
        }",
    );
    let of = |float_operations, other_operations, loaded, stored| Cost {
        float_operations,
        other_operations,
        loaded,
        stored,
        ..Cost::default()
    };
    // the condition; after the loop: 9, 5 and 3, and a store; of the loop: its own condition, gain, colour, and
    // its counter
    let expected = [
        of(0, 1, 0, 0),
        of(17, 0, 0, 12),
        of(0, 1, 0, 0),
        of(1, 1, 4, 0),
        of(6, 0, 12, 0),
        of(0, 1, 0, 0),
    ];
    let sum = |all: &[Cost]| {
        all.iter().fold((0, 0, 0, 0), |s, c| {
            (s.0 + c.float_operations, s.1 + c.other_operations, s.2 + c.loaded, s.3 + c.stored)
        })
    };
    assert_eq!(sum(&found), sum(&expected), "{found:?}");
    for cost in expected {
        assert!(found.contains(&cost), "{cost:?} of {found:?}");
    }
}

#[test]
fn products_of_matrices_and_calls_are_counted_where_they_run() {
    let found = stretches(
        "struct U { m: mat4x4f }
        @group(0) @binding(0) var<uniform> u: U;
        @group(0) @binding(1) var<storage, read_write> out: array<vec4f>;
        @group(0) @binding(2) var<storage, read_write> count: atomic<u32>;
        fn moved(v: vec4f) -> vec4f { return u.m * v; }
        @compute @workgroup_size(1) fn main() {
            out[0] = fma(moved(out[1]), vec4f(2.0), vec4f(1.0));
            atomicAdd(&count, 1u);
        }",
    );
    let main = Cost { float_operations: 8, loaded: 16, stored: 16, atomics: 1, ..Cost::default() };
    let moved = Cost { float_operations: 28, ..Cost::default() };
    assert_eq!(found, [main, moved]);
}

#[test]
fn every_shader_can_count_within_the_limits() {
    for shader in shaders() {
        let module = parse(&shader).unwrap();
        let (counting, counted) =
            instrument(&module).unwrap_or_else(|e| panic!("{}: {e}", shader.file));
        Validator::new(ValidationFlags::all(), Capabilities::empty())
            .validate(&counting)
            .unwrap_or_else(|e| panic!("{}: {:?}", shader.file, e.into_inner()));
        let reflection = Reflection::of(&shader, &counting).unwrap_or_else(|e| panic!("{e}"));
        let storage = reflection.storage_bindings();
        assert_eq!(storage, counted.buffers + 1, "{}", shader.file);
        assert!(storage <= STORAGE_BUFFERS as usize, "{}", shader.file);
        assert!(counted.stretches.len() <= MOST_STRETCHES);
    }
}

/// Bytes of whole sectors.
fn sectors(bytes: usize) -> u64 {
    bytes.next_multiple_of(SECTOR_BYTES as usize) as u64
}

#[test]
fn counted_bytes_are_those_of_the_buffers_and_results_stay() {
    let gpu = match Gpu::open_for_profile(&AdapterChoice::Best) {
        Ok(gpu) => gpu,
        Err(error) => return eprintln!("SKIPPED: {error}"),
    };
    let size = Size::new(67, 43);
    let n = size.pixels();
    let raw = RawFrame {
        index: 0,
        timestamp_s: 0.0,
        color: Image::from_vec(size, (0..n).map(|i| [i as u8, (i / 3) as u8, 90]).collect()),
        depth_m: Image::from_vec(size, (0..n).map(|i| (i % 11) as f32).collect()),
        world_from_camera: None,
        exposure_s: None,
    };
    let pass = InputPass::new(&gpu, &InputParams::default()).unwrap();
    let run = |measure| {
        let pictures = FramePictures::new(&gpu, size).unwrap();
        gpu.measure_passes(measure);
        let mut commands = gpu.commands();
        pass.run(&mut commands, &raw, &pictures).unwrap();
        commands.submit().unwrap();
        gpu.measure_passes(None);
        let color = pictures.color.buffer().download(&gpu).unwrap();
        (color, pictures.depth_m.buffer().download(&gpu).unwrap())
    };
    let expected = run(None);
    assert!(gpu.take_passes().is_empty(), "nothing was measured");

    assert!(run(Some(Measure::Time)) == expected);
    let timed = gpu.take_passes();
    assert!(timed.iter().all(|p| p.time.is_some_and(|t| !t.is_zero()) && p.work.is_none()));

    assert!(run(Some(Measure::Work)) == expected);
    let counted = gpu.take_passes();
    let names = |passes: &[super::PassRecord]| -> Vec<&str> {
        passes.iter().map(|p| p.shader.as_ref().map_or("copies", |s| s.file)).collect()
    };
    assert_eq!(names(&timed), ["input/depth", "input/color"]);
    assert_eq!(names(&counted), names(&timed));

    let [depth, color] = [0, 1].map(|i| counted[i].work.unwrap());
    assert_eq!(depth.invocations, n.next_multiple_of(64) as u64);
    assert_eq!(depth.bytes_read, sectors(4 * n));
    // what is valid stays unwritten
    assert!(depth.bytes_written <= depth.bytes_read, "{depth:?}");
    assert_eq!(depth.bytes_loaded, 4 * n as u64);
    assert_eq!(color.bytes_written, sectors(16 * n));
    assert_eq!(color.bytes_stored, 16 * n as u64);
    // rows of three bytes a pixel, and tables of which at least a part is used
    let picture = sectors((3 * n).next_multiple_of(4));
    let tables = color.bytes_read - picture;
    assert!(tables > 0 && tables <= sectors(4 * (256 + 1026)), "{color:?}");
    assert!(color.bytes_loaded >= color.bytes_read && color.float_operations > 9 * n as u64);
    assert_eq!(Work { invocations: 0, ..Work::default() }.atomics, color.atomics);
}
