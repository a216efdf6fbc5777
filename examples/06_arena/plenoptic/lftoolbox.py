"""LFToolbox 0.5.3 in GNU Octave with image: the grid of micro-images from a white image, and its centres.

doda42/LFToolbox 3bf4f55. It reads white.png alone. Pixels count from 1; returned are ours, with rows from the top. Two
functions that Octave lacks are in octave/: the nearest neighbours of a triangulation. Decoding wants
griddedInterpolant, corners want detectCheckerboardPoints, which Octave 7 lacks, too: these steps do not run.
"""

from pathlib import Path
from typing import Any

import numpy as np
from snapshots import clone, octave, replaced


def build(snapshots: Path, programs: Path) -> None:
    """Check the source out; the radius of its filter becomes a whole number of pixels, as Octave wants it."""
    place = programs / "lftoolbox"
    if clone(snapshots, "doda42/LFToolbox", place):
        radius = "GridModelOptions.ApproxLensletSpacing * GridModelOptions.FilterDiskRadiusMult"
        replaced(place / "SupportFunctions/LFBuildLensletGridModel.m", radius, f"round({radius})")


def run(programs: Path, task: Path, facts: dict[str, Any]) -> dict[str, Any]:
    """Let it find the grid; the disc of its filter is a third of the pitch, as it has it for Lytro's cameras."""
    found = octave(
        "pkg load image; pitch = str2double(getenv('ARENA_INPUT'));"
        " white = double(imread('white.png')(:, :, 1)) / 255;"
        " options = struct('ApproxLensletSpacing', pitch, 'FilterDiskRadiusMult', 1 / 3,"
        " 'CropAmt', 2 * pitch, 'SkipStep', 10, 'Orientation', 'horz', 'Precision', 'double');"
        " [model, centres] = LFBuildLensletGridModel(white, options);",
        "centres",
        [programs / "lftoolbox", programs / "lftoolbox/SupportFunctions"],
        task,
        round(facts["pitch_px"], 1),
    )
    return {"centres_px": np.reshape(found, (-1, 2)) - 1}
