"""A certificate, in lines for a terminal."""

from typing import Any


def lines(cameras: dict[str, dict[str, Any]]) -> list[str]:
    """A verdict per camera, and its figures by distance from the cell's edge [px]."""
    text = []
    for name, found in sorted(cameras.items()):
        claim = "no claim" if found["claim_px"] is None else f"claim {found['claim_px']:g} px"
        text.append(f"certificate of {name}: {_verdict(found)} ({claim})")
        if not found["of"]:
            continue
        text.append("  rows        mean px    rms px     max px     own sigma")
        own = "-" if found["own_sigma_px"] is None else f"{found['own_sigma_px']:.1e}"
        text.append(f"  {found['rows']:4d} of {found['of']:<6d}{_figures(found)}  {own}")
        for part in found["by_kind"]:
            if part["rows"]:
                kept = "" if part["within_claim"] is None else f", {part['within_claim']} within the claim"
                text.append(f"  {part['rows']:4d} of {part['of']:<6d}{_figures(part)}  from {part['kind']}{kept}")
        for part in found["by_distance_from_cell_edge"]:
            if part["rows"]:
                end = "" if part["to_px"] is None else f" to {part['to_px']:g}"
                text.append(
                    f"  {part['rows']:4d}        {_figures(part)}  from {part['from_px']:g}{end} px inside its edge"
                )
    return text


def failed(cameras: dict[str, dict[str, Any]] | None) -> bool:
    """Whether a camera cannot show the accuracy that it claims."""
    return any(found["passed"] is False for found in (cameras or {}).values())


def _verdict(found: dict[str, Any]) -> Any:
    if not found["of"]:
        return found["reason"]
    if found["passed"] is None:
        return f"no verdict, {found['reason']}"
    return "passed" if found["passed"] else f"FAILED, {found['reason']}"


def _figures(found: dict[str, Any]) -> str:
    return "  ".join(
        "      -  " if found[name] is None else f"{found[name]:.3e}" for name in ("mean_px", "rms_px", "max_px")
    )
