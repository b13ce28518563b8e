#!/usr/bin/env bash
# Flies all of rows/, second/, far/, rigid_body/ and late.txt again: fly.sh PROGRAM, from the root of the repository.
set -euo pipefail
program=$1
here=docs/benchmarks/2026-11-23-dead-time

# fly FILE ARGUMENTS...: a batch of 200 flights and its table, the command first.
fly() {
    local file=$here/$1
    shift
    local command=(sim --batch 200 --seed 1001 "$@")
    echo "tello-ctl ${command[*]}" >"$file"
    "$program" "${command[@]}" >>"$file" 2>/dev/null || true # 1: not all flights finished
}

mkdir -p $here/{rows,second,far,rigid_body}
fly rows/square.txt
fly rows/square_at_once.txt --mission configs/missions/square_at_once.json
fly rows/outages.txt --profile outages
fly rows/outages_at_once.txt --profile outages --mission configs/missions/square_at_once.json
fly rows/bad_day.txt --profile bad_day
fly rows/hover.txt --hover 30
for mission in big_square arc cross figure_eight; do
    fly rows/$mission.txt --mission configs/missions/$mission.json
done
fly second/none.txt --earlier 1
fly rigid_body/none.txt --plant rigid_body
fly rigid_body/hover.txt --plant rigid_body --hover 30
fly rigid_body/outages.txt --plant rigid_body --profile outages
fly rigid_body/wind=0.5.txt --plant rigid_body --vary wind=0.5
for change in gain=0.7 gain=1.3 dead_time=-0.1 dead_time=+0.1 lag=0.7 lag=1.4 theta_0=-0.3 theta_0=+0.3; do
    fly rows/vary_$change.txt --vary $change
    fly second/$change.txt --vary $change --earlier 1
    fly rigid_body/$change.txt --plant rigid_body --vary $change
done
for change in dead_time=-0.25 dead_time=-0.15 dead_time=+0.2 dead_time=+0.28; do
    fly far/$change.txt --vary $change
    fly far/second_$change.txt --vary $change --earlier 1
done
for plant in fitted rigid_body; do
    for later_s in 0.4 0.6 1; do
        echo "\$ tello-ctl sim --batch 40 --plant $plant --vary dead_time=$later_s"
        "$program" sim --batch 40 --plant $plant --vary dead_time=$later_s 2>/dev/null || true
        echo
    done
done >$here/late.txt
