#!/usr/bin/env bash
# Installs the Debian package in a new, minimal Debian system and uses the program there, without
# compiler, Rust or network; or unpacks the archive into an empty folder that is all of the system, without
# any library:
#
#     cargo xtask package
#     contrib/package/try.sh target/package/tello-ctl_*.deb
#     contrib/package/try.sh target/package/tello-ctl-*.tar.gz
#
# As root, with mmdebstrap, iproute2 and util-linux (apt-get install mmdebstrap iproute2 util-linux).
# Takes the Debian packages of the system from the sources of this machine's apt. Prints the session;
# ends with 0 if every command of it did. ROOT=DIR keeps the system for another try; QUICK=1 flies in
# virtual time.
set -euo pipefail

package=$(realpath "${1:?usage: try.sh PACKAGE.deb}")
root=${ROOT:-$(mktemp -d)}
[ -n "${ROOT:-}" ] || trap 'rm -rf --one-file-system "$root"' EXIT

# The commands of a new user.
session() {
    cat <<SESSION
tello-ctl --version
tello-ctl init lab --mocap datastream --address 192.168.1.5:801 --object tello --room=-2,2,-3,1,2.5
$(if [ -n "${QUICK:-}" ]; then
        echo "tello-ctl sim --seed 1 --config lab/fly.json --log flight.mcap"
    else
        echo "tello-ctl fly --sim --no-keys --config lab/fly.json --sim-config lab/sim.json --log flight.mcap"
    fi)
tello-ctl replay flight.mcap --view flight.html
tello-ctl report flight.mcap
tello-ctl ident flight.mcap
SESSION
}

if [[ $package == *.tar.gz ]]; then
    tar -xf "$package" --strip-components=1 --no-same-owner -C "$root"
    mkdir -p "$root/proc"
    # shellcheck disable=SC2016 # for the shell inside
    unshare --mount --pid --net --fork bash -euc '
        ip link set lo up
        mount -t proc proc "$1/proc"
        while read -r command; do
            echo "\$ $command"
            # shellcheck disable=SC2086 # words
            env -i HOME=/ TERM=dumb "$(command -v chroot)" "$1" /$command </dev/null
            echo
        done' bash "$root" < <(session)
    exit
fi

if [ ! -e "$root/usr/bin/dpkg" ]; then
    mmdebstrap --quiet --mode=root --variant=minbase "$(. /etc/os-release && echo "$VERSION_CODENAME")" "$root"
fi
cp "$package" "$root/root/tello-ctl.deb"
session | sed 's/^/run /' >"$root/root/commands.sh"
cat >"$root/root/session.sh" <<'SESSION'
set -eu
cd /root
rm -rf lab ident ./*.mcap ./*.html && { dpkg --purge tello-ctl >/dev/null 2>&1 || true; }
run() { echo "\$ $*"; "$@" </dev/null; echo; }
echo "$(. /etc/os-release && echo "$PRETTY_NAME"), $(dpkg --get-selections | wc -l) packages"
for tool in cc gcc rustc cargo python3; do ! command -v $tool || exit 1; done
echo
run dpkg --install tello-ctl.deb
. ./commands.sh
run ls -sh flight.mcap ident
dpkg --listfiles tello-ctl | grep -c 'man/man1/.*[.]gz' >/dev/null
dpkg --verify tello-ctl
run dpkg --remove tello-ctl
SESSION
# Names of its own for mounts, processes and network: only the loopback interface is there.
unshare --mount --pid --net --fork bash -c '
    ip link set lo up
    mount -t proc proc "$1/proc"
    exec chroot "$1" /usr/bin/env -i HOME=/root PATH=/usr/bin:/usr/sbin:/bin:/sbin LC_ALL=C.UTF-8 \
        TERM=dumb sh /root/session.sh' bash "$root"
