"""The output folder of a build as records: cameras, frames, targets, poses, and the ground truth as arrays."""

from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from fnmatch import fnmatch
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.channel_names import body_and_channel, name_with
from pipeline.errors import UsageError
from pipeline.results.notebook import html_table
from pipeline.results.records import BuiltCamera, BuiltFolder, BuiltTarget, BuiltView, finished_folder, target
from pipeline.results.rows import CorrespondenceRows, as_pandas, joined, rows_of
from pipeline.spelling import did_you_mean

if TYPE_CHECKING:
    import pandas


class Named(dict[str, Any]):
    """Things by name; the error about a wrong name lists the right ones, and only names are printed."""

    def __missing__(self, name: Any) -> Any:
        raise KeyError(f"{name!r} is none of {', '.join(self)}")

    def __repr__(self) -> str:
        return f"<{', '.join(self)}>"


@dataclass(frozen=True, kw_only=True)
class Output:
    """Content of an output folder. Tables and poses are read when they are first asked for.

    `stage`: the stage that was built, as the manifest names it.
    `cameras`: sorted by name; a camera with channels has an entry for each, as `Rig.Camera@red`.
    `frames`: sorted; each camera has a view of each. One whose lens or sensor changes is a camera in each of its
    states, as `Rig.Camera.0001`, with a view of each frame in which it is in that state.
    """

    path: Path
    stage: str
    cameras: Mapping[str, BuiltCamera]
    targets: Mapping[str, BuiltTarget] = field(repr=False)
    frames: tuple[int, ...]
    _folder: BuiltFolder = field(repr=False, compare=False)

    @property
    def camera(self) -> BuiltCamera:
        """The only camera; UsageError if there are several."""
        if len(self.cameras) != 1:
            raise UsageError(f"{self.path} has {len(self.cameras)} cameras", hint=f"choose: {', '.join(self.cameras)}")
        return next(iter(self.cameras.values()))

    def view(self, frame: int, camera: str | None = None) -> BuiltView:
        """A camera in a frame; by default the only one there. UsageError if there is no such camera or frame."""
        if camera is not None and camera not in self.cameras:
            hint = did_you_mean(camera, self.cameras) or f"its cameras: {', '.join(self.cameras)}"
            raise UsageError(f"{self.path} has no camera {camera!r}", hint=hint)
        cameras = self.cameras.values() if camera is None else [self.cameras[camera]]
        views = [view for entry in cameras for view in entry.views if view.frame == frame]
        if len(views) > 1:
            names = ", ".join(view.camera for view in views)
            raise UsageError(f"{self.path} has {len(views)} cameras in frame {frame}", hint=f"choose: {names}")
        if views:
            return views[0]
        raise UsageError(f"{self.path} has no frame {frame}", hint=f"its frames: {', '.join(map(str, self.frames))}")

    @cached_property
    def correspondences(self) -> CorrespondenceRows:
        """The ground truth of all cameras and frames; UsageError if only some are plenoptic: their columns differ."""
        return joined([camera.correspondences for camera in self.cameras.values()])

    @cached_property
    def baselines(self) -> np.recarray | None:
        """Rows of baselines.csv; None with one camera."""
        name = "baselines.csv"
        return rows_of(self._folder.table(name)) if self._folder.file(name) else None

    def pandas(self) -> "pandas.DataFrame":
        """The correspondences as a data frame."""
        return as_pandas(self.correspondences)

    def _repr_html_(self) -> str:
        """Cameras and targets, for a notebook."""
        facts = self._folder.record("manifest.json")["points"]
        cameras = []
        for name, camera in self.cameras.items():
            width, height = camera.size_px
            rows = sum(frame["rows"] for frame in facts[name]["frames"]) if name in facts else "-"
            kind = "plenoptic" if camera.is_plenoptic else "conventional"
            cameras.append((name, kind, camera.record["lens"]["name"], f"{width} x {height}", len(camera.views), rows))
        targets = [(target.name, target.kind, len(target.points_mm)) for target in self.targets.values()]
        names = ("camera", "kind", "lens", "image [px]", "frames", "rows of truth")
        return html_table(names, cameras, str(self.path)) + html_table(("target", "kind", "points"), targets)


def open_output(out: str | Path) -> Output:
    """Open the folder that a build filled.

    Only the files that docs/outputs.md promises are read, and the store is not needed. Nothing is verified:
    `pipeline verify` does that. UsageError if it holds no finished build, or one of another version; DamagedFile if a
    file in it cannot be read.

    Examples
    --------
    >>> out = pipeline.open_output("build/01_conventional")  # doctest: +SKIP
    >>> out.camera.correspondences.x_px  # doctest: +SKIP
    """
    folder = finished_folder(out)
    frames = tuple(sorted({int(name.split("/")[1]) for name in folder.files if name.startswith("frames/")}))
    bodies = sorted(name.split("/")[1] for name in folder.files if fnmatch(name, "cameras/*/camera.json"))
    exposed = {(parts[1], parts[2]) for name in folder.files if (parts := name.split("/"))[0] == "frames"}
    cameras = {name: _camera(folder, name, frames, exposed) for body in bodies for name in _in_channels(folder, body)}
    names = sorted(Path(name).stem for name in folder.files if name.startswith("targets/"))
    return Output(
        path=folder.path,
        stage=folder.stage,
        cameras=Named(cameras),
        targets=Named({name: target(name, folder.record(f"targets/{name}.json")) for name in names}),
        frames=frames,
        _folder=folder,
    )


def _in_channels(folder: BuiltFolder, name: str) -> list[str]:
    """Names of a camera's channels, each a camera of its own; for a camera of one wavelength, its own name."""
    channels = folder.record(f"cameras/{name}/camera.json").get("channels", ())
    return [name_with(name, channel["name"]) for channel in channels] or [name]


def _camera(folder: BuiltFolder, name: str, frames: tuple[int, ...], exposed: Set[tuple[str, str]]) -> BuiltCamera:
    """A camera or channel with a view of each frame for which the build made files."""
    body = body_and_channel(name)[0]
    record = folder.record(f"cameras/{body}/camera.json")
    width, height = record["resolution"]
    is_plenoptic = "mla" in record
    views = (
        BuiltView(camera=name, frame=frame, is_plenoptic=is_plenoptic, size_px=(width, height), _folder=folder)
        for frame in frames
        if (f"{frame:04d}", body) in exposed
    )
    return BuiltCamera(name=name, record=record, views=tuple(views), _folder=folder)
