"""Targets and occluders of a frame, from the params of the tasks `image`, `truth` and `verify`."""

from dataclasses import replace
from typing import TypeVar

import numpy as np

from pipeline.camera.rig import Rig
from pipeline.motion import Motion, Shutter
from pipeline.products.views import PlacedOccluder, PlacedTarget, PlacedView
from pipeline.records.plain import from_plain
from pipeline.render.surroundings import Surroundings
from pipeline.targets.mesh import Occluder
from pipeline.targets.target import AnyTarget, target_from_plain
from pipeline.truth.planes import Planes
from pipeline.truth.rows import Solutions
from pipeline.truth.visibility import PointBundles, visibility

_TIMES = 33
"""Instants of a frame in which moving things hide rows [1]: each row is hidden as in the nearest one."""
View = TypeVar("View", bound=PlacedView)


def placed_target(entry: PlacedTarget) -> tuple[AnyTarget, np.ndarray]:
    """A target and its pose vision_from_target, (4, 4) [mm]."""
    return target_from_plain(entry.target), np.array(entry.vision_from_target)


def placed_occluder(entry: PlacedOccluder) -> tuple[Occluder, np.ndarray]:
    """An occluder and its pose vision_from_occluder, (4, 4) [mm]."""
    return from_plain(Occluder, entry.occluder), np.array(entry.vision_from_occluder)


def surroundings_of(view: PlacedView) -> Surroundings:
    """All targets of a frame, in their order, and all occluders."""
    return Surroundings(list(map(placed_target, view.targets)), list(map(placed_occluder, view.occluders)))


def surroundings_at(
    view: PlacedView, shutter: Shutter | None, size_px: tuple[int, int]
) -> tuple[np.ndarray, list[Surroundings]]:
    """Instants (n,) [s] while a shutter is open, and targets and occluders of a frame at each; of a still, at one."""
    if shutter is None or not moves(view):
        return np.zeros(1), [surroundings_of(view)]
    times_s = np.linspace(*shutter.window_s(size_px), _TIMES)
    return times_s, [surroundings_of(view_at(view, time)) for time in times_s.tolist()]


def visibility_then(
    rig: Rig, around: tuple[np.ndarray, list[Surroundings]], target: int, planes: Planes, rows: Solutions
) -> np.ndarray:
    """Visibility of rows of a target, (n,), each at the instant of `surroundings_at` next to its middle time."""
    times_s, surroundings = around
    share = np.empty(len(rows.point))
    instant = np.abs(planes.middle_s(rows.xy_px)[:, None] - times_s).argmin(axis=1)
    # Points are taken at the instant, too: a board that comes nearer would hide its own points as they were before.
    bundles = PointBundles(rig.microlens(rows.cell), rows.xy_px, planes.at(rows.point, times_s[instant]))
    for number in np.unique(instant).tolist():
        is_nearest = instant == number
        share[is_nearest], _ = visibility(rig, surroundings[number], target, *bundles.only(is_nearest))
    return share


def moves(view: PlacedView) -> bool:
    """Whether anything in a view moves before the camera while its shutter is open."""
    motions = [entry.motion for entry in view.targets] + [entry.motion for entry in view.occluders]
    return any(motion is not None for motion in motions)


def view_at(view: View, time_s: float) -> View:
    """The view at a time after the time code of its frame; nothing in it moves."""

    def pose(motion: Motion | None, still: list[list[float]]) -> list[list[float]]:
        return still if motion is None else motion.at(np.array([time_s]))[0].tolist()  # type: ignore[no-any-return]

    return replace(
        view,
        targets=tuple(
            replace(entry, vision_from_target=pose(entry.motion, entry.vision_from_target), motion=None)
            for entry in view.targets
        ),
        occluders=tuple(
            replace(entry, vision_from_occluder=pose(entry.motion, entry.vision_from_occluder), motion=None)
            for entry in view.occluders
        ),
    )
