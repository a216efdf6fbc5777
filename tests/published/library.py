"""Lenses of the library by name."""

from pathlib import Path

from places import ROOT
from pxr import Usd

from pipeline.optics.prescription import Prescription
from pipeline.scene.lens import read_prescription


def path_of(name: str) -> Path:
    return ROOT / f"stages/lenses/{name}.usda"


def prescription(name: str) -> Prescription:
    stage = Usd.Stage.Open(path_of(name).as_posix())
    return read_prescription(stage.GetDefaultPrim())
