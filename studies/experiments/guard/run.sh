#!/bin/sh
# Tunes the guard of each task and measures it: sh studies/experiments/guard/run.sh FOLDER [TASK...]
#
# A second call continues an interrupted one. MISHANDLE names the program; set TRAINING, HELD_OUT,
# SEED and FALSE_ALARMS for other settings.
set -eu
here=$(dirname "$0")
folder=$1
shift
[ $# -gt 0 ] || set -- point-reaching ball-balancing ball-pushing door-opening peg-in-hole \
    ball-catching cube-stacking cloth-placing
mkdir -p "$folder"
for task; do
    # The hardened controller, or that of the first generation where none is.
    controller="$here/../hardening/$task.safetensors"
    [ "$task" = ball-catching ] && controller="$here/../hardening/ball-catching-2.safetensors"
    [ -f "$controller" ] || controller=ppo
    for guard in "$here/$task".toml "$here/$task"-*.toml; do
        [ -f "$guard" ] || continue
        name=$(basename "$guard" .toml)
        ${MISHANDLE:-mishandle} guard "$task" --tune --controller "$controller" --guard "$guard" \
            --space starts+delay+sensing+faults-sensing --axis action_delay=0:2 --axis observation_delay=0:2 --episodes "${TRAINING:-500}" \
            -k "tune.held-out=${HELD_OUT:-500}" --seed "${SEED:-1}" -k "tune.false-alarms=${FALSE_ALARMS:-0.2}" --out "$folder/$name" --json \
            > "$folder/$name.json.part" && mv "$folder/$name.json.part" "$folder/$name.json" ||
            echo "$name: no result" >&2 # such as too few failures to choose from
    done
done
