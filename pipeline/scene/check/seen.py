"""Warnings about targets of which a camera sees nothing or little: the frames, and the reason.

This check works on records, after all other checks.
"""

from collections.abc import Iterator

import numpy as np
from pxr import Usd

from pipeline.camera.figures.outlook import Fate, covered_mm, widest_blur_px
from pipeline.camera.focusing.depth_of_field import focused, middle_focus
from pipeline.camera.parts.camera import Camera
from pipeline.errors import PipelineError
from pipeline.scene.dataset import Dataset
from pipeline.scene.usd.hints import of_reader
from pipeline.scene.usd.problems import Problem
from pipeline.scene.usd.source_locations import problem
from pipeline.scene.views import HIDDEN, MERGED, View, look
from pipeline.spelling import frames_in_words

NOT_SEEN = ("blank", "few-points")
"""Codes of these warnings, which a build repeats before its first task."""
_FEW = 0.25
"""Share of the points that face a camera below which a frame is named [1]: calibrations gain little by such frames, and
boards that reach over the edge of the image on purpose show more."""


def check_seen(stage: Usd.Stage, dataset: Dataset) -> Iterator[Problem]:
    """Warnings for each camera and target if the camera sees no point, or few points, of the target in some frames."""
    for entry in dataset.cameras:
        try:
            camera = focused(entry.camera)
        except (PipelineError, ArithmeticError) as error:
            yield of_reader(stage.GetPrimAtPath(entry.prim_path), error)
            continue
        for number, target in enumerate(dataset.targets):
            if not target.target.points().kinds:
                continue  # the target has no points
            view = look(dataset, entry.name, camera, number)
            prim = stage.GetPrimAtPath(target.prim_path)
            fates = {frame: fate for frame, fate in zip(view.numbers, view.fates, strict=True) if fate is not None}
            is_few = (view.share > 0) & (view.share < _FEW)
            told = ("no point", view.share == 0), ("less than a quarter of the points", is_few)
            for code, (sees, which) in zip(NOT_SEEN, told, strict=True):
                missed = {frame: fates[frame] for frame in np.array(view.numbers)[which].tolist()}
                if missed:
                    whom = f'"{entry.name}" sees {sees} of "{prim.GetName()}"'
                    message = f"{whom} in {len(missed)} of {len(view.numbers)} frames: {_listed(missed)}"
                    yield problem(prim, code, message, hint=_hint(camera, view, missed), severity="warning")


def _listed(missed: dict[int, int]) -> str:
    """A list of frames by the reason why points are missing there, as text."""
    reasons = dict.fromkeys(_REASONS[fate] for fate in missed.values())
    frames = {
        reason: frames_in_words(number for number, fate in missed.items() if _REASONS[fate] == reason)
        for reason in reasons
    }
    return "; ".join(f"{numbers} ({reason})" for reason, numbers in frames.items())


_REASONS = {
    Fate.AWAY: "it shows its back",
    Fate.NO_LIGHT: "out of view",
    Fate.BLURRED: "out of focus",
    Fate.OUTSIDE: "out of view",
    HIDDEN: "hidden",
    MERGED: "too far away or too blurred to tell its points apart",
}


def _turned_deg(points_mm: np.ndarray, front: np.ndarray) -> float:
    """Median angle between the front of points and their direction to the camera [deg]; 180 shows the back."""
    cosine = -np.sum(points_mm * front, axis=-1) / np.linalg.norm(points_mm, axis=-1)
    return float(np.degrees(np.arccos(np.clip(np.median(cosine), -1.0, 1.0))))


def _hint(camera: Camera, view: View, missed: dict[int, int]) -> str:
    """A hint to mend the first frame."""
    number, fate = next(iter(missed.items()))
    index = view.numbers.index(number)
    x, y, z = view.points_mm[index].mean(axis=0)
    if fate == Fate.AWAY:
        turned = _turned_deg(view.points_mm[index], view.front[index])
        return f"in frame {number} its front, +Z, looks {turned:.0f} degrees past the camera: turn it about its X or Y"
    if fate == HIDDEN:
        return "move it, or the object in front of it"
    if fate == MERGED:
        spacing, blur = view.spacing_px[index], np.median(view.outlook.blur_px[index])
        apart = f"{spacing:.2g} px apart{' in a micro-image' if camera.microlenses else ''}"
        return f"in frame {number}, {z:.4g} mm before the stop, points are {apart} and blur to {blur:.3g} px"
    if fate == Fate.BLURRED:
        blur, of = np.median(view.outlook.blur_px[index]), "a micro-image" if camera.microlenses else "the image"
        return (
            f"in frame {number} it is {z:.4g} mm before the stop, and the focus at {middle_focus(camera):.4g} mm: its"
            f" points blur to {blur:.3g} px, and {of} is {widest_blur_px(camera):.3g} px wide"
        )
    width, height = covered_mm(camera, float(z))
    across, down = ("left" if x < 0 else "right"), ("above" if y < 0 else "below")
    return (
        f"in frame {number} it is {abs(x):.1f} mm to the {across} of the axis and {abs(y):.1f} mm {down} it;"
        f" {z:.4g} mm before the stop the image covers about {width:.3g} x {height:.3g} mm"
    )
