"""Claim: a public lens file is read with the focal length of an independent reader, or refused for a reason.

`LENS_FILES=folder pytest -m heavy -s tests/plugins/lenses/test_public_lenses.py` reads all files of a folder, and
prints how they fare. A naive reader judges by its y-nu table, or by its rays where surfaces are displaced, with
indices of the glasses that we name, from optiland's data or makers' catalogues (.agf) in the folder. zmxtools opens
.zar archives for it where it is installed.
"""

import hashlib
import math
import os
import re
import warnings
from collections import Counter, defaultdict
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from naive import lens_files as naive
from plugins.lenses.on_the_spot import apart_mm, bending, stage_prescription
from tolerances import FOCAL_LENGTH_REL, PRINTED_INDEX

from pipeline.app.stages import import_lens, write_stage
from pipeline.errors import PipelineError
from pipeline.optics.first_order import first_order
from pipeline.optics.glass.medium import D_UM
from pipeline.optics.prescription import Prescription
from pipeline.optics.printed import D_LINE_NM, PrintedLens
from pipeline.plugins.lenses.read import read_lens

try:
    from zmxtools import zar as zmxtools
except ImportError:
    zmxtools = None

FOLDER = os.environ.get("LENS_FILES", "")
KINDS = (
    ("non-sequential", "NONSEQCO"),
    ("mirror", "is a mirror"),
    ("tilted or decentred", "is tilted|turned about"),
    ("another type of surface", "is of type|of another kind|makes the vertex a tip|not in \\(-0.001"),
    ("semi-diameters unknown", "no semi-diameter"),
    ("surfaces cross, or are no sphere so far out", " cross: |lacks .* of glass|beyond a sphere"),
    ("afocal", "afocal"),
    ("light goes back to the scene", "leads back"),
    ("ends in another medium than air", "ends in a medium"),
    ("glass unknown", "no glass|has the dispersion formula|several makers"),
)
"""Reasons by what messages say."""
MATERIALS = {
    "FUSED-SILICA": ("SiO2", "Malitson"),
    "CALCIUM-FLUORIDE": ("CaF2", "Malitson"),
    "GERMANIUM": ("Ge", "Icenogle"),
    "PMMA": ("(C5H8O2)n", "Beadie"),
}
"""Pages of refractiveindex.info by our names of materials."""


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
        page, author = MATERIALS.get(name, (name, vendor))
        with warnings.catch_warnings(), suppress(ValueError):
            warnings.simplefilter("ignore")
            found = self.material(page, reference=author)
            value = float(np.ravel(found.n(um))[0])
            # It takes what resembles a name; tables have four digits.
            if Path(found.material_data["filename"]).stem.upper() in (name.upper(), author.upper()):
                if len(found.coefficients):
                    return value
                raise KeyError(f"{label} is a table of few digits")
        return naive.index(*self.own[vendor.upper()][name.upper()], um)

    def anywhere(self, name: str, um: float) -> list[float]:
        """Of the glasses of all makers that have a name."""
        named = [own[name.upper()] for own in self.own.values() if name.upper() in own]
        return [naive.index(*one, um) for one in named if one[0] in (*naive.SELLMEIER, *naive.POWERS)]

    def of_file(self, name: str, catalogues: list[str], um: float) -> float:
        """Of a glass as its file names it; KeyError where no catalogue in the folder has it."""
        for vendor in catalogues or list(self.own):
            if name.upper() in self.own[vendor.upper()]:
                return naive.index(*self.own[vendor.upper()][name.upper()], um)
        raise KeyError(name)


def judged(path: Path, lens: PrintedLens, indices: Indices, prescription: Prescription) -> tuple[float, float | None]:
    """Relative differences of our focal length from that with the glasses that we name, and with those of the file
    where catalogues know all. With displaced surfaces, of rays over the focal length.
    """
    raw, name = path.read_bytes(), path.name
    if path.suffix.lower() == ".zar":
        if zmxtools is None:
            raise KeyError("zmxtools is not installed")
        members = [(one.file_name, one.unpacked_contents) for one in zmxtools.read(path)]
        ((name, raw),) = [(name, raw) for name, raw in members if name.lower().endswith(".zmx")]
    catalogues: list[str] = []
    if name.lower().endswith(".seq"):
        rows = naive.codev(naive.text_of(raw), is_radius="are radii" in " ".join(one.statement for one in lens.lost))
    else:
        rows, catalogues = naive.zemax(naive.text_of(raw))
    um = D_UM if lens.wavelength_nm == D_LINE_NM else lens.wavelength_nm / 1000  # printed indices are n_d
    named, bent = [_name(row) for row in rows], [surface.index for surface in lens.surfaces]
    places = bending(named, [row.focal_length for row in rows], "")
    ours = dict(zip(places, bending(bent, [surface.focal_length_mm for surface in lens.surfaces], 1.0), strict=True))
    media, theirs = [1.0], [1.0]
    for i, row in enumerate(rows):
        surface = lens.surfaces[ours[i]] if i in ours else None
        media.append(_ours(row, surface.glass, surface.index, indices, um) if surface else media[-1])
        try:
            is_named = surface and row.glass and ":" in surface.glass
            theirs.append(indices.of_file(row.glass[0], catalogues, um) if is_named else media[-1])
        except KeyError:
            theirs.append(math.nan)
    efl_mm = first_order(prescription).efl_mm
    if naive.is_displaced(rows):
        return apart_mm(rows, media[1:], prescription) / abs(efl_mm), math.nan
    return abs(efl_mm / naive.focal_length(rows, media[1:]) - 1), abs(efl_mm / naive.focal_length(rows, theirs[1:]) - 1)


def _name(row: naive.Row) -> str:
    """The medium behind a surface as its file has it; empty for air."""
    word = row.glass[0].upper() if row.glass else "AIR"
    return "" if word == "AIR" else f"{word} {row.glass[3:5]}" if word == "___BLANK" else word


def _ours(row: naive.Row, glass: str, index: float, indices: Indices, um: float) -> float:
    """Index behind a surface: of the glass that we name, else what the file states, which ours has to be."""
    if not row.glass or row.glass[0].upper() == "AIR":
        return 1.0
    if ":" in glass:
        return indices.named(glass, um)
    stated, word = [float(word) for word in row.glass[3:4]], row.glass[0].partition(":")[0]
    if re.fullmatch(r"1\.\d+", word):
        stated.append(float(word))
    if code := re.fullmatch(r"(\d{3})\d{3}|(\d{3,})\.\d{3,}", word):
        stated.append(float(f"1.{code[1] or code[2]}"))
    stated += indices.anywhere(row.glass[0], um)
    near = min(stated, key=lambda one: abs(one - index))
    assert abs(near - index) < PRINTED_INDEX, (row.glass, glass, index)
    return near


def reason(message: str) -> str:
    first = message.split("\n")[0]
    return "refused: " + next((kind for kind, words in KINDS if re.search(words, first)), first[-50:])


@pytest.mark.heavy
@pytest.mark.filterwarnings("ignore:Optimal rotation")
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
        try:
            off, off_own = judged(path, read_lens(path), indices, stage_prescription(stage))
        except (KeyError, AssertionError) as error:
            unjudged.append(f"{path.name}: {error!r}")
            continue
        if not off <= FOCAL_LENGTH_REL:
            wrong.append(f"{path.name}: judged otherwise by {off:.1e}")
        stands_for += [] if math.isnan(off_own) else [(off_own, path.name)]
    print(f"\n{len(files)} distinct files")
    for kind, count in counts.most_common():
        print(f"{count:5d}  {kind:40s} {examples.get(kind, '')[:150]}")
    judged_right = counts["read"] - len(wrong) - len(unjudged)
    print(f"{judged_right:5d}  read, and judged to have the right focal length, or the right rays")
    print("not judged:", *unjudged, sep="\n  ")
    print("farthest from the focal length with the very glasses that files name, where a catalogue has them:")
    for off, name in sorted(stands_for, reverse=True)[:12]:
        print(f"  {off:.1e}  {name}")
    assert counts["read"] and not wrong, "\n".join(wrong)
