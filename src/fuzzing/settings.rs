//! Settings of a run, and profiles.

use super::{Scratch, accepted, parts};
use crate::budget::{Ladder, Profile};
use crate::config::Settings;
use std::time::Duration;

/// A settings file, `field=value` assignments, or a profile.
pub fn settings(data: &[u8], scratch: &Scratch) -> bool {
    let Some((kind, rest)) = data.split_first() else { return false };
    let path = scratch.root().join("settings.toml");
    match kind {
        b'p' => {
            scratch.write(&path, rest);
            let Ok(profile) = Profile::read(&path) else { return false };
            let ladder = Ladder::choose(&profile, Duration::from_millis(100), &|_| Ok(()));
            accepted(ladder.map(|ladder| assert!(ladder.start() < ladder.rungs().len())))
        }
        b's' => {
            let mut settings = Settings::default();
            let mut all = true;
            for assignment in parts(rest) {
                let before = settings.clone();
                let taken = accepted(settings.assign(&String::from_utf8_lossy(assignment)));
                assert!(taken || settings == before, "a refused assignment changes nothing");
                all &= taken;
                // NaN is not equal to itself, so such settings are not used for the next one.
                if settings != settings.clone() {
                    settings = before;
                }
            }
            all & whole(&settings)
        }
        _ => {
            scratch.write(&path, rest);
            let mut settings = Settings::default();
            accepted(settings.merge_file(&path)) && whole(&settings)
        }
    }
}

/// Settings that are in range survive being written.
fn whole(settings: &Settings) -> bool {
    let text = settings.to_toml();
    if !accepted(settings.validate()) {
        return false;
    }
    let back: Settings = toml::from_str(&text).expect("own settings are read");
    assert_eq!(back, *settings);
    true
}
