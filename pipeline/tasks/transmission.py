"""Task `transmission`: the share of light that the lens of a camera lets pass, over its image."""

from pathlib import Path

from pipeline.files.jsonfile import read_json, write_json
from pipeline.records.plain import from_plain, to_plain
from pipeline.render.field_transmission import FieldTransmission, field_transmission
from pipeline.tasks.artefacts.cameras import Inputs, focused_camera
from pipeline.tasks.params.exposing import TRANSMISSION
from pipeline.tasks.params.exposing import Transmission as Params

_ALONE = "mono"
"""Name of the light of a camera without channels, as filters have it."""


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write transmission.json."""
    found = {}
    for light in params.lights:
        camera = focused_camera(inputs, "camera" if light.channel is None else f"camera_{light.channel}")
        found[light.channel or _ALONE] = field_transmission(camera, light.of_each)
    write_json(out / TRANSMISSION, {name: to_plain(one) for name, one in found.items()})


def transmission_of(inputs: Inputs) -> dict[str, FieldTransmission]:
    """Transmission by channel, as the task wrote it; empty where it is no input."""
    if "transmission" not in inputs:
        return {}
    plain = read_json(inputs["transmission"][TRANSMISSION])
    return {name: from_plain(FieldTransmission, one) for name, one in plain.items() if one is not None}
