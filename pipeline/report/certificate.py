"""Certificates, and the verdict of `pipeline verify`, in lines for a terminal."""

from typing import Any

from pipeline.files.jsonfile import Json

_LEGEND = "  rows        mean px    rms px     max px     between the table and another rule of integration"
"""What the figures are: lengths of the differences, and which rows they are of."""


def lines(cameras: dict[str, Json]) -> list[str]:
    """A verdict per camera, and its differences: of all rows solved again, and of parts by method and distance."""
    text = []
    for name, certificate in sorted(cameras.items()):
        claim = "no claim" if certificate["claim_px"] is None else f"claim {certificate['claim_px']:g} px"
        text.append(f"certificate of {name}: {_verdict(certificate)} ({claim})")
        if not certificate["of"]:
            continue
        kinds = [(part, f"by {part['kind']}{_kept(part)}") for part in certificate["by_kind"] if part["rows"]]
        edges = [(part, _distance(part)) for part in certificate["by_distance_from_cell_edge"] if part["rows"]]
        own_error = "-" if certificate["own_sigma_px"] is None else f"{certificate['own_sigma_px']:.1e}"
        whole = f"all{f', {kinds.pop()[1]}' if len(kinds) == 1 else ''}; certain to {own_error} px"
        text += [_LEGEND, *(_row(*part) for part in ((certificate, whole), *kinds, *(edges if len(edges) > 1 else ())))]
    return text


def lines_of_verdict(verdict: Json) -> list[str]:
    """Certificates, what speaks against the build, and the verdict, from what `verify --json` prints."""
    agreement = "agrees" if verdict["agrees"] else "DISAGREES"
    return [*lines(verdict["cameras"]), *verdict["problems"], agreement]


def _row(part: Json, name: str) -> str:
    of = f"of {part['of']:<6d}" if part.get("of") else " " * 9
    return f"  {part['rows']:4d} {of}{_figures(part)}  {name}"


def _distance(part: Json) -> str:
    end = "px and more" if part["to_px"] is None else f"to {part['to_px']:g} px"
    return f"{part['from_px']:g} {end} inside the edge of the cell or image"


def _kept(part: Json) -> str:
    return "" if part["within_claim"] is None else f", {part['within_claim']} within the claim"


def failed(cameras: dict[str, Json] | None) -> bool:
    """Whether a camera cannot show the accuracy that it claims."""
    return any(certificate["passed"] is False for certificate in (cameras or {}).values())


def _verdict(certificate: Json) -> Any:
    if not certificate["of"]:
        return certificate["reason"]
    if certificate["passed"] is None:
        return f"no verdict, {certificate['reason']}"
    return "passed" if certificate["passed"] else f"FAILED, {certificate['reason']}"


def _figures(part: Json) -> str:
    return "  ".join(
        "      -  " if part[name] is None else f"{part[name]:.3e}" for name in ("mean_px", "rms_px", "max_px")
    )
