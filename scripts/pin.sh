#!/usr/bin/env bash
# Writes requirements/{run,dev,docs}.txt from pyproject.toml: exact versions with the hashes of all their files, valid for
# Python 3.11 to 3.13 on every platform. pip enforces the hashes (`--require-hashes`).
#
# The build backend is pinned with them, so that installing the project fetches nothing unpinned. No index URL is
# written: the package source is configured by the person or machine that installs.
set -euo pipefail
cd "$(dirname "$0")/.."

readonly backend='hatchling>=1.27'
readonly header='# Written by scripts/pin.sh; change pyproject.toml and run that again.'

workshop=$(mktemp -d)
trap 'rm -rf "$workshop"' EXIT
"${PYTHON:-python3}" -m venv "$workshop/venv"
"$workshop/venv/bin/pip" install --quiet uv

pin() {  # pin OUT OPTIONS...: one version for all Python versions, so that a bug is reproducible on each of them
    local out=$1
    shift
    "$workshop/venv/bin/uv" pip compile pyproject.toml - "$@" --quiet --upgrade --universal --python-version 3.11 \
        --fork-strategy fewest --only-binary :all: --generate-hashes --no-header --no-annotate \
        --output-file "$workshop/pins" <<<"$backend" >/dev/null
    { echo "$header"; cat "$workshop/pins"; } >"$out"
    echo "$out: $(grep -c == "$out") packages"
}

mkdir -p requirements
# Every extra but `docs`, which only `make docs` installs.
mapfile -t extras < <("$workshop/venv/bin/python" - <<'EOF'
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
