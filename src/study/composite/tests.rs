use super::change::Change;
use super::*;
use crate::image::{Image, Size};
use crate::stop::Stop;
use crate::study::StudyError;
use std::cell::RefCell;
use std::path::Path;

const SIZE: Size = Size::new(67, 43);

fn picture(pixel: impl Fn(usize, usize) -> [u8; 3]) -> Image<[u8; 3]> {
    let pixels = (0..SIZE.pixels()).map(|i| pixel(i % SIZE.width, i / SIZE.width));
    Image::from_vec(SIZE, pixels.collect())
}

fn room(x: usize, y: usize) -> [u8; 3] {
    [120 + (x % 7) as u8, 130 + (y % 5) as u8, 110]
}

fn on_object(x: usize, y: usize) -> bool {
    (10..20).contains(&x) && (10..22).contains(&y)
}

fn in_shadow(x: usize, y: usize) -> bool {
    (26..50).contains(&x) && (12..30).contains(&y)
}

/// A dark object and its shadow, `shade` 8-bit steps deep.
fn with_object(shade: u8, object: u8) -> Image<[u8; 3]> {
    picture(|x, y| match (on_object(x, y), in_shadow(x, y)) {
        (true, _) => [object, 60, 90],
        (_, true) => room(x, y).map(|v| v - shade),
        _ => room(x, y),
    })
}

fn truth(picture: Image<[u8; 3]>) -> FrameTruth {
    let mask = (0..SIZE.pixels()).map(|i| on_object(i % SIZE.width, i / SIZE.width)).collect();
    FrameTruth { frame: 7, path: "t.png".into(), picture, object: Image::from_vec(SIZE, mask) }
}

#[test]
fn a_perfect_picture_has_no_error() {
    let truth = truth(with_object(40, 50));
    let found = measure(&picture(room), &truth.picture, &truth).unwrap();
    assert_eq!((found.frame, found.psnr_db), (7, f64::INFINITY));
    assert_eq!((found.flip, found.changed_rmse, found.object_rmse), (0.0, 0.0, 0.0));
    assert_eq!((found.shadow_found, found.spill), (1.0, 0.0));
    assert!((found.ssim - 1.0).abs() < 1e-12); // a * a / a * a
    // The shadow, and around it what the 5x5 averages bring over: two pixels at most.
    assert!((24 * 18..=28 * 22).contains(&found.changed_pixels), "{}", found.changed_pixels);
    assert_eq!(found.noise_rmse, 0.0, "most of the picture did not change at all");
}

#[test]
fn an_unmodified_input_misses_exactly_the_whole_change() {
    let truth = truth(with_object(40, 50));
    let input = picture(room);
    let found = measure(&input, &input, &truth).unwrap();
    assert_eq!((found.changed_rmse, found.shadow_found, found.spill), (1.0, 0.0, 0.0));
    assert!(found.psnr_db < 40.0 && found.flip > 0.0 && found.object_rmse > 0.5);
}

#[test]
fn half_a_shadow_is_half_found() {
    // Linear light is what counts: 120 - 40 and 120 - 18 are about half as far apart as 120 - 40 and 120.
    let truth = truth(with_object(40, 50));
    let found = measure(&picture(room), &with_object(18, 50), &truth).unwrap();
    assert!((found.shadow_found - 0.5).abs() < 0.03, "{}", found.shadow_found);
    assert!((found.changed_rmse - (1.0 - found.shadow_found)).abs() < 0.02);
}

#[test]
fn a_shadow_where_there_is_none_is_spill() {
    let truth = truth(with_object(40, 50));
    let elsewhere = picture(|x, y| {
        if (54..64).contains(&x) { room(x, y).map(|v| v - 30) } else { truth.picture[(x, y)] }
    });
    let found = measure(&picture(room), &elsewhere, &truth).unwrap();
    assert_eq!((found.changed_rmse, found.shadow_found), (0.0, 1.0));
    // 10x43 pixels, 30 steps deep, against 24x18 and 40
    assert!((0.5..1.0).contains(&found.spill), "{}", found.spill);
}

#[test]
fn where_nothing_changed_the_change_is_undefined() {
    let truth = truth(with_object(0, 50));
    let input = picture(room);
    let found = measure(&input, &truth.picture, &truth).unwrap();
    assert_eq!(found.changed_pixels, 0);
    assert!(found.changed_rmse.is_nan() && found.shadow_found.is_nan() && found.spill.is_nan());
    assert!(found.noise_rmse.is_nan());
    assert_eq!(found.object_rmse, 0.0);
    // through JSON and back
    let text = serde_json::to_string(&found).unwrap();
    assert!(text.contains("\"changed_rmse\":null"), "{text}");
    let back: CompositeFrame = serde_json::from_str(&text).unwrap();
    assert!(back.changed_rmse.is_nan() && back.object_rmse == 0.0);

    let nothing = FrameTruth { object: Image::new(SIZE, false), ..truth };
    assert!(measure(&input, &input, &nothing).unwrap().object_rmse.is_nan());
    let everything = FrameTruth { object: Image::new(SIZE, true), ..nothing };
    assert_eq!(measure(&input, &input, &everything).unwrap().changed_pixels, 0);
}

#[test]
fn noise_is_no_change() {
    use crate::math::random::Rng;
    let mut rng = Rng::new(&[3]);
    let clean = with_object(40, 50);
    let noisy: Vec<[u8; 3]> = clean
        .as_slice()
        .iter()
        .map(|rgb| rgb.map(|v| (f32::from(v) + 4.0 * rng.normal()).clamp(0.0, 255.0) as u8))
        .collect();
    let truth = truth(Image::from_vec(SIZE, noisy));
    let change = Change::of(&picture(room), &truth.picture, &truth.object).unwrap();
    // beyond the shadow and its margin, four deviations are passed by one pixel in 16000
    assert!(change.pixels() <= 28 * 22 + 3, "{}", change.pixels());
    assert!(change.pixels() >= 24 * 18, "{}", change.pixels());
    let expected = change.noise_rmse();
    assert!((0.002..0.05).contains(&expected), "{expected}");
    let found = measure(&picture(room), &clean, &truth).unwrap();
    // three channels with noise of their own, where noise_rmse speaks of luminance
    assert!(found.changed_rmse < 4.0 * expected, "{} {expected}", found.changed_rmse);
}

#[test]
fn sizes_must_agree() {
    let truth = truth(with_object(40, 50));
    let small = Image::new(Size::new(32, 24), [0; 3]);
    assert!(measure(&small, &small, &truth).is_err());
    assert!(measure(&picture(room), &small, &truth).is_err());
}

fn options(out: &Path) -> CompositeOptions {
    CompositeOptions {
        out: out.to_owned(),
        presets: vec!["ours-fast".into()],
        variants: ["no-bounce", "ratio", "true-light", "true-albedo"].map(str::to_owned).into(),
        made: None,
        folders: Vec::new(),
        measured: 2,
        anew: false,
        command: "test".into(),
        stop: Stop::default(),
    }
}

fn make(folder: &Path) {
    let options = crate::synth::SynthOptions {
        scene: "sphere".into(),
        frames: 3,
        width: 80,
        height: 60,
        samples: 8,
        bounces: 2,
        with_virtual: true,
        virtual_every: 2,
        ..crate::synth::SynthOptions::default()
    };
    crate::synth::generate(&options, folder, &|_, _| {}).unwrap();
}

#[test]
fn a_study_runs_and_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let (made, out) = (folder.path().join("made"), folder.path().join("out"));
    make(&made);
    let options = CompositeOptions { folders: vec![made.clone()], ..options(&out) };
    let told = RefCell::new(Vec::new());
    let study = run_study(&options, &|what, _, _| told.borrow_mut().push(what.to_owned())).unwrap();
    assert!(told.borrow().iter().any(|what| what.contains("made")));
    // "ratio" is what the preset does
    let keys: Vec<&str> = study.runs.iter().map(|r| r.key.as_str()).collect();
    assert_eq!(keys, [PRESET, "no-bounce", "true-light", "true-albedo"]);
    for run in &study.runs {
        assert_eq!(run.frames.iter().map(|f| f.frame).collect::<Vec<_>>(), [0, 2]);
        assert!(run.frames.iter().all(|f| f.flip > 0.0 && f.psnr_db > 10.0), "{run:?}");
    }
    let [plain, _, given, albedo] = study.runs.as_slice() else { panic!() };
    assert!(albedo.changes[0].starts_with("light.mean_albedo=0."), "{:?}", albedo.changes);
    // f32 coefficients of an area light: its centre and its band 1 differ a little
    assert!(given.frames[1].light_deg < 1.0);
    assert!(plain.frames[1].changed_rmse < 1.2, "{:?}", plain.frames[1]);

    for name in ["study.json", "runs.csv", "summary.md", "pictures/made/000002-ours-fast-flip.png"]
    {
        assert!(out.join(name).exists(), "{name}");
    }
    let csv = std::fs::read_to_string(out.join("runs.csv")).unwrap();
    assert_eq!(csv.lines().count(), 1 + 4 * 2);
    let columns = csv.lines().next().unwrap().split(',').count();
    assert!(csv.lines().all(|l| l.split(',').count() == columns));
    assert!(summary(&study).contains("| without the bounce | 1 |"));

    // Again: nothing is run. Then with half a line at the end: what is whole is kept.
    std::fs::remove_dir_all(out.join("pictures")).unwrap();
    let again = run_study(&options, &|_, _, _| {}).unwrap();
    assert!(!out.join("pictures").exists());
    // JSON may cost the last digit
    let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-12;
    for (again, run) in again.runs.iter().zip(&study.runs) {
        assert_eq!((&again.key, &again.changes), (&run.key, &run.changes));
        assert!(close(again.update_ms, run.update_ms), "not run again");
        assert!(close(again.frames[1].changed_rmse, run.frames[1].changed_rmse));
    }
    let log = out.join("runs.jsonl");
    let text = std::fs::read_to_string(&log).unwrap();
    std::fs::write(&log, &text[..text.len() - 100]).unwrap();
    let third = run_study(&options, &|_, _, _| {}).unwrap();
    assert!(close(third.runs[0].update_ms, study.runs[0].update_ms), "kept");
    assert_eq!(
        third.runs[3].frames[1].object_rmse, study.runs[3].frames[1].object_rmse,
        "run again, with the same result"
    );
}

#[test]
fn mistakes_name_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let (made, out) = (folder.path().join("made"), folder.path().join("out"));
    let fails = |options: &CompositeOptions| -> String {
        let error: StudyError = run_study(options, &|_, _, _| {}).unwrap_err();
        error.to_string()
    };
    assert!(fails(&options(&out)).contains("nothing to study"));
    let nowhere = CompositeOptions { folders: vec!["nowhere".into()], ..options(&out) };
    assert!(fails(&nowhere).contains("nowhere/virtual.json"));
    let wrong = CompositeOptions { variants: vec!["wrong".into()], ..options(&out) };
    assert!(fails(&wrong).contains("'wrong'"));
    let none = CompositeOptions { measured: 0, ..options(&out) };
    assert!(fails(&none).contains("at least one frame"));
    let wrong = CompositeOptions { presets: vec!["best".into()], ..options(&out) };
    assert!(fails(&wrong).contains("'best'"));

    make(&made);
    let good = CompositeOptions { folders: vec![made.clone()], ..options(&out) };
    let truth = made.join("composite/1000.066667.png");
    let small = Image::new(Size::new(8, 6), [0u8; 3]);
    crate::output::write_color_png(&truth, &small).unwrap();
    assert!(fails(&good).contains("1000.066667.mask.png: 80x60"), "{}", fails(&good));
    crate::output::write_color_png(&made.join("composite/1000.066667.mask.png"), &small).unwrap();
    let message = fails(&good);
    assert!(message.contains("1000.066667.png: pictures of different size"), "{message}");
    std::fs::write(&truth, b"no picture").unwrap();
    assert!(fails(&good).contains("1000.066667.png"));
}
