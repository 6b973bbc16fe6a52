//! Where OpenNI2 is found.

#![allow(unsafe_code, reason = "calls of a C library")]

use super::ffi::Api;
use crate::capture::live::DeviceError;
use libloading::Library;
use std::path::{Path, PathBuf};

/// Folder of the library, or the library itself; in place of the system's.
pub const LIBRARY_VARIABLE: &str = "KINLIGHT_OPENNI2";

const NAMES: &[&str] = if cfg!(windows) {
    &["OpenNI2.dll"]
} else if cfg!(target_os = "macos") {
    &["libOpenNI2.dylib"]
} else {
    &["libOpenNI2.so.0", "libOpenNI2.so"]
};

const ADVICE: &str = "install OpenNI2 (Debian and Ubuntu: apt install libopenni2-0), or name its folder \
                      in KINLIGHT_OPENNI2";

/// Loads what [`LIBRARY_VARIABLE`] names, else what the system's loader finds.
pub fn load() -> Result<(Api, String), DeviceError> {
    let candidates = match std::env::var_os(LIBRARY_VARIABLE).filter(|v| !v.is_empty()) {
        Some(given) => named(Path::new(&given))?,
        None => NAMES.iter().map(PathBuf::from).collect(),
    };
    let mut problems = Vec::new();
    for path in candidates {
        // SAFETY: loading runs the library's initialisers. This one's set up its log and its context,
        // without threads; that it is OpenNI2 is what its name, or the user, says.
        let loaded = unsafe { Library::new(&path).and_then(|library| Api::of(library)) };
        match loaded {
            Ok(api) => return Ok((api, path.display().to_string())),
            Err(problem) => problems.push(problem.to_string()),
        }
    }
    let problems = problems.join("; ");
    Err(DeviceError::NoDriver(format!("OpenNI2 cannot be loaded: {ADVICE} ({problems})")))
}

/// The libraries in a folder that was named; an absolute path, because the loader searches elsewhere
/// for names without a folder, and OpenNI2 looks for its drivers beside itself.
fn named(given: &Path) -> Result<Vec<PathBuf>, DeviceError> {
    let missing = |why: String| {
        DeviceError::NoDriver(format!(
            "{LIBRARY_VARIABLE} names {}: {why}; {ADVICE}",
            given.display()
        ))
    };
    let real = given.canonicalize().map_err(|e| missing(e.to_string()))?;
    if real.is_file() {
        return Ok(vec![real]);
    }
    let there: Vec<_> = NAMES.iter().map(|n| real.join(n)).filter(|p| p.is_file()).collect();
    if there.is_empty() {
        return Err(missing(format!("no {} in it", NAMES[0])));
    }
    Ok(there)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_without_the_library_is_said_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let error = named(folder.path()).unwrap_err().to_string();
        assert!(error.contains("no ") && error.contains("libopenni2-0"), "{error}");
        let error = named(&folder.path().join("none")).unwrap_err();
        assert!(matches!(error, DeviceError::NoDriver(_)), "{error:?}");
        std::fs::write(folder.path().join(NAMES[0]), b"").unwrap();
        let found = named(folder.path()).unwrap();
        assert_eq!(found, [folder.path().canonicalize().unwrap().join(NAMES[0])]);
        assert!(named(&found[0]).unwrap()[0].is_absolute());
    }
}
