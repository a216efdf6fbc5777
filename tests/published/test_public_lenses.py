"""Claim: a public lens file is read with the focal length of an independent reader, or refused for a reason.

`LENS_FILES=folder pytest -m heavy -s tests/published/test_public_lenses.py` reads all files of a folder, and prints how
they fare. A naive reader and its y-nu table judge, with indices of the glasses that we name, from optiland's data or
makers' catalogues (.agf) in the folder. zmxtools opens .zar archives for it where it is installed.
"""

import hashlib
import os
import re
import warnings
from collections import Counter, defaultdict
from contextlib import suppress
from pathlib import Path

import pytest
from files.on_the_spot import stage_prescription
from naive import lens_files as naive
from tolerances import FOCAL_LENGTH_REL

from pipeline.app.stages import import_lens, write_stage
from pipeline.errors import PipelineError
from pipeline.files.lenses.read import read_lens
from pipeline.optics.first_order import first_order
from pipeline.optics.glass.medium import D_UM
from pipeline.optics.printed import D_LINE_NM, PrintedLens

FOLDER = os.environ.get("LENS_FILES", "")
KINDS = (
    ("non-sequential", "NONSEQCO"),
    ("mirror", "is a mirror"),
    ("tilted or decentred", "COORDBRK|TILTSURF|tilted"),
    ("another type of surface", "is of type|not of revolution"),
    ("glass unknown", "glass"),
    ("afocal", "afocal"),
    ("light goes back to the scene", "leads back"),
    ("surfaces cross", "cross"),
    ("semi-diameters unknown", "no semi-diameter"),
)
"""Reasons by what messages say."""


class Indices:
    """Indices of glasses from data that we did not write."""

    def __init__(self, folder: Path) -> None:
        self.material = pytest.importorskip("optiland.materials").Material
        self.own: dict[str, dict[str, tuple[int, list[float]]]] = defaultdict(dict)
        for path in sorted(folder.rglob("*")):
            if path.suffix.lower() == ".agf":
                self.own[path.stem.upper()] |= naive.catalogue(naive.text_of(path.read_bytes()))

    def named(self, label: str, um: float) -> float:
        """Of a glass as we name it, vendor:name; KeyError where nobody knows it."""
        vendor, _, name = label.partition(":")
        with warnings.catch_warnings(), suppress(ValueError):
            warnings.simplefilter("ignore")
            found = self.material(name, reference=vendor)
            if Path(found.material_data["filename"]).stem.upper() == name.upper():  # it takes what resembles a name
                return float(found.n(um).item())
        return naive.index(*self.own[vendor.upper()][name.upper()], um)

    def of_file(self, name: str, catalogues: list[str], um: float) -> float:
        """Of a glass as its file names it; KeyError where no catalogue in the folder has it."""
        for vendor in catalogues or list(self.own):
            if name.upper() in self.own[vendor.upper()]:
                return naive.index(*self.own[vendor.upper()][name.upper()], um)
        raise KeyError(name)


def judged(path: Path, lens: PrintedLens, indices: Indices) -> tuple[float, float | None]:
    """Focal lengths [mm]: with the glasses that we name, and with those of the file where catalogues know all."""
    raw, name = path.read_bytes(), path.name
    if path.suffix.lower() == ".zar":
        zar = pytest.importorskip("zmxtools.zar")
        ((name, raw),) = [
            (m.file_name, m.unpacked_contents) for m in zar.read(path) if m.file_name.lower().endswith(".zmx")
        ]
    catalogues: list[str] = []
    if name.lower().endswith(".seq"):
        rows = naive.codev(naive.text_of(raw), is_radius="are radii" in " ".join(one.what for one in lens.lost))
    else:
        rows, catalogues = naive.zemax(naive.text_of(raw))
    um = D_UM if lens.wavelength_nm == D_LINE_NM else lens.wavelength_nm / 1000  # printed indices are n_d
    ours, theirs = [], []
    for row, surface in zip(rows, lens.surfaces, strict=True):
        ours.append(_ours(row, surface.glass, surface.index, indices, um))
        try:
            is_named = row.glass and ":" in surface.glass
            theirs.append(indices.of_file(row.glass[0], catalogues, um) if is_named else ours[-1])
        except KeyError:
            theirs.append(None)
    return naive.focal_length(rows, ours), None if None in theirs else naive.focal_length(rows, theirs)


def _ours(row: naive.Row, glass: str, index: float, indices: Indices, um: float) -> float:
    if not row.glass or row.glass[0].upper() == "AIR":
        return 1.0
    if ":" in glass:
        return indices.named(glass, um)
    written = re.sub(r"\D", "", row.glass[0]) if len(row.glass) == 1 else ""
    stated = [float(word) for word in row.glass[3:4]] + ([float(f"1.{written[:3]}")] if written else [])
    assert any(abs(index - one) < 1e-3 for one in stated), (row, glass, index)
    return index


def reason(message: str) -> str:
    first = message.split("\n")[0]
    return "refused: " + next((kind for kind, words in KINDS if re.search(words, first)), first[-50:])


@pytest.mark.heavy
@pytest.mark.skipif(not FOLDER, reason="LENS_FILES names no folder of public lens files")
def test_each_file_of_a_folder_is_read_rightly_or_refused(tmp_path: Path) -> None:
    indices, files, counts, examples = Indices(Path(FOLDER)), {}, Counter(), {}
    for path in sorted(Path(FOLDER).rglob("*")):
        if path.suffix.lower() in (".zmx", ".seq", ".zar"):
            files.setdefault(hashlib.sha256(path.read_bytes()).digest(), path)
    wrong, stands_for, unjudged = [], [], []
    for number, path in enumerate(files.values()):
        stage = tmp_path / f"{number}.usda"
        try:
            errors = [problem.message for problem in write_stage(import_lens(path).text, stage) if problem.is_error]
            why = f"check says {errors[0]}" if errors else ""
        except PipelineError as error:
            why = f"{error}".replace(str(path), path.name)
        if why:
            counts[reason(why)] += 1
            examples.setdefault(reason(why), why.replace("\n", " "))
            continue
        counts["read"] += 1
        lens, efl_mm = read_lens(path), first_order(stage_prescription(stage)).efl_mm
        try:
            named_mm, own_mm = judged(path, lens, indices)
        except (KeyError, AssertionError) as error:
            unjudged.append(f"{path.name}: {error!r}")
            continue
        if not abs(efl_mm / named_mm - 1) <= FOCAL_LENGTH_REL:
            wrong.append(f"{path.name}: {efl_mm:.9g} mm, judged {named_mm:.9g} mm")
        stands_for += [] if own_mm is None else [(abs(efl_mm / own_mm - 1), path.name)]
    print(f"\n{len(files)} distinct files")
    for kind, count in counts.most_common():
        print(f"{count:5d}  {kind:40s} {examples.get(kind, '')[:150]}")
    print(f"{counts['read'] - len(wrong) - len(unjudged):5d}  read, and judged to have the right focal length")
    print("not judged:", *unjudged, sep="\n  ")
    print("farthest from the glasses that files name, where a catalogue has them:")
    for off, name in sorted(stands_for, reverse=True)[:12]:
        print(f"  {off:.1e}  {name}")
    assert counts["read"] and not wrong, "\n".join(wrong)
