"""The verdict of `pipeline verify`, in lines for a terminal."""

from pipeline.files.jsonfile import Json
from pipeline.report import certificate


def lines(verdict: Json) -> list[str]:
    """Certificates, what speaks against the build, and the verdict.

    Parameters
    ----------
    verdict : dict
        Verdict that `verify --json` prints.
    """
    return [
        *certificate.lines(verdict["cameras"]),
        *verdict["problems"],
        "agrees" if verdict["agrees"] else "DISAGREES",
    ]
