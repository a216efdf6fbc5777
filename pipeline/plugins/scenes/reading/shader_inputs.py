"""Inputs of shaders as their definitions have them: numbers of components, ranges and tokens."""

from functools import cache
from typing import Any

from pxr import Sdr

from pipeline.scene.usd.values import Range, numbers

_RANGES = {"ior": Range(low=0.0, high=1e3), "emissiveColor": Range(low=0.0, high=1e30)}
"""Ranges of inputs [1]: of indices with which no surface reflects more light than it gets, and of radiance."""
_ANY = Range(low=-1e9, high=1e9)
"""Range of all other inputs [1]: shares are cut to 0 to 1, as renderers do."""


def expected_content(shader_id: str, name: str, value: Any) -> str | None:
    """Content of an input by the definition of its shader, in words, if a value of USD is not that; else None."""
    count, tokens = _declared(shader_id).get(name, (0, ()))
    if tokens:
        return None if value in tokens else f"one of {', '.join(tokens)}"
    if not count:
        return None if isinstance(value, str) else "a text"
    values, span = numbers(value), _RANGES.get(name, _ANY)
    return None if len(values) == count and span.holds(values).all() else f"{count} in {span}"


@cache
def _declared(shader_id: str) -> dict[str, tuple[int, tuple[str, ...]]]:
    """Inputs of a shader: the number of components, 0 for texts, and the allowed tokens."""
    shader = Sdr.Registry().GetShaderNodeByIdentifier(shader_id)
    inputs = {name: shader.GetShaderInput(name) for name in shader.GetShaderInputNames()}
    return {
        name: (len(numbers(declared.GetDefaultValueAsSdfType())), tuple(token for token, _ in declared.GetOptions()))
        for name, declared in inputs.items()
    }
