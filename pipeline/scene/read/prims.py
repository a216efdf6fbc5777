"""Reading of prims into records. Only stages that pass the checks are read as a whole; parts raise on wrong values."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from pipeline.camera.focusing.focus_request import FocusRequest
from pipeline.camera.focusing.ideal_lens import PRESCRIPTION, with_ideal_lens
from pipeline.camera.parts.camera import Camera, Sampling, Sensor
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.frames import VISION_FROM_CAMERA
from pipeline.optics.prescription import Group, Prescription, Surface
from pipeline.scene.dataset import CameraEntry, Dataset, Frame, LensEntry, Matrix
from pipeline.scene.read.channels import illuminant_of, read_channels
from pipeline.scene.read.exports import read_exports
from pipeline.scene.read.finishes import seen_meshes
from pipeline.scene.read.lamps import lamp_prims, read_lamp_entry, world_from_lamp
from pipeline.scene.read.media import index_source, ordered_surfaces, with_indices
from pipeline.scene.read.microlenses import read_microlenses
from pipeline.scene.read.occluders import is_visible, read_occluder_entry
from pipeline.scene.read.pictures import read_pictures
from pipeline.scene.read.response import has_response, read_colorimetry, read_irradiation, read_response
from pipeline.scene.read.targets import read_target_entry
from pipeline.scene.usd.poses import inverse, product, world_from
from pipeline.scene.usd.source_locations import place
from pipeline.scene.usd.values import Sources, UnreadableValue, need, read, read_once, take, target, targets
from pipeline.units import mm_per_unit

LAST_FRAME = 1_000_000_000
"""Largest absolute time code that is accepted as a frame."""

_TRUTH = {
    "method": "plen:truth:method",
    "search": "plen:truth:search",
    "filter": "plen:truth:filter",
    "lambda_d": "plen:truth:lambdaD",
    "lambda_alpha_deg": "plen:truth:lambdaAlpha",
    "nearest_threshold_mm": "plen:truth:nearestThreshold",
    "min_hit_fraction": "plen:truth:minHitFraction",
    "columns": "plen:truth:columns",
}

APERTURE_VALUES = {
    "annular": {"inner_semi_diameter_mm": "plen:innerSemiDiameter"},
    "rectangular": {"half_widths_mm": "plen:halfWidths"},
    "polygonal": {"blades": "plen:blades"},
}
"""Attributes that set the size of an aperture, by shape and field of `Surface`."""

_MODELS = {"pinhole": "a pinhole", "thinLens": "a thin lens"}
"""Models of a lens in words, by the value of `plen:camera:model`."""

ACCEPTANCE_VALUES: dict[str, dict[str, str]] = {
    "all": {},
    "cosine": {"acceptance_power": "plen:acceptancePower"},
    "cone": {
        "acceptance_half_angle_deg": "plen:acceptanceHalfAngle",
        "acceptance_roll_off_deg": "plen:acceptanceRollOff",
    },
}
"""Attributes that set the numbers of a pixel's acceptance, by model and field of `Sensor`."""


def read_dataset(root: Usd.Prim) -> Dataset:
    """The records of a PlenDataset whose stage passed the checks."""
    sources = Sources()
    return replace(sources.reading("dataset", _read_dataset, root, sources), sources=sources)


def _read_dataset(root: Usd.Prim, sources: Sources) -> Dataset:
    """The records of a PlenDataset; parts with sources of their own note them."""
    cameras = targets(root, "plen:cameras", "Camera")
    boards = targets(root, "plen:targets", "PlenTarget")
    occluders, lamps = seen_meshes(root), lamp_prims(root.GetStage())
    seed, numbers = need(root, "plen:seed"), frame_numbers(root)
    read = sources.reading
    return Dataset(
        stage_name=root.GetName(),
        seed=seed,
        background=need(root, "plen:background"),
        cameras=tuple(
            read(f"cameras/{camera_name(prim, root)}", read_camera_entry, prim, root, seed) for prim in cameras
        ),
        targets=tuple(read(f"targets/{prim.GetName()}", read_target_entry, prim) for prim in boards),
        frames=_read_frames(root, cameras, boards, sources),
        occluders=tuple(read("occluders", read_occluder_entry, prim, bool(lamps)) for prim in occluders),
        lamps=tuple(read("lamps", read_lamp_entry, prim, numbers) for prim in lamps),
        pictures=read_pictures(root.GetStage()),
        exports=read("exports", read_exports, root),
        meters_per_unit=UsdGeom.GetStageMetersPerUnit(root.GetStage()),
        up_axis=str(UsdGeom.GetStageUpAxis(root.GetStage())),
    )


def frame_numbers(root: Usd.Prim) -> Sequence[int]:
    """Time codes of a dataset, in the order in which they are built; empty if the stage names none."""
    frames = read(root, "plen:frames")
    if frames:
        return tuple(sorted(set(frames)))
    take("/")  # metadata of the layer
    stage = root.GetStage()
    if not (stage.HasAuthoredMetadata("startTimeCode") and stage.HasAuthoredMetadata("endTimeCode")):
        return ()
    start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if not (start.is_integer() and end.is_integer() and max(abs(start), abs(end)) <= LAST_FRAME):
        return ()
    return range(int(start), int(end) + 1)  # a list would be made before its length can be checked


def camera_name(prim: Usd.Prim, root: Usd.Prim) -> str:
    """Path of a camera below the dataset, with dots instead of slashes."""
    return str(prim.GetPath().MakeRelativePath(root.GetPath())).replace("/", ".")


def read_camera_entries(stage: Usd.Stage) -> tuple[CameraEntry, ...]:
    """Every camera with PlenCameraAPI on a stage that passed the checks, in stage order; names are relative to its
    root.
    """
    root = stage.GetDefaultPrim() or stage.GetPseudoRoot()
    seed = read(root, "plen:seed") or 0
    cameras = [prim for prim in stage.Traverse() if prim.IsA("Camera") and prim.HasAPI("PlenCameraAPI")]
    return tuple(read_camera_entry(prim, root, seed) for prim in cameras)


def read_lens_entry(stage: Usd.Stage) -> LensEntry | None:
    """The lens that is the default prim of a stage that passed the checks; None for any other stage."""
    prim = stage.GetDefaultPrim()
    if not prim or not prim.IsA("PlenLens"):
        return None
    return LensEntry(
        name=prim.GetName(),
        lens_name=need(prim, "plen:name") or prim.GetName(),
        index_source=index_source(prim, ordered_surfaces(prim)),
        wavelength_nm=need(prim, "plen:wavelength"),
        prescription=read_prescription(prim),
        stop_name=next(one.GetName() for one in ordered_surfaces(prim) if need(one, "plen:isStop")),
    )


@read_once
def read_camera_entry(prim: Usd.Prim, root: Usd.Prim, seed: int) -> CameraEntry:
    """The entry of one camera with its settings."""
    lens = target(prim, "plen:camera:lens", "PlenLens")
    sensor = target(prim, "plen:camera:sensor", "PlenSensor")
    file, line = place(prim)
    return CameraEntry(
        name=camera_name(prim, root),
        prim_path=str(prim.GetPath()),
        lens_name=_lens_name(prim, lens),
        index_source=index_source(lens, ordered_surfaces(lens)),
        wavelength_nm=need(prim, "plen:camera:wavelength"),
        weight=need(prim, "plen:camera:weight"),
        footprint=need(prim, "plen:truth:footprint"),
        asked=read_camera(prim),
        sampling=Sampling(
            supersampling=need(prim, "plen:truth:supersampling"), samples=need(prim, "plen:truth:samples"), seed=seed
        ),
        truth={field: need(prim, name) for field, name in _TRUTH.items()}
        | {"accuracy_px": read(prim, "plen:truth:accuracy")},
        image_samples=need(prim, "plen:image:samples"),
        image_noise=read(prim, "plen:image:noise"),
        bounces=need(prim, "plen:image:bounces"),
        extent=need(prim, "plen:truth:extent"),
        delivers_rays=need(prim, "plen:truth:rays"),
        f_numbers=tuple(need(prim, "plen:image:fNumbers")),
        diffraction=need(prim, "plen:image:diffraction"),
        channels=read_channels(prim),
        colorimetry=read_colorimetry(sensor, illuminant_of(prim)),
        response=read_response(sensor) if has_response(sensor) else None,
        irradiation=read_irradiation(prim),
        file=file,
        line=line,
    )


def _lens_name(prim: Usd.Prim, lens: Usd.Prim) -> str:
    """Name of the lens of a camera, with the model that stands for it."""
    name, model = need(lens, "plen:name") or lens.GetName(), need(prim, "plen:camera:model")
    return str(name) if model == PRESCRIPTION else f"{name}, as {_MODELS[model]}"


def read_camera(prim: Usd.Prim) -> Camera | FocusRequest:
    """The record of a Camera with PlenCameraAPI, with the model of its lens that it asks for; a request if it states an
    object in focus or a stop to be matched.
    """
    return with_ideal_lens(
        _read_camera(prim), need(prim, "plen:camera:model"), tuple(need(prim, "plen:camera:distortion"))
    )


@read_once
def _read_camera(prim: Usd.Prim) -> Camera | FocusRequest:
    """The record with the lens as it is prescribed."""
    array = target(prim, "plen:camera:microlenses", "PlenMicrolensArray")
    parts: dict[str, Any] = {
        "prescription": read_prescription(
            target(prim, "plen:camera:lens", "PlenLens"), need(prim, "plen:camera:wavelength")
        ),
        "sensor": read_sensor(target(prim, "plen:camera:sensor", "PlenSensor")),
        "microlenses": _read_microlenses(prim, array) if array else None,
        "circle_of_confusion_px": need(prim, "plen:camera:circleOfConfusion"),
        "near_mm": read(prim, "plen:camera:near"),
        "far_mm": read(prim, "plen:camera:far"),
        "weight": need(prim, "plen:camera:weight"),
    }
    focus_mm, match_stop = read(prim, "plen:camera:focusDistance"), need(prim, "plen:camera:stopMatch") != "none"
    if focus_mm is None and not match_stop:
        return Camera(sensor_distance_mm=need(prim, "plen:camera:sensorDistance"), **parts)
    groups = need(prim, "plen:camera:focusGroups")
    return FocusRequest(
        sensor_distance_mm=need(prim, "plen:camera:sensorDistance") if focus_mm is None or groups else None,
        focus_distance_mm=focus_mm,
        focus_type=read(prim, "plen:camera:focusType"),
        focus_groups=groups,
        match_stop=match_stop,
        **parts,
    )


def lens_groups(lens: Usd.Prim) -> list[Usd.Prim]:
    """Groups of a lens, in stage order."""
    return [prim for prim in lens.GetChildren() if prim.IsA("PlenLensGroup")]


@read_once
def read_prescription(lens: Usd.Prim, wavelength_nm: float | None = None) -> Prescription:
    """The prescription of a PlenLens at a wavelength, by default that of its printed indices."""
    prims = ordered_surfaces(lens)
    surfaces = with_indices(lens, prims, [read_surface(prim) for prim in prims], wavelength_nm)
    groups = [read_group(prim, [surface.GetName() for surface in prims]) for prim in lens_groups(lens)]
    return Prescription(surfaces=surfaces, groups=tuple(sorted(groups, key=lambda group: group.first)))


def read_group(prim: Usd.Prim, surfaces: list[str]) -> Group:
    """The record of a PlenLensGroup; `surfaces` holds the names of all surfaces of its lens in order."""
    names = need(prim, "plen:surfaces")
    first = surfaces.index(names[0]) if names and names[0] in surfaces else 0
    if not names or list(names) != surfaces[first : first + len(names)]:
        raise UnreadableValue(f"<{prim.GetPath()}> does not name surfaces that follow one another", prim)
    return Group(
        name=prim.GetName(),
        first=first,
        count=len(names),
        decentre_mm=need(prim, "plen:decentre"),
        tilt_deg=need(prim, "plen:tilt"),
        pivot_mm=need(prim, "plen:pivot"),
    )


@read_once
def read_surface(prim: Usd.Prim) -> Surface:
    """The record of a PlenSurface, with its printed index."""
    return Surface(
        radius_mm=need(prim, "plen:radius"),
        thickness_mm=need(prim, "plen:thickness"),
        semi_diameter_mm=need(prim, "plen:semiDiameter"),
        index=need(prim, "plen:index"),
        is_stop=need(prim, "plen:isStop"),
        conic=need(prim, "plen:conic"),
        even_coefficients=need(prim, "plen:evenCoefficients"),
        odd_coefficients=need(prim, "plen:oddCoefficients"),
        focal_length_mm=read(prim, "plen:focalLength"),
        decentre_mm=need(prim, "plen:decentre"),
        tilt_deg=need(prim, "plen:tilt"),
        **_read_aperture(prim),
    )


def _read_aperture(prim: Usd.Prim) -> dict[str, Any]:
    """Fields of the aperture of a surface, which lies inside the circle of its semi-diameter."""
    shape = need(prim, "plen:apertureShape")
    fields = {field: need(prim, name) for field, name in APERTURE_VALUES.get(shape, {}).items()}
    if shape in ("rectangular", "polygonal"):
        fields["aperture_rotation_deg"] = need(prim, "plen:apertureRotation")
    return fields


def read_sensor(prim: Usd.Prim) -> Sensor:
    """The record of a PlenSensor."""
    acceptance = need(prim, "plen:acceptance")
    width_px, height_px = need(prim, "plen:resolution")
    offset_x_mm, offset_y_mm = need(prim, "plen:offset")
    return Sensor(
        width_px=width_px,
        height_px=height_px,
        pitch_mm=need(prim, "plen:pixelPitch"),
        offset_x_mm=offset_x_mm,
        offset_y_mm=offset_y_mm,
        acceptance=acceptance,
        **{field: need(prim, name) for field, name in ACCEPTANCE_VALUES[acceptance].items()},
    )


def _read_microlenses(camera: Usd.Prim, array: Usd.Prim) -> MicrolensArray:
    """The microlenses of a camera."""
    return read_microlenses(
        array, need(camera, "plen:camera:microlensDistance"), need(camera, "plen:camera:wavelength")
    )


def camera_from_world(prim: Usd.Prim, times: Sequence[float], scale_mm: float) -> np.ndarray:
    """Vision frame of a camera from the world at some times, (n, 4, 4) [mm]."""
    return product(VISION_FROM_CAMERA, inverse(world_from(prim, times, scale_mm)))


def stage_mm_per_unit(prim: Usd.Prim) -> float:
    """Millimetres in one unit of the stage of a prim."""
    return mm_per_unit(UsdGeom.GetStageMetersPerUnit(prim.GetStage()))


def _read_frames(
    root: Usd.Prim, cameras: list[Usd.Prim], boards: list[Usd.Prim], sources: Sources
) -> tuple[Frame, ...]:
    numbers, scale_mm = frame_numbers(root), stage_mm_per_unit(root)

    def posed(part: str, reader: Callable[..., Any], prim: Usd.Prim) -> list[Matrix]:
        return _matrices(sources.reading(f"poses/{part}", reader, prim, numbers, scale_mm))

    names = {camera_name(prim, root): prim for prim in cameras}
    vision = {name: posed(f"cameras/{name}", camera_from_world, prim) for name, prim in names.items()}
    world = {prim.GetName(): posed(f"targets/{prim.GetName()}", world_from, prim) for prim in boards}
    hiding = {prim: posed("occluders", world_from, prim) for prim in seen_meshes(root)}
    lamps = {prim: posed("lamps", world_from_lamp, prim) for prim in lamp_prims(root.GetStage())}
    return tuple(
        Frame(
            number=number,
            camera_from_world={name: matrices[index] for name, matrices in vision.items()},
            world_from_target={name: matrices[index] for name, matrices in world.items()},
            world_from_occluder=sources.reading("poses/occluders", _visible, hiding, index, number),
            world_from_lamp=sources.reading("poses/lamps", _visible, lamps, index, number),
        )
        for index, number in enumerate(numbers)
    )


def _visible(moved: dict[Usd.Prim, list[Matrix]], index: int, number: int) -> dict[str, Matrix]:
    """Pose of each prim that is visible in a frame, by path."""
    return {str(prim.GetPath()): poses[index] for prim, poses in moved.items() if is_visible(prim, float(number))}


def _matrices(stack: np.ndarray) -> list[Matrix]:
    # + 0.0 turns -0.0, which products may leave, into 0.0: keys must not differ by it.
    return [tuple(map(tuple, matrix)) for matrix in (stack + 0.0).tolist()]
