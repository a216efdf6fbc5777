"""Checks of the work that a stage asks for: counts beyond `limits`."""

import math
from collections.abc import Iterator

from pxr import Usd

from pipeline.scene.channels import images_of
from pipeline.scene.occluders import equal_shapes_in_images
from pipeline.scene.usd.poses import frame_numbers
from pipeline.scene.usd.problems import Problem, metadata_problem, over_limit
from pipeline.scene.usd.values import read, target, targets


def check_budgets(prim: Usd.Prim) -> Iterator[Problem]:
    """Problems of size of one prim of any type. Values out of range are reported elsewhere and ignored here."""
    meshes = []
    if prim.IsA("PlenDataset"):
        yield from _check_frames(prim)
        meshes = [equal[0] for equal in equal_shapes_in_images(prim)]
    elif prim.IsA("PlenTarget"):
        yield from _check_points(prim)
        meshes = targets(prim, "plen:mesh", "Mesh")
    elif prim.IsA("PlenMicrolensArray"):
        yield from _check_microlenses(prim)
    elif prim.IsA("Camera") and prim.HasAPI("PlenCameraAPI"):
        yield from _check_camera(prim)
    for mesh in meshes:
        count = len(read(mesh, "faceVertexIndices") or ())  # of face corners, which are no fewer than triangles
        yield from over_limit(mesh.GetAttribute("faceVertexIndices"), "triangles", count, f"{count:,} corners of faces")


def _check_frames(root: Usd.Prim) -> Iterator[Problem]:
    """A problem of too many frames, at the statement that names them."""
    cameras = max(1, sum(map(images_of, targets(root, "plen:cameras", "Camera"))))
    count = len(frame_numbers(root))
    in_words = f"{count:,} frames of {cameras} cameras" if cameras > 1 else f"{count:,} frames"
    for too_many in over_limit(root.GetAttribute("plen:frames"), "frames", count * cameras, in_words):
        if read(root, "plen:frames"):
            yield too_many
        else:
            layer = root.GetStage().GetRootLayer()
            code, message, hint = too_many.code, too_many.message, too_many.hint
            yield metadata_problem(layer, "endTimeCode", code, message, hint=hint, at=str(root.GetPath()))


def _check_camera(camera: Usd.Prim) -> Iterator[Problem]:
    """Problems of too many F-numbers, pixels or rays of a camera."""
    sensor = target(camera, "plen:camera:sensor", "PlenSensor")
    resolution = read(sensor, "plen:resolution") if sensor else None
    f_numbers = camera.GetAttribute("plen:image:fNumbers")
    count = len(read(camera, "plen:image:fNumbers") or ())
    yield from over_limit(f_numbers, "f_numbers", count, f"{count:,} F-numbers")
    if not sensor or not resolution:
        return
    width, height = resolution
    traced = read(camera, "plen:truth:method") != "direct" or read(camera, "plen:truth:rays")
    fine = (read(camera, "plen:truth:supersampling") or 1) if traced else 1
    pixels = width * height * fine**2
    in_words = f"{width} x {height} pixels" + (f", {fine} x {fine} times as fine," if fine > 1 else "")
    resolution_attribute = sensor.GetAttribute("plen:resolution")
    if too_many := over_limit(resolution_attribute, "pixels", pixels, in_words):
        yield from too_many
        return
    rays = [("plen:image:samples", width * height)] + ([("plen:truth:samples", pixels)] if traced else [])
    for name, starts in rays:
        samples = read(camera, name) or 0
        in_words = f"{samples:,} rays from each of {starts:,} positions"
        yield from over_limit(camera.GetAttribute(name), "rays", starts * samples, in_words)


def _check_microlenses(array: Usd.Prim) -> Iterator[Problem]:
    """A problem of too many microlenses, counted in the square around the array at any rotation."""
    pitch_mm = read(array, "plen:pitch")
    if pitch_mm is None:
        return
    is_square = read(array, "plen:layout") == "square"
    row_distance_mm = (read(array, "plen:crossPitch") or pitch_mm) * (1.0 if is_square else 0.75**0.5)
    columns, rows = read(array, "plen:columns"), read(array, "plen:rows")
    width_mm, height_mm = read(array, "plen:width"), read(array, "plen:height")
    if columns and rows:
        name = "plen:columns"
        width_mm, height_mm = columns * pitch_mm, rows * pitch_mm
    elif width_mm and height_mm:
        name = "plen:width"
    else:
        return  # reported as missing
    count = math.ceil((width_mm**2 + height_mm**2) / (pitch_mm * row_distance_mm))
    size = f"{width_mm:.6g} x {height_mm:.6g} mm at a pitch of {pitch_mm:g} mm"
    in_words = f"{size}, {count:,} microlenses in the square around them,"
    yield from over_limit(array.GetAttribute(name), "microlenses", count, in_words)


def _check_points(prim: Usd.Prim) -> Iterator[Problem]:
    """A problem of too many points of a target."""
    if prim.IsA("PlenMeshTarget"):
        name, count = "plen:points", len(read(prim, "plen:points") or ())
    else:
        faces = {"cube": 6, "stairs": read(prim, "plen:shape:steps") or 1}.get(read(prim, "plen:shape"), 1)
        name, count = "plen:columns", _pattern_points(prim) * faces
    attribute = prim.GetAttribute(name if prim.HasAttribute(name) else "plen:shape:steps")
    yield from over_limit(attribute, "points", count, f"{count:,} points")


def _pattern_points(prim: Usd.Prim) -> int:
    """Upper bound of the number of points of a pattern."""
    columns, rows = (read(prim, name) or 0 for name in ("plen:columns", "plen:rows"))
    if prim.IsA("PlenAprilGrid"):
        return 4 * int(columns * rows)
    if prim.IsA("PlenCharuco") and read(prim, "plen:markerCorners"):
        return int(columns * rows + 2 * (columns + 1) * (rows + 1))
    if prim.IsA("PlenStars"):  # its bars cost as much to draw as points
        return int(columns * rows) * (read(prim, "plen:spokes") or 1)
    if prim.IsA("PlenSiemensStar"):
        return 1 + 2 * (read(prim, "plen:spokes") or 0)
    return int(columns * rows) or 2 * int(columns + rows) or 3
