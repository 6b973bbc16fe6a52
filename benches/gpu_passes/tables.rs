//! Tables in Markdown.

use crate::arguments::Arguments;
use crate::rows::{Row, rows};
use crate::run::Measured;
use kinlight::gpu::roofline::{BoundBy, STATED};
use kinlight::timing::{Stage, StageTimes};
use std::time::Duration;

/// Median, least and most.
struct Spread([f64; 3]);

impl Spread {
    fn of(times: impl Iterator<Item = Duration>) -> Self {
        let mut all: Vec<f64> = times.map(|t| 1e3 * t.as_secs_f64()).collect();
        all.sort_by(f64::total_cmp);
        let at = |i: usize| all.get(i).copied().unwrap_or(0.0);
        Self([at(all.len() / 2), at(0), at(all.len().saturating_sub(1))])
    }

    fn median(&self) -> f64 {
        self.0[0]
    }
}

impl std::fmt::Display for Spread {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [median, least, most] = self.0;
        write!(f, "{median:.2} ({least:.2}-{most:.2})")
    }
}

/// What a stage takes on either side.
pub fn print_stages(measured: &Measured) {
    println!("| stage | CPU ms | GPU ms | GPU / CPU |\n| --- | --- | --- | --- |");
    let print = |name: &str, time: &dyn Fn(&StageTimes) -> Duration| {
        let [cpu, gpu] = [&measured.cpu, &measured.gpu].map(|all| Spread::of(all.iter().map(time)));
        println!("| {name} | {cpu} | {gpu} | {:.1} |", gpu.median() / cpu.median().max(1e-6));
    };
    for stage in Stage::ALL {
        print(stage.name(), &|times| times.get(stage));
    }
    print("all", &|times| times.update());
    let (up, back) = measured.moved;
    println!("\nHost to device {:.2} MB a frame, back {:.2} MB.\n", mega(up), mega(back));
}

pub fn print_passes(measured: &Measured, arguments: &Arguments) {
    let floors = STATED.map(|gpu| format!("floor us: {}", gpu.name)).join(" | ");
    println!(
        "| pass | n | ms here | MB | asked / fetched | Gop | f32 % | op/B | atomics | bound by | {floors} |"
    );
    println!("|{}", " --- |".repeat(10 + STATED.len()));
    let mut all = rows(measured, arguments.kernels);
    let mut sum =
        Row { name: "all passes".to_owned(), calls: 0, times: Vec::new(), works: Vec::new() };
    sum.times = vec![Duration::ZERO; measured.timed.len()];
    for row in &all {
        sum.calls += row.calls;
        sum.works.extend(&row.works);
        sum.times.iter_mut().zip(&row.times).for_each(|(sum, time)| *sum += *time);
    }
    all.push(sum);
    all.iter().filter(|row| arguments.wants(&row.name)).for_each(print_row);
    println!();
}

fn print_row(row: &Row) {
    let (work, times) = (row.work(), Spread::of(row.times.iter().copied()));
    print!("| {} | {} | {times} |", row.name, row.calls);
    let float_share = 100.0 * work.float_operations as f64 / work.operations().max(1) as f64;
    print!(
        " {:.2} | {:.1} | {:.3} | {float_share:.0} | {:.1} | {} |",
        mega(work.bytes()),
        work.reuse(),
        1e-9 * work.operations() as f64,
        work.intensity(),
        work.atomics,
    );
    // the same on all, or each
    let bound = STATED.map(|gpu| match gpu.bound_by(&work) {
        BoundBy::Bytes => "bytes",
        BoundBy::Operations => "operations",
    });
    let same = bound.iter().all(|b| *b == bound[0]);
    print!(" {} |", if same { bound[0].to_owned() } else { bound.join(", ") });
    for gpu in &STATED {
        print!(" {:.1} |", 1e6 * row.floor(gpu).as_secs_f64());
    }
    println!();
}

fn mega(bytes: u64) -> f64 {
    1e-6 * bytes as f64
}
