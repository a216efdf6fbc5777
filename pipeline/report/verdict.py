"""The verdict of `pipeline verify`, in lines for a terminal."""

from typing import Any

from pipeline.report import certificate


def lines(verdict: dict[str, Any]) -> list[str]:
    """Certificates, what was derived again in every column, what speaks against the build, and the verdict.

    Parameters
    ----------
    verdict : dict
        Verdict that `verify --json` prints.
    """
    text = certificate.lines(verdict["cameras"])
    for name, look in sorted(verdict["derived_again"].items()):
        points = f"{look['points']} of {look['of']} target points of {name}"
        text.append(f"derived again in every column: {points}, {look['rows']} rows")
    text += [f"not opened: {name} {reason}" for name, reason in sorted(verdict["unread"].items())]
    return [*text, *verdict["problems"], "agrees" if verdict["agrees"] else "DISAGREES"]
