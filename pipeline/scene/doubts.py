"""Warnings about cameras whose parts hardly fit together, mostly because of a wrong unit."""

from collections.abc import Iterator

from pxr import Usd

from pipeline.camera.figures.doubts import doubts, pixel_doubts
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.errors import PipelineError
from pipeline.scene.dataset import CameraEntry
from pipeline.scene.glass import ordered_surfaces
from pipeline.scene.losses import check_angles
from pipeline.scene.microlenses import by_type
from pipeline.scene.sensor import read_sensor
from pipeline.scene.usd.problems import Problem, of_reader, problem
from pipeline.scene.usd.values import read, target


def check_doubts(stage: Usd.Stage, cameras: tuple[CameraEntry, ...]) -> Iterator[Problem]:
    """Warnings about each camera, at the attribute most likely to blame; an error if no ray can be traced."""
    alone = [prim for prim in stage.Traverse() if prim.IsA("PlenSensor")] if not cameras else []
    for prim in alone:
        for doubt in pixel_doubts(read_sensor(prim)):
            blamed = prim.GetAttribute("plen:pixelPitch")
            yield problem(blamed, doubt.code, doubt.what, hint=doubt.hint, severity="warning")
    for entry in cameras:
        prim = stage.GetPrimAtPath(entry.prim_path)
        try:
            camera = focused(entry.camera)
        except (PipelineError, ArithmeticError) as error:
            yield of_reader(prim, error)
            continue
        try:
            for doubt in doubts(camera):
                blamed = _blamed(prim, camera, doubt.part)
                yield problem(blamed, doubt.code, doubt.what, hint=doubt.hint, severity="warning")
        except CameraError as error:
            yield problem(_blamed(prim, camera, "sensor"), "no-chief-ray", error.what, hint=error.hint)
        except ArithmeticError:
            continue  # a pupil on the sensor or at infinity: no figure tells whether that was intended
        yield from check_angles(prim, camera)


def _blamed(prim: Usd.Prim, camera: Camera, part: str) -> Usd.Prim | Usd.Property:
    """The attribute that states the doubtful value."""
    if part == "stop":
        if read(prim, "plen:camera:stopMatch") == "microlenses":
            return prim
        lens = target(prim, "plen:camera:lens", "PlenLens")
        return ordered_surfaces(lens)[camera.prescription.stop_index].GetAttribute("plen:semiDiameter")
    if part in ("sensor", "image"):
        sensor = target(prim, "plen:camera:sensor", "PlenSensor")
        if part == "image":
            return sensor
        # An override of the stage itself is more likely to be wrong than a file of the library.
        attributes = [sensor.GetAttribute("plen:pixelPitch"), sensor.GetAttribute("plen:resolution")]
        root = prim.GetStage().GetRootLayer()
        return next(
            (attribute for attribute in attributes if attribute.GetPropertyStack()[0].layer == root), attributes[0]
        )
    array = target(prim, "plen:camera:microlenses", "PlenMicrolensArray")
    if part == "microlenses":
        return array
    if part == "focal_lengths":
        return array.GetAttribute(by_type(array))
    return prim
