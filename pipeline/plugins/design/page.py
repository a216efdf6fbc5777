"""A designed plenoptic camera and its judgement as a page for a terminal."""

import math
from dataclasses import asdict

from pipeline.app.pages.text import table
from pipeline.files.jsonfile import Json
from pipeline.plugins.design.formulas import PlenopticDesign
from pipeline.plugins.design.judgement import Judgement


def plain(design: PlenopticDesign, judgement: Judgement, wavelength_nm: float) -> Json:
    """Plain values of the design, its promises and its judgement."""
    camera, array = design.camera, design.array
    parts = {
        "sensor_distance_mm": camera.sensor_distance_mm,
        "microlens_distance_mm": array.distance_mm,
        "pitch_mm": array.pitch_mm,
        "layout": array.layout,
        "focal_lengths_mm": list(array.focal_lengths_mm),
        "f_number": design.f_number,
        "stop_diameter_mm": 2 * camera.prescription.stop.semi_diameter_mm,
    }
    promised = {
        "depth_of_field_mm": [list(ends) for ends in design.depth_of_field_mm],
        "virtual_depths": None if design.virtual_depths is None else list(design.virtual_depths),
        "micro_image_gap_px": design.gap_px,
        "airy_disc_px": design.airy_px(wavelength_nm),
    }
    return {"design": parts, "promised": promised, "judged": asdict(judgement)}


def page(design: PlenopticDesign, judgement: Judgement, wavelength_nm: float) -> list[str]:
    """Lines of the page; distances count from the aperture stop, + towards the scene."""
    camera, array = design.camera, design.array
    focal = ", ".join(f"{length:.5g}" for length in array.focal_lengths_mm)
    lines = [
        "designed by formulas",
        f"  sensor {camera.sensor_distance_mm:.4f} mm behind the stop,"
        f" microlenses {array.distance_mm:.4f} mm before it",
        f"  {array.layout} microlenses {array.pitch_mm:.5g} mm apart, focal lengths {focal} mm",
        f"  F/{design.f_number:.4g}, a stop of {2 * camera.prescription.stop.semi_diameter_mm:.4f} mm;"
        f" {design.gap_px:.2f} px between micro-images of {array.pitch_mm / camera.sensor.pitch_mm:.4g} px",
    ]
    if design.virtual_depths is not None:
        lines.append("  virtual depth {:.3f} at the far end, {:.3f} at the near one".format(*design.virtual_depths))
    airy = f"{design.airy_px(wavelength_nm):.2f} px at {wavelength_nm:g} nm"
    lines.append(f"  diffraction by a microlens: an Airy disc of {airy}, which no blur below includes")
    lines += ["", "judged by real rays; distances [mm] count from the aperture stop", ""]
    if judgement.depths:
        lines += [*_ranges(design, judgement), "", *_depths(judgement), ""]
    else:
        lines += ["views of one pixel are sharp from {} to {} mm, by formula".format(*map(_mm, design.range_mm)), ""]
    return [*lines, *_field(judgement), "", *_views(judgement)]


def _ranges(design: PlenopticDesign, judgement: Judgement) -> list[str]:
    ranges = enumerate(zip(judgement.depth_of_field_mm, design.depth_of_field_mm, strict=True))
    rows = [(str(kind), *map(_mm, (*judged, *promised))) for kind, (judged, promised) in ranges]
    head = f"depth of field of each type: blur of at most {design.camera.circle_of_confusion_px:g} px on the axis"
    return [head, *table(("type", "sharp from", "to", "by formula", "to"), rows)]


def _depths(judgement: Judgement) -> list[str]:
    blurs = [f"blur {kind}" for kind in range(len(judgement.depth_of_field_mm))]
    rows = []
    for row in judgement.depths:
        blur_px = ("-" if blur is None else f"{blur:+.2f}" for blur in row.blur_px)
        rows.append((_mm(row.z_mm), str(row.micro_images), _short(row.lateral_mm), _short(row.depth_mm), *blur_px))
    head = "a point on the axis: what one pixel spans or blurs, and how far it moves for one pixel of disparity"
    return [head, *table(("z", "micro-images", "lateral mm", "depth mm", *blurs), rows)]


def _field(judgement: Judgement) -> list[str]:
    rows = [
        (f"{row.from_axis_mm:.2f}", *(f"{px:.3f}" for px in row.across_px), f"{row.gap_px:+.3f}", f"{row.light:.3f}")
        for row in judgement.field
    ]
    head = "micro-images over the field: diameters, gap to the next, pupil that is not vignetted"
    return [head, *table(("from axis", "least px", "most px", "gap px", "pupil seen"), rows)]


def _views(judgement: Judgement) -> list[str]:
    rows = [
        (_mm(row.z_mm), f"{row.shift:+.4f}", _mm(row.formula_mm), _short(row.lateral_mm), _short(row.depth_mm))
        for row in judgement.views
    ]
    positions = [
        (f"{point.view_px:.4g}", *(f"{coordinate:+.3f}" for coordinate in point.place_mm), f"{point.rms_mm:.4f}")
        for point in judgement.viewpoints
    ]
    return [
        "refocusing: microlenses per pixel of view that make z sharp, and where a formula with the exit pupil puts it",
        *table(("z", "shift", "by formula", "lateral mm", "depth mm"), rows),
        "",
        f"viewpoints of views; the entrance pupil is at {judgement.entrance_pupil_mm:+.3f} mm",
        *table(("view px", "x", "y", "z", "rms"), positions),
    ]


def _mm(value: float | None) -> str:
    if value is None:
        return "-"
    return "infinity" if math.isinf(value) else f"{value:.2f}"


def _short(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"
