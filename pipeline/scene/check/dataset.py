"""Checks of a dataset as a whole: its frames, names and contents."""

import unicodedata
from collections import Counter
from collections.abc import Iterator, Set

from pxr import Sdf, Usd

from pipeline.scene.check.lighting.finishes import check_finishes
from pipeline.scene.check.lighting.lamps import check_lamps
from pipeline.scene.check.occluders import check_occluders
from pipeline.scene.check.unnamed import check_invisible, check_unnamed
from pipeline.scene.read.prims import LAST_FRAME, camera_name, frame_numbers
from pipeline.scene.usd.problems import Problem, shortened, shown_path
from pipeline.scene.usd.source_locations import problem
from pipeline.scene.usd.usda_lines import line_of_metadata
from pipeline.scene.usd.values import read, targets

LONGEST_NAME = 200
"""Longest name of a camera or target [bytes]: file systems allow 255, and suffixes are appended."""


def find_dataset(stage: Usd.Stage) -> Usd.Prim | None:
    """The PlenDataset that is the stage's default prim; None for a part of the library."""
    prim = stage.GetDefaultPrim()
    return prim if prim and prim.IsA("PlenDataset") else None


def check_dataset(root: Usd.Prim, wrong: Set[Sdf.Path]) -> Iterator[Problem]:
    """Problems of a PlenDataset except poses; `wrong` holds the prims with wrong values."""
    yield from _check_frames(root)
    cameras = targets(root, "plen:cameras", "Camera")
    for prim in cameras:
        if not prim.HasAPI("PlenCameraAPI"):
            hint = 'write prepend apiSchemas = ["PlenCameraAPI"] on it'
            yield problem(prim, "camera-without-api", "a camera of the dataset lacks PlenCameraAPI", hint=hint)
    parts = [*cameras, *targets(root, "plen:targets", "PlenTarget"), *targets(root, "plen:occluders", "Mesh")]
    for prim in parts:
        if not prim.GetPath().HasPrefix(root.GetPath()):
            message = f"<{prim.GetPath()}> does not lie below the dataset <{root.GetPath()}>"
            yield problem(prim, "outside-dataset", message)
    yield from _check_names(root, cameras)
    yield from _check_traced(root, cameras)
    yield from check_occluders(root, wrong)
    yield from check_lamps(root, wrong)
    yield from check_finishes(root, wrong)
    yield from check_unnamed(root)
    yield from check_invisible(root)


def check_only_dataset(stage: Usd.Stage) -> Iterator[Problem]:
    """Problems of PlenDataset prims that would not be built, because they are not the default prim."""
    for prim in stage.TraverseAll():
        if prim.IsA("PlenDataset") and prim != stage.GetDefaultPrim():
            hint = f'write defaultPrim = "{prim.GetName()}"'
            yield problem(prim, "default-prim", "this PlenDataset is not the default prim of the stage", hint=hint)


def _check_traced(root: Usd.Prim, cameras: list[Usd.Prim]) -> Iterator[Problem]:
    """A problem if a method would trace position images for every point of a curved target."""
    curved = [
        prim.GetName()
        for prim in targets(root, "plen:targets", "PlenTarget")
        if prim.IsA("PlenMeshTarget") or read(prim, "plen:shape") in ("warped", "heightMap", "cylinder")
    ]
    for camera in cameras:
        if curved and read(camera, "plen:truth:method") == "image":
            message = f'"image" cannot be the method for "{curved[0]}", whose points have a tangent plane each'
            hint = 'plen:truth:method = "direct" takes any surface'
            yield problem(camera.GetAttribute("plen:truth:method"), "not-yet-supported", message, hint=hint)


def _check_frames(root: Usd.Prim) -> Iterator[Problem]:
    repeated = [number for number, count in Counter(read(root, "plen:frames") or ()).items() if count > 1]
    if repeated:
        more = f", and {len(repeated) - 1} others," if len(repeated) > 1 else ""
        message = f'"plen:frames" lists frame {repeated[0]}{more} more than once'
        yield problem(root.GetAttribute("plen:frames"), "repeated-frame", message)
    if not frame_numbers(root):
        stage = root.GetStage()
        message = "the dataset has no frames"
        both = all(stage.HasAuthoredMetadata(key) for key in ("startTimeCode", "endTimeCode"))
        if both and not max(abs(stage.GetStartTimeCode()), abs(stage.GetEndTimeCode())) <= LAST_FRAME:
            return  # reported as out of range
        if both:
            message += f": startTimeCode is {stage.GetStartTimeCode():g}, endTimeCode {stage.GetEndTimeCode():g}"
        hint = "set startTimeCode and endTimeCode to integers, or list plen:frames"
        file = stage.GetRootLayer().realPath
        line, file = line_of_metadata(file, "endTimeCode"), shown_path(file)
        yield Problem(code="no-frames", message=message, file=file, line=line, at=str(root.GetPath()), hint=hint)


def _check_names(root: Usd.Prim, cameras: list[Usd.Prim]) -> Iterator[Problem]:
    named = [(camera_name(prim, root), prim, "cameras") for prim in cameras]
    named += [(prim.GetName(), prim, "targets") for prim in targets(root, "plen:targets", "PlenTarget")]
    seen: dict[tuple[str, str], tuple[str, str]] = {}
    for name, prim, what in named:
        # Names become file names, and some file systems do not distinguish Rig from rig, or two encodings of an
        # umlaut.
        key = (what, unicodedata.normalize("NFC", name).casefold())
        if key in seen:
            other, path = seen[key]
            message = f'two {what} would share the name "{name}": <{path}> and <{prim.GetPath()}>'
            hint = "rename one of the prims"
            if other != name:
                hint += "; some file systems do not distinguish such names, and files are named by them"
            yield problem(prim, "name-collision", message, hint=hint)
        seen.setdefault(key, (name, str(prim.GetPath())))
        if len(name.encode()) > LONGEST_NAME:
            message = f"the name of one of the {what}, {shortened(name)}, has {len(name.encode())} bytes"
            hint = f"names become files and folders: {LONGEST_NAME} bytes are the most"
            yield problem(prim, "long-name", message, hint=hint)
