"""Attributes that another one needs, or that mean nothing beside it, as lines of the schema's documentation say."""

import pytest
from pxr import Usd

from pipeline.scene.check.properties import check_properties


def codes(kind: str, **values: object) -> list[tuple[str, str]]:
    """Codes of the problems of a prim with some tokens, numbers and arrays, and where they are told."""
    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/A", kind)
    for name, value in values.items():
        attribute = prim.GetAttribute(f"plen:{name}")
        assert attribute, name
        attribute.Set(value)
    return [(one.code, str(one.at)) for one in check_properties(prim)]


STOP = {"semiDiameter": 4.0}


@pytest.mark.parametrize("shape", ["circular", "rectangular"])
def test_the_fallback_takes_back_what_a_file_below_says_and_is_nothing_in_vain(shape: str):
    rest = {"halfWidths": (1.0, 1.0)} if shape == "rectangular" else {}

    assert codes("PlenSurface", **STOP, **rest, apertureShape=shape, apertureRotation=0.0) == []
    turned = codes("PlenSurface", **STOP, **rest, apertureShape=shape, apertureRotation=5.0)
    assert [code for code, _ in turned] == ["aperture-value"] * (shape == "circular")


def test_an_empty_array_is_as_good_as_none():
    array = {"pitch": 0.1, "width": 1.0, "height": 1.0}

    assert codes("PlenMicrolensArray", **array, focalLengths=[1.0]) == []
    assert codes("PlenMicrolensArray", **array, focalLengths=[]) == [("missing-value", "/A")]


def test_a_wrong_value_decides_nothing():
    assert [code for code, _ in codes("PlenSurface", **STOP, apertureShape="hexagonal", blades=6)] == ["bad-token"]
