"""Plan of cameras/CAMERA/camera.json."""

from dataclasses import replace

from pipeline.camera.focusing.focus_request import FocusRequest
from pipeline.products.camera.params import TIMES, CameraLabels, FocusLabels, Nothing
from pipeline.products.draft import Draft, light_of
from pipeline.scene.dataset import CameraEntry


def plan_cameras(draft: Draft) -> None:
    """Add the pinhole of each camera, and its first-order figures."""
    for entry in draft.dataset.cameras:
        reads = {"camera": draft.camera(entry, has_planes=True)}
        pinhole = draft.add(f"pinhole/{entry.name}", Nothing(), reads)
        if entry.windows and entry.channels:
            reads["alone"] = draft.camera(entry, is_alone=True)
        report = draft.add(f"first_order/{entry.name}", camera_labels(entry), {**reads, "pinhole": pinhole})
        for file in ("camera.json", TIMES) if entry.shutter else ("camera.json",):
            draft.files[f"cameras/{entry.name}/{file}"] = (report, file)


def camera_labels(entry: CameraEntry) -> CameraLabels:
    """Labels of a camera in camera.json, besides its figures."""
    asked = entry.asked  # the camera itself, or where it is to be focused
    focus = None
    if isinstance(asked, FocusRequest):
        focus = FocusLabels(
            focus_distance_mm=asked.focus_distance_mm,
            focus_type=None if asked.focus_distance_mm is None else asked.type,
            focus_groups=asked.focus_groups,
            group_shift_mm=entry.group_shift_mm,
            stop_match="microlenses" if asked.match_stop else "none",
        )
    return CameraLabels(
        circle_of_confusion_px=asked.circle_of_confusion_px,
        lens_name=entry.lens_name,
        index_source=entry.index_source,
        light=light_of(entry),
        focus_request=focus,
        channels=entry.channels,
        # The number of instants is of images alone.
        shutter=entry.shutter and replace(entry.shutter, instants=1),
        # Figures of the channels are those of the camera without its windows in the world.
        windows=entry.windows if entry.channels else None,
    )
