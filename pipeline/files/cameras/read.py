"""Import of a camera from the file of another program, chosen by the suffix of its name."""

from pathlib import Path

from pipeline.camera.parts.camera import PrintedCamera
from pipeline.files.cameras.blender import read_blender_camera
from pipeline.files.cameras.libpleno import read_libpleno
from pipeline.files.lenses.text import UnreadableLens, computing


def read_camera_file(path: str | Path, lens: Path | None = None) -> PrintedCamera:
    """A camera with its parts.

    Raises UnreadableLens: the format is unknown, or the camera cannot be represented.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".csv":
        with computing(path):
            return read_blender_camera(path, lens)
    if lens is not None:
        raise UnreadableLens(path, "--lens is for cameras of the Blender add-on (.csv)")
    if suffix != ".js":
        hint = "known are .csv (the Blender add-on), .js (libpleno)"
        raise UnreadableLens(path, f'camera files do not end in "{suffix}"', hint=hint)
    with computing(path):
        return read_libpleno(path)
