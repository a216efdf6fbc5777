"""What does a cold start cost? Processor time of compilation in a first build of example 02, before and now.

    python benchmarks/cold.py [--turns N] [--small]

A build until the focus of the camera, whose work is next to nothing, with no kernels compiled; the same again with an
empty store and all kernels there. The difference is compilation. `--help` and a build that is finished are timed, too,
the least of five. With `--small` this commit alone, each once, and example 01 with the kernels that are there.
"""

import argparse
import time

from beside import BEFORE, EXAMPLE_02, Side, sides
from kept import keep

FOCUS = ("--until", "focus/Rig.Camera")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--turns", type=int, default=1, help="the least of so many")
    parser.add_argument("--small", action="store_true", help="this commit alone: does it run at all?")
    options = parser.parse_args()
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
