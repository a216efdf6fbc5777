"""The target of a stage as artwork on paper, for `pipeline target`."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from pipeline.app.stages import chosen, lacking, sound
from pipeline.engine.files import chosen_place
from pipeline.errors import UsageError
from pipeline.files.drawings import pdf_bytes, write_drawing
from pipeline.report.artwork import pages_of, paper_of, pdf_content, svg
from pipeline.scene.dataset import TargetEntry
from pipeline.scene.usd.problems import Problem
from pipeline.targets.mesh import MeshTarget
from pipeline.targets.target import Target


@dataclass(frozen=True)
class TargetPrint:
    """One target of a stage, and warnings about the stage."""

    entry: TargetEntry
    warnings: list[Problem]

    def page(self) -> list[str]:
        """Description of the target, as lines for a terminal."""
        target = self.entry.target
        points = target.points()
        if isinstance(target, Target):
            title, shape, ids = target.pattern.title(), target.surface.KIND, [f"ids     {target.pattern.ORDER}"]
        else:
            title, shape, ids = target.title(), "mesh", []
        lines = [f"{self.entry.name}: {title}", f"shape   {shape}", *ids]
        kinds = {kind: points.kinds.count(kind) for kind in dict.fromkeys(points.kinds)}
        lines.append("points  " + ", ".join(f"{count} x {kind}" for kind, count in kinds.items()))
        low, high = points.position_mm.min(axis=0) + 0.0, points.position_mm.max(axis=0) + 0.0
        lines.append("extent  " + ", ".join(f"{a} {x:g} to {y:g} mm" for a, x, y in zip("xyz", low, high, strict=True)))
        return lines

    def write(self, path: Path) -> str:
        """Write an SVG file of all pages, one below the other, or a PDF file; the paper that they need, in words."""
        if isinstance(self.entry.target, MeshTarget):
            raise UsageError(f'"{self.entry.name}" is a mesh, which cannot be printed on paper')
        pages = pages_of(self.entry.target, self.entry.name)
        with chosen_place("write", path):
            if path.suffix == ".svg":
                write_drawing(path, svg(pages))
            else:
                write_drawing(path, pdf_bytes([(p.width_mm, p.height_mm, pdf_content(p)) for p in pages]))
        return paper_of(pages)


def artwork(path: str | Path, target: str | None = None, allow_roots: Iterable[str | Path] = ()) -> TargetPrint:
    """The artwork of a target of a stage; StageError if the stage is wrong or has no target, UsageError as `chosen`."""
    loaded = sound(path, allow_roots)
    names = [entry.name for entry in loaded.targets]
    if not names:
        raise lacking(path, "target", "name a dataset or a file of stages/targets")
    return TargetPrint(loaded.targets[chosen(path, "target", names, target)], loaded.problems)
