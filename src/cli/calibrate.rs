//! `kinlight calibrate`.

#[cfg(feature = "opencv")]
mod camera;

use super::args::parse_numbers;
use super::{CliError, Talk};
use clap::{Args, Subcommand};
use kinlight::calibrate::CalibrateError;
use kinlight::calibrate::chart::{
    SRGB_CODES, find_matrix, measure_patches, patches_from_codes, read_codes, reference,
};
use kinlight::calibrate::pictures::{read_exposure_list, read_picture};
use kinlight::calibrate::response::{Exposure, ResponseOptions, find_response};
use kinlight::calibrate::vignetting::{FlatField, find_vignetting};
use kinlight::capture::Calibration;
use kinlight::output::atomic_write;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Measure a camera: lenses from boards, response, vignetting and colours from pictures of known light.
#[derive(Debug, Subcommand)]
pub enum Calibrate {
    #[cfg(feature = "opencv")]
    Camera(camera::CameraArgs),
    Response(ResponseArgs),
    Vignetting(VignettingArgs),
    Color(ColorArgs),
}

/// Response curve from pictures of one unmoving view at several exposure times.
#[derive(Debug, Args)]
pub struct ResponseArgs {
    /// Text file: a picture and its exposure time in seconds in each line.
    pub list: PathBuf,
    #[command(flatten)]
    into: Destination,
    /// Weight of the curve's smoothness.
    #[arg(long, default_value_t = ResponseOptions::default().smoothness)]
    smoothness: f64,
    /// Pixels along each side of the pictures to leave out.
    #[arg(long, default_value_t = 0)]
    border: usize,
}

/// Fall-off of light towards the corners from pictures of an evenly lit surface.
///
/// Pictures may differ in brightness, and may each have an even gradient. Measure the response first.
#[derive(Debug, Args)]
pub struct VignettingArgs {
    #[arg(required = true)]
    pub pictures: Vec<PathBuf>,
    #[command(flatten)]
    into: Destination,
}

/// Colour matrix from a picture of a chart of 24 patches (ColorChecker Classic).
///
/// Measure response and vignetting first.
#[derive(Debug, Args)]
pub struct ColorArgs {
    /// Picture of the chart.
    #[arg(required_unless_present = "patches", conflicts_with = "patches", requires = "corners")]
    pub picture: Option<PathBuf>,
    /// Pixels of the chart's corners, from "dark skin" over "bluish green" and "black" to "white".
    #[arg(long, value_name = "X,Y,X,Y,X,Y,X,Y", value_parser = parse_numbers::<8>)]
    corners: Option<[f32; 8]>,
    /// The camera's codes (0 to 255) of the patches instead of a picture: 24 lines of red,green,blue.
    #[arg(long, value_name = "FILE.csv")]
    patches: Option<PathBuf>,
    /// True sRGB codes of the patches [default: the published ones].
    #[arg(long, value_name = "FILE.csv")]
    reference: Option<PathBuf>,
    #[command(flatten)]
    into: Destination,
}

#[derive(Debug, Args)]
struct Destination {
    /// Calibration that gets the result; it must be there.
    #[arg(long, value_name = "FILE.toml")]
    into: PathBuf,
}

impl Destination {
    fn read(&self) -> Result<Calibration, CliError> {
        Calibration::read(&self.into, None).map_err(|e| CalibrateError::from(e).into())
    }

    fn write(&self, calibration: &Calibration) -> Result<(), CliError> {
        calibration.check().map_err(CalibrateError::Data)?;
        write_toml(&self.into, calibration)
    }
}

fn write_toml(path: &Path, calibration: &Calibration) -> Result<(), CliError> {
    let text = calibration.to_toml().map_err(CalibrateError::from)?;
    let written = atomic_write(path, |out| out.write_all(text.as_bytes()));
    Ok(written.map_err(CalibrateError::from)?)
}

pub fn run(what: &Calibrate, talk: Talk) -> Result<(), CliError> {
    let result = match what {
        #[cfg(feature = "opencv")]
        Calibrate::Camera(args) => camera::run(args, talk)?,
        Calibrate::Response(args) => response(args, talk)?,
        Calibrate::Vignetting(args) => vignetting(args, talk)?,
        Calibrate::Color(args) => color(args, talk)?,
    };
    talk.result(&result);
    Ok(())
}

/// What messages call a picture.
fn name_of(path: &Path) -> String {
    path.display().to_string()
}

fn response(args: &ResponseArgs, talk: Talk) -> Result<Value, CliError> {
    let mut calibration = args.into.read()?;
    let mut stack = Vec::new();
    for (path, time) in read_exposure_list(&args.list)? {
        stack.push(Exposure { name: name_of(&path), picture: read_picture(&path)?, time });
    }
    let defaults = ResponseOptions::default();
    let options = ResponseOptions { smoothness: args.smoothness, border: args.border, ..defaults };
    let found = find_response(&stack, &options)?;
    for (c, channel) in ["red", "green", "blue"].into_iter().enumerate() {
        talk.say(format!(
            "{channel}: {} pixels, noise of {:.2} codes, {:.2} % RMS of one exposure",
            found.pixels[c],
            found.noise_codes[c],
            100.0 * found.rms_log[c]
        ));
        let stretches: Vec<String> =
            found.continued[c].iter().map(|(low, high)| format!("{low} to {high}")).collect();
        if !stretches.is_empty() {
            let stretches = stretches.join(", ");
            talk.say(format!(
                "  no picture determines codes {stretches}: there the curve is continued"
            ));
        }
    }
    let result = json!({
        "exposures": stack.len(),
        "pixels": found.pixels,
        "noise_codes": found.noise_codes,
        "rms_log": found.rms_log,
        "continued": found.continued,
    });
    calibration.photometry.response = Some(found.response);
    args.into.write(&calibration)?;
    Ok(result)
}

fn vignetting(args: &VignettingArgs, talk: Talk) -> Result<Value, CliError> {
    let mut calibration = args.into.read()?;
    let field = |path: &PathBuf| -> Result<FlatField, CalibrateError> {
        Ok(FlatField { name: name_of(path), picture: read_picture(path)? })
    };
    let pictures: Result<Vec<_>, _> = args.pictures.iter().map(field).collect();
    let camera = &calibration.color;
    let center =
        [(camera.cx + 0.5) / camera.width as f64, (camera.cy + 0.5) / camera.height as f64];
    let found = find_vignetting(&pictures?, &calibration.photometry, center)?;
    talk.say(format!(
        "{:.1} % of the light reaches the farthest corner; {:.2} % RMS over {} cells",
        100.0 * found.corner,
        100.0 * found.rms,
        found.samples
    ));
    calibration.photometry.vignetting = Some(found.vignetting);
    args.into.write(&calibration)?;
    Ok(json!({ "corner": found.corner, "rms": found.rms, "vignetting": found.vignetting }))
}

fn color(args: &ColorArgs, talk: Talk) -> Result<Value, CliError> {
    let mut calibration = args.into.read()?;
    let photometry = &calibration.photometry;
    let source = args.patches.as_ref().or(args.picture.as_ref());
    let about = |e: CalibrateError| match (e, source) {
        (CalibrateError::Data(p), Some(path)) => {
            CalibrateError::Data(format!("{}: {p}", path.display()))
        }
        (CalibrateError::Options(p), Some(path)) => {
            CalibrateError::Options(format!("{}: {p}", path.display()))
        }
        (other, _) => other,
    };
    let patches = match (&args.patches, &args.picture, &args.corners) {
        (Some(csv), ..) => patches_from_codes(&read_codes(csv)?, photometry),
        (None, Some(picture), Some(c)) => {
            let corners = [0, 2, 4, 6].map(|i| [f64::from(c[i]), f64::from(c[i + 1])]);
            measure_patches(&read_picture(picture)?, &corners, photometry).map_err(about)?
        }
        _ => return Err(CliError::Usage("give a picture with --corners, or --patches".into())),
    };
    let codes = args.reference.as_deref().map_or(Ok(SRGB_CODES), read_codes)?;
    let found = find_matrix(&patches, &reference(&codes)).map_err(about)?;
    if !found.saturated.is_empty() {
        talk.say(format!("left out, saturated: {}", found.saturated.join(", ")));
    }
    talk.say(format!(
        "{} patches, mean colour difference {:.2} before, {:.2} after (CIE 1976)",
        found.patches, found.delta_e_before, found.delta_e_after
    ));
    let result = json!({
        "patches": found.patches,
        "saturated": found.saturated,
        "color_matrix": found.color_matrix,
        "delta_e_before": found.delta_e_before,
        "delta_e_after": found.delta_e_after,
    });
    calibration.photometry.color_matrix = Some(found.color_matrix);
    args.into.write(&calibration)?;
    Ok(result)
}
