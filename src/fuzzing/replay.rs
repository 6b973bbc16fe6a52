//! Every file of the corpus through its target, whole and damaged, without a fuzzer.

use super::mutate::mutated;
use super::{Scratch, TARGETS, Target};
use crate::math::random::Rng;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Where `cargo fuzz` keeps what it starts from; not part of a published package.
pub fn corpus() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus")
}

/// In order of name.
fn inputs(target: &Target) -> Vec<(PathBuf, Vec<u8>)> {
    let entries = std::fs::read_dir(corpus().join(target.name)).unwrap();
    let mut paths: Vec<PathBuf> = entries.map(|e| e.unwrap().path()).collect();
    paths.sort();
    paths.into_iter().map(|path| (path.clone(), std::fs::read(path).unwrap())).collect()
}

fn is_missing() -> bool {
    if corpus().exists() {
        return false;
    }
    println!("SKIPPED: no {}", corpus().display());
    true
}

#[test]
fn the_corpus_is_read_without_a_panic() {
    if is_missing() {
        return;
    }
    for target in &TARGETS {
        let folder = tempfile::tempdir().unwrap();
        let scratch = Scratch::new(folder.path());
        let (mut taken, mut refused) = (0, 0);
        for (path, content) in inputs(target) {
            println!("{}", path.display());
            match (target.body)(&content, &scratch) {
                true => taken += 1,
                false => refused += 1,
            }
        }
        // A target whose reader refuses everything, or takes everything, is not one.
        assert!(taken > 0 && refused > 0, "{}: {taken} taken, {refused} refused", target.name);
    }
}

/// Runs of a target on damaged inputs, in an order that `seed` says; the first that panics is written to a
/// file. `go_on` is asked before each run.
fn try_damaged(target: &Target, seed: u32, mut go_on: impl FnMut(usize) -> bool) -> (usize, usize) {
    let folder = tempfile::tempdir().unwrap();
    let scratch = Scratch::new(folder.path());
    let mut pool: Vec<Vec<u8>> = inputs(target).into_iter().map(|(_, content)| content).collect();
    let seeds = pool.len();
    let mut rng = Rng::new(&[seed]);
    let (mut runs, mut taken, mut slowest) = (0, 0, Duration::ZERO);
    while go_on(runs) {
        let [a, b] = [0, 1].map(|_| rng.next_u32() as usize % pool.len());
        let data = mutated(&pool[a], &pool[b], &mut rng);
        let start = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| (target.body)(&data, &scratch)));
        if start.elapsed() > slowest {
            slowest = start.elapsed();
        }
        let Ok(accepted) = result else {
            let path = std::env::temp_dir().join(format!("kinlight-{}-{seed}-{runs}", target.name));
            std::fs::write(&path, &data).unwrap();
            panic!("{} panics on {}", target.name, path.display());
        };
        // What is still taken is damaged further.
        if accepted && data.len() < 8192 {
            taken += 1;
            match pool.len() < 4 * seeds {
                true => pool.push(data),
                false => {
                    let at = seeds + rng.next_u32() as usize % (pool.len() - seeds);
                    pool[at] = data;
                }
            }
        }
        runs += 1;
    }
    println!("{}: {runs} runs, {taken} taken, slowest {slowest:?}", target.name);
    (runs, taken)
}

#[test]
fn damaged_inputs_are_read_without_a_panic() {
    if is_missing() {
        return;
    }
    for target in &TARGETS {
        // Some damage is always harmless, some never.
        let (runs, taken) = try_damaged(target, 1, |runs| runs < 300);
        assert!(taken > 0 && taken < runs, "{}: {taken} of {runs} taken", target.name);
    }
}

/// `KINLIGHT_DAMAGE_SECONDS` for each target; `KINLIGHT_DAMAGE_TARGET` names one, `KINLIGHT_DAMAGE_SEED`
/// starts elsewhere.
#[test]
#[ignore = "takes as long as it is told to"]
fn damaged_inputs_for_a_while() {
    let number = |name: &str, default: u32| {
        std::env::var(name).map_or(default, |text| text.parse().expect("a number"))
    };
    let limit = Duration::from_secs(u64::from(number("KINLIGHT_DAMAGE_SECONDS", 60)));
    let only = std::env::var("KINLIGHT_DAMAGE_TARGET").ok();
    for target in TARGETS.iter().filter(|t| only.as_ref().is_none_or(|only| only == t.name)) {
        let start = Instant::now();
        try_damaged(target, number("KINLIGHT_DAMAGE_SEED", 1), |_| start.elapsed() < limit);
    }
}
