//! How often host and device wait for each other, and what they move.

use super::*;
use crate::gpu::Traffic;
use crate::tracking::TERMS;

/// What a frame counted, the first frames left out.
fn of_frames(gpu: &Arc<Gpu>, timed: bool, changes: &[(&str, &str)]) -> Vec<Traffic> {
    let mut source = sequence();
    let objects = scene(&source);
    let mut settings = settings(changes);
    if changes.is_empty() {
        settings.tracking.mode = PoseMode::Recorded;
    }
    let camera = source.camera();
    let mut pipeline = GpuPipeline::new(gpu.clone(), settings, camera, objects).expect("one");
    let timer = timed.then(|| StageTimer::new(gpu).expect("a timer")).flatten();
    pipeline.clock = StageClock::with(timer);
    let mut frames = Vec::new();
    while let Some(raw) = source.next_frame().expect("a frame") {
        let before = gpu.traffic();
        assert!(pipeline.process(&raw, StageTimes::default()).expect("a frame").composed);
        frames.push(gpu.traffic().since(before));
    }
    let recorded = pipeline.record().traffic.expect("it is counted");
    let after_first = &frames[1..];
    let mean = |of: fn(&Traffic) -> u64| {
        after_first.iter().map(of).sum::<u64>() as f64 / after_first.len() as f64
    };
    assert_eq!(recorded.submissions, mean(|t| t.submissions));
    assert_eq!(recorded.waits, mean(|t| t.waits));
    assert_eq!(recorded.uploaded, mean(|t| t.uploaded) as u64);
    assert_eq!(recorded.read_back, mean(|t| t.read_back) as u64);
    println!("timed {timed}, {changes:?}: {}", pipeline.record());
    frames.split_off(2)
}

const PICTURE: u64 = 3 * 160 * 120;

/// On the device's clock a frame waits for the light's samples and for the picture, and a tracked one for each
/// iteration; on the host's for every stage.
#[test]
fn a_frame_waits_for_nothing_but_results() {
    let Some(gpu) = gpu() else { return };
    let counts = |t: &Traffic| (t.submissions, t.waits);
    if gpu.has_timestamps() {
        let posed = of_frames(&gpu, true, &[]);
        // with the samples, with the objects, with the picture
        assert!(posed.iter().all(|t| counts(t) == (3, 2)), "{posed:?}");
        let tracked = of_frames(&gpu, true, &[("tracking.mode", "track")]);
        assert!(tracked.iter().all(|t| t.submissions == t.waits + 1 && t.waits > 4), "{tracked:?}");
    }
    let posed = of_frames(&gpu, false, &[]);
    // input, fusion, surface, DynGeo, transfer, samples, objects, bounce, picture
    assert!(posed.iter().all(|t| counts(t) == (9, 9)), "{posed:?}");
    let tracked = of_frames(&gpu, false, &[("tracking.mode", "track")]);
    for (posed, tracked) in posed.iter().zip(&tracked) {
        let iterations = tracked.waits - posed.waits;
        assert_eq!(tracked.submissions - posed.submissions, iterations);
        assert_eq!(tracked.read_back - posed.read_back, iterations * 4 * TERMS as u64);
    }
}

#[test]
fn bytes_are_those_of_the_frame() {
    let Some(gpu) = gpu() else { return };
    for frame in of_frames(&gpu, false, &[]) {
        let parameters = frame.uploaded - 7 * 160 * 120;
        assert!(parameters < 64 << 10, "{parameters} bytes of parameters and objects");
        assert!(frame.read_back - PICTURE < 64 << 10, "{frame:?}");
    }
}
