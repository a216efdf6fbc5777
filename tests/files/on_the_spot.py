"""Files written on the spot and what their readers say, and rays into the lenses that come out."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Usd

from pipeline.files.lenses.text import UnreadableLens
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import Prescription
from pipeline.scene.lens import read_prescription

LENSES = Path(__file__).resolve().parents[2] / "stages/lenses"


def read(reader: Callable[..., Any], folder: Path, name: str, text: str | bytes, **options: Any) -> Any:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return reader(path, **options)


def refused(reader: Callable[..., Any], folder: Path, name: str, text: str | bytes, **options: Any) -> str:
    with pytest.raises(UnreadableLens) as error:
        read(reader, folder, name, text, **options)
    return str(error.value).replace(f"{folder}/", "")


def stage_prescription(path: Path, wavelength_nm: float | None = None) -> Prescription:
    stage = Usd.Stage.Open(path.as_posix())
    return read_prescription(stage.GetDefaultPrim(), wavelength_nm)


def before(lens: Prescription, across_mm: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Starts (n, 3) 5 mm before a lens of rays that aim at points (n, 2) of its entrance pupil."""
    position = np.column_stack([across_mm, np.full(len(across_mm), -first_order(lens).entrance_pupil.z_mm)])
    start_mm = lens.vertices_from_stop_mm[0] - 5
    return position + direction * ((start_mm - position[:, 2]) / direction[:, 2])[:, None]
