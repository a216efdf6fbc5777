#!/usr/bin/env bash
# A scheduler and WORKERS workers on this machine; more machines join with the same `dask worker` line.
# Usage: examples/cluster/laptop.sh STAGE [options of pipeline build]
set -euo pipefail
folder=$(mktemp -d)
trap 'kill $(jobs -p) 2>/dev/null; rm -rf "$folder"' EXIT
file=$folder/scheduler.json

# Dask loads NumPy before the pipeline could tell it which code to choose.
export $(python -c 'from pipeline.machine.processor import settings; print(*(f"{k}={v}" for k, v in settings().items()))')

dask scheduler --host 127.0.0.1 --port 0 --no-dashboard --scheduler-file "$file" 2>"$folder/scheduler.log" &
until [ -s "$file" ]; do sleep 0.1; done
for _ in $(seq "${WORKERS:-2}"); do
    dask worker --scheduler-file "$file" --nthreads 1 --no-dashboard 2>>"$folder/workers.log" &
done

pipeline build "$@" --engine "dask:$file"
