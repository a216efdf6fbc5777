"""Text that stages of the tests have in common."""

import re


def head(prim: str, end: int = 1, unit: str = "0.001") -> str:
    """The first lines of a layer in millimetres with y up: its default prim, and frames from 1."""
    return f"""#usda 1.0
(
    defaultPrim = "{prim}"
    endTimeCode = {end}
    metersPerUnit = {unit}
    startTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Y"
)
"""


def without_method(stage: str) -> str:
    """The same stage without an opinion on `plen:truth:method`, so that a test can write its own."""
    return re.sub(" *uniform token plen:truth:method = .*\n", "", stage)
