"""Places of edits: file and line of statements that were changed, added or removed."""

from pathlib import Path
from typing import NamedTuple

from pxr import Sdf, Usd

from pipeline.scene.edits.composed import Composed, Site, site_of, written
from pipeline.scene.usd.problems import shown_path
from pipeline.scene.usd.source_locations import place
from pipeline.scene.usd.usda_lines import line_of, line_of_metadata

GONE = "removed; the line is that of the prim that held it"


class Place(NamedTuple):
    """File as messages show it, line, and a remark if the line is not that of the new value."""

    file: str | None = None
    line: int | None = None
    remark: str | None = None


class EditPlaces:
    """Search for the places of edits.

    Parameters
    ----------
    before, now : Composed
    stage : Usd.Stage
        The present stage, opened from its files.
    """

    def __init__(self, before: Composed, now: Composed, stage: Usd.Stage) -> None:
        self.before, self.now, self.stage = before, now, stage
        self._files = {layer.realPath for layer in stage.GetUsedLayers()}

    def of_opinion(self, path: Sdf.Path, time: float | None = None) -> Place:
        """The place of a prim, a property or a time sample."""
        was, now = self.before.sites.get(str(path)), self.now.sites.get(str(path))
        if now is None:
            return place_of_gone(was, GONE) if was else Place(remark="removed")
        thing = self.stage.GetObjectAtPath(path)
        file, line = place(thing, time)
        if was in (None, now) or was[0] not in self._files or was in _sites(thing):
            return Place(file, line)
        # A stronger opinion was removed from a file that still exists: that is the edit, not the value that is now
        # visible.
        return place_of_gone(was, f"removed here; {file}:{line} counts now")

    def of_metadata(self, path: Sdf.Path, field: str) -> Place:
        """The place of metadata of a prim or of the whole layer."""
        if path == Sdf.Path.absoluteRootPath:
            root = self.stage.GetRootLayer().realPath
            return Place(shown_path(root), line_of_metadata(root, field))
        spec = self.says(path, field)
        return Place(shown_path(spec.layer.realPath), line_of(*site_of(spec))) if spec else self.of_opinion(path)

    def says(self, path: Sdf.Path, field: str) -> Sdf.PrimSpec | None:
        """The strongest spec that sets a metadata field of a prim."""
        prim = self.stage.GetPrimAtPath(path)
        specs = written(prim.GetPrimStack()) if prim else []
        return next((spec for spec in specs if spec.HasInfo(field)), None)


def place_of_gone(site: Site, remark: str | None = None) -> Place:
    """The nearest line above a removed statement; no line if the file does not exist or is not text."""
    file, at = site[0], Sdf.Path(site[1])
    line = None
    if Path(file).is_file():
        while line is None and at != Sdf.Path.absoluteRootPath:
            line, at = line_of(file, str(at)), at.GetParentPath()
        line = line or 1
    return Place(shown_path(file), line, remark)


def _sites(thing: Usd.Prim | Usd.Property) -> list[Site]:
    stack = thing.GetPrimStack() if isinstance(thing, Usd.Prim) else thing.GetPropertyStack(Usd.TimeCode.Default())
    return [site_of(spec) for spec in written(stack)]
