#!/bin/sh
# Trains the five shipped policies side by side, and puts them and their logs into a folder:
#
#   all.sh PROGRAM MINUTES OUT
#
# PROGRAM is the program `mishandle`. Each policy has MINUTES of wall-clock time, an equal share of
# the CPU cores and, in turn, one of the GPUs. OUT then has TASK/vision.onnx and TASK.jsonl.
set -eu
program=$(realpath "$1")
minutes=$2
mkdir -p "$3"
out=$(realpath "$3")
here=$(dirname "$(realpath "$0")")
tasks="point-reaching ball-pushing peg-in-hole door-opening cube-stacking"
cores=$(nproc)
gpus=$(nvidia-smi --list-gpus 2>/dev/null | wc -l)
[ "$gpus" -gt 0 ] || gpus=1
index=0
for task in $tasks; do
    (
        folder=$(mktemp -d)
        CUDA_VISIBLE_DEVICES=$((index % gpus)) python3 "$here/train.py" "$task" --mishandle "$program" \
            --out "$folder/policy" --minutes "$minutes" --rounds 100 --episodes 128 --student-episodes 64 \
            --threads $(((cores + 4) / 5)) --choose 64 --evaluate 0 >"$folder/output" 2>&1 ||
            cat "$folder/output" >&2
        mkdir -p "$out/$task"
        cp "$folder/policy/log.jsonl" "$out/$task.jsonl"
        cp "$folder/policy/policy.onnx" "$out/$task/vision.onnx"
    ) &
    index=$((index + 1))
done
wait
