#!/usr/bin/env bash
# install_node.sh: installs the pinned packages of requirements/node into build/node, with all hashes checked, for the
# tests of the ROS interface with a browser client. The lock file contains no addresses: the package source is
# configured by the person or machine that installs.
#
# Without Node it prints a message and succeeds: the tests that need it are skipped. In CI it fails.
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
