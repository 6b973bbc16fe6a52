//! OpenNI2: its library, its drivers, and the devices that they announce.

use super::Problem;
use super::machine::{entries, file_name};
use super::probe::{Failure, Prober};
use crate::capture::openni::{FoundDevice, INSTALL_ADVICE, LoadedLibrary, SensorDetail};
use serde::{Serialize, Serializer};
use std::path::{Path, PathBuf};

/// Drivers that come with the library and are for no sensor: recordings, and a test picture.
const NO_SENSORS: [&str; 2] = ["onifile", "dummydevice"];

#[derive(Clone, Debug, Serialize)]
pub struct OpenniReport {
    /// Where it was loaded from.
    pub library: Option<PathBuf>,
    pub version: Option<String>,
    pub drivers_folder: Option<PathBuf>,
    /// What a driver's file name has to end with for this build of the library.
    pub driver_ending: String,
    pub drivers: Vec<DriverFile>,
    /// `None` where that could not be found out.
    pub devices: Option<Vec<SensorReport>>,
    /// Why there is no library, or no answer about devices.
    #[serde(serialize_with = "as_text")]
    pub library_error: Option<Failure>,
    #[serde(serialize_with = "as_text")]
    pub devices_error: Option<Failure>,
}

/// A file in the folder of drivers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct DriverFile {
    pub file: String,
    #[serde(flatten)]
    pub fate: Fate,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(tag = "state", rename_all = "kebab-case")]
pub enum Fate {
    Loads,
    /// Its name is not one that the library looks for.
    Ignored,
    Fails {
        why: String,
    },
}

/// A device that OpenNI2 announces, and what came of opening it.
#[derive(Clone, Debug, Serialize)]
pub struct SensorReport {
    #[serde(flatten)]
    pub found: FoundDevice,
    #[serde(flatten)]
    pub detail: Option<SensorDetail>,
    #[serde(serialize_with = "as_text")]
    pub error: Option<Failure>,
}

fn as_text<S: Serializer>(failure: &Option<Failure>, serializer: S) -> Result<S::Ok, S::Error> {
    failure.as_ref().map(ToString::to_string).serialize(serializer)
}

impl OpenniReport {
    pub(super) fn of(prober: &Prober) -> Self {
        let mut report = Self {
            library: None,
            version: None,
            drivers_folder: None,
            driver_ending: ".so".to_owned(),
            drivers: Vec::new(),
            devices: None,
            library_error: None,
            devices_error: None,
        };
        match prober.library() {
            Ok(loaded) => report.look_into(loaded, prober),
            Err(failure) => report.library_error = Some(failure),
        }
        report
    }

    fn look_into(&mut self, loaded: LoadedLibrary, prober: &Prober) {
        self.drivers = drivers(&loaded.drivers_folder, &loaded.driver_ending, prober);
        self.library = Some(loaded.path);
        self.version = Some(loaded.version);
        self.driver_ending = loaded.driver_ending;
        self.drivers_folder = Some(loaded.drivers_folder);
        match prober.announced() {
            Ok(devices) => {
                self.devices = Some(devices.into_iter().map(|d| sensor(d, prober)).collect())
            }
            Err(failure) => self.devices_error = Some(failure),
        }
    }

    /// Names of the files that the library can load.
    pub(super) fn working_drivers(&self) -> impl Iterator<Item = &str> {
        self.drivers.iter().filter(|d| d.fate == Fate::Loads).map(|d| d.file.as_str())
    }

    pub(super) fn announces_nothing(&self) -> bool {
        self.devices.as_ref().is_some_and(Vec::is_empty)
    }

    pub(super) fn problems(&self) -> Vec<Problem> {
        if let Some(failure) = &self.library_error {
            return vec![Problem::new(failure.to_string(), INSTALL_ADVICE)];
        }
        let Some(folder) = &self.drivers_folder else { return Vec::new() };
        let mut problems: Vec<_> =
            self.drivers.iter().filter_map(|d| d.problem(folder, &self.driver_ending)).collect();
        if self.working_drivers().all(is_no_sensors) {
            problems.push(Problem::new(
                format!("there is no driver for a sensor in {}", folder.display()),
                "put the driver of your sensor there, or install a whole OpenNI2 (apt install libopenni2-0)",
            ));
        }
        // What keeps its drivers from loading keeps it from starting.
        if let Some(failure) = self.devices_error.as_ref().filter(|_| problems.is_empty()) {
            problems.push(Problem::new(
                format!("OpenNI2 does not start: {failure}"),
                format!(
                    "move drivers out of {} until it does; the last one is at fault",
                    folder.display()
                ),
            ));
        }
        problems.extend(self.devices.iter().flatten().filter_map(SensorReport::problem));
        problems
    }
}

fn is_no_sensors(file: &str) -> bool {
    let file = file.to_lowercase();
    NO_SENSORS.iter().any(|name| file.contains(name))
}

fn drivers(folder: &Path, ending: &str, prober: &Prober) -> Vec<DriverFile> {
    let files = entries(folder).into_iter().filter(|path| path.is_file());
    let driver = |path: PathBuf| {
        let file = file_name(&path);
        let named = file.starts_with(std::env::consts::DLL_PREFIX) && file.ends_with(ending);
        let fate = match named.then(|| prober.driver(&path)) {
            None => Fate::Ignored,
            Some(Ok(())) => Fate::Loads,
            Some(Err(failure)) => Fate::Fails { why: failure.to_string() },
        };
        DriverFile { file, fate }
    };
    files.map(driver).collect()
}

impl DriverFile {
    /// Files that lie about are none, but a driver of another name is.
    fn problem(&self, folder: &Path, ending: &str) -> Option<Problem> {
        let Self { file, fate } = self;
        match fate {
            Fate::Loads => None,
            Fate::Ignored => {
                let stem = file.strip_prefix("lib").filter(|_| file.contains(".so"))?;
                let name = stem.split(".so").next().unwrap_or(stem);
                Some(Problem::new(
                    format!("{file} is ignored: this OpenNI2 only looks for lib*{ending}"),
                    format!("rename it to lib{name}{ending}, in {}", folder.display()),
                ))
            }
            Fate::Fails { why } => {
                let fix = match missing_library(why) {
                    Some("libudev.so.0") => {
                        "take a driver that was built for this system: this one is for one that still had \
                         libudev.so.0"
                            .to_owned()
                    }
                    Some(missing) => {
                        format!("install what brings {missing} (`apt-file search {missing}` says what does)")
                    }
                    None => format!("move it out of {}, or take another build of it", folder.display()),
                };
                Some(Problem::new(format!("{file} does not load: {why}"), fix))
            }
        }
    }
}

/// What the loader says it has not found, where it is not the file itself.
fn missing_library(why: &str) -> Option<&str> {
    let before = why.split_once(": cannot open shared object file")?.0;
    let name = before.rsplit([' ', ':']).next()?;
    (!name.contains('/') && name.contains(".so")).then_some(name)
}

fn sensor(found: FoundDevice, prober: &Prober) -> SensorReport {
    match prober.device(&found.uri) {
        Ok(detail) => SensorReport { found, detail: Some(detail), error: None },
        Err(failure) => SensorReport { found, detail: None, error: Some(failure) },
    }
}

impl SensorReport {
    fn problem(&self) -> Option<Problem> {
        let uri = &self.found.uri;
        let problem = match (&self.error, &self.detail) {
            (Some(failure @ Failure::Crashed { .. }), _) => Problem::new(
                format!("{uri}: {failure}"),
                "take another build of its driver; kinlight would crash with it as well",
            ),
            (Some(failure @ Failure::Silent { .. }), _) => Problem::new(
                format!("{uri}: {failure}"),
                "unplug it, plug it into a port of its own, and close other programs that use it",
            ),
            (Some(failure), _) => Problem::new(
                failure.to_string(),
                "close other programs that use it, and see that you may write its USB device",
            ),
            (None, Some(detail)) => {
                let why = detail.stream_error.as_ref()?;
                Problem::new(
                    format!("{uri}: {why}"),
                    "plug it into a port of its own, without a hub, and close other programs that use it",
                )
            }
            (None, None) => return None,
        };
        Some(problem)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_loader_misses_is_named() {
        let glibc = "libudev.so.0: cannot open shared object file: No such file or directory";
        assert_eq!(missing_library(glibc), Some("libudev.so.0"));
        let itself = "/a/libX.so.0: cannot open shared object file: No such file or directory";
        assert_eq!(missing_library(itself), None);
        assert_eq!(missing_library("/a/libX.so.0: file too short"), None);
    }

    #[test]
    fn a_driver_of_another_name_is_a_problem_and_a_readme_is_none() {
        let ignored = |file: &str| {
            let driver = DriverFile { file: file.into(), fate: Fate::Ignored };
            driver.problem("/drivers".as_ref(), ".so.0")
        };
        let problem = ignored("libFreenectDriver.so").expect("it is no use like this");
        assert!(problem.what.contains("lib*.so.0"), "{problem:?}");
        assert!(problem.fix.contains("libFreenectDriver.so.0"), "{problem:?}");
        assert!(
            ignored("libFreenectDriver.so.0.7")
                .is_some_and(|p| p.fix.contains("libFreenectDriver.so.0,"))
        );
        assert_eq!((ignored("README"), ignored("PS1080.ini")), (None, None));
    }

    #[test]
    fn an_old_libudev_has_an_advice_of_its_own() {
        let fails = |missing: &str| {
            let why =
                format!("{missing}: cannot open shared object file: No such file or directory");
            let driver = DriverFile { file: "libX.so.0".into(), fate: Fate::Fails { why } };
            driver.problem("/drivers".as_ref(), ".so.0").expect("it does not load").fix
        };
        assert!(fails("libudev.so.0").contains("built for this system"));
        assert!(fails("libfreenect.so.0.7").contains("apt-file search libfreenect.so.0.7"));
    }
}
