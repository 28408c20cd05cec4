#!/usr/bin/env bash
# pin.sh [--keep]: writes requirements/{run,dev,docs}.txt from pyproject.toml: exact versions with the hashes of all
# their files, valid for Python 3.11 to 3.13 on every platform. pip enforces the hashes (`--require-hashes`).
# requirements/ros2.txt is the real ROS 2 of the tests, wheels for Python 3.11 on Linux.
#
# Every package gets its newest allowed version. With --keep, pinned packages keep their versions and only missing ones
# are added, which is what a new dependency needs.
#
# The build backend is pinned with them, so that installing the project fetches nothing unpinned. No index URL is
# written: the package source is configured by the person or machine that installs.
set -euo pipefail
cd "$(dirname "$0")/.."

readonly backend='hatchling>=1.27'
keep=false
case ${1:-} in
    '') ;;
    --keep) keep=true ;;
    *) echo "usage: pin.sh [--keep]" >&2; exit 2 ;;
esac
readonly keep
readonly header='# Written by scripts/pin.sh; change pyproject.toml and run that again.'

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet uv

pin() {  # pin OUT OPTIONS...: one version for all Python versions, so that a bug is reproducible on each of them
    local out=$1
    shift
    rm -f "$folder/pins"  # uv prefers the versions of an existing output file
    if $keep && [[ -f $out ]]; then cp "$out" "$folder/pins"; fi
    "$folder/venv/bin/uv" pip compile pyproject.toml - "$@" --quiet --universal --python-version 3.11 \
        --fork-strategy fewest --only-binary :all: --generate-hashes --no-header --no-annotate \
        --output-file "$folder/pins" <<<"$backend" >/dev/null
    { echo "$header"; cat "$folder/pins"; } >"$out"
    echo "$out: $(grep -c == "$out") packages"
}

mkdir -p requirements
# Every extra but `docs`, which only `make docs` installs.
mapfile -t extras < <("$folder/venv/bin/python" - <<'EOF'
import tomllib
with open("pyproject.toml", "rb") as file:
    extras = tomllib.load(file)["project"]["optional-dependencies"]
print(*(f"--extra={extra}" for extra in extras if extra != "docs"), sep="\n")
EOF
)
pin requirements/dev.txt "${extras[@]}"
# The other sets use the versions of dev.txt, even if newer ones were released in between.
pin requirements/run.txt --constraints requirements/dev.txt
pin requirements/docs.txt --extra docs --constraints requirements/dev.txt

# What building message packages takes is named, too, since the wheels do not depend on it.
readonly ros2_packages='catkin-pkg docutils empy lark-parser numpy rosbridge-server-rs setuptools'
readonly jazzy_packages='ament-cmake ament-cmake-gmock ament-cmake-gtest ament-cmake-pytest ament-cmake-ros ament-package
    common-interfaces domain-coordinator python-cmake-module rclpy rmw-fastrtps-cpp rmw-implementation
    rosidl-core-generators rosidl-default-generators rosidl-typesupport-introspection-c
    rosidl-typesupport-introspection-cpp'
rm -f "$folder/pins"
if $keep && [[ -f requirements/ros2.txt ]]; then cp requirements/ros2.txt "$folder/pins"; fi
{ printf '%s\n' $ros2_packages; printf 'ros-jazzy-%s\n' $jazzy_packages; } >"$folder/ros2.in"
"$folder/venv/bin/uv" pip compile "$folder/ros2.in" --quiet --python-version 3.11 --python-platform x86_64-manylinux_2_35 \
    --generate-hashes --no-header --no-annotate --output-file "$folder/pins" >/dev/null
{
    echo '# Real ROS 2 for the tests, written by scripts/pin.sh: Jazzy as wheels for Python 3.11, with rosbridge-server-rs.'
    cat "$folder/pins"
} >requirements/ros2.txt
echo "requirements/ros2.txt: $(grep -c == requirements/ros2.txt) packages"
