"""Ready cameras and the scene before them: from a stage, the folder of a build, or records without USD."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.errors import UsageError
from pipeline.results.answers import SeenScene
from pipeline.results.ready_camera import ReadyCamera
from pipeline.results.records import finished_folder
from pipeline.scene.dataset import CameraEntry, VariedNumber
from pipeline.scene.load import load, open_dataset, varied_cameras
from pipeline.scene.usd.problems import StageError, blamed_on
from pipeline.scene.views import surroundings
from pipeline.spelling import did_you_mean
from pipeline.truth.settings import TruthSettings

STAGE = "dataset.usda"
"""Name of the built stage in the folder of a build; it is self-contained, so no other file is needed."""


def ready(source: str | Path | Camera, name: str | None = None, allow_roots: Iterable[str | Path] = ()) -> ReadyCamera:
    """A camera that projects points and knows its rays, by the solver of the ground truth.

    Parameters
    ----------
    source : path or Camera
        A stage, the folder that a build filled, or a record.
    name : str, optional
        Name of the camera, as in tables: `Rig.Camera`, or `Rig.Camera@red` for a channel; by default the only one.
    allow_roots : iterable of path
        Folders that the stage may read from, besides its project and the shipped library.

    Raises UsageError without such a stage, folder or camera, StageError if the stage has errors, and CameraError if the
    camera cannot be focused.

    Examples
    --------
    >>> camera = pipeline.ready("build/01_conventional")  # doctest: +SKIP
    >>> camera.project([[0, 0, 435.0]]).x_px  # doctest: +SKIP
    """
    if isinstance(source, Camera):
        settings = TruthSettings()
        rig = Rig.of(Tracer(source))
        return ReadyCamera(name="", rig=rig, min_hit_fraction=settings.min_hit_fraction, accuracy_px=settings.aim_px)
    if not isinstance(source, str | Path):
        hint = "give its `path`" if hasattr(source, "path") else "give a path, or a Camera"
        raise UsageError(f"a {type(source).__name__} is no stage, no folder of a build and no Camera", hint=hint)
    return opened(Path(source), name, allow_roots).ready()


@dataclass(frozen=True, kw_only=True)
class Opened:
    """A camera, or a channel of one, from a stage or from the stage in a build folder, before it is made ready.

    The seed is that of the dataset; 0 for a rig alone.
    """

    stage: Path
    entry: CameraEntry
    seed: int
    allow_roots: tuple[str | Path, ...] = ()

    def ready(self) -> ReadyCamera:
        """The camera, made ready as a build does it."""
        entry = self.entry
        with blamed_on(entry.file, entry.line, entry.prim_path):
            rig = Rig.of(Tracer(entry.camera, self.seed), entry.square_px)
        return ReadyCamera(
            name=entry.full_name,
            rig=rig,
            min_hit_fraction=entry.truth.min_hit_fraction,
            accuracy_px=entry.truth.aim_px,
            shutter=entry.shutter,
            vary=self._vary,
        )

    def _vary(self, path: str) -> list[VariedNumber[Camera]]:
        """The camera with each number of a property slightly decreased and increased; StageError if it holds none."""
        numbers = varied_cameras(self.stage, path, self.allow_roots)

        def of(cameras: Iterable[CameraEntry]) -> Camera:
            return _entry(cameras, self.entry.full_name, self.stage).camera

        return [number.mapped(of) for number in numbers]


def opened(path: Path, name: str | None = None, allow_roots: Iterable[str | Path] = ()) -> Opened:
    """A camera of a stage or of a build folder; raises as `ready`."""
    stage = finished_folder(path).path / STAGE if path.is_dir() else path
    allow_roots = tuple(allow_roots)
    loaded = load(stage, allow_roots)
    if loaded.errors:
        raise StageError(loaded.problems)
    cameras = loaded.dataset.cameras if loaded.dataset else loaded.cameras
    seed = loaded.dataset.seed if loaded.dataset else 0
    return Opened(stage=stage, entry=_entry(cameras, name, path), seed=seed, allow_roots=allow_roots)


def _entry(cameras: Iterable[CameraEntry], name: str | None, path: Path) -> CameraEntry:
    """The camera or channel of this name, by default the only one; UsageError if there is none, or several."""
    entries = {entry.full_name: entry for camera in cameras for entry in camera.in_channels}
    if name is None and len(entries) == 1:
        return next(iter(entries.values()))
    if not entries:
        raise UsageError(f"{path} has no camera", hint="name a dataset, a rig or the folder of a build")
    listed = ", ".join(entries)
    if name is None:
        raise UsageError(f"{path} has {len(entries)} cameras", hint=f"choose: {listed}")
    if name not in entries:
        raise UsageError(f"{path} has no camera {name!r}", hint=did_you_mean(name, entries) or f"its cameras: {listed}")
    return entries[name]


def scene_of(out: Path) -> SeenScene:
    """The scene of the stage that was built."""
    dataset = open_dataset(finished_folder(out).path / STAGE)
    frames = {frame.number: frame for frame in dataset.frames}
    return SeenScene(lambda number, camera, only: surroundings(dataset, frames[number], camera, only))
