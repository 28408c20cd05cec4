#!/usr/bin/env bash
# install_node.sh: puts the pinned packages of requirements/node into build/node, every hash checked, for the tests that
# let a client written for browsers talk to the ROS face. The lock file names no addresses: where packages come from is
# the business of whoever installs.
#
# Where Node is missing it says so and goes on: the tests that need it skip with that reason, or fail where CI is set.
set -euo pipefail
cd "$(dirname "$0")/.."

readonly folder=build/node tries=4

if ! command -v npm >/dev/null; then
    echo "mindstage: npm is missing here (on Debian: sudo apt-get install nodejs npm)" >&2
    if [[ -n ${CI:-} ]]; then exit 1; else exit 0; fi
fi
mkdir -p "$folder"
if cmp --silent requirements/node/package-lock.json "$folder/package-lock.json" && [[ -f $folder/installed ]]; then
    exit 0
fi

rm -f "$folder/installed"
cp requirements/node/package.json requirements/node/package-lock.json "$folder/"
for ((try = 1; ; try++)); do  # mirrors fail for a moment now and then
    npm ci --prefix "$folder" --ignore-scripts --no-audit --no-fund --loglevel=error && break
    if ((try == tries)); then
        echo "mindstage: the packages of requirements/node cannot be installed" >&2
        if [[ -n ${CI:-} ]]; then exit 1; else exit 0; fi
    fi
    sleep $((try * 5))
done
touch "$folder/installed"
