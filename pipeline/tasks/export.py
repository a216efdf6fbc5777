"""Task `export`: results of a build as the files of another program, as `pipeline export` writes them."""

from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import import_module
from pathlib import Path

import numpy as np

from pipeline.built.output import output_of
from pipeline.channel_names import body_and_channel
from pipeline.exports.gathering import Around, gather
from pipeline.exports.noise import with_noise
from pipeline.exports.writing import write_format
from pipeline.render.surroundings import Surroundings
from pipeline.sight.ready_camera import ReadyCamera
from pipeline.tasks.artefacts.built_parts import parts_of
from pipeline.tasks.artefacts.cameras import Inputs, rig_of
from pipeline.tasks.artefacts.surroundings import surroundings_of
from pipeline.tasks.params.exports import Export as Params
from pipeline.tasks.params.exports import SeenFrame


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write the files of the format, and export.json."""
    # No import statement: what makes keys is no part of them.
    import_module("pipeline.exports.writer_code").require_code(params.format, params.code)
    places = {path: inputs[role][output] for path, (role, output) in params.files.items()}
    output = output_of(parts_of(params.stage, places, params.records))

    def sight(name: str) -> ReadyCamera:
        how = params.sights[name]
        settled = {"camera": inputs[how.camera_role], "planes": inputs[how.planes_role]}
        return ReadyCamera(
            name=name,
            rig=rig_of(settled, how.seed, how.square_px),
            min_hit_fraction=how.min_hit_fraction,
            accuracy_px=how.accuracy_px,
        )

    around = Around(sight=sight, scene=lambda: SeenScene(params.views))
    material = replace(gather(output, params.position, around), frames=params.numbers)
    write_format(params.format, with_noise(material, params.noise), out, params.position, params.noise)


@dataclass(frozen=True, eq=False)
class SeenScene:
    """Targets and occluders before the cameras, as `sight.scenes.BuiltScene` has them."""

    views: tuple[SeenFrame, ...]

    def distance_mm(self, frame: int, camera: str, origin_mm: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Way along rays (n, 3) of the vision frame to the first surface, (n,); NaN: there is none."""
        return self._around(frame, body_and_channel(camera)[0]).distance_mm(origin_mm, direction)

    @lru_cache(maxsize=1)  # noqa: B019 (a band of rows follows another, and there is one scene at a time)
    def _around(self, frame: int, camera: str) -> Surroundings:
        """Everything before a camera in a frame."""
        (view,) = [one.view for one in self.views if (one.number, one.camera) == (frame, camera)]
        return surroundings_of(view.targets, view.occluders)
