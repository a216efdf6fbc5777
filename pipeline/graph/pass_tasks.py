"""The tasks of images that are sampled to a stated noise: passes over strips of rows, and checks between them.

All passes that there may be are in the graph. Those after the noise is low enough hand on what they read.
"""

from collections.abc import Sequence
from dataclasses import replace

from pipeline.engine.planning.graph import TaskGraph
from pipeline.graph.adding import add
from pipeline.limits import MOST_SAMPLES
from pipeline.tasks.params.cameras import Nothing
from pipeline.tasks.params.images import BEFORE, CHECK, STRIP, ImagePass, NoiseCheck, WhitePass


def add_passes(
    graph: TaskGraph,
    name: str,
    parts: Sequence[WhitePass | ImagePass],
    reads: dict[str, str],
    noise: float,
) -> dict[str, str]:
    """Add all passes over an image; role and name of what the image reads of them.

    The name is that of the passes and what they belong to, such as `image_pass/Rig.Camera/0001`; `parts` are the first
    pass over each strip. A name in `reads` that ends with a slash stands for strips: their first passes. The noise that
    is asked for is a standard error relative to the mean of the image.
    """
    kind, _, subject = name.partition("/")
    subject = subject if kind == "image_pass" else f"{subject}/white"
    own = [_of_strip(reads, strip) for strip in range(len(parts))]
    first = [
        add(graph, pass_name(name, strip, 0), part, source)
        for strip, (part, source) in enumerate(zip(parts, own, strict=True))
    ]
    level = add(graph, f"noise_level/{subject}", Nothing(), _roles(STRIP, first))
    last = list(first)
    for number in range(1, passes_of(parts[0].exposure.samples)):
        for strip, part in enumerate(parts):
            found = {BEFORE: last[strip], "level": level}
            check = f"noise_check/{subject}/{strip:04d}/{number - 1:02d}"
            add(graph, check, NoiseCheck(noise=noise), found)
            source = {**own[strip], "first": first[strip], BEFORE: last[strip], CHECK: check}
            last[strip] = add(graph, pass_name(name, strip, number), replace(part, number=number), source)
    return {"level": level, **_roles(STRIP, last), **_roles("first", first)}


def passes_of(samples: int) -> int:
    """Number of passes that there may be after a first one with so many samples, itself included."""
    return 1 + max(0, (MOST_SAMPLES // samples).bit_length() - 1)


def pass_name(name: str, strip: int, number: int) -> str:
    """Name of a pass over a strip."""
    return f"{name}/{strip:04d}/{number:02d}"


def _roles(role: str, names: Sequence[str]) -> dict[str, str]:
    return {f"{role}{number}": name for number, name in enumerate(names)}


def _of_strip(reads: dict[str, str], strip: int) -> dict[str, str]:
    """Sources of a strip."""
    return {
        role: pass_name(source.rstrip("/"), strip, 0) if source.endswith("/") else source
        for role, source in reads.items()
    }
