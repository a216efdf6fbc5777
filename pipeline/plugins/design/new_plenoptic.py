"""A new plenoptic rig, designed from its requirements and judged by real rays."""

from dataclasses import dataclass
from pathlib import Path

from pipeline.app.authoring.new_rig import RigWish, lens_of, new_rig
from pipeline.app.stages import require_free, stage_or_library_path
from pipeline.camera.parts.camera import Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.errors import UsageError
from pipeline.optics.prescription import Prescription, Surface
from pipeline.plugins.design.formulas import PlenopticDesign, PlenopticWish, designed
from pipeline.plugins.design.judgement import Judgement, judged
from pipeline.results.opening import ready
from pipeline.scene.load import Loaded, sensor_figures
from pipeline.scene.usd.values import UnreadableValue


@dataclass(frozen=True)
class NewPlenoptic:
    """A written rig, its design, and its judgement by real rays."""

    loaded: Loaded
    design: PlenopticDesign
    judgement: Judgement


def new_plenoptic(out: Path, lens: Path | float, sensor: Path, wish: PlenopticWish) -> NewPlenoptic:
    """Design a rig, write it, and judge the written file.

    `lens` and `sensor` as in `RigWish`. UsageError if no camera meets the demands; further errors as for `new_rig`.
    """
    require_free(out)
    try:
        figures = sensor_figures(stage_or_library_path(sensor))
    except UnreadableValue:
        raise UsageError(f"{sensor} is no sensor", hint="a stage whose default prim is a PlenSensor") from None
    plane = Sensor(width_px=figures["width_px"], height_px=figures["height_px"], pitch_mm=figures["pitch_mm"])
    try:
        design = designed(_prescription(lens, wish), plane, wish)
    except CameraError as error:  # what was typed cannot be
        raise UsageError(error.message, hint=error.hint) from None
    rig = RigWish(
        lens=lens,
        sensor=sensor,
        focus_mm=None,
        sensor_distance_mm=design.camera.sensor_distance_mm,
        f_number=design.f_number,
        microlenses=design.array,
        microlens_distance_mm=design.array.distance_mm,
        circle_of_confusion_px=None if wish.blur_px == 1 else wish.blur_px,
        origin="Written by pipeline design plenoptic",
    )
    loaded = new_rig(out, rig)
    return NewPlenoptic(loaded, design, judged(ready(out), design.range_mm))


def _prescription(lens: Path | float, wish: PlenopticWish) -> Prescription:
    if isinstance(lens, float):
        if wish.f_number is None and wish.magnification is not None:
            raise UsageError("a lens of a focal length alone has no stop", hint="give --f-number, too")
        semi_mm = lens / (1.0 if wish.f_number is None else wish.f_number) / 2
        return Prescription(surfaces=(Surface(focal_length_mm=lens, semi_diameter_mm=semi_mm, is_stop=True),))
    return lens_of(lens).prescription
