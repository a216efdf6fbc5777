"""The tables of the plenoptic half."""

from typing import Any

from tables import markdown

Results = dict[str, Any]
Table = tuple[str, list[str], list[list[str]]]


def all_tables(results: Results) -> list[Table]:
    """Titles, heads and rows."""
    return [
        calibrations(results),
        parameters(results),
        *([places] if (places := centres(results))[2] else []),
        *([nodes] if (nodes := corners(results))[2] else []),
        *refocusing(results),
        ("Missing", ["contestant", "reason"], [[name, why] for name, why in results["missing"].items()]),
        failures(results),
    ]


def calibrations(results: Results) -> Table:
    """Residual that each prints, and what is true of it."""
    head = ["camera", "contestant", "positions", "prints px", "field px", "beyond px", "outside px",
            "chief px", "marginal px", "depth mm", "beyond mm", "turn deg", "place mm"]  # fmt: skip
    rows = []
    for camera, case in results["cases"].items():
        for name, judged in case["contestants"].items():
            for kind in ("exact", "noise", "own"):
                one = judged.get(kind)
                if one:
                    field, depth = one["field_px"], [abs(value) for value in one["depth_mm"]]
                    cells = [one["own_rms_px"], max(field[1:-1]), max(field[0], field[-1]), one.get("outside_px"),
                             one.get("chief_px"), one.get("marginal_px"), max(depth[1:-1]), max(depth[0], depth[-1]),
                             *one["pose"]]  # fmt: skip
                    rows.append([camera, name, kind, *map(_number, cells)])
    return "Calibrations", head, rows


def parameters(results: Results) -> Table:
    """Numbers that calibrations find beside those of first-order optics; with their spread where there is noise."""
    head = ["camera", "contestant", "parameter", "first order", "from exact rows", "spread by noise"]
    rows = []
    for camera, case in results["cases"].items():
        for name, judged in case["contestants"].items():
            for key, true in judged.get("true", {}).items():
                spread = judged.get("spread", {}).get(key)
                numbers = [true, judged["exact"]["parameters"][key]]
                cells = [f"{value:.6g}" for value in numbers] + ["-" if spread is None else f"{spread:.2g}"]
                rows.append([camera, name, key, *cells])
    return "Parameters", head, rows


def centres(results: Results) -> Table:
    """Centres of micro-images against each kind of true centre."""
    kinds = ("centre", "centroid", "exit pupil")
    head = ["camera", "contestant", "found", *(f"rms px to {kind}" for kind in kinds), "bias px to centroid"]
    rows = []
    for camera, case in results["cases"].items():
        for name, judged in case["contestants"].items():
            if "centres" in judged:
                one = judged["centres"]
                bias = f"{one['centroid']['bias_x_px']:+.3f} {one['centroid']['bias_y_px']:+.3f}"
                cells = [_number(one[kind]["rms_px"]) for kind in kinds]
                rows.append([camera, name, f"{one['centre']['found']:.3f}", *cells, bias])
    return "Centres of micro-images", head, rows


def corners(results: Results) -> Table:
    """Corners that contestants detect in micro-images, by frame."""
    head = ["camera", "contestant", "frame", "found", "bias px", "rms px", "rms px to J + fraction of the centre"]
    rows = []
    for camera, case in results["cases"].items():
        for name, judged in case["contestants"].items():
            for frame, kinds in judged.get("corners", {}).items():
                near, moved = kinds["corner"], kinds["with fraction"]
                bias = f"{near['bias_x_px']:+.3f} {near['bias_y_px']:+.3f}"
                cells = [f"{near['found']:.3f}", bias, _number(near["rms_px"]), _number(moved["rms_px"])]
                rows.append([camera, name, frame, *cells])
    return "Corners in micro-images", head, rows


def refocusing(results: Results) -> list[Table]:
    """Distances of refocusing and viewpoints of the unfocused cameras."""
    tables = []
    for camera, case in results["cases"].items():
        if "refocus" not in case:
            continue
        one = case["refocus"]
        forms = {"view_px": "g", "z_mm": "g", "shift": "+.4f", "pupil_mm": ".2f", "thin_mm": ".2f"}
        forms |= {"plenoptisign_mm": ".2f"}
        rows = [[format(row[key], form) if key in row else "-" for key, form in forms.items()] for row in one["rows"]]
        head = ["view px", "true distance mm", "shift", "with the exit pupil mm", "without mm", "plenoptisign mm"]
        tables.append((f"Refocusing, {camera}", head, rows))
        seen = [
            [f"{row['view_px']:g}", *(f"{value:.3f}" for value in row["place_mm"]), f"{row['rms_mm']:.4f}"]
            + [_number(value) for value in row.get("plenoptisign_mm", [None, None])]
            for row in one["viewpoints"]
        ]
        head = ["view px", "x mm", "y mm", "z mm", "rays off mm", "plenoptisign: x mm", "z mm"]
        tables.append((f"Viewpoints, {camera}; entrance pupil at {one['entrance_pupil_z_mm']:.3f} mm", head, seen))
    return tables


def failures(results: Results) -> Table:
    """Who failed on which camera, and why."""
    rows = [
        [camera, name, judged["failed"]]
        for camera, case in results["cases"].items()
        for name, judged in case["contestants"].items()
        if "failed" in judged
    ]
    return "Failed", ["camera", "contestant", "reason"], rows


def tables(results: Results) -> str:
    """All tables as text."""
    parts = [f"{title}\n\n" + "\n".join(markdown(head, rows)) for title, head, rows in all_tables(results) if rows]
    return "\n\n".join(parts) + "\n"


def _number(value: float | None) -> str:
    return "-" if value is None or value != value else f"{value:.3f}" if abs(value) < 100 else f"{value:.0f}"
