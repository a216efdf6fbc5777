"""What several task kinds share: reading a focused camera and making its tracer."""

from pathlib import Path

from pipeline.camera.camera import Camera
from pipeline.camera.micro_images import MicroImages, micro_images
from pipeline.camera.tracer import Tracer
from pipeline.files.jsonfile import read_json
from pipeline.records import from_plain

Inputs = dict[str, dict[str, Path]]
"""Role -> output name -> file in the store."""

FOCUSED = "focused.json"


def focused_camera(inputs: Inputs) -> Camera:
    """The camera that the `focus` task wrote, near and far planes settled."""
    return from_plain(Camera, read_json(inputs["camera"][FOCUSED]))


def tracer_of(inputs: Inputs, seed: int) -> tuple[Tracer, MicroImages | None]:
    """Tracer and micro-images (None for a conventional camera) of the focused camera."""
    tracer = Tracer(focused_camera(inputs), seed)
    return tracer, micro_images(tracer) if tracer.camera.microlenses else None
