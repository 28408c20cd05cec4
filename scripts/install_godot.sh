#!/usr/bin/env bash
# install_godot.sh [FOLDER]: installs Godot 4 into FOLDER (build/godot); the program is FOLDER/bin/godot.
#
# Debian 12 has no Godot 4, Debian unstable has. The packages are downloaded from there without changing the system: apt
# uses separate lists, cache and state with the archive of this machine's own sources, and the packages are only
# unpacked. They need a newer C library than Debian 12 has, so FOLDER/bin/godot starts Godot through the loader of that
# library. Mesa's software drivers are included, so that Godot can render without a graphics card.
#
# No root is needed. A FOLDER with a working Godot is left unchanged.
set -euo pipefail

readonly packages=(godot libgl1-mesa-dri libglx-mesa0 libegl1 libegl-mesa0 libgl1 libxcursor1 libxinerama1 libxi6
    libxrandr2 libxrender1 libxkbcommon0 libfontconfig1 libdbus-1-3)
readonly tries=4 etc=/etc/apt

mkdir -p "${1:-build/godot}"
folder=$(cd "${1:-build/godot}" && pwd)
readonly folder apt=$folder/apt root=$folder/root program=$folder/bin/godot

log() { echo "mindstage: $*" >&2; }

die() {
    log "$1"
    log "Godot is missing here; install Godot 4.4 or later and set GODOT to its program, or put it on PATH"
    exit 1
}

retry() {  # mirrors fail temporarily
    local try
    for ((try = 1; try < tries; try++)); do
        "$@" && return
        log "'${*##*/}' failed, trying again in $((try * 5)) s"
        sleep $((try * 5))
    done
    "$@"
}

works() { [[ -x $program ]] && timeout 60 "$program" --headless --version 2>/dev/null | grep -q '^4\.'; }

own_archive() {  # the archive of Debian in the apt sources of this machine
    local sources=() release
    release=$(. /etc/os-release && echo "${VERSION_CODENAME:-stable}")
    mapfile -t sources < <(find "$etc" -type f \( -name '*.list' -o -name '*.sources' \) 2>/dev/null | sort)
    [[ ${#sources[@]} -gt 0 ]] || return 0
    awk -v release="$release" '
        function flush(   i) {
            if (suites ~ " " release " " && components ~ / main / && enabled) for (i = 1; i <= count; i++) print uris[i]
            count = 0; suites = components = " "; enabled = 1
        }
        FNR == 1 || /^[ \t]*$/ { flush() }
        tolower($1) == "uris:" { for (i = 2; i <= NF; i++) uris[++count] = $i }
        tolower($1) == "suites:" { for (i = 2; i <= NF; i++) suites = suites $i " " }
        tolower($1) == "components:" { for (i = 2; i <= NF; i++) components = components $i " " }
        tolower($1) == "enabled:" && tolower($2) == "no" { enabled = 0 }
        $1 == "deb" { i = 2; if ($2 ~ /^\[/) { while ($i !~ /\]$/) i++; i++ } if ($(i + 1) == release && $0 ~ / main/) print $i }
        END { flush() }
    ' "${sources[@]}" | sed 's|/*$||' | head -n 1 || true
}

own_apt() {  # configures apt for separate folders
    mkdir -p "$apt"/{lists/partial,cache/archives/partial,state}
    : >"$apt/state/status"
    echo "deb [signed-by=$keyring] $archive unstable main" >"$apt/sources.list"
    cat >"$apt/apt.conf" <<CONF
Dir::Etc::SourceList "$apt/sources.list";
Dir::Etc::SourceParts "/dev/null";
Dir::Etc::Preferences "/dev/null";
Dir::Etc::PreferencesParts "/dev/null";
Dir::State "$apt/state";
Dir::State::Lists "$apt/lists";
Dir::State::Status "$apt/state/status";
Dir::Cache "$apt/cache";
Debug::NoLocking "true";
APT::Sandbox::User "";
APT::Install-Recommends "false";
APT::Update::Error-Mode "any";
APT::Update::Post-Invoke "";
APT::Update::Post-Invoke-Success "";
Acquire::Languages "none";
Acquire::Retries "2";
CONF
    printf '#clear APT::Update::Post-Invoke;\n#clear APT::Update::Post-Invoke-Success;\n' >>"$apt/apt.conf"
    export APT_CONFIG=$apt/apt.conf DEBIAN_FRONTEND=noninteractive
}

unpack() {
    local package
    mkdir -p "$root.part"
    for package in "$apt"/cache/archives/*.deb; do
        dpkg-deb --extract "$package" "$root.part"
    done
    rm -rf "$root"
    mv "$root.part" "$root"
}

write_program() {
    local loader libraries private
    loader=$(find "$root" -name 'ld-linux-*.so.*' | head -n 1)
    libraries=$(dirname "$(find "$root" -name libc.so.6 | head -n 1)")
    [[ -n $loader && -e $libraries/libc.so.6 ]] || die "the packages hold no C library"
    private=$(find "$libraries" -mindepth 2 -name 'lib*.so*' -printf '%P\n' | sed 's|/[^/]*$||' | sort -u | sed 's|^|:$libraries/|' | tr -d '\n')
    mkdir -p "$folder/bin"
    cat >"$program.part" <<WRAPPER
#!/usr/bin/env bash
# Starts Godot with its own libraries. Written by scripts/install_godot.sh.
root=\$(cd "\$(dirname "\$(readlink -f "\${BASH_SOURCE[0]}")")/../root" && pwd)
libraries=\$root/${libraries#"$root"/}
export LIBGL_DRIVERS_PATH=\$libraries/dri __EGL_VENDOR_LIBRARY_DIRS=\$root/usr/share/glvnd/egl_vendor.d
export LIBGL_ALWAYS_SOFTWARE=\${LIBGL_ALWAYS_SOFTWARE:-1}
exec "\$root/${loader#"$root"/}" --library-path "\$libraries$private" "\$root/usr/bin/godot" "\$@"
WRAPPER
    chmod +x "$program.part"
    mv "$program.part" "$program"
}

if works; then exit 0; fi
for tool in apt-get dpkg-deb awk; do
    command -v "$tool" >/dev/null || die "not a Debian system: there is no $tool"
done
keyring=$(find /usr/share/keyrings -name 'debian-archive-keyring.gpg' 2>/dev/null | head -n 1)
[[ -n $keyring ]] || die "the keyring of Debian's archive is missing; install debian-archive-keyring"
archive=$(own_archive)
[[ -n $archive ]] || die "the apt sources of this machine contain no archive of Debian"
readonly keyring archive

log "fetching Godot into $folder"
own_apt
retry apt-get update -qq || die "cannot download the package lists from $archive"
retry apt-get install -qq --yes --download-only --no-install-recommends "${packages[@]}" >/dev/null ||
    die "cannot download the packages from $archive"
unpack
write_program
works || die "the installed Godot does not start: $("$program" --headless --version 2>&1 | tail -n 1)"
rm -rf "$apt"
log "$("$program" --headless --version) is $program"
