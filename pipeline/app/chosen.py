"""One of several things of a stage, by its name."""

from pathlib import Path

from pipeline.errors import UsageError
from pipeline.scene.usd.problems import did_you_mean


def chosen(path: str | Path, kind: str, names: list[str], wanted: str | None) -> int:
    """Number of the camera or target (`kind`) that is wanted; None is enough where there is one.

    Raises
    ------
    UsageError
        There is none of that name, or several and none is named.
    """
    if wanted is None and len(names) > 1:
        raise UsageError(f"{path} has {len(names)} {kind}s: {', '.join(names)}", hint="name one of them")
    if wanted is not None and wanted not in names:
        hint = did_you_mean(wanted, names) or f"its {kind}s: {', '.join(names)}"
        raise UsageError(f'{path} has no {kind} "{wanted}"', hint=hint)
    return 0 if wanted is None else names.index(wanted)
