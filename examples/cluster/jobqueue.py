"""Build a dataset on workers that Slurm starts: python jobqueue.py STAGE [WORKERS]."""

import argparse
import sys

from dask_jobqueue import SLURMCluster

import pipeline
from pipeline.machine.processor import settings

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Build a dataset on workers that Slurm starts.")
    parser.add_argument("stage", help="the dataset")
    parser.add_argument("workers", nargs="?", type=int, default=16, help="so many at most")
    arguments = parser.parse_args()
    with SLURMCluster(
        cores=1,
        processes=1,
        memory="4GB",
        walltime="01:00:00",
        # Dask loads NumPy before the pipeline could tell it which code to choose.
        job_script_prologue=[f"export {name}={value}" for name, value in settings().items()],
        # Workers end before Slurm ends them, not all at the same time.
        worker_extra_args=["--lifetime", "55m", "--lifetime-stagger", "4m"],
    ) as cluster:
        cluster.adapt(minimum=1, maximum=arguments.workers)
        result = pipeline.build(arguments.stage, engine=f"dask:{cluster.scheduler_address}", retries=1)
    sys.exit(result.exit_code)
