//! `kinlight calibrate camera`: lenses and places of cameras from pictures of boards.

use super::write_toml;
use crate::cli::{CliError, Talk};
use clap::{Args, ValueEnum};
use kinlight::calibrate::CalibrateError;
use kinlight::calibrate::board::{Board, Markers};
use kinlight::calibrate::geometry::{
    CameraReport, DepthPictures, DepthReport, Outcome, Plan, calibrate, view_errors,
};
use kinlight::calibrate::intrinsics::{LensModel, RefusedView};
use kinlight::capture::calibration::CameraModel;
use kinlight::output::write_color_png;
use serde_json::{Value, json};
use std::path::PathBuf;

/// Lens of a camera from pictures of a board; with infrared pictures or raw disparities, the depth
/// camera and its place, too.
#[derive(Debug, Args)]
pub struct CameraArgs {
    /// Colour pictures: a folder, or a pattern with one * (quoted) in the file name. What * stands for
    /// tells which pictures of two cameras are a pair.
    #[arg(long, value_name = "PATTERN")]
    pub color: PathBuf,
    /// Infrared pictures of the depth camera.
    #[arg(long, value_name = "PATTERN", conflicts_with = "disparity")]
    infrared: Option<PathBuf>,
    /// Raw disparities of a Kinect v1 (.pgm).
    #[arg(long, value_name = "PATTERN")]
    disparity: Option<PathBuf>,
    /// Inner corners of the board.
    #[arg(long, value_name = "COLUMNSxROWS", value_parser = parse_pair)]
    board: (usize, usize),
    /// Side of the board's squares.
    #[arg(long, value_name = "25mm", value_parser = parse_length_m)]
    square: f64,
    /// The board is a ChArUco board with markers of this side.
    #[arg(long, value_name = "18mm", value_parser = parse_length_m)]
    markers: Option<f64>,
    /// Which markers: bits along a side, and how many the dictionary holds.
    #[arg(long, value_name = "4x4_50", value_parser = parse_dictionary, default_value = "4x4_50")]
    dictionary: (usize, usize),
    #[arg(long, value_enum, default_value_t = Model::Brown)]
    model: Model,
    /// Lens of the depth camera [default: that of the colour camera].
    #[arg(long, value_enum, requires = "infrared")]
    infrared_model: Option<Model>,
    /// Name of the calibration [default: that of the file].
    #[arg(long)]
    name: Option<String>,
    /// Calibration to write. Beside it, FILE-color.png (and FILE-infrared.png) show where corners were
    /// seen and how far off they are.
    #[arg(long, value_name = "FILE.toml")]
    out: PathBuf,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Model {
    /// No distortion.
    Ideal,
    /// Radial and tangential, 5 coefficients.
    Brown,
    /// The same with a denominator, 8 coefficients.
    Rational,
    /// Equidistant fish-eye, 4 coefficients.
    Fisheye,
}

impl From<Model> for LensModel {
    fn from(model: Model) -> Self {
        match model {
            Model::Ideal => Self::Ideal,
            Model::Brown => Self::Brown,
            Model::Rational => Self::Rational,
            Model::Fisheye => Self::Fisheye,
        }
    }
}

fn parse_pair(text: &str) -> Result<(usize, usize), String> {
    let number = |t: &str| t.parse().map_err(|_| format!("'{t}' is no number"));
    let (columns, rows) = text.split_once('x').ok_or("expected COLUMNSxROWS, such as 9x6")?;
    Ok((number(columns)?, number(rows)?))
}

fn parse_length_m(text: &str) -> Result<f64, String> {
    let units = [("mm", 1e-3), ("cm", 1e-2), ("m", 1.0)];
    let (number, unit) = units
        .iter()
        .find_map(|(name, unit)| Some((text.strip_suffix(name)?, unit)))
        .ok_or("a length needs its unit: mm, cm or m")?;
    let number: f64 = number.trim().parse().map_err(|_| format!("'{number}' is no number"))?;
    if number > 0.0 && number.is_finite() { Ok(number * unit) } else { Err("not positive".into()) }
}

fn parse_dictionary(text: &str) -> Result<(usize, usize), String> {
    let (bits, count) = text.split_once('_').ok_or("expected 4x4_50 to 7x7_1000")?;
    let (bits, same) = parse_pair(bits)?;
    let count = count.parse().map_err(|_| format!("'{count}' is no number"))?;
    if bits == same { Ok((bits, count)) } else { Err(format!("{bits} is not {same}")) }
}

pub(super) fn run(args: &CameraArgs, talk: Talk) -> Result<Value, CliError> {
    let plan = plan(args);
    let bar = indicatif::ProgressBar::new_spinner();
    if talk.quiet || talk.json {
        bar.set_draw_target(indicatif::ProgressDrawTarget::hidden());
    }
    let outcome = calibrate(&plan, &mut |key| {
        bar.set_message(key.to_owned());
        bar.inc(1);
    });
    bar.finish_and_clear();
    let outcome = outcome?;
    write_toml(&args.out, &outcome.calibration)?;
    let picture = |report: &CameraReport, which: &str| -> Result<(), CliError> {
        let stem = args.out.file_stem().unwrap_or_default().to_string_lossy();
        let path = args.out.with_file_name(format!("{stem}-{which}.png"));
        let written = write_color_png(&path, &report.coverage.picture);
        Ok(written.map_err(CalibrateError::from)?)
    };
    picture(&outcome.color, "color")?;
    if let Some(DepthReport::Infrared(report, _)) = &outcome.depth {
        picture(report, "infrared")?;
    }
    describe(&plan.board, &outcome, talk);
    Ok(as_json(&plan.board, &outcome))
}

fn plan(args: &CameraArgs) -> Plan {
    let (columns, rows) = args.board;
    let (bits, count) = args.dictionary;
    let markers = args.markers.map(|side_m| Markers { side_m, bits, count });
    let model = args.infrared_model.unwrap_or(args.model);
    let infrared = args.infrared.clone().map(|p| DepthPictures::Infrared(p, model.into()));
    let stem = || args.out.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Plan {
        name: args.name.clone().unwrap_or_else(stem),
        board: Board { columns, rows, square_m: args.square, markers },
        color: args.color.clone(),
        model: args.model.into(),
        depth: infrared.or_else(|| args.disparity.clone().map(DepthPictures::Disparity)),
    }
}

fn describe(board: &Board, outcome: &Outcome, talk: Talk) {
    describe_camera("colour", board, &outcome.color, talk);
    let place = |pose: &kinlight::math::Pose| {
        let t = 1e3 * pose.translation.vector;
        let turn = pose.rotation.angle().to_degrees();
        format!("depth camera at {:.2} {:.2} {:.2} mm, turned by {turn:.3} degrees", t.x, t.y, t.z)
    };
    match &outcome.depth {
        None => {}
        Some(DepthReport::Infrared(report, found)) => {
            describe_camera("infrared", board, report, talk);
            talk.say(format!("{}; {:.3} px RMS", place(&found.color_from_depth), found.rms_px));
            describe_refused(&found.refused, talk);
        }
        Some(DepthReport::Disparity(found, keys)) => {
            let d = found.deviation_px;
            talk.say(format!("depth: {}", lens(&found.depth)));
            talk.say(format!("  +- {:.2} {:.2} {:.2} {:.2} px", d[0], d[1], d[2], d[3]));
            talk.say(place(&found.color_from_depth));
            let (c0, c1) = (found.disparity.c0, found.disparity.c1);
            talk.say(format!("z = 1 / ({c0:.5} + {c1:.7} d), {:.2} units RMS", found.rms));
            for (key, (rms, pixels)) in keys.iter().zip(&found.views) {
                talk.say(format!("  {key}: {rms:.2} units over {pixels} pixels"));
            }
        }
    }
}

fn lens(camera: &CameraModel) -> String {
    let CameraModel { width, height, fx, fy, cx, cy, .. } = camera;
    format!("{width}x{height}, fx {fx:.2} fy {fy:.2} cx {cx:.2} cy {cy:.2}")
}

fn describe_camera(which: &str, board: &Board, report: &CameraReport, talk: Talk) {
    let found = &report.found;
    talk.say(format!("{which}: {}", lens(&found.camera)));
    let d = found.deviation_px;
    talk.say(format!("  +- {:.2} {:.2} {:.2} {:.2} px", d[0], d[1], d[2], d[3]));
    let coverage = 100.0 * report.coverage.share;
    talk.say(format!(
        "  {:.3} px RMS over {} views, corners in {coverage:.0} % of the picture",
        found.rms_px,
        found.views.len()
    ));
    for (key, error) in view_errors(board, found) {
        talk.say(format!("  {key}: {error:.3} px"));
    }
    describe_refused(&report.refused, talk);
}

fn describe_refused(refused: &[RefusedView], talk: Talk) {
    for RefusedView { key, reason } in refused {
        talk.say(format!("  refused {key}: {reason}"));
    }
}

fn as_json(board: &Board, outcome: &Outcome) -> Value {
    let refused = |list: &[RefusedView]| -> Vec<Value> {
        list.iter().map(|r| json!({ "view": r.key, "reason": r.reason })).collect()
    };
    let camera = |report: &CameraReport| {
        json!({
            "rms_px": report.found.rms_px,
            "deviation_px": report.found.deviation_px,
            "views": view_errors(board, &report.found),
            "refused": refused(&report.refused),
            "coverage": report.coverage.share,
            "coverage_warning": report.coverage.warning(),
            "residuals_drawn_times": report.coverage.magnification,
        })
    };
    let depth = outcome.depth.as_ref().map(|depth| match depth {
        DepthReport::Infrared(report, place) => json!({
            "infrared": camera(report),
            "rms_px": place.rms_px,
            "pairs": place.pairs,
            "refused": refused(&place.refused),
        }),
        DepthReport::Disparity(found, keys) => json!({
            "rms": found.rms,
            "deviation_px": found.deviation_px,
            "views": keys.iter().zip(&found.views).collect::<Vec<_>>(),
        }),
    });
    json!({ "calibration": outcome.calibration, "color": camera(&outcome.color), "depth": depth })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_boards_and_dictionaries() {
        assert_eq!(parse_length_m("25mm"), Ok(0.025));
        assert_eq!(parse_length_m("2.5 cm"), Ok(0.025));
        assert_eq!(parse_length_m("1m"), Ok(1.0));
        assert!(["25", "mm", "-1mm", "nanm"].iter().all(|t| parse_length_m(t).is_err()));
        assert_eq!(parse_pair("9x6"), Ok((9, 6)));
        assert_eq!(parse_dictionary("5x5_250"), Ok((5, 250)));
        assert!(parse_dictionary("5x4_250").is_err());
    }
}
