"""Choice of one camera or target of a stage by its name."""

from pathlib import Path

from pipeline.errors import UsageError
from pipeline.scene.usd.problems import did_you_mean


def chosen(path: str | Path, kind: str, names: list[str], wanted: str | None) -> int:
    """Index of the camera or target (`kind`) with the name `wanted`. None is enough if the stage has only one.

    Raises
    ------
    UsageError
        No entry has that name, or the stage has several and none is named.
    """
    if wanted is None and len(names) > 1:
        raise UsageError(f"{path} has {len(names)} {kind}s: {', '.join(names)}", hint="name one of them")
    if wanted is not None and wanted not in names:
        hint = did_you_mean(wanted, names) or f"its {kind}s: {', '.join(names)}"
        raise UsageError(f'{path} has no {kind} "{wanted}"', hint=hint)
    return 0 if wanted is None else names.index(wanted)
