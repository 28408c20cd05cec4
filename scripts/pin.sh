#!/usr/bin/env bash
# Writes requirements/run.txt and requirements/dev.txt anew from pyproject.toml: exact versions with the hashes of all
# their files, good for Python 3.11 to 3.13 on every platform. pip enforces them (`--require-hashes`).
#
# The build backend is pinned among them, so that installing the project fetches nothing unpinned. No address of an
# index is written: where packages come from is the business of whoever installs.
set -euo pipefail
cd "$(dirname "$0")/.."

readonly backend='hatchling>=1.27'
readonly header='# Written by scripts/pin.sh; change pyproject.toml and run that again.'

workshop=$(mktemp -d)
trap 'rm -rf "$workshop"' EXIT
"${PYTHON:-python3}" -m venv "$workshop/venv"
"$workshop/venv/bin/pip" install --quiet uv

pin() {  # pin OUT OPTIONS...: one version for all Pythons, so that a bug seen on one is there on the other
    local out=$1
    shift
    "$workshop/venv/bin/uv" pip compile pyproject.toml - "$@" --quiet --upgrade --universal --python-version 3.11 \
        --fork-strategy fewest --only-binary :all: --generate-hashes --no-header --no-annotate \
        --output-file "$workshop/pins" <<<"$backend" >/dev/null
    { echo "$header"; cat "$workshop/pins"; } >"$out"
    echo "$out: $(grep -c == "$out") packages"
}

mkdir -p requirements
pin requirements/dev.txt --all-extras
# What runs is a part of what develops: the same versions, whatever appeared in between.
pin requirements/run.txt --constraints requirements/dev.txt
