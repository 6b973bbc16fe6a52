#!/usr/bin/env bash
# Sets up what the build and the tests need and runs every check: format, lints, documentation, tests.
#
# Usage: ./test.sh [further arguments of `cargo test`]
#   KINLIGHT_ALL=1   also the features opencv and v4l, which need a gigabyte of packages, and the emulated
#                    machine with a camera
#   KINLIGHT_FUZZ=1  also every fuzz target for a few seconds, where a nightly toolchain and cargo-fuzz are;
#                    their corpus is read by `cargo test` anyway
set -euo pipefail
cd "$(dirname "$0")"

install() {
  local as_root=""
  [ "$(id -u)" = 0 ] || as_root=sudo
  echo "test.sh: installing $*" >&2
  $as_root apt-get update -qq
  $as_root apt-get install -y -qq --no-install-recommends "$@"
}

command -v cc >/dev/null || install build-essential
# any Vulkan driver will do; Mesa's computes in software
compgen -G '/usr/share/vulkan/icd.d/*.json' >/dev/null || compgen -G '/etc/vulkan/icd.d/*.json' >/dev/null ||
  install libvulkan1 mesa-vulkan-drivers
# what depth sensors and their recordings are read through; loaded when it is needed
ls /usr/lib/*/libOpenNI2.so.0 >/dev/null 2>&1 || install libopenni2-0
if ! command -v cargo >/dev/null; then
  echo "test.sh: Rust 1.95 or newer is needed; see https://rustup.rs" >&2
  exit 1
fi

features=gpu
without_gpu=()
if [ "${KINLIGHT_ALL:-}" = 1 ]; then
  features=gpu,opencv,v4l
  # what the emulated machine runs too
  without_gpu=(--features v4l)
  dpkg -s libopencv-dev clang libclang-dev >/dev/null 2>&1 || install libopencv-dev clang libclang-dev
fi

echo "== format"
cargo fmt --all --check
echo "== lints"
cargo clippy --locked --workspace --all-targets --features "$features" -- -D warnings
cargo clippy --locked --all-targets --no-default-features -- -D warnings
echo "== documentation"
RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps --features "$features"
# Under nohup and in the background of scripts signals are ignored, which the program respects; tests send it some.
run_tests() {
  env --default-signal=HUP,INT,TERM cargo test --locked "$@"
}

echo "== tests, with the GPU backend"
# a machine without a Vulkan device or without OpenNI2 fails here instead of skipping; the extremes on a software
# GPU take an hour (cargo test --test extremes)
KINLIGHT_EXTREMES=${KINLIGHT_EXTREMES:-cpu} KINLIGHT_REQUIRE_GPU=1 KINLIGHT_REQUIRE_OPENNI=1 run_tests --features "$features" "$@"
echo "== tests, without it"
run_tests --no-default-features "${without_gpu[@]}" --lib --bins "$@"
if [ "${KINLIGHT_ALL:-}" = 1 ]; then
  echo "== the kernel's virtual camera, in an emulated machine"
  tests/vivid/run.sh --install
fi
if [ "${KINLIGHT_FUZZ:-}" = 1 ]; then
  echo "== fuzzing, a few seconds each"
  fuzz/run.sh
fi
