//! What the fuzz targets share.

use kinlight::fuzzing::{Scratch, TARGETS};
use std::sync::OnceLock;

/// Hands the bytes to the body of a target. Files are made below the folder for temporary files: `run.sh`
/// names one in memory, and removes it at the end.
pub fn run(name: &str, data: &[u8]) {
    static SCRATCH: OnceLock<Scratch> = OnceLock::new();
    let scratch = SCRATCH.get_or_init(|| {
        let name = format!("kinlight-fuzz-{}", std::process::id());
        let root = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&root).expect("a folder for temporary files");
        Scratch::new(root)
    });
    let target = TARGETS.iter().find(|target| target.name == name).expect("a target of that name");
    (target.body)(data, scratch);
}
