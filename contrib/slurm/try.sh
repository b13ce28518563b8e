#!/usr/bin/env bash
# tello-batch.sbatch on a real Slurm: one controller and two nodes on this machine, one of which is lost in the middle.
#
#     contrib/slurm/try.sh [FLIGHTS [PARTS]]     a campaign; ends with 0 if the merged bytes are those of one process
#     contrib/slurm/try.sh --install             only fetches Slurm; ends with 3 if that is not possible
#
# Needs Debian or a relative of it. Nothing is installed: the packages are unpacked into target/slurm, and all
# processes are ended at the end. TELLO_CTL names the program (default: target/debug/tello-ctl). With
# TELLO_UNDER="/usr/bin/time -v" it prints the time of the processors and the largest memory too.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

packages=(slurmctld slurmd slurm-client slurm-wlm-basic-plugins munge libmunge2 libhwloc15 liblua5.1-0)
store=${CARGO_TARGET_DIR:-$PWD/target}/slurm
root=$store/root
libraries=$root/usr/lib/$(uname -m)-linux-gnu

say() {
    echo "$SECONDS s: $*"
}

fail() {
    say "$*" >&2
    tail -n 5 "$run"/log/* >&2 || true
    exit 1
}

# Downloads and unpacks the packages, once.
install_slurm() {
    [ -e "$store/.ready" ] && return
    command -v apt-get >/dev/null && command -v dpkg >/dev/null || return 1
    rm -rf "$store" && mkdir -p "$store/packages"
    # As root apt-get would download as another user, who may not write here.
    local get=(apt-get -qq -o APT::Sandbox::User=root download "${packages[@]}")
    (cd "$store/packages" && { "${get[@]}" || { apt-get update -qq && "${get[@]}"; }; }) >&2 || return 1
    local package
    for package in "$store"/packages/*.deb; do dpkg -x "$package" "$root" || return 1; done
    touch "$store/.ready"
}

# write_settings PORT: Slurm's settings, for this user on this machine.
write_settings() {
    local host port=$1 node
    host=$(hostname -s)
    # cred_expire is also how long a task of a lost node waits before it starts anew.
    cat <<END
ClusterName=try
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$port
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
AuthType=auth/munge
AuthInfo=socket=$run/munge.sock,cred_expire=5
CredType=cred/munge
PluginDir=$libraries/slurm-wlm
StateSaveLocation=$run/state
SlurmdSpoolDir=$run/spool-%n
SlurmctldPidFile=$run/slurmctld.pid
SlurmdPidFile=$run/slurmd-%n.pid
SlurmctldLogFile=$run/log/slurmctld
SlurmdLogFile=$run/log/slurmd-%n
SlurmdTimeout=6
KillWait=2
InactiveLimit=0
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SchedulerType=sched/backfill
SchedulerParameters=batch_sched_delay=0,sched_min_interval=0,bf_interval=2,defer_batch
ReturnToService=2
PartitionName=try Nodes=n1,n2 Default=YES MaxTime=INFINITE State=UP
END
    for node in 1 2; do
        echo "NodeName=n$node NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + node)) CPUs=1"
    done
}

# processes WORD..: ids of our processes in whose environment all the words stand.
processes() {
    local environment words word
    for environment in /proc/[0-9]*/environ; do
        words=$({ tr '\0' '\n' <"$environment"; } 2>/dev/null) || continue
        for word in "SLURM_CONF=$SLURM_CONF" "$@"; do
            grep -qxF "$word" <<<"$words" || continue 2
        done
        environment=${environment%/environ}
        echo "${environment#/proc/}"
    done
}

end_all() {
    local ids
    mapfile -t ids < <(processes)
    [ ${#ids[@]} -eq 0 ] || kill -KILL "${ids[@]}" 2>/dev/null || true
    rm -rf "$run"
}

start_slurm() {
    mkdir -p "$run"/{state,spool-n1,spool-n2,log}
    write_settings $((17000 + $$ % 3000 * 5)) >"$SLURM_CONF"
    "$root/usr/sbin/mungekey" -c -k "$run/munge.key" -f
    "$root/usr/sbin/munged" --force --key-file="$run/munge.key" --socket="$run/munge.sock" \
        --pid-file="$run/munge.pid" --log-file="$run/log/munged" --seed-file="$run/munge.seed"
    "$root/usr/sbin/slurmctld-wlm" -f "$SLURM_CONF"
    local node
    for node in n1 n2; do
        TRY_NODE=$node "$root/usr/sbin/slurmd-wlm" -f "$SLURM_CONF" -N "$node" -d "$root/usr/sbin/slurmstepd-wlm"
    done
    for _ in {1..100}; do
        [ "$(sinfo -h -t idle -o %D 2>/dev/null)" = 2 ] && return
        sleep 0.2
    done
    fail "the nodes did not come up"
}

# wait_for SECONDS CONDITION..
wait_for() {
    local until=$((SECONDS + $1))
    shift
    until "$@"; do
        [ "$SECONDS" -lt "$until" ] || fail "waited too long: $*"
        sleep 0.2
    done
}

# has_parts COUNT: whether so many parts are there.
has_parts() {
    [ "$(find "$run/out" -name '[0-9]*.part' | wc -l)" -ge "$1" ]
}

# Whether there is a result, or no job that could bring it.
is_over() {
    [ -e "$run/out/result.txt" ] || [ -z "$(squeue -h)" ]
}

# task_of NODE: number of the part that runs there, to the variable `task`; false if there is none.
task_of() {
    task=$(squeue -h -w "$1" -t R -o %K | head -n 1)
    [[ $task =~ ^[0-9]+$ ]]
}

# stop_node NODE: stops all processes of a node in the middle of a part; their ids to `ids`, the part to `task`. False,
# and they go on, if nothing is flown there now.
stop_node() {
    local task_process parent is_flying=
    task_of "$1" || return 1
    mapfile -t ids < <(processes "TRY_NODE=$1")
    for task_process in $(processes "SLURMD_NODENAME=$1"); do
        [ "$(readlink "/proc/$task_process/exe")" != "$TELLO_CTL" ] || is_flying=yes
        # The parent of a task is Slurm's own, with an empty environment, or init.
        parent=$(ps -o ppid= -p "$task_process" | xargs)
        [[ $(readlink "/proc/$parent/exe") != "$root"/* ]] || ids+=("$parent")
        ids+=("$task_process")
    done
    kill -STOP "${ids[@]}" 2>/dev/null || is_flying=
    # The file of a part is the last that a task makes.
    [ -z "$is_flying" ] || [ -e "$run/out/$task-of-$parts.part" ] || return 0
    kill -CONT "${ids[@]}" 2>/dev/null || true
    return 1
}

# A node without power: its daemon, and all that it started, before one of them can report the end of another.
lose_node() {
    wait_for 60 stop_node "$1"
    kill -KILL "${ids[@]}"
    say "node $1 is lost while it flies part $task (${#ids[@]} processes)"
}

# print_costs NAME FILE..: what GNU time wrote there, if it ran.
print_costs() {
    local name=$1
    shift
    awk -F': ' -v name="$name" '
        /Command being timed/ { runs++ }
        /(User|System) time/ { cpu += $2 }
        /Elapsed/ { n = split($NF, w, ":"); s = 0; for (i = 1; i <= n; i++) s = s * 60 + w[i]
            wall += s; if (runs == 1 || s < least) least = s }
        /Maximum resident/ && $2 > kb { kb = $2 }
        END { if (runs) printf "%s: %d runs, CPU %.1f s, wall %.1f s (shortest %.1f s), largest memory %.1f MB\n",
            name, runs, cpu, wall, least, kb / 1000 }' "$@"
}

try() {
    local flights=$1 parts=$2 task ids campaign jobs under
    campaign=(--batch "$flights" --campaign --seed 1)
    start_slurm
    say "two nodes are up, $(sinfo --version)"
    jobs=$(contrib/slurm/tello-batch.sbatch "$run/out" "$parts" "${campaign[@]}")
    say "$flights flights in $parts parts: ${jobs%; result*}"
    wait_for 3600 has_parts 2
    lose_node n2
    wait_for 14400 is_over
    [ -e "$run/out/result.txt" ] || fail "there is no result"
    say "merged; states of the nodes: $(sinfo -h -o '%N %T' -N | xargs)"
    jobs=${jobs#parts: job } jobs=${jobs%%;*}
    scontrol show job "${jobs}_$task" | grep -q "Restarts=[1-9]" ||
        fail "part $task was not started anew"
    say "part $task was started anew"
    read -ra under <<<"${TELLO_UNDER:-}"
    "${under[@]}" "$TELLO_CTL" sim "${campaign[@]}" >"$run/whole.txt" 2>"$run/whole.log" || [ $? -eq 1 ]
    print_costs parts "$run"/out/part-*.log
    print_costs merge "$run/out/merge.log"
    print_costs "one process" "$run/whole.log"
    cmp "$run/whole.txt" "$run/out/result.txt" || fail "merged and whole differ"
    say "the merged result has the $(wc -c <"$run/whole.txt") bytes of one process"
}

if ! install_slurm; then
    echo "Slurm cannot be fetched from Debian's packages" >&2
    exit 3
fi
[ "${1:-}" = --install ] && exit
TELLO_CTL=$(realpath "${TELLO_CTL:-${CARGO_TARGET_DIR:-target}/debug/tello-ctl}")
[ -x "$TELLO_CTL" ]
run=$(mktemp -d)
export TELLO_CTL SLURM_CONF=$run/slurm.conf PATH=$root/usr/bin:$PATH
export LD_LIBRARY_PATH=$libraries:$libraries/slurm-wlm
trap end_all EXIT
try "${1:-600}" "${2:-6}"
