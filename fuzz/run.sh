#!/usr/bin/env bash
# Runs every fuzz target from its corpus and fails on the first input that makes one panic, take more than
# 1 GiB, ask for more than 600 MB at once, or run for 10 seconds.
# Usage: fuzz/run.sh [SECONDS a target, 5] [TARGET ...]
#
# Needs a nightly toolchain and cargo-fuzz 0.13 (`cargo install cargo-fuzz --version 0.13.2 --locked`). Where
# they are not, nothing is fuzzed; `cargo test` reads the corpus anyway, on any machine.
set -euo pipefail
cd "$(dirname "$0")"

seconds=${1:-5}
shift || true

missing=""
cargo +nightly --version >/dev/null 2>&1 || missing="no nightly toolchain"
cargo fuzz --version >/dev/null 2>&1 || missing="${missing:+$missing, }no cargo-fuzz"
if [ -n "$missing" ]; then
  echo "SKIPPED: fuzzing ($missing). Only the corpus is read, by cargo test." >&2
  exit 0
fi

# What targets write goes into memory where that can be, and is gone afterwards.
scratch=$(mktemp -d -p "$([ -w /dev/shm ] && echo /dev/shm || echo "${TMPDIR:-/tmp}")" kinlight-fuzz.XXXXXX)
trap 'rm -rf "$scratch"' EXIT
export TMPDIR=$scratch RAYON_NUM_THREADS=1

cd ..
cargo +nightly fuzz build
for target in ${*:-$(cargo +nightly fuzz list)}; do
  # New finds go into the scratch folder: the corpus holds what was chosen for it.
  mkdir "$scratch/found-$target"
  dictionary=fuzz/dictionaries/$target.dict
  options=(-max_total_time="$seconds" -timeout=10 -rss_limit_mb=1024 -malloc_limit_mb=600 -print_final_stats=1)
  # Recordings are folders of files; all else that is read is short.
  [ "$target" = sequence ] && options+=(-max_len=8192) || options+=(-max_len=4096)
  [ -f "$dictionary" ] && options+=(-dict="$dictionary")
  echo "== fuzz $target, $seconds s"
  cargo +nightly fuzz run "$target" "$scratch/found-$target" "fuzz/corpus/$target" -- "${options[@]}"
done
