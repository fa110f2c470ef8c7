#!/usr/bin/env bash
# Runs the README's commands on a machine that has nothing but Debian's smallest system, python3, git,
# make and ca-certificates: in a root folder of its own, from a clone of the last commit.
#
#   tests/benchmarks/checkout/fresh_machine.sh [--keep] [demo] [test] [wheel] ['any other command']...
#
#   demo, test  what the README starts with, `make demo` and `make test`; both unless told otherwise
#   wheel       what a user of the library does: the wheel alone in an empty environment, the first
#               examples of the documentation, the command line, a type checker
#   --keep      leaves the root folder, and says where it is
#
# Needs root and debootstrap; without them it says so in one line and ends with 77. Packages come from
# where this machine has its own: apt's sources and pip's settings are taken along. All mounts are
# made where only this script's own processes see them, and end with it whatever happens.
# FRESH_MACHINE_DIR: where root folders are made, with some 6 GB of room; by default /var/tmp.
set -euo pipefail

SKIPPED=77
BARE=python3,git,make,ca-certificates
repository=$(cd "$(dirname "${BASH_SOURCE[0]}")/../../.." && pwd)

say() { printf 'fresh machine: %s\n' "$*"; }

skip() {
    say "skipped: $*"
    exit $SKIPPED
}

require_tools() {
    [ "$(id -u)" = 0 ] || skip "needs root, to make a root folder and to mount in it"
    command -v debootstrap >/dev/null || skip "needs debootstrap: apt-get install debootstrap"
    unshare --mount --pid --fork true 2>/dev/null || skip "needs mounts of its own (unshare --mount)"
}

# Making the root folder

# The archive and the release that this machine's apt reads first.
archive() {
    apt-get indextargets --format '$(REPO_URI) $(CODENAME)' 'Created-By: Packages' | head -n 1
}

bootstrap() {
    local uri release
    read -r uri release <<<"$(archive)"
    [ -n "${uri:-}" ] || skip "apt has no sources here"
    say "Debian $release in $root"
    debootstrap --variant=minbase --include="$BARE" "$release" "$root" "$uri" >"$root.log" 2>&1 ||
        { tail -n 5 "$root.log"; skip "debootstrap failed, see $root.log"; }
    rm -f "$root.log"
}

# What this machine needs to reach packages, a new one of its kind needs, too.
take_settings_along() {
    rm -rf "$root/etc/apt"
    cp -a /etc/apt "$root/etc/apt"
    cp -aL /etc/resolv.conf "$root/etc/resolv.conf"
    copy_over /usr/share/keyrings /usr/local/share/ca-certificates /etc/ssl/certs/ca-certificates.crt
    copy_over /etc/pip.conf "$HOME/.config/pip" "$HOME/.pip"
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
    { cat /etc/pip.conf "$HOME/.config/pip/pip.conf" "$HOME/.pip/pip.conf" 2>/dev/null || true
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
    local what start code
    for what in "$@"; do
        say "running: $what"
        start=$SECONDS code=0
        run_one "$what" || code=$?
        summary+=("$(printf '%-8s exit code %s, %s s' "$what" "$code" $((SECONDS - start)))")
        [ "$code" = 0 ] || failed=1
    done
}

clean_up() {
    [ -n "${keep:-}" ] && { say "left in $root"; return; }
    # Private mounts: they are gone for everybody else already, and --one-file-system heeds them here.
    umount --recursive --quiet "$root"/proc "$root"/dev/shm "$root"/dev/pts || true
    local folder
    for folder in $(pip_folders); do umount --quiet "$root$folder" || true; done
    rm -rf --one-file-system "$root" "$root.log"
}

main() {
    keep='' failed=0 summary=()
    [ "${1:-}" != --keep ] || { keep=1; shift; }
    [ $# -gt 0 ] || set -- demo test
    root=$(mktemp -d "${FRESH_MACHINE_DIR:-/var/tmp}/fresh-machine.XXXXXX")
    chmod 755 "$root" # apt reads as a user of its own
    trap clean_up EXIT
    trap 'exit 130' INT TERM
    bootstrap
    take_settings_along
    mount_everything
    inside_root_checkout
    run_all "$@"
    say "of commit $commit:"
    printf '  %s\n' "${summary[@]}"
    return "$failed"
}

# A clone, so that nothing comes along that is not committed.
inside_root_checkout() {
    git clone --quiet --no-hardlinks "$repository" "$root/root/checkout"
    commit=$(git -C "$root/root/checkout" rev-parse --short HEAD)
}

require_tools
if [ -z "${FRESH_MACHINE_INSIDE:-}" ]; then
    FRESH_MACHINE_INSIDE=1 exec unshare --mount --propagation private --pid --fork --kill-child \
        bash "${BASH_SOURCE[0]}" "$@"
fi
main "$@"
