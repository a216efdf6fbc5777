"""What does a cold start cost? Processor time of compilation in a first build of example 02, before and now.

    python benchmarks/cold.py [--turns N] [--small] [--clone]

A build until the focus of the camera, whose work is next to nothing, with no kernels compiled; the same again with an
empty store and all kernels there. The difference is compilation. `--help` and a build that is finished are timed, too,
the least of five. With `--small` this commit alone, each once, and example 01 with the kernels that are there. With
`--clone` what a newcomer waits for, of this commit: an environment, the picture of `make demo`, and what tests need.
"""

import argparse
import os
import subprocess
import tempfile
import time
from pathlib import Path

from beside import BEFORE, EXAMPLE_02, ROOT, Side, sides
from kept import keep

FOCUS = ("--until", "camera/Rig.Camera")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--turns", type=int, default=1, help="the least of so many")
    parser.add_argument("--small", action="store_true", help="this commit alone: does it run at all?")
    parser.add_argument("--clone", action="store_true", help="from an empty clone to the first picture")
    options = parser.parse_args()
    if options.clone:
        tell_of_clone()
        return
    with sides(now_alone=options.small) as found:
        least_of = 1 if options.small else 5
        stage = EXAMPLE_02.replace("02_plenoptic", "01_conventional") if options.small else EXAMPLE_02
        places = ["" if options.small else f"kernels{turn}" for turn in range(options.turns)]
        rows = {side.name: [measure(side, stage, place, least_of) for place in places] for side in found}
    least = {name: {key: min(row[key] for row in turns) for key in turns[0]} for name, turns in rows.items()}
    print(f"{'CPU s':10s}{'compile':>10s}{'by the clock':>14s}{'--help':>9s}{'finished':>10s}")
    for name, row in least.items():
        print(
            f"{name:10s}{row['compile_cpu_s']:10.1f}{row['wall_s']:14.1f}{row['help_cpu_s']:9.2f}{row['done_cpu_s']:10.2f}"
        )
    if len(least) == 2:
        before, now = (row["compile_cpu_s"] for row in least.values())
        print(f"compilation takes {now / before:.2f} of what it took")
        keep("cold", {"before": BEFORE, "stage": EXAMPLE_02, "sides": least, "ratio": round(now / before, 3)})


def tell_of_clone() -> None:
    """Processor and clock time of each step in an empty clone, and the size of its environment."""
    with tempfile.TemporaryDirectory() as name:
        clone = Path(name) / "clone"
        subprocess.run(["git", "clone", "-q", str(ROOT), str(clone)], check=True)
        places = {"PIPELINE_CACHE": f"{name}/store", "PIPELINE_JIT_CACHE": f"{name}/kernels"}
        environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"} | places
        for goal in (".venv/.core", "demo", ".venv/.installed"):
            before, start = os.times(), time.monotonic()
            subprocess.run(["make", "-s", goal], cwd=clone, env=environment, check=True, stdout=subprocess.DEVNULL)
            now, took_s = os.times(), time.monotonic() - start
            cpu_s = now.children_user + now.children_system - before.children_user - before.children_system
            size = sum(path.lstat().st_blocks * 512 for path in (clone / ".venv").rglob("*"))
            print(f"make {goal:18s}{cpu_s:8.1f} CPU s {took_s:8.1f} s by the clock {size / 1e6:8.0f} MB")


def measure(side: Side, stage: str, kernels: str, least_of: int) -> dict[str, float]:
    """Seconds of one side with kernels in a folder of this name; short ones are the least of so many."""
    places = {"kernels": kernels, "store": f"store {kernels}"}
    start = time.monotonic()
    cold = side.cpu_s("build", stage, *FOCUS, "-o", str(side.home / "out"), **places)
    took = time.monotonic() - start
    warm = side.cpu_s("build", stage, *FOCUS, "-o", str(side.home / "out"), **{**places, "store": f"again {kernels}"})
    done = min(side.cpu_s("build", stage, *FOCUS, "-o", str(side.home / "out"), **places) for _ in range(least_of))
    found = {"compile_cpu_s": cold - warm, "wall_s": took, "done_cpu_s": done}
    return {
        key: round(value, 2)
        for key, value in {**found, "help_cpu_s": min(side.cpu_s("--help") for _ in range(least_of))}.items()
    }


if __name__ == "__main__":
    main()
