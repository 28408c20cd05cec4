#!/usr/bin/env bash
# ros2_for_tests.sh: installs real ROS 2 (Jazzy, wheels pinned with hashes in requirements/ros2.txt) into an environment of
# its own, builds the message packages that it lacks, and prints the environment's Python as the last line. Both are kept
# in the cache directory under a key of the pins, so that it takes minutes only once.
#
# Without Python 3.11, the wheels or a compiler it prints a message and succeeds: the tests that need it are skipped. In CI
# it fails.
set -euo pipefail
cd "$(dirname "$0")/.."

give_up() {
    echo "mindstage: no ROS 2 for tests: $1" >&2
    if [[ -n ${CI:-} ]]; then exit 1; else exit 0; fi
}

python=$(command -v python3.11) || give_up "Python 3.11 is missing, for which its wheels are"
[[ $(uname -sm) == "Linux x86_64" ]] || give_up "its wheels are for Linux on x86-64"
cache=${MINDSTAGE_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/mindstage}/ros2
folder=$cache/tests-$(sha256sum requirements/ros2.txt | cut -c1-16)
mkdir -p "$cache"

exec 9>"$cache/tests.lock"
flock 9  # of several checkouts, one installs
if [[ ! -f $folder/installed ]]; then
    rm -rf "$folder"
    "$python" -m venv "$folder"
    for try in 1 2 3; do  # mirrors fail for a moment now and then
        "$folder/bin/pip" install --quiet --disable-pip-version-check --require-hashes --no-deps \
            -r requirements/ros2.txt 2>"$folder/pip.log" && break
        if ((try == 3)); then
            tail -3 "$folder/pip.log" >&2
            give_up "the wheels of requirements/ros2.txt cannot be installed"
        fi
        sleep $((try * 5))
    done
    find "$folder/bin" -name 'rosbridge*' -exec chmod +x {} +
    touch "$folder/installed"
fi
PYTHONPATH=$PWD/src .venv/bin/python -m mindstage ros2 build-messages --package rosapi \
    --ros2-python "$folder/bin/python" >&2 || give_up "its message packages cannot be built"
echo "$folder/bin/python"
