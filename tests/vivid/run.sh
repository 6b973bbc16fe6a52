#!/usr/bin/env bash
# Runs the tests of real cameras (tests/vivid) in a small virtual machine: Debian's kernel has `vivid`, a V4L2
# camera made of software, as a module. The machine is emulated by QEMU without /dev/kvm, so that it runs where
# virtual machines do. The depth sensor beside the camera is the virtual one behind the real OpenNI2.
#
# Usage: tests/vivid/run.sh [--install] [TEST..]
#   --install  installs what is missing with apt (qemu-system-x86 may replace a newer qemu-utils)
#   TEST       only tests whose names contain one of these
# KINLIGHT_REQUIRE_VIVID=1: what would be skipped fails.
# VIVID_DIR: where kernel and image are kept [target/vivid]; VIVID_TIMEOUT: seconds for the machine [900].
set -euo pipefail
cd "$(dirname "$0")/../.."
export PATH="$PATH:/usr/sbin:/sbin"
target=${CARGO_TARGET_DIR:-target}
work=${VIVID_DIR:-$target/vivid}
packages=(qemu-system-x86 busybox-static cpio kmod libopenni2-0 clang libclang-dev)

skip() {
  if [ "${KINLIGHT_REQUIRE_VIVID:-}" = 1 ]; then
    echo "vivid: FAILED: $1, and KINLIGHT_REQUIRE_VIVID=1" >&2
    exit 1
  fi
  echo "vivid: SKIPPED: $1" >&2
  exit 0
}

missing() {
  dpkg-query -W -f '${Package} ${db:Status-Status}\n' "${packages[@]}" 2>/dev/null |
    awk '$2 == "installed" { print $1 }' | cat - <(printf '%s\n' "${packages[@]}") | sort | uniq -u
}

as_root=""
[ "$(id -u)" = 0 ] || as_root=sudo
if [ "${1:-}" = --install ]; then
  shift
  mapfile -t wanted < <(missing)
  if [ ${#wanted[@]} -gt 0 ]; then
    $as_root apt-get update -qq || skip "apt-get update failed"
    $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${wanted[@]}" ||
      skip "apt cannot install ${wanted[*]}"
  fi
fi
[ "$(uname -m)" = x86_64 ] || skip "it needs an x86-64 machine"
command -v apt-get dpkg-query >/dev/null || skip "it needs Debian's apt for the kernel"
wanted=$(missing | xargs)
[ -z "$wanted" ] || skip "not installed: $wanted (tests/vivid/run.sh --install does)"

# The kernel: downloaded and unpacked, never installed.
mkdir -p "$work"
work=$(realpath "$work")
kernel=$work/kernel
if ! compgen -G "$kernel/boot/vmlinuz-*" >/dev/null; then
  name=$(apt-cache depends linux-image-amd64 2>/dev/null | awk '/Depends:/ { print $2; exit }')
  [ -n "$name" ] || skip "apt knows no linux-image-amd64 (try --install)"
  download=$(mktemp -d "$work/download.XXXXXX")
  (cd "$download" && apt-get download -qq "$name") || skip "the package $name cannot be had"
  mkdir "$download/kernel"
  dpkg -x "$download/$name"_*.deb "$download/kernel"
  mv "$download/kernel" "$kernel"
  rm -r "$download"
fi
version=$(ls "$kernel/lib/modules")
[ -e "$kernel/lib/modules/$version/modules.dep" ] || depmod -b "$kernel" "$version"

echo "vivid: building" >&2
# The file of a program that cargo has built.
program() { sed -n "s/.*\"name\":\"$1\".*\"executable\":\"\([^\"]*\)\".*/\1/p" "$work/built.json" | tail -n 1; }
cargo build --locked --quiet --package kinlight-virtual-sensor
# As test.sh builds the tests without a GPU, so that this is built once.
cargo test --locked --no-default-features --features v4l --test vivid --no-run --message-format=json >"$work/built.json"
tests=$(program vivid)
kinlight=$(program kinlight)
sensor=$target/debug/libkinlight_virtual_sensor.so
openni=$(dirname "$(ls /usr/lib/*/libOpenNI2.so.0 | head -n 1)")

# The machine's files: busybox, the module with what it needs in order of loading, the programs with their
# libraries, OpenNI2 with the virtual sensor as its only driver.
image=$work/image
rm -rf "$image"
mkdir -p "$image"/{bin,dev,proc,sys,tmp,modules,sensor,openni/OpenNI2/Drivers}
cp /bin/busybox "$image/bin/"
number=10
while read -r module; do
  cp "$module" "$image/modules/$number-$(basename "$module")"
  number=$((number + 1))
done < <(modprobe -d "$kernel" -S "$version" --show-depends vivid | awk '$1 == "insmod" { print $2 }')
vivid=$(basename "$(ls "$image"/modules/*-vivid.ko*)")
cp "$openni/libOpenNI2.so.0" "$image/openni/"
cp "$sensor" "$image/openni/OpenNI2/Drivers/libKinlightVirtual.so.0"
cp "$tests" "$image/bin/tests"
cp "$kinlight" "$image/bin/kinlight"
strip --strip-debug "$image/bin/tests" "$image/bin/kinlight" 2>/dev/null || true
for file in "$tests" "$kinlight" "$sensor" "$openni/libOpenNI2.so.0"; do
  # no such library is an error in the machine, where it is seen
  ldd "$file" | grep -o '/[^ ]*' | while read -r library; do cp -L --parents "$library" "$image/"; done
done
cat >"$image/init" <<INIT
#!/bin/busybox sh
/bin/busybox mount -t devtmpfs devtmpfs /dev
/bin/busybox mount -t proc proc /proc
/bin/busybox mount -t sysfs sysfs /sys
for module in /modules/*; do
  case \$module in
    *-vivid.ko*) /bin/busybox insmod \$module n_devs=1 ;;
    *) /bin/busybox insmod \$module ;;
  esac
done
export HOME=/tmp RUST_BACKTRACE=1 RUST_LOG=warn
export KINLIGHT_VIVID_MODULE=/modules/$vivid KINLIGHT_PROGRAM=/bin/kinlight
export KINLIGHT_OPENNI2=/openni KINLIGHT_VIRTUAL_SENSOR=/sensor
/bin/tests --test-threads=1 --nocapture $*
echo "vivid: exit \$?"
/bin/busybox poweroff -f
INIT
chmod +x "$image/init"
(cd "$image" && find . | cpio --quiet -o -H newc | gzip -1) >"$work/image.gz"

echo "vivid: kernel $version" >&2
# tcg: with /dev/kvm inside a virtual machine the guest may hang before its first message.
timeout "${VIVID_TIMEOUT:-900}" qemu-system-x86_64 -accel tcg -cpu max -smp 2 -m 1536 -nographic -no-reboot -net none \
  -kernel "$kernel/boot/vmlinuz-$version" -initrd "$work/image.gz" -append "console=ttyS0 quiet loglevel=2 panic=-1" \
  </dev/null | sed -u 's/\r//g' | tee "$work/console.log" || true

passed=$(sed -n 's/^test result:.* \([0-9]*\) passed; .*/\1/p' "$work/console.log")
failed=$(sed -n 's/^test result:.* \([0-9]*\) failed; .*/\1/p' "$work/console.log")
status=$(sed -n 's/^vivid: exit \([0-9]*\)$/\1/p' "$work/console.log")
if [ -z "$status" ] || [ -z "$passed" ]; then
  echo "vivid: FAILED: the machine ended before its tests did; see $work/console.log" >&2
  exit 1
fi
echo "vivid: $passed passed, $failed failed"
if [ "$passed" = 0 ] && [ "$status" = 0 ]; then
  echo "vivid: FAILED: no test of that name" >&2
  exit 1
fi
exit "$status"
