"""Parts of a build as a finished folder, for tasks that read them as `pipeline export` reads a folder."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.built.folder import BuiltFolder


@dataclass(frozen=True, slots=True)
class BuiltParts(BuiltFolder):
    """Some files of a build, wherever they are.

    Attributes
    ----------
    places : mapping of str to Path
        Path in the output folder -> the file.
    records : mapping of str to dict
        Path in the output folder -> content of a JSON file.
    """

    places: Mapping[str, Path]
    records: Mapping[str, Any]

    def file(self, name: str) -> Path | None:
        """Place of a file; None if the task was not given it."""
        return self.places.get(name)

    def record(self, name: str) -> dict[str, Any]:
        """Content of a JSON file."""
        if name not in self.records:
            return BuiltFolder.record(self, name)
        found: dict[str, Any] = self.records[name]
        return found

    def present(self, name: str) -> Path:
        """Place of a file that the task was given."""
        return self.places[name]


def parts_of(stage: str, places: Mapping[str, Path], records: Mapping[str, Any]) -> BuiltParts:
    """These files and records as the folder of a build."""
    digests = dict.fromkeys((*places, *records), "")
    return BuiltParts(path=Path(), stage=stage, digests=digests, places=places, records=records)
