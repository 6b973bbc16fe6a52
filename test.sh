#!/usr/bin/env bash
# Sets up what the build needs and runs every check: format, lints, documentation, tests.
# Usage: ./test.sh [further arguments of `cargo test`]
set -euo pipefail
cd "$(dirname "$0")"

if ! command -v cc >/dev/null; then
  echo "test.sh: no C compiler, installing build-essential" >&2
  as_root=""
  [ "$(id -u)" = 0 ] || as_root=sudo
  $as_root apt-get update -qq
  $as_root apt-get install -y -qq --no-install-recommends build-essential
fi
if ! command -v cargo >/dev/null; then
  echo "test.sh: Rust 1.95 or newer is needed; see https://rustup.rs" >&2
  exit 1
fi

echo "== format"
cargo fmt --all --check
echo "== lints"
cargo clippy --locked --all-targets --all-features -- -D warnings
echo "== documentation"
RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps --all-features
echo "== tests"
cargo test --locked --all-features "$@"
