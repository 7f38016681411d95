#!/bin/sh
# Whether every dependency of the package, and each of theirs, has a wheel for Linux on Arm: nothing is compiled on a
# robot. Resolves them for 64-bit Arm and glibc 2.28 or newer (Raspberry Pi OS 12 and 13) without such a machine, by the
# indexes that uv is told of (`pip install uv`; UV_DEFAULT_INDEX, ...). Fetches metadata only, in seconds.
#
#   deploy/arm_wheels.sh            ends with how many, exit code 1 with the one that has none
set -eu
cd "$(dirname "$0")/.."
for python in 3.11 3.13; do
  found=$(uv pip compile --quiet --no-annotate --no-header --only-binary :all: --python-version "$python" \
    --python-platform aarch64-manylinux_2_28 pyproject.toml)
  # PyTorch's CUDA libraries, of pip's usual index, are no part of a robot: docs/pi.md has the index of CPU wheels.
  echo "Python $python: $(echo "$found" | grep -c -v -E '^(nvidia-|cuda-|triton)') packages, all with wheels for aarch64"
done
