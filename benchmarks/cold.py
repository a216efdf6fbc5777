"""What does a cold start cost? Processor and clock time of kernels and first builds, now and at a commit before.

    python benchmarks/cold.py [--before COMMIT] [--turns N] [--examples NAME ...] [--small] [--clone]

Each turn has folders of its own for kernels and results, and both sides take turns. One process compiles all groups of
kernels, one after the other. Then each example is built with no kernels there, by the usual number of workers, and
again when all of it is finished. With `--small` this commit alone, until the camera of example 01 is settled, with the
kernels that are there. With `--clone` what a newcomer waits for, of this commit: an environment, the picture of `make
demo`, and what tests need.
"""

import argparse
import os
import subprocess
import tempfile
import time
from pathlib import Path

from beside import ROOT, Side, sides
from kept import keep, processor

EXAMPLES = "01_conventional", "02_plenoptic", "05_scene"
SETTLED = ("--until", "camera/Rig.Camera")
_GROUPS = """
import time
from pipeline.app.build import STEPS
from pipeline.app.compile_kernels import compile_kernels
for count, step in enumerate(STEPS, 1):
    start, cpu = time.monotonic(), time.process_time()
    compile_kernels(STEPS[:count])
    print(step, time.process_time() - cpu, time.monotonic() - start)
"""
Seconds = dict[str, tuple[float, float]]
"""Of the processor and by the clock, by what takes them."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", default="HEAD~", metavar="COMMIT", help="the commit to compare with")
    parser.add_argument("--turns", type=int, default=3, help="the least of so many")
    parser.add_argument("--examples", nargs="*", choices=EXAMPLES, default=EXAMPLES, metavar="NAME")
    parser.add_argument("--small", action="store_true", help="this commit alone: does it run at all?")
    parser.add_argument("--clone", action="store_true", help="from an empty clone to the first picture")
    options = parser.parse_args()
    if options.clone:
        tell_of_clone()
        return
    examples, turns = (EXAMPLES[:1], 1) if options.small else (options.examples, options.turns)
    with sides(options.before, now_alone=options.small) as compared:
        rows = {side.name: list[Seconds]() for side in compared}
        for turn in range(turns):
            for side in compared:
                kernels = "" if options.small else f"kernels {turn}"
                groups = {} if options.small else groups_of(side, f"groups {turn}")
                rows[side.name].append(groups | builds_of(side, examples, kernels, SETTLED if options.small else ()))
                tell({name: least(of_turns) for name, of_turns in rows.items() if of_turns})
    if not options.small:
        keep("cold", {"before": options.before, "sides": {name: least(of_turns) for name, of_turns in rows.items()}})


def least(turns: list[Seconds]) -> Seconds:
    """The least of some turns, each for itself."""
    seconds = {key: (min(row[key][0] for row in turns), min(row[key][1] for row in turns)) for key in turns[0]}
    return {key: (round(cpu_s, 2), round(took_s, 2)) for key, (cpu_s, took_s) in seconds.items()}


def tell(sides_seconds: dict[str, Seconds]) -> None:
    """A table of all sides so far."""
    print(processor(), "CPU s, and s by the clock", *(f"{name:>16}" for name in sides_seconds), sep="  ")
    for key in max(sides_seconds.values(), key=len):  # a commit may not have a group
        figures = "".join(
            f"{row.get(key, (0, 0))[0]:10.1f}{row.get(key, (0, 0))[1]:8.1f}" for row in sides_seconds.values()
        )
        print(f"{key:32s}{figures}", flush=True)


def groups_of(side: Side, kernels: str) -> Seconds:
    """Each group of kernels after those before it, in one process, and all of them."""
    seconds_of = {}
    for line in side.run(_GROUPS, kernels=kernels):
        step, *seconds = line.split()
        seconds_of[f"kernels, {step}"] = float(seconds[0]), float(seconds[1])
    total = sum(cpu_s for cpu_s, _ in seconds_of.values()), sum(took_s for _, took_s in seconds_of.values())
    return {**seconds_of, "all kernels": total}


def builds_of(side: Side, examples: tuple[str, ...], kernels: str, until: tuple[str, ...]) -> Seconds:
    """First builds, each without kernels, if `kernels` names a folder for them; and the same when they are finished."""
    seconds_of = {}
    for example in examples:
        places = {"kernels": kernels and f"{kernels} {example}", "store": f"store {kernels} {example}"}
        out = str(side.home / f"out {kernels} {example}")
        for build in ("first build of", "finished build of"):
            start = time.monotonic()
            cpu_s = side.cpu_s("build", f"examples/{example}/dataset.usda", *until, "-o", out, **places)
            seconds_of[f"{build} {example}"] = cpu_s, time.monotonic() - start
    return seconds_of


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


if __name__ == "__main__":
    main()
