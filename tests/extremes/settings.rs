//! Every numeric setting at 0, below, and far beyond: refused with its name, or it works.

use crate::checks::Broken;
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

/// Which of them shows what a field is for, the one that shows it best first.
fn bases(key: &str) -> &'static [&'static [(&'static str, &'static str)]] {
    match key.split_once('.') {
        Some(("transfer", name)) if name == "ray_length_m" || name.starts_with("refine") => {
            &BASES[3..]
        }
        Some(("transfer", _)) => &BASES[1..2],
        Some(("bounce", _)) => &BASES[1..2],
        Some(("light" | "compositing", _)) => &BASES[1..3],
        _ => &BASES[..1],
    }
}

/// Every value that is taken runs; on the GPU the first and the last of them, with the first base.
fn pushed(on: Device<'_>, frames: &[RawFrame], key: &str, values: &[String]) -> Outcome {
    let (mut taken, mut refused) = (Vec::new(), Vec::new());
    let mut broken = Broken::default();
    let name = key.rsplit('.').next().unwrap_or(key);
    for value in values {
        match with(bases(key)[0], key, value)? {
            Ok(_) => taken.push(value.as_str()),
            Err(text) => {
                broken.rule(text.contains(name), || format!("{value}: {text}"));
                refused.push(value.as_str());
            }
        }
    }
    let (tried, bases) = match (on, &taken[..]) {
        (Device::Gpu(_), [first, .., last]) => (vec![*first, *last], &bases(key)[..1]),
        (Device::Gpu(_), _) => (taken.clone(), &bases(key)[..1]),
        (Device::Cpu, _) => (taken.clone(), bases(key)),
    };
    for value in tried {
        for base in bases {
            let settings = with(base, key, value)?.map_err(|e| format!("{value}: {e}"))?;
            let found = processed(on, &settings, frames).map_err(|e| format!("{value}: {e}"))?;
            broken.values(found.error as usize, || format!("{value}: {}", found.what));
        }
    }
    let told = format!("taken {}; refused {}", taken.join(" "), refused.join(" "));
    Ok(Found::broken(broken.count, broken.first.unwrap_or(told)))
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
