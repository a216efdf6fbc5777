"""Checks of a camera as a whole: its parts must fit together."""

from collections.abc import Iterator

from pxr import Usd

from pipeline.camera.parts.camera import REPLICAS
from pipeline.errors import PipelineError
from pipeline.optics.prescription import Prescription
from pipeline.scene.check.camera.channels import check_channels
from pipeline.scene.check.camera.focus import check_focus, check_request
from pipeline.scene.check.camera.glass import check_formulas, check_wavelength
from pipeline.scene.check.camera.microlenses import check_microlens_glass, check_near_microlenses
from pipeline.scene.check.camera.response import check_exposure
from pipeline.scene.read.prims import read_prescription
from pipeline.scene.usd.hints import of_reader
from pipeline.scene.usd.problems import Problem
from pipeline.scene.usd.source_locations import problem
from pipeline.scene.usd.values import read, target, target_paths


def check_camera(camera: Usd.Prim) -> Iterator[Problem]:
    """Problems of a Camera with PlenCameraAPI as a whole."""
    for name in ("plen:camera:lens", "plen:camera:sensor", "plen:camera:microlenses"):
        relationship = camera.GetRelationship(name)
        count = len(target_paths(relationship))
        if count > 1:
            message = f'"{name}" has {count} targets, a camera has one'
            yield problem(relationship, "several-targets", message)
    for name in ("plen:truth:samples", "plen:image:samples"):
        yield from _check_samples(camera, name)
    yield from check_request(camera)
    lens = target(camera, "plen:camera:lens", "PlenLens")
    if lens:
        yield from check_wavelength(camera, lens)
        yield from check_formulas(camera, lens)
        yield from check_channels(camera, lens)
    if sensor := target(camera, "plen:camera:sensor", "PlenSensor"):
        yield from check_exposure(camera, sensor)
    array = target(camera, "plen:camera:microlenses", "PlenMicrolensArray")
    if array:
        yield from check_microlens_glass(camera, array)
        yield from check_near_microlenses(camera, array)
    try:
        prescription = read_prescription(lens, read(camera, "plen:camera:wavelength")) if lens else None
    except PipelineError as error:
        yield of_reader(camera, error)
        return
    if prescription:
        yield from _check_behind_lens(camera, prescription)
        yield from _check_near_far(camera, prescription)
        yield from check_focus(camera)


def _check_samples(camera: Usd.Prim, name: str) -> Iterator[Problem]:
    samples = read(camera, name)
    if not isinstance(samples, int) or samples < REPLICAS:
        return
    per_replica, rest = divmod(samples, REPLICAS)
    if rest or per_replica & (per_replica - 1):
        power = REPLICAS * 2 ** (per_replica.bit_length() - 1)
        message = f'"{name}" = {samples} is not {REPLICAS} times a power of two'
        yield problem(camera.GetAttribute(name), "samples", message, hint=f"take {power} or {2 * power}")


def _check_behind_lens(camera: Usd.Prim, prescription: Prescription) -> Iterator[Problem]:
    sensor_mm = read(camera, "plen:camera:sensorDistance")
    if sensor_mm is None:
        return
    last_mm = prescription.vertices_from_stop_mm[-1]
    film = [("sensor", "plen:camera:sensorDistance", sensor_mm)]
    microlens_mm = read(camera, "plen:camera:microlensDistance")
    if microlens_mm is not None:
        film.append(("microlens array", "plen:camera:microlensDistance", sensor_mm - microlens_mm))
    for what, name, distance_mm in film:
        if distance_mm <= last_mm:
            message = (
                f"the {what} is {distance_mm:.6g} mm behind the stop, inside the lens, whose last vertex is"
                f" {last_mm:.6g} mm behind it"
            )
            yield problem(camera.GetAttribute(name), "inside-lens", message)
            return


def _check_near_far(camera: Usd.Prim, prescription: Prescription) -> Iterator[Problem]:
    near_mm, far_mm = read(camera, "plen:camera:near"), read(camera, "plen:camera:far")
    first_mm = -prescription.vertices_from_stop_mm[0]
    if near_mm is not None and far_mm is not None and not near_mm < far_mm:
        message = f"the near plane ({near_mm:g} mm) is not nearer than the far plane ({far_mm:g} mm)"
        yield problem(camera.GetAttribute("plen:camera:near"), "near-far", message)
    for name, plane_mm in (("plen:camera:near", near_mm), ("plen:camera:far", far_mm)):
        if plane_mm is not None and plane_mm <= first_mm:
            inside = f"inside the lens, whose first vertex is {first_mm:g} mm before the stop"
            message = f'"{name}" = {plane_mm:g} mm lies {inside}'
            yield problem(camera.GetAttribute(name), "inside-lens", message)
