//! Files of a recording name other files: none of them leads out of it unless that was asked for, and nothing
//! that a recording says becomes the name of a file that is written.

mod common;

use common::recording::small_demo;
use common::{kinlight, text};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// A recording of two frames, with a folder beside it that it has no business in.
struct Made {
    folder: tempfile::TempDir,
}

impl Made {
    fn new() -> Self {
        let made = Self { folder: tempfile::tempdir().unwrap() };
        small_demo(2).write(&made.path("sequence"));
        fs::create_dir(made.path("elsewhere")).unwrap();
        made
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn edit(&self, name: &str, change: impl FnOnce(String) -> String) {
        let text = fs::read_to_string(self.path(name)).unwrap();
        fs::write(self.path(name), change(text)).unwrap();
    }

    /// Exit code and messages of a command on the recording.
    fn run(&self, command: &str, rest: &[&str]) -> (Option<i32>, String) {
        let sequence = self.path("sequence");
        let output = kinlight(&[&[command, text(&sequence)], rest].concat());
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(!stderr.contains("panicked"), "{stderr}");
        (output.status.code(), stderr)
    }

    /// As a run with quick settings.
    fn replay(&self, rest: &[&str]) -> (Option<i32>, String) {
        let out = self.path("out");
        let quick = ["--preset", "ours-fast-mobile", "--backend", "cpu", "--out", text(&out)];
        self.run("replay", &[&quick, rest].concat())
    }

    /// All files below, by their names from here.
    fn files(&self) -> BTreeSet<String> {
        let mut found = BTreeSet::new();
        let mut open = vec![self.folder.path().to_owned()];
        while let Some(folder) = open.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                match path.is_dir() {
                    true => open.push(path),
                    false => {
                        let name = path.strip_prefix(self.folder.path()).unwrap();
                        found.insert(text(name).to_owned());
                    }
                }
            }
        }
        found
    }
}

#[test]
fn names_in_a_recording_do_not_become_names_of_results() {
    let made = Made::new();
    let odd = "rgb/$(touch x) ; <b>'\"%2e%2e.png";
    let list = fs::read_to_string(made.path("sequence/rgb.txt")).unwrap();
    let first = list.lines().find(|l| !l.starts_with('#')).unwrap().to_owned();
    let (stamp, name) = first.split_once(' ').unwrap();
    fs::rename(made.path("sequence").join(name), made.path("sequence").join(odd)).unwrap();
    made.edit("sequence/rgb.txt", |list| list.replace(&first, &format!("{stamp} {odd}")));
    let object = "..%2f..%2f<img src=x>.glb";
    fs::rename(made.path("sequence/object.glb"), made.path("sequence").join(object)).unwrap();
    made.edit("sequence/scene.toml", |scene| scene.replace("object.glb", object));

    let before = made.files();
    let (code, said) = made.replay(&["--dump", "depth,normals"]);
    assert_eq!(code, Some(0), "{said}");
    let made_by_run: Vec<String> = made.files().difference(&before).cloned().collect();
    assert!(made_by_run.len() > 8, "{made_by_run:?}");
    for name in &made_by_run {
        let plain = |c: char| c.is_ascii_alphanumeric() || "._-/".contains(c);
        assert!(name.starts_with("out/") && name.chars().all(plain), "{name}");
    }
    let report = fs::read_to_string(made.path("out/report.html")).unwrap();
    assert!(!report.contains("<img src=x>") && !report.contains("<b>'"), "names are escaped");

    let before = made.files();
    let copy = made.path("copy");
    let (code, said) = made.run("convert", &[text(&copy)]);
    assert_eq!(code, Some(0), "{said}");
    for name in made.files().difference(&before) {
        let plain = |c: char| c.is_ascii_alphanumeric() || "._-/".contains(c);
        assert!(name.starts_with("copy/") && name.chars().all(plain), "{name}");
    }
}

#[test]
fn a_scene_of_a_recording_reads_its_own_folder_only() {
    let made = Made::new();
    fs::rename(made.path("sequence/object.glb"), made.path("elsewhere/o.glb")).unwrap();
    let absolute = made.path("elsewhere/o.glb");
    let scene = made.path("sequence/scene.toml");
    for name in ["../elsewhere/o.glb", text(&absolute)] {
        let content = format!("[[object]]\nfile = '{name}'\nat = [0, 0, 0]\n");
        fs::write(&scene, content).unwrap();
        let (code, said) = made.replay(&[]);
        assert_eq!(code, Some(4), "{said}");
        assert!(said.contains("points outside its folder") && said.contains("--scene"), "{said}");
        assert!(!made.path("out/frames").exists());
    }
    let (code, said) = made.replay(&["--scene", text(&scene)]);
    assert_eq!(code, Some(0), "asked for: {said}");
}

#[cfg(unix)]
#[test]
fn links_out_of_a_recording_are_followed_when_asked_for() {
    use std::os::unix::fs::symlink;
    let link = |made: &Made, name: &str| {
        let (here, there) = (made.path("sequence").join(name), made.path("elsewhere/moved"));
        fs::rename(&here, &there).unwrap();
        symlink(Path::new("../elsewhere/moved"), &here).unwrap();
    };
    let made = Made::new();
    link(&made, "rgb");
    for command in ["info", "replay"] {
        let (code, said) = match command {
            "info" => made.run("info", &[]),
            _ => made.replay(&[]),
        };
        assert_eq!(code, Some(3), "{said}");
        assert!(said.contains("leads out of the recording"), "{said}");
    }
    let (code, said) = made.replay(&["--follow-links"]);
    assert_eq!(code, Some(0), "{said}");

    let made = Made::new();
    link(&made, "object.glb");
    let (code, said) = made.replay(&[]);
    assert_eq!(code, Some(4), "{said}");
    assert!(said.contains("object.glb") && said.contains("link"), "{said}");
}
