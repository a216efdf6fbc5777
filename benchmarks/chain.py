"""What does truth cost? Processor time of the truth of example 02 and of one pose of the paper's rig, before and now.

    python benchmarks/chain.py [--small]

Builds of one worker until a task, with all kernels compiled before; what a build until the camera's focus takes is
subtracted, so that starting Python does not count. Example 02 as its stage says, by the default method of each commit;
the rig of the paper in full, 2173 x 2173 pixels, one board of 40 corners, by `direct` to 0.001 px. The share of the
certificate is what it takes more than the tables: a small difference, so that start and certificate are the least of
three. With `--small` this commit, the rig and one turn alone.
"""

import argparse
import shutil
from pathlib import Path

from beside import BEFORE, EXAMPLE_02, Side, sides
from kept import keep

CAMERA = "Rig.Camera"
STAGE = """#usda 1.0
(
    defaultPrim = "Full"
    endTimeCode = 1
    metersPerUnit = 0.001
    startTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Y"
)

def PlenDataset "Full"
{
    rel plen:cameras = </Full/Rig/Camera>
    rel plen:targets = </Full/Board>

    def "Rig" (
        prepend references = @rigs/plenoptic_michels_2019.usda@
        variants = {
            string sensor = "full"
        }
    )
    {
        over "Camera"
        {
            uniform double plen:truth:accuracy = 0.001
            uniform token plen:truth:method = "direct"
        }
    }

    def PlenCheckerboard "Board"
    {
        uniform int plen:columns = 8
        uniform int plen:rows = 5
        uniform double plen:squareSize = 2
        quatd xformOp:orient.timeSamples = {
            1: (0.9844702839913732, 0.004545579370543608, 0.17358867277340387, -0.02577926164379328),
        }
        double3 xformOp:translate.timeSamples = {
            1: (-1, 0.5, -420),
        }
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]
    }
}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="this commit, rig and turn alone: does it run at all?")
    options = parser.parse_args()
    figures = {}
    with sides(now_alone=options.small) as compared:
        for side in compared:
            (side.home / "dataset.usda").write_text(STAGE, encoding="utf-8")
            figures[side.name] = {
                "full rig, one pose": measure(side, str(side.home / "dataset.usda"), 1 if options.small else 3)
            }
            if not options.small:
                figures[side.name]["example 02"] = measure(side, EXAMPLE_02, 3)
    for stage in figures["now"]:
        for name, rows in figures.items():
            row = rows[stage]
            share = row["certificate_cpu_s"] / row["truth_cpu_s"]
            print(f"{stage:20s}{name:10s}truth {row['truth_cpu_s']:6.1f} CPU s, certificate {share:.0%} of that")
    if len(figures) == 2:
        totals = [{stage: sum(row.values()) for stage, row in rows.items()} for rows in figures.values()]
        ratios = {stage: round(totals[1][stage] / totals[0][stage], 3) for stage in totals[0]}
        print("; ".join(f"{stage}: {ratio:.2f} of what it took" for stage, ratio in ratios.items()))
        keep("chain", {"before": BEFORE, "sides": figures, "ratios": ratios})


def measure(side: Side, stage: str, turns: int) -> dict[str, float]:
    """Processor time of the tables of a stage with all that they need, and of the certificate [s]."""
    until(side, stage, f"camera/{CAMERA}", "kernels")  # a build compiles what all its tasks need
    start = min(until(side, stage, f"camera/{CAMERA}", f"start{turn}") for turn in range(turns))
    truth = until(side, stage, f"truth/{CAMERA}/*", "truth")
    for turn in range(turns):
        shutil.copytree(folder(side, stage, "truth"), folder(side, stage, f"judged{turn}"))
    judged = min(until(side, stage, f"certificate/{CAMERA}", f"judged{turn}") for turn in range(turns))
    return {"truth_cpu_s": round(truth - start, 2), "certificate_cpu_s": round(judged - start, 2)}


def until(side: Side, stage: str, task: str, store: str) -> float:
    """Processor time of a build by one worker that ends with a task."""
    out = str(side.home / "out")
    return side.cpu_s("build", stage, "-j", "1", "--until", task, "-o", out, store=folder(side, stage, store).name)


def folder(side: Side, stage: str, store: str) -> Path:
    """The store of this name for a stage."""
    return side.home / f"{store} {len(stage)}"


if __name__ == "__main__":
    main()
