"""A new rig: a lens, a sensor and a focus distance, and microlenses if wanted."""

from dataclasses import dataclass
from pathlib import Path

from pipeline.app.authoring.assets import asset, found
from pipeline.app.importing import require_free, write_stage
from pipeline.errors import UsageError
from pipeline.optics.first_order import first_order
from pipeline.scene.load import load
from pipeline.scene.usd.problems import Problem, StageError


@dataclass(frozen=True, slots=True, kw_only=True)
class RigWish:
    """Demands on a rig.

    Attributes
    ----------
    lens, sensor : Path
        Stages: files, or names of the library.
    focus_mm : float
        Object distance from the stop that is in focus.
    f_number : float or None
        None: the stop as the lens has it.
    microlenses : Path or None
    microlens_distance_mm : float or None
        Distance of the microlenses from the sensor; only with microlenses.
    """

    lens: Path
    sensor: Path
    focus_mm: float
    f_number: float | None = None
    microlenses: Path | None = None
    microlens_distance_mm: float | None = None


def new_rig(out: Path, wish: RigWish) -> list[Problem]:
    """Write a rig that is focused by its parts; gives the problems of the new stage.

    Raises
    ------
    StageError
        The lens does not pass `check`.
    UsageError
        A part is missing or is none, or the file cannot be written.
    """
    require_free(out)
    if (wish.microlenses is None) != (wish.microlens_distance_mm is None):
        raise UsageError(
            "microlenses and their distance from the sensor go together",
            hint="give --microlenses and --microlens-distance, or neither",
        )
    loaded = load(found(wish.lens))
    if loaded.errors:
        raise StageError(loaded.problems)
    if loaded.lens is None:
        raise UsageError(f"{wish.lens} is no lens", hint="a stage whose default prim is a PlenLens")
    stop = ""
    if wish.f_number is not None:
        prescription = loaded.lens.prescription
        semi_mm = prescription.stop.semi_diameter_mm * first_order(prescription).f_number / wish.f_number
        stop = f'        # The stop of F/{wish.f_number:g}.\n        over "{loaded.lens.stop_name}"\n        {{\n'
        stop += f"            uniform double plen:semiDiameter = {semi_mm:.9g}\n        }}\n"
    return write_stage(_text(out, wish, stop), out)


def _text(out: Path, wish: RigWish, stop: str) -> str:
    array = ""
    camera = f"        uniform double plen:camera:focusDistance = {wish.focus_mm:g}\n"
    if wish.microlenses is not None:
        array = _part("Microlenses", asset(wish.microlenses, out), "")
        camera += "        rel plen:camera:microlenses = </Rig/Microlenses>\n"
        camera += f"        uniform double plen:camera:microlensDistance = {wish.microlens_distance_mm:g}\n"
    return f"""#usda 1.0
(
    defaultPrim = "Rig"
    doc = "A camera focused at {wish.focus_mm:g} mm from its stop. Written by pipeline new rig; edit it as you like."
    metersPerUnit = 0.001
    timeCodesPerSecond = 24
    upAxis = "Y"
)

def Xform "Rig" (
    kind = "assembly"
)
{{
    def Camera "Camera" (
        prepend apiSchemas = ["PlenCameraAPI"]
    )
    {{
        rel plen:camera:lens = </Rig/Lens>
        rel plen:camera:sensor = </Rig/Sensor>
        # The sensor moves to where this distance is sharp; plen:camera:sensorDistance would say where it stands.
{camera}    }}

{_part("Lens", asset(wish.lens, out), stop)}
{_part("Sensor", asset(wish.sensor, out), "")}{array and chr(10)}{array}}}
"""


def _part(name: str, path: str, inside: str) -> str:
    return f'    def "{name}" (\n        prepend references = @{path}@\n    )\n    {{\n{inside}    }}\n'
