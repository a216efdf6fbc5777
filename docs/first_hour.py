"""The first hour of a new user, step by step, in a fresh clone: what is typed, what is expected, and what came.

python docs/first_hour.py                 installs everything anew, as a newcomer does; minutes
python docs/first_hour.py --venv .venv    takes the libraries of a virtual environment, and the code of the clone

The clone is of the last commit. A step that gives something else than expected ends it, with 1. Without Chromium the
page is not opened, and the last line says so.
"""

import argparse
import csv
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import stones
from chromium import browser, found

ROOT = Path(__file__).resolve().parents[1]
BOARD = "examples/02_plenoptic/dataset.usda"
OUT = "build/02_plenoptic"
OF_A_BOARD = {"truth_tile", "truth", "image_tile", "image", "certificate", "sheet"}
"""Kinds of tasks that see the board: these, and no others, run again when it changes."""


class Unexpected(Exception):
    """Something else than was expected came."""


@dataclass
class Checkout:
    """A clone, and how commands run in it."""

    folder: Path
    venv: Path | None
    environment: dict[str, str] = field(default_factory=dict)

    def run(self, command: str) -> str:
        """Output of a command in the clone, as a user types it.

        Raises
        ------
        Unexpected
            It fails.
        """
        done = subprocess.run(
            command, shell=True, cwd=self.folder, env=self.environment, capture_output=True, text=True, errors="replace"
        )
        if done.returncode:
            raise Unexpected(f"{command} ends with {done.returncode}:\n{(done.stdout + done.stderr)[-3000:]}")
        return done.stdout + done.stderr

    def tasks(self, stage: str) -> list[dict[str, str]]:
        """Tasks of a plan, with their kinds and states."""
        tasks: list[dict[str, str]] = json.loads(self.run(f"pipeline plan {stage} --json"))["tasks"]
        return tasks


@dataclass(frozen=True)
class Step:
    """A step: `typed` is what a user does, and `expected` what must come of it."""

    typed: str
    expected: str
    do: Callable[[Checkout], str]


def expect(holds: bool, came: str) -> str:
    """What came, if it is as expected."""
    if not holds:
        raise Unexpected(came)
    return came


def clone(here: Checkout) -> str:
    subprocess.run(["git", "clone", "-q", str(ROOT), str(here.folder)], check=True)
    if here.venv is not None:
        (here.folder / ".venv").symlink_to(here.venv.resolve())
    named = [name for name in ("README.md", "Makefile", BOARD) if (here.folder / name).is_file()]
    return expect(len(named) == 3, f"{', '.join(named)} are there")


def demo(here: Checkout) -> str:
    installed = "-o .venv/.installed " if here.venv else ""
    said = here.run(f"make {installed}demo").splitlines()
    opened = [line.split()[1].rstrip(":") for line in said if line.startswith("Open ")]
    there = [path for path in opened if (here.folder / path).is_file()]
    return expect(len(there) == 3 == len(opened), f"{len(there)} of {len(opened)} files to open are there")


def open_report(here: Checkout) -> str:
    program = found()
    if program is None:
        return "NOT TRIED: no Chromium here (apt install chromium)"
    lines = (here.folder / OUT / "frames/0001/Rig.Camera/correspondences.csv").read_text().splitlines()
    first = next(csv.DictReader(line for line in lines if not line.startswith("#")))
    with browser(program) as tab:
        tab.look_as(1400, 900)
        tab.open(here.folder / f"{OUT}.report/index.html")
        verdict = tab.run("document.querySelector('header .pill').textContent")
        tab.run("document.documentElement.style.scrollBehavior = 'auto'")
        tab.run("document.querySelector('#images').scrollIntoView()")
        tab.wait("(one => one.scale && one.rows > 0)(document.querySelector('.viewer-stage').dataset)")
        tab.run("document.querySelector('.viewer-stage').focus()")
        tab.press("n")
        tab.wait("document.querySelector('[data-column=x_px]')")
        x_px = tab.run("document.querySelector('[data-column=x_px]').textContent")
        wrong = [*tab.errors, *(url for url in tab.requests if url.startswith("http"))]
    holds = verdict == "certificate passed" and x_px == first["x_px"] and not wrong
    return expect(holds, f"{verdict}; x_px of the first row {x_px}, in the table {first['x_px']}; {len(wrong)} errors")


def edit(here: Checkout) -> str:
    stage = here.folder / BOARD
    before = stage.read_text(encoding="utf-8")
    stage.write_text(before.replace("plen:squareSize = 2\n", "plen:squareSize = 2.1\n"), encoding="utf-8")
    planned = here.tasks(BOARD)
    again = {task["kind"].split("/")[0] for task in planned if task["state"] != "cached"}
    said = here.run(f"pipeline build {BOARD}")
    executed, cached = map(int, re.search(r"^(\d+) executed, (\d+) cached", said, re.MULTILINE).groups())  # type: ignore[union-attr]
    stage.write_text(before, encoding="utf-8")
    undone = here.run(f"pipeline build {BOARD}")
    holds = again == OF_A_BOARD and cached > 0 and undone.startswith("0 executed") | ("\n0 executed" in undone)
    kinds = ", ".join(sorted(again))
    return expect(holds, f"{executed} executed ({kinds}), {cached} cached; taken back: 0 executed")


def own(here: Checkout) -> str:
    here.run("pipeline new rig rig.usda --lens lenses/wide_22mm_nakamura.usda"
             " --sensor sensors/sensor_640x480_10um.usda --focus 500 --f-number 8")  # fmt: skip
    here.run("pipeline new dataset mine.usda --rig rig.usda --target targets/charuco_8x5.usda --fit --poses 6")
    checked = here.run("pipeline check mine.usda")
    expect("0 errors, 0 warnings" in checked, checked)
    here.run("pipeline build mine.usda")
    manifest = json.loads((here.folder / "build/mine/manifest.json").read_text(encoding="utf-8"))
    facts, (verdict,) = manifest["points"]["Rig.Camera"], manifest["certificate"].values()
    seen = sum(sum(frame["seen"].values()) for frame in facts["frames"])
    of = len(facts["frames"]) * sum(facts["of"].values())
    return expect(verdict["passed"] and seen == of, f"certificate passed, {seen} of {of} points seen in 6 frames")


def export(here: Checkout) -> str:
    here.run("pipeline export opencv build/mine")
    files = sorted(path.name for path in (here.folder / "exports/mine/opencv").iterdir())
    return expect({"Rig.Camera.npz", "Rig.Camera.yml"} <= set(files), f"exports/mine/opencv has {', '.join(files)}")


def calibrate(here: Checkout) -> str:
    """By OpenCV and the files of the export alone; the principal distance is compared with that of camera.json."""
    import cv2
    import numpy as np

    kept = np.load(here.folder / "exports/mine/opencv/Rig.Camera.npz")
    views = list(zip(kept["starts"][:-1], kept["starts"][1:], strict=True))
    objects, images = ([kept[name][a:b] for a, b in views] for name in ("object_points", "image_points"))
    flags = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3
    rms_px, matrix, *_ = cv2.calibrateCamera(objects, images, (640, 480), None, None, flags=flags)
    camera = json.loads((here.folder / "build/mine/cameras/Rig.Camera/camera.json").read_text(encoding="utf-8"))
    known_px = camera["pinhole"]["with_distortion"]["principal_distance_px"]
    off = matrix[0, 0] / known_px - 1
    return expect(
        rms_px < 0.02 and abs(off) < 2e-3, f"rms {rms_px:.4f} px; fx {matrix[0, 0]:.1f} px, known {known_px:.1f} px"
    )


def stumble(here: Checkout) -> str:
    """Mistakes that a new user made, and what came of them: each must be named with a way out."""
    trodden = [stone for stone in stones.STONES if not stone.is_gone(here.folder / "stones", here.environment)]
    return expect(not trodden, f"{len(stones.STONES) - len(trodden)} of {len(stones.STONES)} mistakes are named with a"
                  f" way out{''.join(f'; not: {stone.name}' for stone in trodden)}")  # fmt: skip


STEPS = (
    Step("git clone", "README.md, Makefile and the examples", clone),
    Step("make demo", "three files to open, all there", demo),
    Step(f"open {OUT}.report/index.html", "the verdict, and a row as in the table; no errors, no network", open_report),
    Step("edit plen:squareSize, build", "only tasks that see the board; none when it is taken back", edit),
    Step("pipeline new rig, new dataset, build", "no warning, all points seen, certificate passed", own),
    Step("pipeline export opencv", "files for OpenCV", export),
    Step("cv2.calibrateCamera", "rms below 0.02 px, principal distance to 0.2 %", calibrate),
    Step("mistakes of newcomers", "each named with a way out", stumble),
)


def walk(here: Checkout) -> Iterator[str]:
    """Do all steps; a line about each."""
    for number, step in enumerate(STEPS, 1):
        begun = time.monotonic()
        came = step.do(here)
        seconds = f"{time.monotonic() - begun:.0f} s"
        yield f"{number}. {step.typed}  ({seconds})\n   expected: {step.expected}\n   came:     {came}"


def main() -> int:
    """Walk through the hour; 1 where a step ends otherwise."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--venv", type=Path, help="take its libraries instead of installing them")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="first-hour-") as place:
        folder = Path(place) / "plenoptic-pipeline"
        kept = {name: value for name, value in os.environ.items() if not name.startswith(("PIPELINE_", "PXR_"))}
        kept["PATH"] = f"{folder / '.venv/bin'}:{kept['PATH']}"
        kept["PIPELINE_CACHE"] = str(Path(place) / "store")
        if asked.venv:
            kept["PYTHONPATH"] = str(folder)
        try:
            for line in walk(Checkout(folder, asked.venv, kept)):
                print(line, flush=True)
        except Unexpected as error:
            print(f"not as expected: {error}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
