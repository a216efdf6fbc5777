#!/usr/bin/env bash
# Slurm without Dask: what can run now goes as one array job; then what can run after that, until nothing is left.
# Usage: examples/cluster/array.sh STAGE        (SBATCH="--partition=long --time=1:00:00 --mem=4G" for example)
set -euo pipefail
stage=$1
specs=$(mktemp -d "$PWD/specs.XXXX") # below the working directory, which all nodes see
trap 'rm -rf "$specs"' EXIT

while :; do
    code=0
    pipeline plan "$stage" --specs "$specs" --exit-code || code=$?
    [ "$code" -eq 0 ] && break # nothing to do
    [ "$code" -eq 3 ] || exit "$code"
    last=$(($(ls "$specs" | wc -l) - 1))
    sbatch --wait --array="0-$last" ${SBATCH:-} --wrap "pipeline run-task $specs/\$SLURM_ARRAY_TASK_ID.json"
done
pipeline build "$stage" -j1 # everything is a hit: it only fills the output folder
