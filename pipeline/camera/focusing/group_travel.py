"""Focusing by lens groups: named groups move together along the axis while stop and sensor stay.

Paraxial. A shift is positive towards the sensor. It opens the air in front of each moving block of surfaces and closes
the air behind it, so travel ends where surfaces touch within their clear apertures, or where the last vertex meets the
sensor. A block that stands first has nothing before it; there the travel ends after ten focal lengths.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

from pipeline.camera.parts.errors import CameraError
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import Prescription, PrescriptionError, least_gap_mm

_LONGEST = 10.0
"""Focal lengths that a block may travel with nothing in its way [1]: longer than any mount."""
_STEPS = 400
"""Equal parts of the travel that are searched for a solution: two within one part would both be missed."""
_BISECTIONS = 100
"""Halvings of such a part at most: a double has 53 bits, and the search ends where it has no middle left."""


def moved(prescription: Prescription, names: tuple[str, ...], shift_mm: float) -> Prescription:
    """The lens with groups shifted along the axis.

    Raises CameraError: there is no such group, it holds the stop, or it ends within an element.
    """
    surfaces = list(prescription.surfaces)
    for last, sign in _gaps(prescription, names):
        thickness = surfaces[last].thickness_mm + sign * shift_mm
        surfaces[last] = dataclasses.replace(surfaces[last], thickness_mm=thickness)
    return dataclasses.replace(prescription, surfaces=tuple(surfaces))


def travel_mm(prescription: Prescription, names: tuple[str, ...], film_mm: float) -> tuple[float, float]:
    """Least and greatest shift of groups before a plane (sensor or array) `film_mm` behind the stop."""
    low = high = _LONGEST * abs(first_order(prescription).efl_mm)
    for last, sign in _gaps(prescription, names):
        room = least_gap_mm(*prescription.surfaces[last : last + 2])
        low, high = (min(low, room), high) if sign > 0 else (low, min(high, room))
    if _moving(prescription, names)[-1]:
        high = min(high, film_mm - prescription.vertices_from_stop_mm[-1])
    return -low, high


def shift_mm(
    prescription: Prescription, names: tuple[str, ...], film_mm: float, image_mm: float, object_mm: float
) -> float:
    """The shift, the smallest one there is, with which the object at vision z has its image `image_mm` behind the stop.

    Raises CameraError: there is none; the hint says what distances are within reach.
    """
    low, high = travel_mm(prescription, names, film_mm)

    def miss(shift: float) -> float:
        return _miss(moved(prescription, names, shift), object_mm, image_mm)

    shifts = np.linspace(low, high, _STEPS + 1).tolist()
    misses = [miss(shift) for shift in shifts]
    brackets = [
        (a, b) for (a, fa), (b, fb) in pairwise(zip(shifts, misses, strict=True)) if fa == 0 or (fa < 0) != (fb < 0)
    ]
    solutions = [_bisected(miss, a, b) for a, b in brackets]
    if solutions:
        return min(solutions, key=abs)
    place = f"{object_mm:g} mm from the stop" if math.isfinite(object_mm) else "infinity"
    moving = f'"{", ".join(names)}"'
    what = f"no position of {moving} between {low:.4g} and {high:.4g} mm from where it stands brings {place} into focus"
    raise CameraError(what, hint=_reach(prescription, names, shifts, image_mm))


def _gaps(prescription: Prescription, names: tuple[str, ...]) -> Iterator[tuple[int, float]]:
    """Surfaces whose thickness changes, each with +1 or -1 for how."""
    moving = _moving(prescription, names)
    for i, (here, behind) in enumerate(pairwise(moving)):
        if here == behind:
            continue
        if prescription.surfaces[i].index != 1:
            raise CameraError(f"between surfaces {i + 1} and {i + 2} there is glass, and only one of them would move")
        yield i, -1.0 if here else 1.0


def _moving(prescription: Prescription, names: tuple[str, ...]) -> list[bool]:
    known = {group.name: group for group in prescription.groups}
    for name in names:
        if name not in known:
            hint = f"its groups: {', '.join(known)}" if known else "a PlenLensGroup below the lens names surfaces"
            raise CameraError(f'the lens has no group "{name}"', hint=hint)
    held = {i for name in names for i in known[name].members}
    if prescription.stop_index in held:
        what = "the stop would move with its group, and it is the origin of the camera"
        raise CameraError(what, hint="name the groups before or behind it")
    return [i in held for i in range(len(prescription.surfaces))]


def _miss(lens: Prescription, object_mm: float, image_mm: float) -> float:
    """Height at the image plane of a paraxial ray from the axial object point; it vanishes where both are conjugate."""
    surfaces, vertices = lens.surfaces, lens.vertices_from_stop_mm
    # Of unit height or slope, whichever is the smaller number: infinity is no special case.
    before = object_mm + vertices[0]
    height, slope = (1.0, 1.0 / before) if before else (0.0, 1.0)
    index = 1.0
    for i, surface in enumerate(surfaces):
        if i:
            height += surfaces[i - 1].thickness_mm * slope / index
        slope -= surface.power_per_mm(index) * height
        index = surface.index
    return height + (image_mm - vertices[-1]) * slope


def _bisected(miss: Callable[[float], float], low: float, high: float) -> float:
    at_low = miss(low)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        if not low < middle < high:
            break
        low, high = (middle, high) if (miss(middle) < 0) == (at_low < 0) and at_low != 0 else (low, middle)
    return min((low, high), key=lambda shift: abs(miss(shift)))


def _reach(prescription: Prescription, names: tuple[str, ...], shifts: list[float], image_mm: float) -> str:
    """Object distances that the groups bring into focus, as a hint."""
    distances = []
    for shift in shifts:
        lens = moved(prescription, names, shift)
        try:
            figures = first_order(lens)
        except PrescriptionError:
            continue  # afocal just there
        # Behind the rear focus the image is that of a real object, before it of one beyond infinity.
        distance = figures.object_mm(-image_mm) if -image_mm < figures.rear_focus_mm else math.inf
        if figures.efl_mm > 0 and distance > -lens.vertices_from_stop_mm[0]:
            distances.append(distance)
    near, far = min(distances, default=math.inf), max(distances, default=math.inf)
    if math.isinf(near):
        return "within reach: no object at all"
    return "within reach: distances " + (
        f"between {near:.6g} and {far:.6g} mm" if far < math.inf else f"beyond {near:.6g} mm"
    )
