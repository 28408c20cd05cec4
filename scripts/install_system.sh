#!/usr/bin/env bash
# install_system.sh [COMMAND:]PACKAGE...: installs those Debian packages whose command is missing (all without one).
#
# Where that is not possible (no root, no apt-get) it names what is missing and goes on: the tests that need it skip
# with that reason, or fail where CI is set. A package without a command is needed at once, so there it fails.
set -euo pipefail

readonly tries=4
missing=()
vital=false
for entry in "$@"; do
    if [[ $entry == *:* ]]; then
        command -v "${entry%%:*}" >/dev/null || missing+=("${entry#*:}")
    else
        missing+=("$entry")
        vital=true
    fi
done
[[ ${#missing[@]} -gt 0 ]] || exit 0

if [[ $(id -u) -ne 0 ]] || ! command -v apt-get >/dev/null; then
    echo "mindstage: missing here: ${missing[*]} (on Debian: sudo apt-get install ${missing[*]})" >&2
    if $vital || [[ -n ${CI:-} ]]; then exit 1; else exit 0; fi
fi

again() {  # mirrors fail for a moment now and then
    local try
    for ((try = 1; try < tries; try++)); do
        "$@" && return
        echo "mindstage: '$*' failed, trying again in $((try * 5)) s" >&2
        sleep $((try * 5))
    done
    "$@"
}

export DEBIAN_FRONTEND=noninteractive DEBCONF_NOWARNINGS=yes
echo "installing ${missing[*]}"
again apt-get update -qq
again apt-get install -qq --yes --no-install-recommends "${missing[@]}" >/dev/null
