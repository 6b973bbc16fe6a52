//! Hours of a camera in one run: memory, handles and frame times over many frames of a recording that is
//! played forth and back.
//!
//! `cargo bench --bench soak -- [--frames 20000] [--sequence FOLDER] [further arguments of kinlight stream]`
//!
//! Linux only: it reads `/proc`. Ends with 1 where memory or handles grow after the warm-up.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::Duration;

/// Samples of memory over the whole run.
const SAMPLES: usize = 200;

/// The first part of a run fills maps, pools and the page cache of its own files.
const WARM_UP_SHARE: f64 = 0.2;

/// What the straight line through the samples may gain over the whole run: allocators return pages late, and a
/// sample is whole pages of several threads.
const MOST_GROWTH: f64 = 0.01;

struct Arguments {
    frames: usize,
    sequence: PathBuf,
    further: Vec<String>,
}

impl Arguments {
    fn read() -> Result<Self, Box<dyn Error>> {
        let demo = Path::new(env!("CARGO_MANIFEST_DIR")).join("sequences/demo");
        let mut found = Self { frames: 20_000, sequence: demo, further: Vec::new() };
        let mut arguments = std::env::args().skip(1).filter(|a| a != "--bench");
        while let Some(argument) = arguments.next() {
            let mut value = || arguments.next().ok_or(format!("{argument} needs a value"));
            match argument.as_str() {
                "--frames" => found.frames = value()?.parse()?,
                "--sequence" => found.sequence = value()?.into(),
                _ => found.further.push(argument),
            }
        }
        Ok(found)
    }
}

/// What the process holds after so many frames.
struct Sample {
    frames: usize,
    resident_mib: f64,
    handles: usize,
}

fn main() -> ExitCode {
    match Arguments::read().and_then(|arguments| soak(&arguments)) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("soak: {error}");
            ExitCode::FAILURE
        }
    }
}

fn soak(arguments: &Arguments) -> Result<bool, Box<dyn Error>> {
    let out = tempfile::tempdir()?;
    let mut run = Command::new(env!("CARGO_BIN_EXE_kinlight"))
        .args(["stream", "--every-frame", "--loop", "--without", "report", "--quiet"])
        .arg("--device")
        .arg(format!("play:{}", arguments.sequence.display()))
        .arg("--frames")
        .arg(arguments.frames.to_string())
        .args(&arguments.further)
        .arg("--out")
        .arg(out.path())
        .stdout(Stdio::null())
        .spawn()?;
    let samples = watch(&mut run, out.path(), arguments.frames)?;
    let status = run.wait()?;
    if !status.success() {
        return Err(format!("the run ended with {status}").into());
    }
    let timings = std::fs::read_to_string(out.path().join("timings.json"))?;
    let timings: serde_json::Value = serde_json::from_str(&timings)?;
    Ok(judge(&samples, &timings))
}

/// Takes samples until the run ends.
fn watch(run: &mut Child, out: &Path, frames: usize) -> Result<Vec<Sample>, Box<dyn Error>> {
    let (process, log) = (PathBuf::from(format!("/proc/{}", run.id())), out.join("timings.csv"));
    let every = (frames / SAMPLES).max(1);
    let mut samples: Vec<Sample> = Vec::new();
    println!("{:>8} {:>12} {:>8}", "frames", "resident MiB", "handles");
    while run.try_wait()?.is_none() {
        std::thread::sleep(Duration::from_millis(200));
        let Ok(lines) = std::fs::read(&log) else { continue };
        let done = lines.iter().filter(|&&b| b == b'\n').count().saturating_sub(1);
        if done < samples.last().map_or(1, |last| last.frames + every) {
            continue;
        }
        // It may have ended since.
        let Some((resident_mib, handles)) = held(&process) else { break };
        samples.push(Sample { frames: done, resident_mib, handles });
        if samples.len() % (SAMPLES / 20) == 1 {
            println!("{done:>8} {resident_mib:>12.1} {handles:>8}");
        }
    }
    Ok(samples)
}

fn held(process: &Path) -> Option<(f64, usize)> {
    let status = std::fs::read_to_string(process.join("status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kib: f64 = line.split_whitespace().next()?.parse().ok()?;
    let handles = std::fs::read_dir(process.join("fd")).ok()?.count();
    Some((kib / 1024.0, handles))
}

fn judge(samples: &[Sample], timings: &serde_json::Value) -> bool {
    let all = samples.last().map_or(0, |last| last.frames);
    let warm = samples.iter().filter(|s| s.frames as f64 >= WARM_UP_SHARE * all as f64);
    let warm: Vec<&Sample> = warm.collect();
    let count = warm.len() as f64;
    if warm.len() < 10 {
        println!("too few samples for a verdict: more frames are needed");
        return false;
    }
    let mean = |of: &dyn Fn(&Sample) -> f64| warm.iter().map(|s| of(s)).sum::<f64>() / count;
    let (at, level_mib) = (mean(&|s| s.frames as f64), mean(&|s| s.resident_mib));
    let spread = mean(&|s| (s.frames as f64 - at).powi(2));
    let slope = mean(&|s| (s.frames as f64 - at) * (s.resident_mib - level_mib)) / spread;
    let growth_mib = slope * all as f64;
    let handles = |s: &&Sample| s.handles;
    let (fewest, most) =
        (warm.iter().map(handles).min().unwrap_or(0), warm.iter().map(handles).max().unwrap_or(0));
    println!("after {:.0} % of {all} frames:", WARM_UP_SHARE * 100.0);
    println!("  resident memory {level_mib:.1} MiB, {growth_mib:+.2} MiB over the whole run");
    println!("  handles {fewest} to {most}");
    let [median, p99, max] =
        ["median_ms", "p99_ms", "max_ms"].map(|name| timings["update"][name].as_f64());
    if let [Some(median), Some(p99), Some(max)] = [median, p99, max] {
        let ratio = p99 / median;
        println!(
            "  update {median:.1} ms (median), {p99:.1} ms (99 %), {max:.1} ms (max): 99 % is {ratio:.2} times the median"
        );
    }
    let flat = growth_mib <= MOST_GROWTH * level_mib;
    let same = warm.first().is_some_and(|first| most <= first.handles);
    println!("{}", if flat && same { "flat" } else { "GROWS" });
    flat && same
}
