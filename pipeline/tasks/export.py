"""Task `export`: results of a build as the files of another program, as `pipeline export` writes them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from pipeline.exports.conversion import write_format
from pipeline.exports.gathering import gather
from pipeline.exports.noise import with_noise
from pipeline.files.jsonfile import Json
from pipeline.render.surroundings import Surroundings
from pipeline.results.answers import SeenScene
from pipeline.results.output import output_of
from pipeline.results.ready_camera import ReadyCamera
from pipeline.results.records import BuiltFolder
from pipeline.tasks.artefacts.cameras import Inputs, rig_of
from pipeline.tasks.artefacts.surroundings import surroundings_of
from pipeline.tasks.params.outputs import Export


def run(params: Export, inputs: Inputs, out: Path) -> None:
    """Write the files of the format, and export.json."""
    # No import statement: what makes keys is no part of them.
    import_module("pipeline.exports.writer_code").require_code(params.format, params.code)
    places = {path: inputs[role][output] for path, (role, output) in params.files.items()}
    digests = dict.fromkeys((*places, *params.records), "")
    parts = BuiltParts(path=Path(), stage=params.stage, digests=digests, places=places, records=params.records)
    views = {(seen.number, seen.camera): seen.view for seen in params.views}

    def sight(name: str) -> ReadyCamera:
        how = params.sights[name]
        return ReadyCamera(
            name=name,
            rig=rig_of({"camera": inputs[how.camera_role]}, how.seed, how.square_px),
            min_hit_fraction=how.min_hit_fraction,
            accuracy_px=how.accuracy_px,
        )

    def before(frame: int, camera: str, only: str | None) -> Surroundings:
        view = views[frame, camera]
        if only is not None:
            some = tuple(target for target in view.targets if target.name == only)
            view = replace(view, targets=some, occluders=())
        return surroundings_of(view)

    material = gather(output_of(parts), sight, lambda: SeenScene(before), params.position)
    material = replace(material, frames=params.numbers)
    write_format(params.format, with_noise(material, params.noise), out, params.position, params.noise)


@dataclass(frozen=True, slots=True)
class BuiltParts(BuiltFolder):
    """Some files of a build, wherever they are, and the content of JSON files, by path in the output folder."""

    places: Mapping[str, Path]
    records: Mapping[str, Any]

    def file(self, name: str) -> Path | None:
        """Place of a file; None if the task was not given it."""
        return self.places.get(name)

    def record(self, name: str) -> Json:
        if name not in self.records:
            return BuiltFolder.record(self, name)
        content: Json = self.records[name]
        return content

    def present(self, name: str) -> Path:
        """Place of a file that the task was given."""
        return self.places[name]
