"""The scene of a build as rays meet it: targets and occluders of a frame before a camera."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from pipeline.built.folder import finished_folder
from pipeline.channel_names import body_and_channel
from pipeline.render.surroundings import Surroundings
from pipeline.scene.dataset import Dataset
from pipeline.scene.load import open_dataset
from pipeline.scene.views import surroundings
from pipeline.sight.opening import STAGE


@dataclass(frozen=True, eq=False)
class BuiltScene:
    """Targets and other things before the cameras of a dataset."""

    dataset: Dataset

    def distance_mm(self, frame: int, camera: str, origin_mm: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Way along rays (n, 3) of the vision frame, of unit directions, to the first surface, (n,); NaN: there is
        none.
        """
        return self._around(frame, body_and_channel(camera)[0]).distance_mm(origin_mm, direction)

    @lru_cache(maxsize=1)  # noqa: B019 (a band of rows follows another, and there is one scene at a time)
    def _around(self, frame: int, camera: str) -> Surroundings:
        """Everything before a camera in a frame."""
        (there,) = [one for one in self.dataset.frames if one.number == frame]
        return surroundings(self.dataset, there, camera)


def scene_of(out: Path) -> BuiltScene:
    """The scene of the stage that was built."""
    return BuiltScene(open_dataset(finished_folder(out).path / STAGE))
