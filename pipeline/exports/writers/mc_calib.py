"""MC-Calib: detected_keypoints_data.yml, which `keypoints_path` of its configuration takes in place of images."""

from collections.abc import Iterator
from pathlib import Path

from pipeline.exports.cameras import ExportCamera
from pipeline.exports.errors import ExportError
from pipeline.exports.material import Material


def write(material: Material, folder: Path) -> None:
    """Write the file.

    Raises
    ------
    ExportError
        Points of a target form no grid.
    """
    for target in material.targets:
        if target.grid is None:
            raise ExportError(
                f"this format knows boards whose points form a grid, and {target.name} is a {target.kind}"
            )
    lines = ["%YAML:1.0", "---", *(f"# {line}" for line in material.remarks), f"nb_camera: {len(material.cameras)}"]
    for number, camera in enumerate(material.cameras):
        lines += [f"camera_{number}:", *(f"   {line}" for line in _camera(material, camera))]
    (folder / "detected_keypoints_data.yml").write_text("\n".join([*lines, ""]), encoding="utf-8")


def _camera(material: Material, camera: ExportCamera) -> Iterator[str]:
    """A camera: five lists with an entry for each board that it sees in a frame."""
    width, height = camera.size_px
    boards = [target.name for target in material.targets]
    views = [view for view in material.of(camera) if len(view.observations.ids)]
    yield f"img_width: {width}"
    yield f"img_height: {height}"
    yield f"frame_idxs: {[view.frame for view in views]}"
    yield f"frame_paths: [{', '.join(_quoted(view.image) for view in views)}]"
    yield f"board_idxs: {[boards.index(view.target) for view in views]}"
    yield "pts_2d:" if views else "pts_2d: []"
    for view in views:
        yield f"   - {[float(number) for number in view.observations.positions.ravel()]}"
    yield "charuco_idxs:" if views else "charuco_idxs: []"
    for view in views:
        yield f"   - {view.observations.ids.tolist()}"


def _quoted(text: str) -> str:
    return '"' + text + '"'
