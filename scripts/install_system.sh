#!/usr/bin/env bash
# install_system.sh [COMMAND:|/PATH:]PACKAGE...: installs those Debian packages whose command or path is missing (all
# without one).
#
# Where that is not possible (no root, no apt-get) it names the missing packages and succeeds: the tests that need them
# are skipped. It fails in CI, and for a package without either, because the caller needs that one.
set -euo pipefail

readonly tries=4
missing=()
required=false
for entry in "$@"; do
    if [[ $entry == *:* ]]; then
        [[ $entry == /* && -e ${entry%%:*} ]] || command -v "${entry%%:*}" >/dev/null || missing+=("${entry#*:}")
    else
        missing+=("$entry")
        required=true
    fi
done
[[ ${#missing[@]} -gt 0 ]] || exit 0

if [[ $(id -u) -ne 0 ]] || ! command -v apt-get >/dev/null; then
    echo "mindstage: missing here: ${missing[*]} (on Debian: sudo apt-get install ${missing[*]})" >&2
    if $required || [[ -n ${CI:-} ]]; then exit 1; else exit 0; fi
fi

retry() {  # mirrors fail temporarily
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
retry apt-get update -qq
retry apt-get install -qq --yes --no-install-recommends "${missing[@]}" >/dev/null
