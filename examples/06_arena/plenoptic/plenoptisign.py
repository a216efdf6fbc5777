"""plenoptisign: distances of refocusing and viewpoints of an unfocused plenoptic camera, by paraxial formulas.

hahnec/plenoptisign 112d289, Hahne et al. 2016 and 2017; pure Python with NumPy. It knows the principal planes and the
exit pupil. Its lengths along the axis count from the microlenses; so does its distance in focus, to which it iterates
the image distance until floats are equal. Its shift `a` and its views `G` are ours with the other sign.
"""

import json
import subprocess
import sys
from pathlib import Path

from refocus import Bench
from snapshots import clone

_COMMIT = "112d289"
_LONGEST_S = 60
"""Time limit [s]: its iteration may go to and fro between two floats for ever."""
_PROGRAM = """
import json, sys
from plenoptisign import MainClass
optics, refocused, views = json.loads(sys.argv[1])
answer = [[], []]
for shift, view in refocused:
    camera = MainClass(optics | {"a": -shift, "M": 2 * view + 1})
    camera.refo()
    answer[0].append(float(camera.d))
for view in views:
    camera = MainClass(optics | {"G": -view, "dx": 1})
    camera.tria()
    answer[1].append([float(camera.B), float(camera._ent_pup_pos)])
print(json.dumps(answer))
"""
"""In a process of its own: this module has its name."""


def build(snapshots: Path, folder: Path) -> None:
    """Check the source out."""
    clone(snapshots, "hahnec+plenoptisign", _COMMIT, folder / "plenoptisign")


def run(
    folder: Path, optics: Bench, refocused: list[tuple[float, float]], views: list[float]
) -> tuple[list[float], list[list[float]]]:
    """Vision z [mm] that pairs of shift and view make sharp, and places (x, z) of views [mm]."""
    image_mm, focal_mm = optics.to_rear_mm, optics.focal_mm
    between_mm = optics.front_z_mm + optics.array_mm - image_mm
    keys = {"pp": optics.pixel_mm, "fs": optics.gap_mm, "pm": optics.pitch_mm, "dA": optics.to_pupil_mm}
    keys |= {"fU": focal_mm, "HH": between_mm, "df": 1 / (1 / focal_mm - 1 / image_mm) + image_mm + between_mm}
    asked = json.dumps([keys, refocused, views])
    command = [sys.executable, "-W", "ignore", "-c", _PROGRAM, asked]
    place = folder / "plenoptisign"
    printed = subprocess.run(command, cwd=place, capture_output=True, text=True, timeout=_LONGEST_S, check=True).stdout
    distances, places = json.loads(printed)
    return [d - optics.array_mm for d in distances], [[x, z - optics.array_mm] for x, z in places]
