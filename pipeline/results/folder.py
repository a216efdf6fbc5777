"""A finished output folder: the files that its manifest lists, and nothing else of it."""

import json
from collections.abc import Set
from dataclasses import dataclass
from pathlib import Path

from pipeline.engine.output import manifest
from pipeline.errors import UsageError
from pipeline.files.jsonfile import Json, read_json
from pipeline.files.tables import Table, read_table

_BUILD = "`pipeline build STAGE` fills a folder, and writes its manifest.json last"


@dataclass(frozen=True, slots=True)
class BuiltFolder:
    """A folder that a build finished.

    `path`: the folder.
    `stage`: the stage that was built, as the manifest names it.
    `digests`: SHA-256 of every file, by its posix path below the folder.
    """

    path: Path
    stage: str
    digests: dict[str, str]

    @property
    def files(self) -> Set[str]:
        """Posix paths below the folder."""
        return self.digests.keys()

    def file(self, name: str) -> Path | None:
        """Path of a file; None if this build has none of that name."""
        return self.path / name if name in self.files else None

    def table(self, name: str) -> Table:
        """A table of the build; UsageError if it is gone, DamagedFile if it cannot be read."""
        return read_table(self.present(name))

    def record(self, name: str) -> Json:
        """A JSON file of the build; raises as `table`."""
        content: Json = read_json(self.present(name))
        return content

    def folders(self, below: str, holding: str) -> list[str]:
        """Names of the folders below a folder in which a file of that name lies, sorted."""
        paths = [name.split("/") for name in self.files]
        start = below.split("/")
        deep = len(start)
        return sorted(
            parts[deep] for parts in paths if len(parts) == deep + 2 and parts[:deep] == start and parts[-1] == holding
        )

    def present(self, name: str) -> Path:
        """Path of a file that the build made; UsageError if it is gone."""
        path = self.path / name
        if not path.is_file():
            raise UsageError(
                f"{path} is missing, though manifest.json lists it", hint="build the stage again: lost files come back"
            )
        return path


def finished_folder(out: str | Path) -> BuiltFolder:
    """The output folder of a build; UsageError if it is none, or not finished, or of another version."""
    path = Path(out)
    if path.suffix in (".usda", ".usdc", ".usd") and not path.is_dir():
        raise UsageError(f"{out} is a stage, and no output folder", hint=_BUILD)
    if not path.is_dir():
        raise UsageError(f"{out} is no folder", hint=_BUILD)
    listed = manifest.read(path)
    if listed.stage is None:
        raise UsageError(f"{out} holds no finished build: {_reason(listed.data)}", hint=_hint(path))
    if not any(name.endswith("camera.json") for name in listed.files):
        raise UsageError(f"{out} holds a preview, without truth", hint="build the stage without --preview")
    digests = {name: entry.sha256 for name, entry in listed.files.items()}
    return BuiltFolder(path=path, stage=str(listed.stage), digests=digests)


def _reason(data: bytes | None) -> str:
    if data is None:
        return "it has no manifest.json"
    try:
        version = json.loads(data)["format"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return "its manifest.json is none of a build, or damaged"
    if version != manifest.FORMAT:
        return f"its manifest.json has format {version!r}, and this version reads {manifest.FORMAT}"
    return "its manifest.json is damaged"


def _hint(path: Path) -> str:
    """Advice for a folder without a manifest of ours: builds may lie below it, or it is being filled."""
    below = sorted(place.parent for place in path.glob(f"*/{manifest.NAME}"))
    if below:
        return f"did you mean {below[0]}?" if len(below) == 1 else f"{below[0]} and {len(below) - 1} more lie below it"
    if (path / "frames").is_dir() or (path / "cameras").is_dir():
        return "its build runs, or was interrupted, or made single targets: build the whole stage"
    return _BUILD
