//! Whether files are whole.

use crate::common::process::lines;
use kinlight::capture::{CaptureOptions, FrameSource, open_sequence};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// All files below `folder` that have their final names, each of which must be whole; temporary ones are counted.
pub fn whole_files(folder: &Path) -> (Vec<PathBuf>, usize) {
    let (mut files, mut temporary) = (Vec::new(), 0);
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.file_name().unwrap().to_string_lossy().starts_with('.') {
                temporary += 1;
            } else {
                is_whole(&path);
                files.push(path);
            }
        }
    }
    files.sort();
    (files, temporary)
}

fn is_whole(path: &Path) {
    let name = path.display();
    let bytes = fs::read(path).unwrap();
    let text = || String::from_utf8(bytes.clone()).unwrap_or_else(|e| panic!("{name}: {e}"));
    match path.extension().unwrap().to_str().unwrap() {
        "png" | "hdr" => drop(image::open(path).unwrap_or_else(|e| panic!("{name}: {e}"))),
        "json" => {
            drop(serde_json::from_slice::<Value>(&bytes).unwrap_or_else(|e| panic!("{name}: {e}")))
        }
        "toml" => {
            drop(toml::from_str::<toml::Table>(&text()).unwrap_or_else(|e| panic!("{name}: {e}")))
        }
        "ply" => is_mesh(&bytes, &name.to_string()),
        "html" => assert!(text().trim_end().ends_with("</html>"), "{name}"),
        "jsonl" => {
            let text = text();
            assert!(text.is_empty() || text.ends_with('\n'), "{name}: the last line is whole");
            for line in text.lines() {
                serde_json::from_str::<Value>(line)
                    .unwrap_or_else(|e| panic!("{name}: {e}: {line}"));
            }
        }
        "txt" | "csv" => {
            let text = text();
            assert!(text.is_empty() || text.ends_with('\n'), "{name}: the last line is whole");
            let words = |line: &str| line.split([' ', ',']).count();
            let mut rows = text.lines().filter(|line| !line.starts_with('#')).map(words);
            let first = rows.next();
            assert!(rows.all(|row| Some(row) == first), "{name}: lines of one form");
        }
        "glb" => {
            assert_eq!(bytes.len(), u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize)
        }
        other => panic!("{name}: {other} files are not checked"),
    }
}

/// The header says how many vertices and faces follow, in binary.
fn is_mesh(bytes: &[u8], name: &str) {
    let end = b"end_header\n";
    let at = bytes.windows(end.len()).position(|w| w == end).expect("a header") + end.len();
    let header = String::from_utf8(bytes[..at].to_vec()).expect("text");
    let number = |what: &str| -> usize {
        let line = header.lines().find_map(|l| l.strip_prefix(&format!("element {what} ")));
        line.expect("an element").parse().expect("a number")
    };
    let (mut vertex, mut in_vertex) = (0, false);
    for line in header.lines() {
        in_vertex = if line.starts_with("element") { line.contains("vertex") } else { in_vertex };
        vertex += match line.split(' ').nth(1) {
            Some("float") if in_vertex => 4,
            Some("uchar") if in_vertex => 1,
            _ => 0,
        };
    }
    // A face is a count in one byte and three indices.
    let expected = at + number("vertex") * vertex + number("face") * 13;
    assert_eq!(bytes.len(), expected, "{name}:\n{header}");
}

/// Frames of a run's folder; pictures come before their lines.
pub fn frames_of_run(out: &Path) -> usize {
    let lights = lines(&out.join("light.jsonl"));
    let poses = lines(&out.join("trajectory.txt"));
    let timings = lines(&out.join("timings.csv")).saturating_sub(1);
    let pictures = fs::read_dir(out.join("frames"))
        .unwrap()
        .filter(|entry| !entry.as_ref().unwrap().file_name().to_string_lossy().starts_with('.'));
    let pictures = pictures.count();
    for (fewer, more) in [(timings, poses), (poses, lights), (lights, pictures)] {
        assert!(fewer <= more && more <= fewer + 1, "{pictures} {lights} {poses} {timings}");
    }
    lights
}

/// Frames of a recording, all of which must be readable.
pub fn frames_of_recording(out: &Path) -> usize {
    let mut source = open_sequence(out, &CaptureOptions::default()).unwrap();
    let frames = std::iter::from_fn(|| source.next_frame().unwrap()).count();
    assert_eq!(source.skipped(), []);
    assert_eq!(frames, lines(&out.join("rgb.txt")));
    frames
}
