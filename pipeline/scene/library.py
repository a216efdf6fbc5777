"""Sensors and microlens arrays that stand alone in a file, as in the library; `load` reads every other part."""

import re
from pathlib import Path

from pipeline.files.jsonfile import Json
from pipeline.scene.sensor import read_sensor
from pipeline.scene.usd.opening import open_stage
from pipeline.scene.usd.values import need

_RESPONSE = {"bits": "plen:response:bitDepth", "full_well_electrons": "plen:response:fullWell"}
"""Figures of a sensor that says how it counts photons."""

_SENTENCE = re.compile(r"(?<=[\w)]{2})[.:] ")
"""End of the first sentence, which the dot of an initial is not; or a colon."""


def sensor_figures(path: Path) -> Json:
    """Key figures of the sensor of a file.

    Raises
    ------
    StageError
        The file is no stage.
    """
    stage, _ = open_stage(path)  # a prim lives as long as its stage
    prim = stage.GetDefaultPrim()
    sensor = read_sensor(prim)
    figures: Json = {"width_px": sensor.width_px, "height_px": sensor.height_px, "pitch_mm": sensor.pitch_mm}
    for name, attribute in _RESPONSE.items():
        if prim.HasAttribute(attribute) and prim.GetAttribute(attribute).HasAuthoredValue():
            figures[name] = need(prim, attribute)
    return figures


def array_figures(path: Path) -> Json:
    """Key figures of the microlens array of a file; raises as `sensor_figures`."""
    stage, _ = open_stage(path)
    prim = stage.GetDefaultPrim()
    return {
        "pitch_mm": need(prim, "plen:pitch"),
        "focal_lengths_mm": list(need(prim, "plen:focalLengths")),
        "layout": need(prim, "plen:layout"),
        "model": need(prim, "plen:model"),
        "size_mm": [need(prim, "plen:width"), need(prim, "plen:height")],
    }


def title_of(path: Path) -> str:
    """First sentence of the description of a file; empty if it has none."""
    stage, _ = open_stage(path)
    words = " ".join(str(stage.GetRootLayer().documentation).split())
    return _SENTENCE.split(words)[0].rstrip(".")
