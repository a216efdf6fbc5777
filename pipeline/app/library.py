"""The library of stages with the key figures of each part."""

from dataclasses import dataclass
from pathlib import Path

from pipeline.camera.figures.first_order_figures import lens_report
from pipeline.errors import UsageError
from pipeline.folders import shipped_folder
from pipeline.scene.load import array_figures, load, sensor_figures, title_of
from pipeline.spelling import did_you_mean

Figures = dict[str, float | str | list[float] | None]
"""Key figures of a part by names with units."""
KINDS = ("lenses", "rigs", "sensors", "mlas", "targets")


@dataclass(frozen=True, slots=True, kw_only=True)
class LibraryPart:
    """A file of the library: the name by which stages refer to it, a description, and its key figures."""

    name: str
    title: str
    figures: Figures

    def to_dict(self) -> Figures:
        """Plain data, as in `library --json`."""
        return {"name": self.name, "title": self.title, **self.figures}


def library(kind: str | None = None) -> dict[str, list[LibraryPart]]:
    """Parts by kind, of one kind or of all; UsageError if there is no such kind."""
    if kind is not None and kind not in KINDS:
        hint = _hint_for_part(Path(kind).stem) or did_you_mean(kind, KINDS) or f"there are {', '.join(KINDS)}"
        raise UsageError(f"the library has no {kind}", hint=hint)
    return {
        name: [
            LibraryPart(name=f"{name}/{path.name}", title=title_of(path), figures=_FIGURES[name](path))
            for path in _files(name)
        ]
        for name in (KINDS if kind is None else (kind,))
    }


def _hint_for_part(name: str) -> str | None:
    """Hint for a part named in place of a kind."""
    kind = next((kind for kind in KINDS for path in _files(kind) if path.stem == name), None)
    if kind is None:
        return None
    verb = {"lenses": "show", "rigs": "show", "targets": "target"}.get(kind)
    more = f", `pipeline {verb} {kind}/{name}.usda` tells more" if verb else ""
    return f"it is one of the {kind}: `pipeline library {kind}` lists it{more}"


def _files(kind: str) -> list[Path]:
    return sorted((shipped_folder("stages") / kind).glob("*.usda"))


def _lens_figures(path: Path) -> Figures:
    lens = load(path).lens
    assert lens is not None, path
    report = lens_report(lens.prescription)
    return {name: report[name] for name in ("efl_mm", "f_number", "bfd_mm", "length_mm", "surfaces")}


def _rig_figures(path: Path) -> Figures:
    entry = load(path).cameras[0]
    camera = entry.asked
    report = lens_report(camera.prescription)
    sensor = camera.sensor
    figures = {"lens": entry.lens_name, "efl_mm": report["efl_mm"], "f_number": report["f_number"]}
    figures |= {"width_px": sensor.width_px, "height_px": sensor.height_px, "pitch_mm": sensor.pitch_mm}
    array = camera.microlenses
    return {**figures, "microlens_types": None if array is None else len(array.focal_lengths_mm)}


def _target_figures(path: Path) -> Figures:
    target = load(path).targets[0].target
    return {"kind": target.kind, "points": len(target.points().kinds)}


_FIGURES = {
    "lenses": _lens_figures,
    "rigs": _rig_figures,
    "sensors": sensor_figures,
    "mlas": array_figures,
    "targets": _target_figures,
}
