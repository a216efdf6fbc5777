"""PlenopticToolbox 2.0: disparity of every pixel of the micro-images of a focused camera, Palmieri et al. 2018.

freerafiki/PlenopticToolbox2.0 79f2761, Python and Cython. It reads the export `raytrix`, which knows hexagonal rows of
three types, and one image. Its centres are (row, column), its disparities pixels per pitch of microlenses, whatever the
sign. Its types are those that it reads. Each micro-image has the disparities of a square as wide as its diameter.
"""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
from environments import Failed, called, installed
from snapshots import clone

_PACKAGES = (
    "Cython==3.0.12",
    "matplotlib==3.11.2",
    "numpy==1.26.4",
    "opencv-python-headless==4.10.0.84",
    "scikit-image==0.22.0",
    "scipy==1.12.0",
    "setuptools==65.5.0",
)
_PROGRAM = """
import sys
import matplotlib
matplotlib.use("Agg")
import numpy as np
import disparity.disparity_methods as methods
asked = methods.EvalParameters()
asked.filename, asked.min_disp, asked.max_disp, asked.num_disp = sys.argv[1:5]
asked.technique, asked.method, asked.scene_type, asked.analyze_err = "sad", "real_lut", "real", False
asked.confidence_technique = "mlm"
kept = []
def keep(lenses, images):
    if not kept:
        pairs = [(lenses[key].pcoord, images[key]) for key in lenses]
        kept.extend(map(np.array, zip(*pairs)))
    return np.zeros((2, 2))
methods.rtxrender.render_lens_imgs = keep
methods.estimate_disp(asked)
np.savez(sys.argv[5], centre=kept[0], disparity=kept[1])
"""
"""What it would paint into one image is kept as it is: disparities of each micro-image, the regularised ones first."""


def build(snapshots: Path, programs: Path) -> None:
    """Check the source out, and compile its module where it looks for it."""
    place = programs / "plenoptictoolbox"
    if clone(snapshots, "freerafiki/PlenopticToolbox2.0", place):
        called([installed(_PACKAGES, programs), "setup.py", "build_ext", "--inplace"], cwd=place / "python")
        for module in (place / "python").glob("sgm_cost_path*.so"):
            module.rename(place / "python/disparity" / module.name)


def run(programs: Path, task: Path, facts: dict[str, Any]) -> dict[str, Any]:
    """Disparities in the last tilted board at the middle distance, between a fifth and 0.55 of the pitch."""
    export, work = task / f"exports/raytrix/{facts['camera']}.xml", programs / "runs/plenoptictoolbox"
    if "raytrix" not in facts["formats"]:
        raise Failed("its calibration files know hexagonal rows of three types alone")
    work.mkdir(parents=True, exist_ok=True)
    frame = facts["frames"][2 * len(facts["frames"]) // 3 - 1]
    shutil.copy(export, work / "image.xml")
    shutil.copy(task / f"{frame}.png", work / "image.png")
    range_px = [round(part * facts["pitch_px"], 2) for part in (0.2, 0.55)]
    place = programs / "plenoptictoolbox/python"
    command = [installed(_PACKAGES, programs), "-c", _PROGRAM, work / "image.xml", *range_px, 36, work / "found.npz"]
    called(command, cwd=place / "samples", env={"PYTHONPATH": str(place)})  # it looks for ../disparity
    found = np.load(work / "found.npz")
    return {"frame": int(frame), "centre_px": found["centre"][:, ::-1], "disparity_px": found["disparity"]}
