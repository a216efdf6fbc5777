"""A new rig: a lens, a sensor and its position, and an optional microlens array."""

from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.app.stages import asset_path, require_free, sound, stage_or_library_path, write_sound
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.errors import UsageError
from pipeline.optics.first_order import first_order
from pipeline.scene.dataset import LensEntry
from pipeline.scene.load import Loaded
from pipeline.scene.usd.problems import StageError


@dataclass(frozen=True, slots=True, kw_only=True)
class RigWish:
    """Demands on a rig. `lens`, `sensor` and `microlenses` are stages, files or names of the library. A number in place
    of a lens is the focal length of an ideal thin lens [mm], for a lens without a published prescription. A thin array
    in place of a file is written into the rig. `origin` is the author's remark.
    """

    sensor: Path
    lens: Path | float
    focus_mm: float | None
    sensor_distance_mm: float | None
    f_number: float | None = None
    microlenses: Path | MicrolensArray | None = None
    microlens_distance_mm: float | None = None
    near_mm: float | None = None
    far_mm: float | None = None
    circle_of_confusion_px: float | None = None
    origin: str = "Written by pipeline new rig"


_AS_OPTIONS = {
    "author plen:camera:near and plen:camera:far": "give --near and --far",
}
"""Hints about a stage, and their counterparts for a stage that is not written yet."""


def new_rig(out: Path, wish: RigWish) -> Loaded:
    """Write a rig and read it again.

    StageError if the lens or the rig does not pass `check`; then there is no file. UsageError if a part is missing or
    has the wrong type, demands contradict each other, or the file cannot be written.
    """
    require_free(out)
    if (wish.focus_mm is None) == (wish.sensor_distance_mm is None):
        raise UsageError(
            "a rig has a distance in focus, or a distance of its sensor from the stop",
            hint="give either --focus or --sensor-distance",
        )
    if (wish.microlenses is None) != (wish.microlens_distance_mm is None):
        raise UsageError(
            "microlenses and their distance from the sensor go together",
            hint="give --microlenses and --microlens-distance, or neither",
        )
    try:
        return write_sound(_text(out, wish, _lens(out, wish)), out)
    except StageError as error:
        mended = [replace(problem, hint=_AS_OPTIONS.get(str(problem.hint), problem.hint)) for problem in error.problems]
        raise StageError(mended) from None


def lens_of(path: Path) -> LensEntry:
    """The lens of a file, or of the library; UsageError if it is none, StageError if it does not pass `check`."""
    loaded = sound(stage_or_library_path(path))
    if loaded.lens is None:
        raise UsageError(f"{path} is no lens", hint="a stage whose default prim is a PlenLens")
    return loaded.lens


def _lens(out: Path, wish: RigWish) -> str:
    """The lens of the rig as a prim: a reference to its file, with another stop if asked for, or an ideal thin lens."""
    if isinstance(wish.lens, float):
        if wish.f_number is None:
            raise UsageError("a lens of a focal length alone has no stop", hint="give --f-number, too")
        return _THIN_LENS.format(focal_mm=wish.lens, semi_mm=wish.lens / wish.f_number / 2)
    lens = lens_of(wish.lens)
    stop = ""
    if wish.f_number is not None:
        prescription = lens.prescription
        semi_mm = prescription.stop.semi_diameter_mm * first_order(prescription).f_number / wish.f_number
        if not semi_mm:
            raise UsageError("a telecentric lens has no F-number at infinity", hint="leave --f-number out")
        stop = f'        # The stop of F/{wish.f_number:g}.\n        over "{lens.stop_name}"\n        {{\n'
        stop += f"            uniform double plen:semiDiameter = {semi_mm:.9g}\n        }}\n"
    return _part("Lens", asset_path(wish.lens, out), stop)


_THIN_LENS = """    # An ideal thin lens, as camera models have it: sharp and undistorted everywhere. No glass does it.
    def PlenLens "Lens"
    {{
        uniform token[] plen:surfaceOrder = ["Stop"]

        def PlenSurface "Stop"
        {{
            uniform double plen:focalLength = {focal_mm:.9g}
            uniform bool plen:isStop = 1
            uniform double plen:semiDiameter = {semi_mm:.9g}
        }}
    }}
"""


_UNDISTORTED = """        # Brown's distortion, k1, k2, p1, p2, k3 of OpenCV: none, until you calibrate it.
        uniform double[] plen:camera:distortion = [0, 0, 0, 0, 0]
        uniform token plen:camera:model = "thinLens"
"""


def _text(out: Path, wish: RigWish, lens: str) -> str:
    """The stage of a rig with this prim of its lens."""
    array = ""
    if wish.focus_mm is None:
        doc = f"A camera whose sensor is {wish.sensor_distance_mm:g} mm behind its stop."
        camera = f"        uniform double plen:camera:sensorDistance = {wish.sensor_distance_mm:.9g}\n"
    else:
        doc = f"A camera focused at {wish.focus_mm:g} mm from its stop."
        camera = "        # The sensor moves to where this distance is sharp;"
        camera += " plen:camera:sensorDistance would say where it stands.\n"
        camera += f"        uniform double plen:camera:focusDistance = {wish.focus_mm:.9g}\n"
    if isinstance(wish.lens, float):
        camera += _UNDISTORTED
    numbers = {"near": wish.near_mm, "far": wish.far_mm, "circleOfConfusion": wish.circle_of_confusion_px}
    for name, value in numbers.items():
        camera += "" if value is None else f"        uniform double plen:camera:{name} = {value:.9g}\n"
    if wish.microlenses is not None:
        array = _array(wish.microlenses, out)
        camera += "        rel plen:camera:microlenses = </Rig/Microlenses>\n"
        camera += f"        uniform double plen:camera:microlensDistance = {wish.microlens_distance_mm:.9g}\n"
    return f"""#usda 1.0
(
    defaultPrim = "Rig"
    doc = "{doc} {wish.origin}; edit it as you like."
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
{camera}    }}

{lens}
{_part("Sensor", asset_path(wish.sensor, out), "")}{array and chr(10)}{array}}}
"""


_THIN_ARRAY = """    def PlenMicrolensArray "Microlenses"
    {{
        uniform double[] plen:focalLengths = [{focal}]
        uniform double plen:height = {height:.9g}
        uniform token plen:layout = "{layout}"
        uniform double plen:pitch = {pitch:.9g}
        uniform double plen:width = {width:.9g}
    }}
"""


def _array(array: Path | MicrolensArray, out: Path) -> str:
    """The microlens array as a prim: a reference to its file, or the numbers of a thin one."""
    if isinstance(array, Path):
        return _part("Microlenses", asset_path(array, out), "")
    focal = ", ".join(f"{length_mm:.9g}" for length_mm in array.focal_lengths_mm)
    sizes = {"height": array.height_mm, "width": array.width_mm, "pitch": array.pitch_mm}
    return _THIN_ARRAY.format(focal=focal, layout=array.layout, **sizes)


def _part(name: str, path: str, inside: str) -> str:
    return f'    def "{name}" (\n        prepend references = @{path}@\n    )\n    {{\n{inside}    }}\n'
