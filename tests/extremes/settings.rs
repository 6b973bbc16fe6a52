//! Every numeric setting at 0, below, and far beyond: refused with its name, or it works.

use crate::frames::{SIZE, at_corner, camera, seen};
use crate::models::on_floor;
use crate::runs::{QUICK, Run};
use crate::table::{Device, Found, On, Outcome, Table};
use kinlight::capture::RawFrame;
use kinlight::config::Settings;
use kinlight::scene::analytic::AnalyticScene;

const NUMBERS: [&str; 12] =
    ["0", "-1", "1e-30", "0.5", "1", "3", "1000", "1e9", "1e30", "nan", "inf", "-inf"];
const WHOLE: [&str; 8] = ["0", "-1", "1", "2", "3", "1000", "4294967295", "9223372036854775807"];

/// Without a value by default, so that they are not in the file.
const POINTS: [&str; 2] = ["volume.centre", "light.at"];
const POINT_VALUES: [&str; 6] = [
    "[0.0, 0.0, 0.0]",
    "[nan, 0.0, 0.0]",
    "[0.0, inf, 0.0]",
    "[1e6, 0.0, 0.0]",
    "[1e30, 0.0, 0.0]",
    "[0.0, 0.0, -1e300]",
];

/// Every number that a settings file has, with the values that it is given.
fn fields() -> Vec<(String, Vec<String>)> {
    let table: toml::Table = Settings::default().to_toml().parse().expect("it is TOML");
    let mut fields = Vec::new();
    for (section, values) in &table {
        let values = values.as_table().expect("sections");
        for (name, value) in values {
            let key = format!("{section}.{name}");
            let given: Vec<String> = match value {
                toml::Value::Float(_) => NUMBERS.map(String::from).to_vec(),
                toml::Value::Integer(_) => WHOLE.map(String::from).to_vec(),
                toml::Value::Array(_) => {
                    let mut lists: Vec<_> = WHOLE.map(|v| format!("[{v}]")).to_vec();
                    lists.extend(["[]".to_owned(), "[1, 1, 1, 1, 1, 1]".to_owned()]);
                    lists
                }
                _ => continue,
            };
            fields.push((key, given));
        }
    }
    fields.extend(POINTS.map(|key| (key.to_owned(), POINT_VALUES.map(String::from).to_vec())));
    fields
}

/// Sets one field after the others; `Err` is what a user is told.
fn with(base: &[(&str, &str)], key: &str, value: &str) -> Result<Result<Settings, String>, String> {
    let text = |e: kinlight::config::SettingsError| e.to_string();
    let mut settings = Settings::preset("ours-fast-mobile").map_err(text)?;
    for (key, value) in QUICK.iter().chain(base) {
        settings.set(key, value).map_err(text)?;
    }
    Ok(settings.set(key, value).and_then(|()| settings.validate()).map(|()| settings).map_err(text))
}

/// What a field is for may show only with other settings.
const BASES: [&[(&str, &str)]; 4] = [
    &[("tracking.mode", "track")],
    &[
        ("transfer.subsampling", "4"),
        ("light.channels", "rgb"),
        ("compositing.upsampling", "bicubic-gauss"),
    ],
    &[("compositing.compositor", "difference"), ("light.prior", "dark")],
    &[
        ("transfer.method", "ray-traced"),
        ("bounce.enabled", "false"),
        ("transfer.subsampling", "4"),
        ("transfer.refine", "true"),
        ("light.prior", "distant-lamp"),
    ],
];

/// Which of them shows what a section is for.
fn bases(key: &str) -> &'static [&'static [(&'static str, &'static str)]] {
    match key.split('.').next() {
        Some("tracking" | "volume" | "input" | "surface" | "dyn_geo") => &BASES[..1],
        Some("transfer") => &BASES[1..],
        Some("bounce") => &BASES[1..2],
        _ => &BASES[1..3],
    }
}

fn pushed(on: Device<'_>, frames: &[RawFrame], key: &str, values: &[String]) -> Outcome {
    let (mut taken, mut refused) = (Vec::new(), Vec::new());
    let mut broken = 0;
    let mut first = None;
    let mut note = |count: usize, what: String| {
        broken += count;
        if count > 0 {
            first.get_or_insert(what);
        }
    };
    let name = key.rsplit('.').next().unwrap_or(key);
    for value in values {
        let mut was_refused = false;
        for base in bases(key) {
            let settings = match with(base, key, value)? {
                Ok(settings) => settings,
                Err(text) => {
                    was_refused = true;
                    note(usize::from(!text.contains(name)), format!("{value}: {text}"));
                    break;
                }
            };
            let found = processed(on, &settings, frames).map_err(|e| format!("{value}: {e}"))?;
            note(found.error as usize, format!("{value}: {}", found.what));
        }
        if was_refused { refused.push(value.as_str()) } else { taken.push(value.as_str()) }
    }
    let what = first.unwrap_or(format!("taken {}; refused {}", taken.join(" "), refused.join(" ")));
    Ok(Found::broken(broken, what))
}

fn processed(on: Device<'_>, settings: &Settings, frames: &[RawFrame]) -> Outcome {
    let run = Run::new(on, settings, camera(SIZE), on_floor());
    let mut run = run.map_err(|e| e.to_string())?;
    for frame in frames {
        run.frame(frame).map_err(|e| e.to_string())?;
    }
    run.finish()
}

pub fn cases(table: &mut Table) {
    let frames = [0, 1].map(|index| seen(&AnalyticScene::corner(), SIZE, at_corner(), index));
    for (key, values) in fields() {
        table.case("settings", &key, On::Both, |on| pushed(on, &frames, &key, &values));
    }
}
