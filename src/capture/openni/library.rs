//! Where OpenNI2 is found.

#![allow(unsafe_code, reason = "calls of a C library")]

use super::ffi::Api;
use crate::capture::live::DeviceError;
use libloading::{Error, Library};
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

/// What to do where it is missing.
pub const INSTALL_ADVICE: &str = "install OpenNI2 (Debian and Ubuntu: apt install libopenni2-0), or name its folder in KINLIGHT_OPENNI2";

/// Loads what [`LIBRARY_VARIABLE`] names, else what the system's loader finds.
pub fn load() -> Result<(Api, String), DeviceError> {
    find().map_err(|why| DeviceError::NoDriver(format!("{why}: {INSTALL_ADVICE}")))
}

/// As [`load`], with what is wrong and no advice.
pub fn find() -> Result<(Api, String), String> {
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
    Err(format!("OpenNI2 cannot be loaded ({})", problems.join("; ")))
}

/// The libraries in a folder that was named; an absolute path, because the loader searches elsewhere
/// for names without a folder, and OpenNI2 looks for its drivers beside itself.
fn named(given: &Path) -> Result<Vec<PathBuf>, String> {
    let missing = |why: String| format!("{LIBRARY_VARIABLE} names {}: {why}", given.display());
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

/// Loads a library with all of its functions found at once, as OpenNI2 loads its drivers.
///
/// # Safety
/// As [`Library::new`].
pub unsafe fn load_at_once(path: &Path) -> Result<Library, Error> {
    #[cfg(unix)]
    {
        use libloading::os::unix;
        // SAFETY: the caller's promise.
        unsafe { unix::Library::open(Some(path), unix::RTLD_NOW | unix::RTLD_LOCAL) }
            .map(Into::into)
    }
    #[cfg(not(unix))]
    // SAFETY: the caller's promise.
    unsafe {
        Library::new(path)
    }
}

/// The file that a library was loaded from, by one of its functions: as OpenNI2 finds itself.
#[cfg(unix)]
pub fn origin(api: &Api) -> Option<PathBuf> {
    use std::ffi::{CStr, OsStr, c_char, c_int, c_void};
    use std::os::unix::ffi::OsStrExt;
    use std::ptr::{null, null_mut};

    /// `Dl_info` of dlfcn.h.
    #[repr(C)]
    struct Info {
        file: *const c_char,
        _base: *mut c_void,
        _symbol: *const c_char,
        _address: *mut c_void,
    }
    unsafe extern "C" {
        fn dladdr(address: *const c_void, info: *mut Info) -> c_int;
    }
    let mut info = Info { file: null(), _base: null_mut(), _symbol: null(), _address: null_mut() };
    // SAFETY: any address may be asked for; the output is valid.
    let known = unsafe { dladdr(api.initialize as *const c_void, &mut info) } != 0;
    if !known || info.file.is_null() {
        return None;
    }
    // SAFETY: the loader's own text, NUL-terminated, which lives as long as the library is loaded.
    let file = unsafe { CStr::from_ptr(info.file) };
    Some(PathBuf::from(OsStr::from_bytes(file.to_bytes())))
}

#[cfg(not(unix))]
pub fn origin(_api: &Api) -> Option<PathBuf> {
    None
}

/// Where Debian's build looks for its configuration. Others have theirs beside the library.
const SYSTEM_CONFIGURATION: &str = "/etc/openni2/OpenNI.ini";

/// Where a library looks for its drivers, and what their names must end with: Debian's build has changed
/// the ending, and nothing but the texts in it tells.
pub fn drivers_of(library: &Path) -> (PathBuf, String) {
    let folder = library.parent().unwrap_or(Path::new("")).to_owned();
    let content = std::fs::read(library).unwrap_or_default();
    let holds = |text: &str| {
        let text = format!("\0{text}\0");
        content.windows(text.len()).any(|window| window == text.as_bytes())
    };
    let usual = std::env::consts::DLL_SUFFIX;
    let versioned = format!("{usual}.0");
    let ending = if holds(&versioned) { versioned } else { usual.to_owned() };
    let configuration = match holds(SYSTEM_CONFIGURATION) {
        true => PathBuf::from(SYSTEM_CONFIGURATION),
        false => folder.join("OpenNI.ini"),
    };
    let text = std::fs::read_to_string(configuration).unwrap_or_default();
    let repository = repository(&text).unwrap_or("OpenNI2/Drivers");
    (folder.join(repository), ending)
}

/// The folder of drivers that a configuration names, relative to the library or not.
fn repository(configuration: &str) -> Option<&str> {
    let mut section = "";
    for line in configuration.lines().map(str::trim) {
        if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
            section = name;
        } else if let ("Drivers", Some(("Repository", folder))) =
            (section, line.split_once('=').map(|(key, value)| (key.trim(), value.trim())))
        {
            return Some(folder).filter(|folder| !folder.is_empty());
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_without_the_library_is_said_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let error = named(folder.path()).unwrap_err();
        assert!(error.contains(&format!("no {}", NAMES[0])), "{error}");
        let error = named(&folder.path().join("none")).unwrap_err();
        assert!(error.contains("none: "), "{error}");
        std::fs::write(folder.path().join(NAMES[0]), b"").unwrap();
        let found = named(folder.path()).unwrap();
        assert_eq!(found, [folder.path().canonicalize().unwrap().join(NAMES[0])]);
        assert!(named(&found[0]).unwrap()[0].is_absolute());
    }

    #[test]
    fn drivers_are_where_the_configuration_says() {
        let text =
            "[Log]\nRepository=no\n[Drivers]\n; Default\n;Repository=a\n Repository = /opt/d\n";
        assert_eq!(repository(text), Some("/opt/d"));
        assert_eq!(repository("[Drivers]\n;Repository=OpenNI2/Drivers\n"), None);
        assert_eq!(repository("[Drivers]\nRepository=\n"), None);
    }

    #[test]
    fn a_build_tells_the_ending_of_its_drivers() {
        let folder = tempfile::tempdir().unwrap();
        let library = folder.path().join("libOpenNI2.so.0");
        let (suffix, drivers) =
            (std::env::consts::DLL_SUFFIX, folder.path().join("OpenNI2/Drivers"));
        // The library's own name has the ending, too, but does not consist of it.
        let texts = format!("\0libOpenNI2{suffix}.0\0{suffix}\0");
        std::fs::write(&library, &texts).unwrap();
        assert_eq!(drivers_of(&library), (drivers.clone(), suffix.to_owned()));
        std::fs::write(&library, format!("{texts}\0{suffix}.0\0")).unwrap();
        assert_eq!(drivers_of(&library), (drivers, format!("{suffix}.0")));
        std::fs::write(folder.path().join("OpenNI.ini"), "[Drivers]\nRepository=mine\n").unwrap();
        assert_eq!(drivers_of(&library).0, folder.path().join("mine"));
    }
}
