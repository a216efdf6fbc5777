"""plenoptisign: distances of refocusing and viewpoints of an unfocused plenoptic camera, by paraxial formulas.

plenoptisign 1.1.3 of PyPI, Hahne et al. 2016 and 2017; pure Python with NumPy. It knows the principal planes and the
exit pupil. Its lengths along the axis count from the microlenses; so does its distance in focus, to which it iterates
the image distance until floats are equal. Its shift `a` and its views `G` are ours with the other sign.
"""

import json
from pathlib import Path
from typing import Any

from environments import called, installed

_PACKAGES = ("plenoptisign==1.1.3", "numpy==2.4.6")
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


def build(snapshots: Path, programs: Path) -> None:
    """Make an environment of its own; nothing of `snapshots` is needed."""
    installed(_PACKAGES, programs)


def run(programs: Path, task: Path, facts: dict[str, Any]) -> dict[str, Any]:
    """Vision z [mm] that pairs of shift and view make sharp, and places (x, z) of views [mm]."""
    b = facts["bench"]
    between_mm = b["front_z_mm"] + b["array_mm"] - b["to_rear_mm"]
    keys = {"pp": b["pixel_mm"], "fs": b["gap_mm"], "pm": b["pitch_mm"], "dA": b["to_pupil_mm"], "fU": b["focal_mm"]}
    in_focus_mm = 1 / (1 / b["focal_mm"] - 1 / b["to_rear_mm"]) + b["to_rear_mm"] + between_mm
    asked = json.dumps([keys | {"HH": between_mm, "df": in_focus_mm}, facts["refocused"], facts["views"]])
    command = [installed(_PACKAGES, programs), "-W", "ignore", "-c", _PROGRAM, asked]
    distances, places = json.loads(called(command, timeout=_LONGEST_S))
    before_mm = b["array_mm"]
    return {"distances_mm": [d - before_mm for d in distances], "views_mm": [[x, z - before_mm] for x, z in places]}
