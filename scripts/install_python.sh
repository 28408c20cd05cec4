#!/usr/bin/env bash
# install_python.sh run|dev|docs: creates .venv if it is missing, installs the pinned packages of requirements/PART.txt
# (wheels only, every hash checked) and the project itself, editable, without fetching anything for its build.
set -euo pipefail
cd "$(dirname "$0")/.."

readonly part=${1:?run, dev or docs}
readonly oldest='(3, 11)'
export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_INPUT=1 PIP_RETRIES=8 PIP_DEFAULT_TIMEOUT="${PIP_DEFAULT_TIMEOUT:-60}"

fail() {
    echo "mindstage: $*" >&2
    exit 1
}

new_enough() {
    "$1" -c "import sys; sys.exit(sys.version_info < $oldest)" 2>/dev/null
}

choose_python() {
    local candidate
    if [[ -n ${PYTHON:-} ]]; then
        new_enough "$PYTHON" || fail "PYTHON=$PYTHON is not Python 3.11 or later"
        echo "$PYTHON"
        return
    fi
    for candidate in python3 python3.13 python3.12 python3.11; do
        if new_enough "$candidate"; then
            echo "$candidate"
            return
        fi
    done
    fail 'no Python 3.11 or later found; install one, or name it: make PYTHON=/path/to/python3'
}

make_venv() {
    local python
    python=$(choose_python)
    if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
        # On Debian these are in a separate package for each version.
        scripts/install_system.sh "$("$python" -c 'import sys; print("python3.%d-venv" % sys.version_info[1])')"
    fi
    echo "making .venv with $("$python" --version)"
    rm -rf .venv
    "$python" -m venv .venv
}

new_enough .venv/bin/python && .venv/bin/python -m pip --version >/dev/null 2>&1 || make_venv

echo "installing $(grep -c == "requirements/$part.txt") pinned packages ($part)"
.venv/bin/python -m pip install -qq --require-hashes --only-binary :all: --requirement "requirements/$part.txt"
.venv/bin/python -m pip install -qq --no-deps --no-index --no-build-isolation --editable .
# pip compiles what it installs, but not an editable project; each command would compile it again where Python must not.
.venv/bin/python -m compileall -qq src/mindstage || true
