"""A collection of FlareSim lenses, imported one by one: how many pass, with which remarks, and how well they are what
their names say. docs/lens_library.md quotes it.

python docs/lens_collection.py FOLDER [--lenses]

FOLDER holds .lens files, such as those of github.com/LocalStarlight/flaresim_nuke (lenses/lens_files, MIT licence).
"""

import argparse
import re
import tempfile
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.app.importing import write_stage
from pipeline.files.lenses.read import read_lens
from pipeline.files.lenses.stated import figures
from pipeline.files.lenses.text import UnreadableLens
from pipeline.optics.prescription import PrescriptionError
from pipeline.optics.printed import PrintedLens
from pipeline.scene.write.text import lens_text

WITHIN = (0.5, 1, 2, 5, 10)
"""Shares by which a figure may differ from the stated one [%]: the columns of the second table."""
REFUSED = {
    "has no stop": "has no stop",
    "must be a number": "states an infinite focal length",
    "beyond a sphere": "a clear aperture reaches beyond its sphere",
    "leads back": "a thickness is negative",
    "can be diameters": "F-number and shapes contradict each other",
    "semi_ap 0": "a clear aperture is 0",
    "not in air": "ends in glass",
    "afocal": "is afocal",
}
REMARKS = {
    "lost aspheric terms": "blurred on the axis: aspheric terms may be lost",
    "have the focal length": "focal length off by more than 1 %",
    "the focus lies": "back focus off by more than 1 % of the focal length",
    "with its stop": "F-number off by more than 10 %",
}


@dataclass
class Imported:
    """A file and what became of it: kinds of remarks, codes of `check`, or the reason why it was refused."""

    path: Path
    lens: PrintedLens | None = None
    refused: str = ""
    remarks: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @property
    def is_clean(self) -> bool:
        """Whether nothing at all was said but how the column of the apertures was read."""
        return not (self.refused or self.remarks or self.errors or self.warnings)


def imported(path: Path, folder: Path) -> Imported:
    """Import a file and check the stage, as `pipeline import lens FILE -o OUT.usda` does."""
    result = Imported(path)
    try:
        result.lens = read_lens(path)
        text = lens_text(result.lens)
    except (UnreadableLens, PrescriptionError) as error:
        result.refused = _kind(error.what, REFUSED)
        return result
    result.remarks = [_kind(lost.what, REMARKS) for lost in result.lens.lost[1:]]
    out = folder / "lens.usda"
    out.unlink(missing_ok=True)
    for problem in write_stage(text, out):
        (result.errors if problem.is_error else result.warnings).append(problem.code)
    return result


def _kind(said: str, kinds: dict[str, str]) -> str:
    return next((kind for words, kind in kinds.items() if words in said), said)


def stated_by_name(name: str) -> tuple[float | None, float | None]:
    """Shortest focal length [mm] and smallest F-number of a name, e.g. "Zoom 28-45mm F4.5"; None without one."""
    length = re.search(r"(\d+\.?\d*)(?:-\d+\.?\d*)? ?mm", name, re.IGNORECASE)
    speed = re.search(r"\bf/?(\d+\.?\d*)", name, re.IGNORECASE)
    return float(length[1]) if length else None, float(speed[1]) if speed else None


def deviations(lens: PrintedLens) -> dict[str, float | None]:
    """Relative differences in % of the figures of a lens from those of its name and its file."""
    found = figures(lens)
    length, speed = stated_by_name(lens.name)
    if found is None:
        return {}
    back, efl = lens.nominal_bfd_mm, lens.nominal_efl_mm
    return {
        "focal length, name": _percent(found.efl_mm, length),
        "focal length, file": _percent(found.efl_mm, efl),
        "F-number, name": _percent(abs(found.f_number), speed),
        "back focus, file, of the focal length": 100 * (found.bfd_mm - back) / abs(found.efl_mm) if back else None,
    }


def _percent(found: float, stated: float | None) -> float | None:
    return 100 * (found / stated - 1) if stated else None


def tables(results: list[Imported]) -> str:
    """The three tables of the page."""
    usable = [one for one in results if not one.refused and not one.errors]
    rows = [
        ("files", len(results)),
        ("import, and `check` finds no error", len(usable)),
        ("of these without any remark or warning", sum(one.is_clean for one in usable)),
        ("import, but `check` refuses the stage", sum(bool(one.errors) for one in results)),
        ("are refused on import", sum(bool(one.refused) for one in results)),
    ]
    text = _table(("collection", "lenses"), rows)
    kinds = [("refused", [one.refused] if one.refused else []) for one in results]
    kinds += [("remark", one.remarks) for one in results]
    kinds += [("error of `check`", one.errors) for one in results] + [
        ("warning of `check`", one.warnings) for one in results
    ]
    counts = Counter((kind, said) for kind, all_said in kinds for said in set(all_said))
    order = ["refused", "error of `check`", "remark", "warning of `check`"]
    ranked = sorted(counts.items(), key=lambda item: (order.index(item[0][0]), -item[1], item[0][1]))
    text += "\n" + _table(("what is said", "of", "lenses"), [(said, kind, count) for (kind, said), count in ranked])
    return text + "\n" + _agreement([one.lens for one in usable if one.lens])


def _agreement(lenses: list[PrintedLens]) -> str:
    found = [deviations(lens) for lens in lenses]
    rows = []
    for name in ("focal length, name", "focal length, file", "F-number, name", "back focus, file, of the focal length"):
        values = [value for one in found if (value := one.get(name)) is not None]
        rows.append((name, len(values), *(sum(abs(value) <= limit for value in values) for limit in WITHIN)))
    return _table(("figure, stated by", "stated", *(f"within {limit} %" for limit in WITHIN)), rows)


def _table(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    head = tuple(head)
    lines = [head, ("---",) * len(head), *rows]
    return "".join(
        f"| {' | '.join(f'{cell:,}' if isinstance(cell, int) else str(cell) for cell in row)} |\n" for row in lines
    )


def main() -> None:
    """Print the tables, and on request a line per lens."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of .lens files, also in folders below")
    parser.add_argument("--lenses", action="store_true", help="a line per lens with all that is said of it")
    asked = parser.parse_args()
    paths = sorted(asked.folder.rglob("*.lens"))
    if not paths:
        raise SystemExit(f"{asked.folder} holds no .lens file")
    with tempfile.TemporaryDirectory() as folder:
        results = [imported(path, Path(folder)) for path in paths]
    for one in results if asked.lenses else ():
        print(f"{one.path.name}: {one.refused or ', '.join([*one.errors, *one.remarks, *one.warnings]) or 'clean'}")
    print(tables(results), end="")


if __name__ == "__main__":
    main()
