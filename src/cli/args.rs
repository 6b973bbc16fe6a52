//! The command line. Names here are relied on by scripts.

use super::calibrate::Calibrate;
use super::convert::ConvertArgs;
use super::doctor::{DoctorArgs, PROBE, ProbeArgs};
#[cfg(feature = "gpu")]
use super::parity::ParityArgs;
use super::record::RecordArgs;
use super::report::ReportArgs;
use super::stream::StreamArgs;
use super::study_composite::CompositeStudyArgs;
use super::study_estimator::EstimatorStudyArgs;
use super::study_light::LightStudyArgs;
use super::tradeoff::TradeoffArgs;
use clap::{Args, Parser, Subcommand, ValueEnum};
use kinlight::budget::parse_budget;
use kinlight::capture::writer::ColorFormat;
use kinlight::synth::{LightSwitch, SynthOptions, VirtualKind};
use std::path::PathBuf;
use std::time::Duration;

/// Lights virtual objects with the light of the real room, from one RGB-D camera and no light probe.
#[derive(Debug, Parser)]
#[command(name = "kinlight", version, arg_required_else_help = true)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
    /// Print one machine-readable result (or error) on standard output.
    #[arg(long, global = true)]
    pub json: bool,
    /// No progress bar and no table; warnings and errors stay.
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// More log lines (-v: debug, -vv: trace).
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a recorded sequence and write lit frames, light, trajectory, mesh and timings.
    Replay(Box<ReplayArgs>),
    /// Run several presets over the same frames and print their stage times side by side.
    Compare(Box<CompareArgs>),
    Stream(Box<StreamArgs>),
    Record(RecordArgs),
    Convert(ConvertArgs),
    /// Say what a sequence holds and whether it is plausible.
    Info(InfoArgs),
    /// Render a test sequence with exact depth, poses and light.
    Synth(SynthArgs),
    /// Measure many runs against the truth.
    Study {
        #[command(subcommand)]
        study: Study,
    },
    Tradeoff(TradeoffArgs),
    Calibrate {
        #[command(subcommand)]
        what: Calibrate,
    },
    Report(ReportArgs),
    Doctor(DoctorArgs),
    #[command(name = PROBE, hide = true)]
    DoctorProbe(ProbeArgs),
    #[cfg(feature = "gpu")]
    Parity(ParityArgs),
}

#[derive(Debug, Subcommand)]
pub enum Study {
    Light(LightStudyArgs),
    Composite(CompositeStudyArgs),
    Estimator(EstimatorStudyArgs),
}

#[derive(Debug, Args)]
pub struct ReplayArgs {
    #[command(flatten)]
    pub run: RunArgs,
    /// Named settings to start from.
    #[arg(long, default_value = "ours", conflicts_with = "budget")]
    pub preset: String,
    /// Also write augmented.mp4 (needs the ffmpeg program).
    #[arg(long)]
    pub video: bool,
    /// Leave out some of the outputs.
    #[arg(long, value_enum, value_delimiter = ',')]
    pub without: Vec<Output>,
    /// Write intermediate buffers of every frame as pictures.
    #[arg(long, value_enum, value_delimiter = ',')]
    pub dump: Vec<Buffer>,
}

#[derive(Debug, Args)]
pub struct CompareArgs {
    #[command(flatten)]
    pub run: RunArgs,
    #[arg(long, value_delimiter = ',', default_value = "ours,ours-fast")]
    pub presets: Vec<String>,
    /// Also write the composed frames of each preset.
    #[arg(long)]
    pub frames_out: bool,
    /// Leave out some of the outputs.
    #[arg(long, value_enum, value_delimiter = ',')]
    pub without: Vec<CompareOutput>,
}

/// What is run over.
#[derive(Debug, Args)]
pub struct SourceArgs {
    /// Folder of the recording.
    #[arg(default_value = "sequences/demo")]
    pub sequence: PathBuf,
    #[command(flatten)]
    pub reading: ReadingArgs,
    /// Frames to process, counted from 0; B is not included (A.. and ..B work too).
    #[arg(long, value_name = "A..B", value_parser = parse_frames)]
    pub frames: Option<FrameRange>,
    #[command(flatten)]
    pub object: ObjectArgs,
}

/// What is changed of a preset.
#[derive(Debug, Args)]
pub struct SettingsArgs {
    /// TOML file of settings, applied on top of the preset.
    #[arg(long, value_name = "FILE.toml")]
    pub settings: Option<PathBuf>,
    /// Set one field of the settings, after preset and file (may be repeated).
    #[arg(long = "set", value_name = "FIELD=VALUE")]
    pub assignments: Vec<String>,
    /// Where camera poses come from.
    #[arg(long, value_enum)]
    pub poses: Option<Poses>,
    /// Seed of the sample pattern.
    #[arg(long)]
    pub seed: Option<u32>,
}

/// What replay and compare share.
#[derive(Debug, Args)]
pub struct RunArgs {
    #[command(flatten)]
    pub source: SourceArgs,
    #[command(flatten)]
    pub compute: ComputeArgs,
}

/// How frames are computed, wherever they are from.
#[derive(Debug, Args)]
pub struct ComputeArgs {
    #[command(flatten)]
    pub changes: SettingsArgs,
    /// Where the computing is done.
    #[arg(long, value_enum, default_value_t = Backend::Auto)]
    pub backend: Backend,
    /// Compute on the graphics device whose name or driver contains this.
    #[cfg(feature = "gpu")]
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
    /// Destroy the graphics device before each of these frames: the way to try what a run does when a
    /// driver resets. It is opened anew once; named again, a frame takes that device, too.
    #[cfg(feature = "gpu")]
    #[arg(long, value_name = "FRAME", value_delimiter = ',', hide = true)]
    pub lose_gpu_at: Vec<usize>,
    /// MiB of the graphics device's memory that may be used: the way to try what a run does without enough.
    #[cfg(feature = "gpu")]
    #[arg(long, value_name = "MIB", hide = true)]
    pub gpu_memory: Option<u64>,
    /// Folder for everything that is written.
    #[arg(long, default_value = "out")]
    pub out: PathBuf,
    /// Worker threads; 0 takes one a core.
    #[arg(long, default_value_t = 0)]
    pub threads: usize,
    /// Frames left out of the timing statistics at the start.
    #[arg(long, default_value_t = 5)]
    pub warm_up: usize,
    /// Take the most accurate settings that keep each frame within this time, and change them while
    /// running where that is needed (compare: as one more column).
    #[arg(long, value_name = "33ms", value_parser = parse_budget)]
    pub budget: Option<Duration>,
    /// What settings cost on this machine, as written by `kinlight tradeoff`
    /// [default: $XDG_CONFIG_HOME/kinlight/profile-cpu.toml, or -gpu; ~/.config without it].
    #[arg(long, value_name = "FILE.toml", requires = "budget")]
    pub profile: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct ObjectArgs {
    /// Virtual object, glTF 2.0 (.glb or .gltf).
    #[arg(long, value_name = "FILE.glb", conflicts_with_all = ["scene", "no_object"])]
    pub object: Option<PathBuf>,
    /// World position of the object's origin, metres.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vec3, conflicts_with = "on", allow_hyphen_values = true)]
    pub at: Option<[f32; 3]>,
    /// Stand on the surface seen at pixel U,V of frame FRAME.
    #[arg(long, value_name = "U,V,FRAME", value_parser = parse_anchor)]
    pub on: Option<(f32, f32, usize)>,
    /// Turn of the object about its upright axis, degrees.
    #[arg(long, default_value_t = 0.0, value_parser = parse_number, allow_hyphen_values = true)]
    pub yaw: f32,
    /// Size factor of the object.
    #[arg(long, default_value_t = 1.0, value_parser = parse_scale, allow_hyphen_values = true)]
    pub scale: f32,
    /// TOML file that places several objects.
    #[arg(long, value_name = "FILE.toml", conflicts_with = "no_object")]
    pub scene: Option<PathBuf>,
    /// Compose nothing: the camera image comes out as it went in.
    #[arg(long)]
    pub no_object: bool,
}

#[derive(Clone, Debug, Args)]
pub struct ReadingArgs {
    /// Calibration file (own TOML, OpenCV YAML, ROS camera_info, Open3D JSON).
    #[arg(long, value_name = "FILE")]
    pub calibration: Option<PathBuf>,
    /// Depth units a metre, where the layout's own is wrong.
    #[arg(long)]
    pub depth_factor: Option<f64>,
    /// Another depth list or folder of the sequence, for example depth_kinect.txt.
    #[arg(long, value_name = "NAME")]
    pub depth_list: Option<String>,
    /// Read files that links in the sequence's folder lead out to (such a link is refused otherwise).
    #[arg(long)]
    pub follow_links: bool,
    /// Colour and depth further apart than this are no pair.
    #[arg(long, default_value_t = 0.02, value_name = "SECONDS")]
    pub max_time_difference: f64,
}

#[derive(Debug, Args)]
pub struct InfoArgs {
    /// Folder of the recording.
    #[arg(default_value = "sequences/demo")]
    pub sequence: PathBuf,
    #[command(flatten)]
    pub reading: ReadingArgs,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Backend {
    /// The GPU where there is a fit one, else the CPU.
    #[default]
    Auto,
    Cpu,
    /// The best device, even one that computes in software.
    #[cfg(feature = "gpu")]
    Gpu,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Poses {
    /// Track the camera from depth.
    Track,
    /// Take the poses of the recording.
    Recorded,
    /// The camera does not move.
    Static,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Output {
    Frames,
    Light,
    Environment,
    Trajectory,
    Mesh,
    Timings,
    Report,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum CompareOutput {
    Report,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Buffer {
    /// D_c, the sensor's depth.
    SensorDepth,
    /// D_v, ray-cast from the volume.
    ModelDepth,
    /// D''', merged and filtered.
    Depth,
    Normals,
    /// Which pixels are model, sensor, virtual.
    Origin,
    /// R: the real scene, shaded with the estimated light.
    Shading,
    /// R': the real and virtual scene, shaded.
    VirtualShading,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRange {
    pub first: usize,
    pub end: Option<usize>,
}

pub fn parse_frames(text: &str) -> Result<FrameRange, String> {
    let (a, b) = text.split_once("..").ok_or("expected A..B, A.. or ..B")?;
    let number =
        |t: &str| t.trim().parse::<usize>().map_err(|_| format!("'{t}' is no frame number"));
    let first = if a.trim().is_empty() { 0 } else { number(a)? };
    let end = if b.trim().is_empty() { None } else { Some(number(b)?) };
    match end {
        Some(end) if end <= first => Err(format!("{first}..{end} holds no frame")),
        _ => Ok(FrameRange { first, end }),
    }
}

pub(super) fn parse_numbers<const N: usize>(text: &str) -> Result<[f32; N], String> {
    let values: Result<Vec<f32>, _> = text.split(',').map(|t| t.trim().parse::<f32>()).collect();
    let values = values.map_err(|_| format!("'{text}' is not {N} numbers with commas"))?;
    if !values.iter().all(|v| v.is_finite()) {
        return Err(format!("'{text}': numbers must be finite"));
    }
    values.try_into().map_err(|v: Vec<f32>| format!("{} numbers given, {N} expected", v.len()))
}

fn parse_number(text: &str) -> Result<f32, String> {
    parse_numbers(text).map(|[number]| number)
}

fn parse_scale(text: &str) -> Result<f32, String> {
    match parse_number(text)? {
        scale if scale > 0.0 => Ok(scale),
        scale => Err(format!("{scale} is no size: it must be above 0")),
    }
}

fn parse_vec3(text: &str) -> Result<[f32; 3], String> {
    parse_numbers(text)
}

fn parse_anchor(text: &str) -> Result<(f32, f32, usize), String> {
    let [u, v, frame] = parse_numbers::<3>(text)?;
    if frame < 0.0 || frame.fract() != 0.0 {
        return Err(format!("{frame} is no frame number"));
    }
    Ok((u, v, frame as usize))
}

#[derive(Debug, Args)]
pub struct SynthArgs {
    /// Folder to write the sequence to.
    pub out: PathBuf,
    /// Remake sequences/demo bit for bit; other options are not needed then.
    #[arg(long, conflicts_with_all = ["scene", "synth_frames", "size", "samples", "kinect", "with_virtual", "light", "switch", "environment", "jpeg", "seed", "still", "color_noise", "virtual_object"])]
    pub demo: bool,
    /// Which built-in scene.
    #[arg(long, default_value = "demo")]
    pub scene: String,
    #[arg(long = "frames", id = "synth_frames", default_value_t = 60)]
    pub frames: usize,
    /// Width and height in pixels.
    #[arg(long, value_name = "W,H", value_parser = parse_size, default_value = "640,480")]
    pub size: (usize, usize),
    /// Light paths a pixel.
    #[arg(long, default_value_t = 16)]
    pub samples: u32,
    /// Also write depth_kinect/, as a Kinect v1 would see it.
    #[arg(long)]
    pub kinect: bool,
    /// Also write composite/, the frames with the virtual object truly in the scene.
    #[arg(long)]
    pub with_virtual: bool,
    /// Take one of four area lights on a half circle (0 to 3) instead of the scene's lamps.
    #[arg(long)]
    pub light: Option<usize>,
    /// From frame FRAME on, take half-circle light LIGHT instead.
    #[arg(long, value_name = "FRAME,LIGHT", value_parser = parse_switch)]
    pub switch: Option<LightSwitch>,
    /// Light from a lat-long Radiance picture, +z up.
    #[arg(long, value_name = "FILE.hdr")]
    pub environment: Option<PathBuf>,
    /// Colour as JPEG of this quality instead of PNG.
    #[arg(long, value_name = "QUALITY")]
    pub jpeg: Option<u8>,
    /// The camera does not move.
    #[arg(long)]
    pub still: bool,
    /// Add a sensor's noise to the colour pictures.
    #[arg(long)]
    pub color_noise: bool,
    /// Virtual object: figure, diffuse, coloured or bright-dark (default: the scene's own).
    #[arg(long = "object", id = "virtual_object", value_name = "KIND", value_parser = parse_kind)]
    pub object: Option<VirtualKind>,
    #[arg(long, default_value_t = 1)]
    pub seed: u32,
}

impl SynthArgs {
    pub fn options(&self) -> SynthOptions {
        if self.demo {
            return SynthOptions::demo();
        }
        let (width, height) = self.size;
        SynthOptions {
            scene: self.scene.clone(),
            frames: self.frames,
            width,
            height,
            samples: self.samples,
            seed: self.seed,
            kinect_noise: self.kinect,
            color: self.jpeg.map_or(ColorFormat::Png, ColorFormat::Jpeg),
            with_virtual: self.with_virtual,
            light: self.light,
            switch: self.switch,
            environment: self.environment.clone(),
            still: self.still,
            color_noise: self.color_noise,
            object: self.object,
            ..SynthOptions::default()
        }
    }
}

fn parse_switch(text: &str) -> Result<LightSwitch, String> {
    let number = |t: &str| t.trim().parse::<usize>().map_err(|_| format!("'{t}' is no number"));
    let (frame, light) = text.split_once(',').ok_or("expected FRAME,LIGHT")?;
    Ok(LightSwitch { frame: number(frame)?, light: number(light)? })
}

fn parse_kind(text: &str) -> Result<VirtualKind, String> {
    VirtualKind::by_name(text)
        .ok_or_else(|| format!("one of {}", VirtualKind::ALL.map(VirtualKind::name).join(", ")))
}

pub(super) fn parse_size(text: &str) -> Result<(usize, usize), String> {
    let side =
        |t: &str| t.trim().parse::<usize>().map_err(|_| format!("'{t}' is no number of pixels"));
    let (w, h) = text.split_once(',').ok_or("expected W,H")?;
    Ok((side(w)?, side(h)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn frame_ranges() {
        let range = |first, end| Ok(FrameRange { first, end });
        assert_eq!(parse_frames("3..7"), range(3, Some(7)));
        assert_eq!(parse_frames("3.."), range(3, None));
        assert_eq!(parse_frames("..7"), range(0, Some(7)));
        for bad in ["7", "7..3", "3..3", "a..b", "-1..2"] {
            assert!(parse_frames(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn positions_and_anchors() {
        assert_eq!(parse_vec3("1,-2.5, 3"), Ok([1.0, -2.5, 3.0]));
        assert!(parse_vec3("1,2").is_err() && parse_vec3("1,2,inf").is_err());
        assert_eq!(parse_anchor("320,240,0"), Ok((320.0, 240.0, 0)));
        assert!(parse_anchor("320,240,0.5").is_err());
        assert_eq!((parse_scale("0.5"), parse_number("-90")), (Ok(0.5), Ok(-90.0)));
        for bad in ["0", "-1", "nan", "inf", "1,2", "big"] {
            assert!(parse_scale(bad).is_err(), "{bad}");
        }
        let cli =
            Cli::try_parse_from(["kinlight", "replay", "--object", "a.glb", "--at", "-1,2,3"]);
        let Command::Replay(args) = cli.unwrap().command else { panic!() };
        assert_eq!(args.run.source.object.at, Some([-1.0, 2.0, 3.0]));
    }
}
