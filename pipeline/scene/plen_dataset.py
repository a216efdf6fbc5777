"""Reader and checks of a dataset: contents, frames, names, exports, and differences from what a USD viewer shows."""

import unicodedata
from collections import Counter
from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import replace
from typing import Any

from pxr import Sdf, Usd, UsdGeom, UsdShade

from pipeline.formats import EXACT, ExportError, Format, Targets, format_of, loadable
from pipeline.scene.channels import images_of
from pipeline.scene.dataset import CameraEntry, Dataset, Frame, Matrix, Motions, RequestedExports
from pipeline.scene.occluders import check_occluders, read_occluder_entries, shapes_in_images
from pipeline.scene.shutters import check_motions, motions_before
from pipeline.scene.states import read_states
from pipeline.scene.targets import is_preview, read_target_entry
from pipeline.scene.usd.meshes import alike, is_drawn
from pipeline.scene.usd.plug_in import scene_reader
from pipeline.scene.usd.poses import (
    LAST_FRAME,
    camera_from_world,
    camera_name,
    comes_and_goes,
    frame_numbers,
    is_visible,
    stage_mm_per_unit,
    world_from,
)
from pipeline.scene.usd.problems import Problem, metadata_problem, not_drawn, problem, shortened, warning
from pipeline.scene.usd.readers import Sources
from pipeline.scene.usd.values import need, read, target_paths, targets
from pipeline.spelling import frames_in_words

LONGEST_NAME = 200
"""Longest name of a camera or target [bytes]: file systems allow 255, and suffixes are appended."""
_MOST_KINDS = 8
"""Number of types of prims with a warning of their own: scenes made elsewhere have dozens, and errors must stay in
sight.
"""
_SPACES = ("lin_rec709_scene", "lin_rec709", "lin_srgb", "raw", "data", "identity", "unknown")
"""Names of linear sRGB, in which colours are taken, and of no space."""
_MOST_PATHS = 4
"""Number of prims that the warning about a type lists; further ones are counted."""
_AIDS = 'what is there for viewers alone says so with uniform token purpose = "guide"'
NOISE = {
    "noise_px": "plen:exports:noise",
    "outliers": "plen:exports:outliers",
    "outlier_px": "plen:exports:outlierReach",
    "missed": "plen:exports:missed",
    "seed": "plen:exports:noiseSeed",
}
"""Attributes of the noise, by field of `exports.noise.Noise`."""
_EXPORTS = "plen:exports"
_States = dict[Usd.Prim, list[tuple[CameraEntry, list[int]]]]
"""Each camera in each of its states, with the frames of the state."""
_GRIDS = ("PlenCheckerboard", "PlenCharuco", "PlenCircleGrid")
"""Types of targets whose points may form a grid."""


def read_dataset(root: Usd.Prim) -> Dataset:
    """The records of a PlenDataset whose stage passed the checks."""
    sources = Sources(root.GetStage())
    dataset = sources.reading("dataset", _read_dataset, root, sources)
    return replace(dataset, sources={part: tuple(sorted(paths)) for part, paths in sources.items()})


def _read_dataset(root: Usd.Prim, sources: Sources) -> Dataset:
    """The records; `sources` gets the paths from which each part was read."""
    stage = root.GetStage()
    scenes = scene_reader()
    cameras = targets(root, "plen:cameras", "Camera")
    boards = targets(root, "plen:targets", "PlenTarget")
    occluders = shapes_in_images(root)
    lamps = scenes.lamp_prims(stage)
    has_light = scenes.is_lit(stage)
    seed = need(root, "plen:seed")
    numbers = frame_numbers(root)
    read = sources.reading
    names = {prim: f"cameras/{camera_name(prim, root)}" for prim in cameras}
    states = {prim: read(name, read_states, prim, root, seed, numbers) for prim, name in names.items()}
    dataset = Dataset(
        stage_name=root.GetName(),
        seed=seed,
        background=need(root, "plen:background"),
        cameras=tuple(entry for several in states.values() for entry, _ in several),
        targets=tuple(read(f"targets/{prim.GetName()}", read_target_entry, prim) for prim in boards),
        frames=_read_frames(root, states, boards, sources),
        occluders=tuple(
            entry for prim in occluders for entry in read("occluders", read_occluder_entries, prim, has_light, numbers)
        ),
        lamps=tuple(read("lamps", scenes.read_lamp_entry, prim, numbers) for prim in lamps),
        pictures=tuple({picture.name: picture for picture in scenes.read_pictures(stage).values()}.values()),
        exports=read("exports", _read_exports, root),
        meters_per_unit=UsdGeom.GetStageMetersPerUnit(root.GetStage()),
        up_axis=str(UsdGeom.GetStageUpAxis(root.GetStage())),
    )
    for prim, name in names.items():  # states of a camera are parts of their own
        for entry, _ in states[prim]:
            state = f"cameras/{entry.name}"
            sources |= {state: sources[name], f"poses/{state}": sources[f"poses/{name}"]}
    return dataset


def _read_frames(root: Usd.Prim, states: _States, boards: list[Usd.Prim], sources: Sources) -> tuple[Frame, ...]:
    """All frames of a dataset, with the poses of its cameras, boards, occluders and lamps."""
    numbers = frame_numbers(root)
    scale_mm = stage_mm_per_unit(root)

    def posed(part: str, reader: Callable[..., Any], prim: Usd.Prim) -> list[Matrix]:
        """Poses of a prim in all frames, by a reader whose sources are those of a part."""
        # + 0.0 turns -0.0, which products may leave, into 0.0: keys must not differ by it.
        stack = sources.reading(f"poses/{part}", reader, prim, numbers, scale_mm) + 0.0
        return [tuple(map(tuple, matrix)) for matrix in stack.tolist()]

    vision = {prim: posed(f"cameras/{camera_name(prim, root)}", camera_from_world, prim) for prim in states}
    world = {prim.GetName(): posed(f"targets/{prim.GetName()}", world_from, prim) for prim in boards}
    occluders = {prim: posed("occluders", world_from, prim) for prim in shapes_in_images(root)}
    scenes = scene_reader()
    lamps = {prim: posed("lamps", scenes.world_from_lamp, prim) for prim in scenes.lamp_prims(root.GetStage())}
    things: dict[Usd.Prim, Callable[..., Any]] = {
        **dict.fromkeys(shapes_in_images(root), world_from),
        **dict.fromkeys(lamps, scenes.world_from_lamp),
    }

    def cameras_in(number: int) -> dict[Usd.Prim, CameraEntry]:
        """Each camera in its state in a frame."""
        return {prim: entry for prim in states for entry, numbers in states[prim] if number in numbers}

    def motions_in(number: int) -> dict[str, Motions]:
        """Motions in a frame before each camera with a shutter, by its name."""
        return {
            entry.name: motions_before(prim, entry.shutter, boards, things, number, scale_mm)
            for prim, entry in cameras_in(number).items()
            if entry.shutter is not None
        }

    return tuple(
        Frame(
            number=number,
            camera_from_world={entry.name: vision[prim][index] for prim, entry in cameras_in(number).items()},
            world_from_target={name: matrices[index] for name, matrices in world.items()},
            world_from_occluder=sources.reading("poses/occluders", _visible, occluders, index, number),
            world_from_lamp=sources.reading("poses/lamps", _visible, lamps, index, number),
            motions=sources.reading("poses/motions", motions_in, number),
        )
        for index, number in enumerate(numbers)
    )


def _visible(poses_of: dict[Usd.Prim, list[Matrix]], index: int, number: int) -> dict[str, Matrix]:
    """Pose of each prim that is visible in a frame, by path."""
    return {str(prim.GetPath()): poses[index] for prim, poses in poses_of.items() if is_visible(prim, float(number))}


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
    parts = [*cameras, *targets(root, "plen:targets", "PlenTarget"), *targets(root, "plen:occluders", "Imageable")]
    for prim in parts:
        if not prim.GetPath().HasPrefix(root.GetPath()):
            message = f"<{prim.GetPath()}> does not lie below the dataset <{root.GetPath()}>"
            yield problem(prim, "outside-dataset", message)
    yield from check_motions(
        root,
        [camera for camera in cameras if camera.GetPath() not in wrong],
        targets(root, "plen:targets", "PlenTarget"),
        [*shapes_in_images(root), *scene_reader().lamp_prims(root.GetStage())],
    )
    yield from _check_names(root, cameras)
    yield from _check_traced(root, cameras)
    yield from check_occluders(root, wrong)
    yield from scene_reader().check_dataset(root, wrong)
    yield from _check_unnamed(root)
    yield from _check_invisible(root)


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
    """Problems of a dataset without frames, or with repeated ones."""
    frames = read(root, "plen:frames") or ()
    if repeated := [number for number, count in Counter(frames).items() if count > 1]:
        rest = f", and {len(repeated) - 1} others," if len(repeated) > 1 else ""
        message = f'"plen:frames" lists frame {repeated[0]}{rest} more than once'
        yield problem(root.GetAttribute("plen:frames"), "repeated-frame", message)
    if not frame_numbers(root):
        stage = root.GetStage()
        message = "the dataset has no frames"
        has_range = all(stage.HasAuthoredMetadata(key) for key in ("startTimeCode", "endTimeCode"))
        if has_range and not max(abs(stage.GetStartTimeCode()), abs(stage.GetEndTimeCode())) <= LAST_FRAME:
            return  # reported as out of range
        if has_range:
            message += f": startTimeCode is {stage.GetStartTimeCode():g}, endTimeCode {stage.GetEndTimeCode():g}"
        hint = "set startTimeCode and endTimeCode to integers, or list plen:frames"
        layer, at = stage.GetRootLayer(), str(root.GetPath())
        yield metadata_problem(layer, "endTimeCode", "no-frames", message, hint=hint, at=at)


def _check_names(root: Usd.Prim, cameras: list[Usd.Prim]) -> Iterator[Problem]:
    """Problems of cameras, or targets, whose names would make the same file, or one that is too long."""
    named = [(camera_name(prim, root), prim, "cameras") for prim in cameras]
    named += [(prim.GetName(), prim, "targets") for prim in targets(root, "plen:targets", "PlenTarget")]
    first_with: dict[tuple[str, str], tuple[str, str]] = {}
    for name, prim, kind in named:
        # Names become file names, and some file systems do not distinguish Rig from rig, or two encodings of an
        # umlaut.
        key = (kind, unicodedata.normalize("NFC", name).casefold())
        if key in first_with:
            other, path = first_with[key]
            message = f'two {kind} would share the name "{name}": <{path}> and <{prim.GetPath()}>'
            hint = "rename one of the prims"
            if other != name:
                hint += "; some file systems do not distinguish such names, and files are named by them"
            yield problem(prim, "name-collision", message, hint=hint)
        first_with.setdefault(key, (name, str(prim.GetPath())))
        if len(name.encode()) > LONGEST_NAME:
            message = f"the name of one of the {kind}, {shortened(name)}, has {len(name.encode())} bytes"
            hint = f"names become files and folders: {LONGEST_NAME} bytes are the most"
            yield problem(prim, "long-name", message, hint=hint)


def _check_unnamed(root: Usd.Prim) -> Iterator[Problem]:
    """One warning per type of prim that viewers show, and images of the dataset do not."""
    stage = root.GetStage()
    frames = frame_numbers(root)
    prims = list(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
    # Collect prims that a relationship names, and attributes whose values are not supported.
    named = {prim.GetPath() for prim in (*scene_reader().lamp_prims(stage), *shapes_in_images(root))}
    unsupported: dict[str, list[Usd.Attribute]] = {}
    for equal in alike(prims):
        names = [rel.GetName() for rel in equal[0].GetAuthoredRelationships() if rel.GetName().startswith("plen:")]
        named |= {path for prim in equal for name in names for path in target_paths(prim.GetRelationship(name))}
        for attribute in equal[0].GetAuthoredAttributes():
            if substitute := _substitute(attribute):
                equal_attributes = (prim.GetAttribute(attribute.GetName()) for prim in equal)
                unsupported.setdefault(substitute, []).extend(equal_attributes)
    # Warn of shapes that viewers show: of types that nothing draws, and of those that nothing names.
    unnamed_by_type: dict[str, list[Usd.Prim]] = {}
    for prim in prims:
        if prim.GetPath() in named and is_drawn(prim):
            continue
        if not prim.IsA(UsdGeom.Gprim) or is_preview(prim) or not _is_visible_in_any(prim, frames):
            continue
        if not is_drawn(prim):
            message = f"<{prim.GetPath()}> is not drawn: no image and no truth has a {prim.GetTypeName()}"
            yield not_drawn(prim, message, hint=f"make it a Mesh; {_AIDS}")
        else:
            unnamed_by_type.setdefault(prim.GetTypeName(), []).append(prim)
    for type_name, unnamed in list(unnamed_by_type.items())[:_MOST_KINDS]:
        message = f"{type_name} {_listed(unnamed)} is in no image: no relationship names it"
        hint = f"name it or what it lies below in rel plen:occluders of the dataset; {_AIDS}"
        yield warning(unnamed[0], "not-in-image", message, hint=hint)
    for substitute, attributes in unsupported.items():
        yield not_drawn(attributes[0], f"{_listed(attributes)}: {substitute}")


def _substitute(attribute: Usd.Attribute) -> str | None:
    """Words for the substitute of a draw mode or of a colour space that is not supported; None of one that is."""
    is_name = attribute.GetName() == "colorSpace:name"
    is_colour = attribute.GetRoleName() == "Color"
    space = attribute.Get() if is_name else attribute.GetColorSpace() if is_colour else ""
    if space and space not in _SPACES:
        return f'colours in "{space}" are drawn as those of linear sRGB'
    if attribute.GetName() == "inputs:file" and (space := attribute.GetColorSpace()) not in ("", "auto"):
        shader = UsdShade.Shader(attribute.GetPrim())
        if shader.GetShaderId() == "UsdUVTexture" and not shader.GetInput("sourceColorSpace"):
            return f'the space "{space}" of a picture counts only as its inputs:sourceColorSpace'
    is_mode = attribute.GetName() == "model:drawMode" and attribute.Get() not in (None, "default", "inherited")
    return "models are drawn themselves" if is_mode else None


def _listed(things: Sequence[Usd.Prim | Usd.Attribute]) -> str:
    """Paths of the first things, and how many more there are."""
    paths = ", ".join(f"<{thing.GetPath()}>" for thing in things[:_MOST_PATHS])
    return paths + (f" and {len(things) - _MOST_PATHS} more" if len(things) > _MOST_PATHS else "")


def _check_invisible(root: Usd.Prim) -> Iterator[Problem]:
    """A warning for each target that is invisible in USD in some frames, although images and truth have it in all."""
    frames = frame_numbers(root)
    for prim in targets(root, "plen:targets", "PlenTarget"):
        if hidden := [number for number in frames if not is_visible(prim, float(number))]:
            number = f"{len(hidden)} of {len(frames)} frames: {frames_in_words(hidden)}"
            message = f'"{prim.GetName()}" is invisible in {number}; its images and ground truth are made all the same'
            hint = "take it out of rel plen:targets, list other plen:frames, or make it visible"
            yield warning(prim, "invisible-target", message, hint=hint)


def _is_visible_in_any(prim: Usd.Prim, frames: Sequence[int]) -> bool:
    """Whether USD shows a prim in any of the frames."""
    if UsdGeom.Imageable(prim).ComputePurpose() in (UsdGeom.Tokens.guide, UsdGeom.Tokens.proxy):
        return False
    return any(is_visible(prim, float(number)) for number in (frames if comes_and_goes(prim) else frames[:1]))


def _read_exports(root: Usd.Prim) -> RequestedExports:
    """The exports that a dataset asks for."""
    return RequestedExports(
        formats=tuple(need(root, "plen:exports")),
        position=need(root, "plen:exports:position"),
        noise={field: need(root, name) for field, name in NOISE.items()},
    )


def check_exports(root: Usd.Prim) -> Iterator[Problem]:
    """Problems of the formats that a dataset names."""
    names = read(root, _EXPORTS) or ()
    attribute = root.GetAttribute(_EXPORTS)
    for name in [name for name, count in Counter(names).items() if count > 1]:
        yield problem(attribute, "repeated-export", f'"{_EXPORTS}" lists "{name}" more than once', hint="remove one")
    cameras = targets(root, "plen:cameras", "Camera")
    for name in dict.fromkeys(names):
        try:
            format_named = format_of(name)
        except ExportError as error:
            yield problem(attribute, error.code, error.message, hint=error.hint)
            continue
        suitable = [camera for camera in cameras if format_named.takes(_is_plenoptic(camera))]
        if cameras and not suitable:
            kind = "conventional" if _is_plenoptic(cameras[0]) else "plenoptic"
            fitting = [other for other, format_ in loadable().items() if format_.takes(_is_plenoptic(cameras[0]))]
            message = f'"{name}" describes {kind} cameras alone, and the dataset has none'
            yield problem(attribute, "export-cameras", message, hint=f"formats for its cameras: {', '.join(fitting)}")
        elif cameras and (count := sum(map(images_of, suitable))) < format_named.least_cameras:
            needed = f"{format_named.least_cameras} cameras, or channels of one, at least"
            message = f'"{name}" relates {needed}, and the dataset has {count} that it describes'
            yield problem(attribute, "export-cameras", message, hint="take it out, or add a camera")
        yield from _check_targets(root, name, format_named)
        yield from _check_position(root, name, suitable)


def _check_targets(root: Usd.Prim, name: str, format_named: Format) -> Iterator[Problem]:
    """A problem of the targets of a dataset that a format cannot describe."""
    prims = targets(root, "plen:targets", "PlenTarget")
    attribute = root.GetAttribute(_EXPORTS)
    if format_named.targets is Targets.ANY:
        return
    if len(prims) > 1:
        message = f'"{name}" describes one target, and the dataset has {len(prims)}'
        hint = f"`pipeline export {name} OUT --only TARGET` takes one"
        yield problem(attribute, "export-targets", message, hint=hint)
        return
    board = prims[0] if prims and format_named.targets is Targets.BOARD else None
    counts = [read(board, axis) or 0 for axis in ("plen:columns", "plen:rows")] if board else []
    if board and not (board.GetTypeName() in _GRIDS and min(counts) > 1 and not read(board, "plen:asymmetric")):
        message = f'"{name}" describes boards whose points form a grid, and {prims[0].GetName()} has none'
        hint = "checkerboards, ChArUco boards and symmetric circle grids have one, of two columns and rows at least"
        yield problem(attribute, "export-targets", message, hint=hint)


def _check_position(root: Usd.Prim, name: str, cameras: list[Usd.Prim]) -> Iterator[Problem]:
    """A problem of a format that is to take positions that a camera does not compute."""
    position = read(root, f"{_EXPORTS}:position")
    if position in (None, EXACT):
        return
    lacking = [camera for camera in cameras if position not in (read(camera, "plen:truth:columns") or ())]
    if lacking:
        message = f'"{name}" is to take the positions "{position}", which <{lacking[0].GetPath()}> does not compute'
        hint = f'write plen:truth:columns = ["{position}"] on the camera'
        yield problem(root.GetAttribute(f"{_EXPORTS}:position"), "export-position", message, hint=hint)


def _is_plenoptic(camera: Usd.Prim) -> bool:
    return bool(target_paths(camera.GetRelationship("plen:camera:microlenses")))
