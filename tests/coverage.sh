#!/usr/bin/env bash
# Which lines of src/ the tests run: for each file functions and lines, how many are missed, and the share of the others;
# files with the most missed lines first.
#
# Usage: tests/coverage.sh [further arguments of `cargo test`]
#   LLVM  the folder of llvm-profdata and llvm-cov, 19 or newer [/usr/lib/llvm-19/bin: package llvm-19 of Debian]
# What is measured stays in target/coverage: its text.txt is the source with counts. Code that only runs where the
# features opencv and v4l, an NVIDIA GPU, a sensor or a camera are, counts as not run.
set -euo pipefail
cd "$(dirname "$0")/.."
llvm=${LLVM:-/usr/lib/llvm-19/bin}
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
work=$target/coverage
rm -rf "$work"
mkdir -p "$work"

# Only the workspace is instrumented.
printf '#!/bin/sh\nexec "$@" -Cinstrument-coverage\n' >"$work/rustc"
chmod +x "$work/rustc"
export RUSTC_WORKSPACE_WRAPPER=$work/rustc
# Two processes may write one file each at a time; programs that are killed write none.
export LLVM_PROFILE_FILE=$work/%4m.profraw
cargo test --locked --no-run --message-format=json "$@" >"$work/built.json"
KINLIGHT_EXTREMES=${KINLIGHT_EXTREMES:-cpu} cargo test --locked --no-fail-fast "$@"

mapfile -t programs < <(sed -n 's/.*"executable":"\([^"]*\)".*/\1/p' "$work/built.json" | sort -u)
"$llvm/llvm-profdata" merge -sparse "$work"/*.profraw -o "$work/all.profdata"
objects=()
for program in "${programs[@]:1}"; do objects+=(-object "$program"); done
seen=("${programs[0]}" "${objects[@]}" -instr-profile="$work/all.profdata")
"$llvm/llvm-cov" show "${seen[@]}" src >"$work/text.txt"
"$llvm/llvm-cov" report "${seen[@]}" -show-region-summary=false -show-branch-summary=false src >"$work/report.txt"
# name, functions: all, missed, share; lines: all, missed, share
grep '\.rs ' "$work/report.txt" | sort -k6,6nr
tail -n 1 "$work/report.txt"
