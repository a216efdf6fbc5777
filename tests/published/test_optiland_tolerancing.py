"""Claim: optiland, a lens-design program, finds the same lenses where its tolerancing is given the very same errors.

It is installed by `pip install optiland`; without it there is nothing to compare with.
"""

from pathlib import Path

import numpy as np
import pytest
from published.library import optic_of
from stage_text import tiny_text

from pipeline.optics.first_order import first_order
from pipeline.scene.load import load
from pipeline.scene.tolerances import layer_of_member

MEMBERS = 8
LENS = "/TinyConventional/Rig/Lens"
WIDE = {"radius": 0.3, "thickness": 0.1, "indexOffset": 3e-3}
"""Spreads, ten times those of a workshop: what is not linear has to agree, too."""
FIGURES = {"efl_mm": "f2", "bfd_mm": "F2"}
NAMES = {"radius": "radius", "thickness": "thickness", "indexOffset": "index"}
"""What optiland calls the numbers."""


@pytest.mark.heavy  # imports optiland
def test_optiland_finds_the_same_lenses_for_the_same_errors(tmp_path: Path) -> None:
    pytest.importorskip("optiland")
    from optiland.tolerancing.core import Tolerancing
    from optiland.tolerancing.monte_carlo import MonteCarlo

    stage = _stage(tmp_path)
    layers = [tmp_path / f"member_{number}.usda" for number in range(1, MEMBERS + 1)]
    errors = list[dict[str, float]]()
    for number, layer in enumerate(layers, 1):
        text, numbers = layer_of_member(stage, number, layer)
        layer.write_text(text, encoding="utf-8")
        errors.append({of.name: of.error for of in numbers})
    nominal = load(stage).cameras[0].asked.prescription
    optic = optic_of(nominal)
    tolerancing = Tolerancing(optic)
    for name in errors[0]:
        place, _, what = name.removeprefix(f"{LENS}/").partition(".plen:")
        row = ("S1", "S2", "S3", "S4", "S5", "Stop", "S7", "S8", "S9", "S10", "S11").index(place)
        stated = getattr(nominal.surfaces[row], {"indexOffset": "index"}.get(what, f"{what}_mm"))
        further = {"wavelength": 0.5876} if what == "indexOffset" else {}
        sampler = _Listed([stated + of[name] for of in errors])
        tolerancing.add_perturbation(NAMES[what], sampler, surface_number=row + 1, **further)
    for operand in FIGURES.values():
        tolerancing.add_operand(operand, {"optic": optic})
    trials = MonteCarlo(tolerancing)
    trials.run(MEMBERS)
    theirs = trials.get_results().iloc[:, -len(FIGURES) :].to_numpy(float)
    ours = [first_order(load(layer).cameras[0].asked.prescription) for layer in layers]
    assert np.std(theirs, axis=0).min() > 0.3
    assert np.allclose(theirs, [[getattr(of, name) for name in FIGURES] for of in ours], rtol=0, atol=1e-9)


def _stage(folder: Path) -> Path:
    """The tiny camera with wide tolerances of its lens."""
    curved = ("S1", "S2", "S3", "S4", "S5", "S7", "S8", "S9", "S10", "S11")
    having = {
        "radius": curved,
        "thickness": (*curved[:-1], "Stop"),
        "indexOffset": ("S1", "S3", "S4", "S7", "S8", "S10"),
    }
    tolerances = "".join(
        f'def PlenTolerance "{what.title()}"\n{{\nuniform double plen:tolerance:spread = {WIDE[what]}\n'
        f"rel plen:tolerance:of = [{', '.join(f'<{LENS}/{name}.plen:{what}>' for name in names)}]\n}}\n"
        for what, names in having.items()
    )
    path, sensor = folder / "dataset.usda", '        over "Sensor"\n'
    path.write_text(tiny_text("conventional", (sensor, tolerances + sensor)), encoding="utf-8")
    return path


class _Listed:
    """Optiland's sampler of numbers that were drawn before."""

    def __init__(self, values: list[float]) -> None:
        self._values, self.size = iter(values), len(values)

    def sample(self) -> float:
        return next(self._values)
