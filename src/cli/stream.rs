//! `kinlight stream`: the pipeline on a camera that is running.

use super::args::{Buffer, ComputeArgs, ObjectArgs, Output};
use super::backend::Device;
use super::live::{DeviceArgs, Rate};
use super::run::{self, Input, Pace, Run};
use super::{CliError, Talk, commands, objects, report, setup};
use clap::Args;
use kinlight::capture::live::Monitor;
use kinlight::output::OutputPlan;
use kinlight::pipeline::FrameOutcome;
use kinlight::stop::Stop;
use std::path::Path;

/// Light virtual objects before a camera that is running, until Ctrl-C.
///
/// The newest frame is taken; frames for which there is no time are dropped and counted. A device that is
/// lost or stalls is opened again; the map stays. Outputs are those of replay.
#[derive(Debug, Args)]
pub struct StreamArgs {
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    object: ObjectArgs,
    #[command(flatten)]
    compute: ComputeArgs,
    /// Named settings to start from.
    #[arg(long, default_value = "ours-fast", conflicts_with = "budget")]
    preset: String,
    /// Also write the composed frames.
    #[arg(long)]
    frames_out: bool,
    /// Also write augmented.mp4 (needs the ffmpeg program).
    #[arg(long)]
    video: bool,
    /// Leave out some of the outputs.
    #[arg(long, value_enum, value_delimiter = ',')]
    without: Vec<Output>,
    /// Write intermediate buffers of every frame as pictures.
    #[arg(long, value_enum, value_delimiter = ',')]
    dump: Vec<Buffer>,
}

/// Frames that may wait for the pipeline: more would only make what it takes older.
const QUEUE: usize = 1;

pub fn run(args: &StreamArgs, talk: Talk) -> Result<(), CliError> {
    let compute = &args.compute;
    setup::start_threads(compute.threads)?;
    let device = Device::choose(compute)?;
    let pace = Pace::choose(&args.preset, compute, &device)?;
    let plan = run::plan(&args.without);
    let plan = OutputPlan { frames: args.frames_out && plan.frames, video: args.video, ..plan };
    let mut camera = args.device.open(QUEUE)?;
    let recording = camera.recording.as_deref();
    let truth = recording.map(commands::light_truth).transpose()?.flatten();
    let scene = objects::scene(&args.object, recording, 0, &camera.source)?;

    let (bar, monitor, mut rate) = (talk.status(), camera.source.monitor(), Rate::default());
    bar.set_prefix(pace.name().to_owned());
    let (dump, warm_up) = (&args.dump, compute.warm_up);
    // An interrupt ends the camera, and with it the run.
    let stop = Stop::default();
    let run = Run { pace, plan, dump, out: &compute.out, device: &device, warm_up, stop: &stop };
    let name = Path::new(&args.device.device);
    let done = run.go(
        Input { source: &mut camera.source, name, scene, truth: truth.as_ref() },
        &mut |frame| {
            rate.tick();
            bar.set_message(status(frame, &monitor, &rate));
        },
    );
    bar.finish_and_clear();
    drop(camera);
    let done = done?;
    if !args.without.contains(&Output::Report) {
        report::write_page(&compute.out)?;
    }
    if let Some(age) = done.timings.age {
        let (median, p95) = (age.median_ms, age.p95_ms);
        talk.say(format_args!(
            "age of frames when their processing began: {median:.1} ms (median), {p95:.1} ms (95 %)"
        ));
    }
    done.tell(&compute.out, talk);
    Ok(())
}

fn status(frame: &FrameOutcome, monitor: &Monitor, rate: &Rate) -> String {
    let counts = monitor.counts();
    format!(
        "{:.1} FPS  age {:.0} ms + {:.0} ms  {} frames, {} dropped, {} bad  {:?}{}",
        rate.per_second(),
        counts.last_age.as_secs_f64() * 1e3,
        frame.duration.as_secs_f64() * 1e3,
        counts.delivered,
        counts.dropped,
        counts.bad,
        frame.tracking.state,
        if monitor.is_down() { "  no camera" } else { "" },
    )
}
