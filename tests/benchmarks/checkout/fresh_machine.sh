#!/usr/bin/env bash
# Runs the README's commands on machines that have nothing but Debian's smallest system, python3, git,
# make and ca-certificates, and no compiler: each in a root folder of its own, from a clone of the
# last commit.
#
#   tests/benchmarks/checkout/fresh_machine.sh [--keep] [--release NAME]... \
#       [demo] [test] [wheel] ['any other command']...
#
#   demo, test  what the README starts with, `make demo` and `make test`; both unless told otherwise
#   wheel       what a user of the library does: the wheel alone in an empty environment, the first
#               examples of the documentation, the command line, a type checker
#   --release   Debian's release; as often as wanted, by default bookworm (Python 3.11) and trixie
#               (Python 3.13)
#   --keep      leaves the root folders, and says where they are
#
# Ends with 0 where every command did, and no compiler came along with what it installed.
#
# Needs root and debootstrap; without them it says so in one line and ends with 77. Packages come from
# where this machine has its own: the archive's address, apt's and pip's settings are taken along. All
# mounts are made where only this script's own processes see them, and end with it whatever happens.
# FRESH_MACHINE_DIR: where root folders are made, with some 6 GB of room; by default /var/tmp.
set -euo pipefail

SKIPPED=77
BARE=python3,git,make,ca-certificates
COMPILERS='cc gcc c++ g++ clang tcc rustc cargo'
repository=$(cd "$(dirname "${BASH_SOURCE[0]}")/../../.." && pwd)

say() { printf 'fresh machine: %s\n' "$*"; }

skip() {
    say "skipped: $*"
    [ "${failed:-0}" = 0 ] || exit 1
    exit $SKIPPED
}

require_tools() {
    [ "$(id -u)" = 0 ] || skip "needs root, to make a root folder and to mount in it"
    command -v debootstrap >/dev/null || skip "needs debootstrap: apt-get install debootstrap"
    unshare --mount --pid --fork true 2>/dev/null || skip "needs mounts of its own (unshare --mount)"
}

# Making the root folder

# The address of the archive that this machine's apt reads first; all releases are there.
archive() {
    apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' | head -n 1
}

bootstrap() {
    local uri
    uri=$(archive)
    [ -n "$uri" ] || skip "apt has no sources here"
    say "Debian $release in $root"
    debootstrap --variant=minbase --include="$BARE" "$release" "$root" "$uri" >"$root.log" 2>&1 ||
        { tail -n 5 "$root.log"; skip "debootstrap failed for $release"; }
    rm -f "$root.log"
    take_settings_along "$uri"
}

# What this machine needs to reach packages, a new one needs, too. Sources are of the new one's release.
take_settings_along() {
    rm -rf "$root/etc/apt"
    cp -a /etc/apt "$root/etc/apt"
    rm -rf "$root"/etc/apt/sources.list "$root"/etc/apt/sources.list.d/*
    echo "deb $1 $release main" >"$root/etc/apt/sources.list"
    cp -aL /etc/resolv.conf "$root/etc/resolv.conf"
    copy_over /usr/share/keyrings /usr/local/share/ca-certificates /etc/ssl/certs/ca-certificates.crt
    copy_over /etc/pip.conf /etc/xdg/pip "$HOME/.config/pip" "$HOME/.pip"
}

# Copies files and folders to the same place below the root; HOME is /root there.
copy_over() {
    local path target
    for path in "$@"; do
        [ -e "$path" ] || continue
        target=$root${path/#$HOME//root}
        mkdir -p "$(dirname "$target")"
        cp -aL --no-target-directory "$path" "$target"
    done
}

# The folders of this machine that pip's settings name: package indexes without a server.
pip_folders() {
    { cat /etc/pip.conf /etc/xdg/pip/pip.conf "$HOME"/{.config/pip,.pip}/pip.conf 2>/dev/null || true
      env | grep '^PIP_' || true; } |
        grep -oE '(file://)?/[^ ,"=]+' | sed -e 's|^file://||' -e 's|/simple/*$||' | sort -u |
        while read -r path; do if [ -d "$path" ]; then echo "$path"; fi; done
}

mount_everything() {
    local folder
    mount -t proc proc "$root/proc"
    mount -t tmpfs -o mode=1777 shm "$root/dev/shm"
    mount -t devpts -o newinstance,ptmxmode=0666 devpts "$root/dev/pts"
    for folder in $(pip_folders); do
        mkdir -p "$root$folder"
        mount --bind "$folder" "$root$folder"
        mount -o remount,bind,ro "$root$folder"
    done
}

# Running in it

# Nothing of this machine's environment but what leads to packages.
environment() {
    env | grep -iE '^(PIP_|(https?|no|ftp)_proxy=|SSL_CERT_|REQUESTS_CA_BUNDLE=|CURL_CA_BUNDLE=)' || true
}

inside() {
    local settings
    mapfile -t settings < <(environment)
    chroot "$root" /usr/bin/env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin TERM=dumb \
        ${settings[@]+"${settings[@]}"} bash -c "cd /root/checkout && $1"
}

run_one() {
    case $1 in
        demo | test) inside "make $1" ;;
        wheel) inside 'bash tests/benchmarks/checkout/fresh_wheel.sh' ;;
        *) inside "$1" ;;
    esac
}

run_all() {
    local what start code compilers python
    for what in "$@"; do
        say "running on $release: $what"
        start=$SECONDS code=0
        run_one "$what" || code=$?
        summary+=("$(printf '%-9s %-8s exit code %s, %s s' "$release" "$what" "$code" $((SECONDS - start)))")
        [ "$code" = 0 ] || failed=1
    done
    compilers=$(inside "command -v $COMPILERS" | xargs || true)
    python=$(inside 'python3 --version')
    summary+=("$(printf '%-9s %s, compilers: %s' "$release" "$python" "${compilers:-none}")")
    [ -z "$compilers" ] || failed=1
}

clean_up() {
    [ -d "${root:-}" ] || return 0
    [ -z "$keep" ] || { say "left in $root"; return 0; }
    # Private mounts: they are gone for everybody else already, and --one-file-system heeds them here.
    umount --recursive --quiet "$root"/proc "$root"/dev/shm "$root"/dev/pts || true
    local folder
    for folder in $(pip_folders); do umount --quiet "$root$folder" || true; done
    rm -rf --one-file-system "$root" "$root.log"
}

# Everything for one release, in a root folder that is gone before the next one is made.
run_release() {
    release=$1
    shift
    root=$(mktemp -d "${FRESH_MACHINE_DIR:-/var/tmp}/fresh-machine.XXXXXX")
    chmod 755 "$root" # apt reads as a user of its own
    bootstrap
    mount_everything
    inside_root_checkout
    run_all "$@"
    clean_up
    root=''
}

main() {
    local one
    failed=0 root='' summary=()
    trap 'clean_up; report' EXIT
    trap 'exit 130' INT TERM
    for one in "${releases[@]}"; do run_release "$one" "${commands[@]}"; done
    return "$failed"
}

report() {
    [ ${#summary[@]} -gt 0 ] || return 0
    say "of commit $commit:"
    printf '  %s\n' "${summary[@]}"
}

# A clone, so that nothing comes along that is not committed.
inside_root_checkout() {
    git clone --quiet --no-hardlinks "$repository" "$root/root/checkout"
    commit=$(git -C "$root/root/checkout" rev-parse --short HEAD)
}

read_arguments() {
    keep='' releases=() commands=()
    while [ $# -gt 0 ]; do
        case $1 in
            --keep) keep=1 ;;
            --release)
                [ -n "${2:-}" ] || wrong "--release: needs the name of a release of Debian, as in --release trixie"
                releases+=("$2")
                shift
                ;;
            -*) wrong "$1: unknown; there are --keep and --release NAME" ;;
            *) commands+=("$1") ;;
        esac
        shift
    done
    [ ${#releases[@]} -gt 0 ] || releases=(bookworm trixie)
    [ ${#commands[@]} -gt 0 ] || commands=(demo test)
}

wrong() {
    say "$*" >&2
    exit 2
}

read_arguments "$@"
require_tools
if [ -z "${FRESH_MACHINE_INSIDE:-}" ]; then
    FRESH_MACHINE_INSIDE=1 exec unshare --mount --propagation private --pid --fork --kill-child \
        bash "${BASH_SOURCE[0]}" "$@"
fi
main
