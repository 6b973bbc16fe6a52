#!/usr/bin/env bash
# Which lines of src/ the tests run: for each file the share, how many lines are missed and how many there are, files with
# most missed lines first; tests themselves do not count. The last line is the sum.
#
# Usage: tests/coverage.sh [further arguments of `cargo test`]
#   LLVM  the folder of llvm-profdata and llvm-cov, 19 or newer [/usr/lib/llvm-19/bin: package llvm-19 of Debian]
# What is measured stays in target/coverage: its lines.info (LCOV) has the count of each line.
set -euo pipefail
cd "$(dirname "$0")/.."
llvm=${LLVM:-/usr/lib/llvm-19/bin}
work=$(realpath -m "${CARGO_TARGET_DIR:-target}")/coverage
rm -rf "$work"
mkdir -p "$work"

# Only the workspace is instrumented. Counters stay in registers within loops: threads that write the same ones in memory
# make the tests fifty times as slow.
printf '#!/bin/sh\nexec "$@" -Cinstrument-coverage -Cllvm-args=-do-counter-promotion=true\n' >"$work/rustc"
chmod +x "$work/rustc"
export RUSTC_WORKSPACE_WRAPPER=$work/rustc CARGO_INCREMENTAL=0
LLVM_PROFILE_FILE=$work/build.profraw cargo test --locked --no-run --message-format=json "$@" >"$work/built.json"
# Processes of one program share four files; those that are killed leave nothing.
LLVM_PROFILE_FILE=$work/%4m.profraw cargo test --locked --no-fail-fast "$@"

rm -f "$work/build.profraw"
"$llvm/llvm-profdata" merge -sparse "$work"/*.profraw -o "$work/all.profdata"
mapfile -t programs < <(sed -n 's/.*"executable":"\([^"]*\)".*/\1/p' "$work/built.json" | sort -u)
objects=("${programs[0]}")
for program in "${programs[@]:1}"; do objects+=(-object "$program"); done
"$llvm/llvm-cov" export -format=lcov "${objects[@]}" -instr-profile="$work/all.profdata" src >"$work/lines.info"
awk -F '[:,]' '
  # files of tests, and what follows `#[cfg(test)]` before a module at the end of others
  /^SF:/ {
    file = $2
    sub(/.*\/src\//, "src/", file)
    end = file ~ /(\/tests\/|_tests?\.rs$|\/tests\.rs$|\/test_(data|log|support)|made_sequences)/ ? 0 : 1e9
    for (number = 1; end == 1e9 && (getline text < $2) > 0; number++) {
      if (before == "#[cfg(test)]" && text ~ /^(pub(\([a-z]*\))? )?mod [a-z_]* \{/) end = number
      before = text
    }
    close($2)
  }
  /^DA:/ && $2 < end { lines[file]++; missed[file] += $3 == 0 }
  END {
    for (file in lines) {
      all += lines[file]
      none += missed[file]
      printf "%6.2f %% %5d of %5d missed  %s\n", 100 - 100 * missed[file] / lines[file], missed[file], lines[file], file | "sort -k3,3nr"
    }
    close("sort -k3,3nr")
    printf "%6.2f %% %5d of %5d missed  all\n", 100 - 100 * none / all, none, all
  }' "$work/lines.info"
