"""The end of a build in lines for a terminal: certificates, visible points, and where the time went."""

from collections.abc import Callable, Iterable
from typing import Any

from pipeline.channel_names import without_state
from pipeline.files.jsonfile import Json
from pipeline.spelling import frames_in_words

_LEGEND = "  rows        mean px    rms px     max px     between the table and another rule of integration"
"""Heading of the differences: lengths, and the rows that they are taken over."""


def certificate_lines(cameras: dict[str, Json]) -> list[str]:
    """A verdict per camera, and its differences: over all rows solved again, and in parts by method and distance."""
    text = []
    for name, certificate in sorted(cameras.items()):
        claim = "no claim" if certificate["claim_px"] is None else f"claim {certificate['claim_px']:g} px"
        text.append(f"certificate of {name}: {_verdict(certificate)} ({claim})")
        if not certificate["of"]:
            continue
        own_error = "-" if certificate["own_sigma_px"] is None else f"{certificate['own_sigma_px']:.1e}"
        label = f"all, by {certificate['kind']}{_against_claim(certificate)}; certain to {own_error} px"
        text += [_LEGEND, _row(certificate, label)]
        by_distance = [part for part in certificate["by_distance_from_cell_edge"] if part["rows"]]
        if len(by_distance) > 1:
            text += [_row(part, _distance(part)) for part in by_distance]
    return text


def lines_of_verdict(verdict: Json) -> list[str]:
    """Certificates, contradictions of the build, and the verdict, from the data of `verify --json`."""
    agreement = "agrees" if verdict["agrees"] else "DISAGREES"
    undecided = [name for name, judged in verdict["cameras"].items() if str(judged["reason"]).startswith("undecided")]
    agreement += f"; positions of {', '.join(undecided)} are undecided" if undecided else ""
    return [*certificate_lines(verdict["cameras"]), *verdict["problems"], agreement]


def _row(part: Json, name: str) -> str:
    total = f"of {part['of']:<6d}" if part.get("of") else " " * 9
    return f"  {part['rows']:4d} {total}{_figures(part)}  {name}"


def _distance(part: Json) -> str:
    end = "px and more" if part["to_px"] is None else f"to {part['to_px']:g} px"
    return f"{part['from_px']:g} {end} inside the edge of the cell or image"


def _against_claim(certificate: Json) -> str:
    """Numbers of rows within the claim, beyond it, and undecided; empty without a claim."""
    if certificate["within_claim"] is None:
        return ""
    within = certificate["within_claim"]
    beyond = certificate["beyond_claim"]
    counts = ((beyond, "beyond"), (certificate["rows"] - within - beyond, "undecided"))
    return f", {within} within the claim" + "".join(f", {count} {word}" for count, word in counts if count)


def failed(cameras: dict[str, Json] | None) -> bool:
    """Whether a camera cannot show its claimed accuracy."""
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


_ROWS = 20
"""Most frames that are tabulated: of more, columns are summarised, because nobody reads so long a table."""
_Column = tuple[str, str]
"""Names of a camera and of a target."""
_Counts = dict[_Column, dict[int, int]]
"""Number of visible points by column and frame."""


def point_lines(cameras: dict[str, Json]) -> list[str]:
    """A table with a row per frame and a column per camera, in all its states, and target; and the blank frames.

    Each camera has `of`, points per target, and `frames`, a list of {frame, rows, seen: points with a row per target}.
    """
    numbers = sorted({row["frame"] for points in cameras.values() for row in points["frames"]})
    visible: _Counts = {}
    totals = dict[_Column, int]()
    for camera, points in sorted(cameras.items()):
        for target in sorted(points["of"]):
            column = without_state(camera), target
            visible.setdefault(column, {}).update({row["frame"]: row["seen"][target] for row in points["frames"]})
            totals[column] = points["of"][target]
    if not visible or not numbers:
        return []
    text = _table(numbers, visible, totals) if len(numbers) <= _ROWS else _summary(numbers, visible, totals)
    return [*text, *_blank(cameras)]


def _table(numbers: list[int], visible: _Counts, totals: dict[_Column, int]) -> list[str]:
    """A row per frame, with visible points of all points in each column."""
    heads = [f"{camera} {target}" for camera, target in visible]
    width = max(5, *(len(str(number)) for number in numbers))
    text = [f"  {'frame':>{width}}  {'  '.join(heads)}   (points seen)"]
    for number in numbers:
        cells = (f"{counts[number]} of {totals[key]}" if number in counts else "" for key, counts in visible.items())
        padded = (f"{cell:<{len(head)}}" for cell, head in zip(cells, heads, strict=True))
        text.append(f"  {number:>{width}}  {'  '.join(padded).rstrip()}")
    return text


def _summary(numbers: list[int], visible: _Counts, totals: dict[_Column, int]) -> list[str]:
    """A line per column: complete frames, the median, and the frame with fewest visible points."""
    text = [f"points seen in {len(numbers)} frames:"]
    for (camera, target), counts in visible.items():
        values = sorted(counts.values())
        total = totals[camera, target]
        complete = sum(value == total for value in values)
        fewest = min(counts, key=lambda number: (counts[number], number))
        text.append(
            f"  {camera} {target}: all {total} in {complete} frames; median {values[len(values) // 2]};"
            f" fewest {counts[fewest]}, in frame {fewest}"
        )
    return text


def _blank(cameras: dict[str, Json]) -> list[str]:
    text = []
    for camera, points in sorted(cameras.items()):
        blank = [row["frame"] for row in points["frames"] if not row["rows"]]
        if blank:
            frames = "any frame" if len(blank) == len(points["frames"]) else frames_in_words(blank)
            text.append(f"warning: {camera} sees no point in {frames}: `pipeline check` says why")
    return text


_SUMS = ("count", "seconds", "rays", "crossings")
"""Fields that are summed; `peak_bytes` takes the maximum."""


def profile(tasks: Iterable[tuple[str, Json]]) -> Json:
    """Sum the costs of tasks by kind and of kernels by name: `kinds` and `kernels`, rows with the most expensive first.

    Seconds of the processor: all `cpu_seconds`, `loading_seconds` for compiled code, `other_seconds` outside kernels.
    """
    kinds = dict[str, Json]()
    kernels = dict[str, Json]()
    total = loading = 0.0
    for kind, run in tasks:
        total += run["cpu_seconds"]
        loading += run["loading_seconds"]
        sums = {name: sum(calls.get(name, 0) for calls in run["kernels"].values()) for name in ("rays", "crossings")}
        _add(kinds, kind, {**run, "count": 1, "seconds": run["cpu_seconds"], **sums})
        for name, calls in run["kernels"].items():
            _add(kernels, name, {**calls, "count": calls.get("calls", 0)})
    in_kernels = sum(row["seconds"] for row in kernels.values())
    facts = {"cpu_seconds": total, "loading_seconds": loading, "other_seconds": max(0.0, total - loading - in_kernels)}
    return {**facts, "kinds": _dearest_first(kinds), "kernels": _dearest_first(kernels)}


def _add(rows: dict[str, Json], name: str, costs: Json) -> None:
    """Add the costs of one task or kernel; fields that it lacks are 0."""
    row = rows.setdefault(name, {"name": name, "count": 0, "seconds": 0.0, "rays": 0, "crossings": 0, "peak_bytes": 0})
    for key in _SUMS:
        row[key] += costs.get(key, 0)
    row["peak_bytes"] = max(row["peak_bytes"], costs.get("peak_bytes", 0))


def _dearest_first(rows: dict[str, Json]) -> list[Json]:
    return sorted(rows.values(), key=lambda row: (-row["seconds"], row["name"]))


def profile_lines(costs: Json, limit_per_s: float) -> list[str]:
    """Two tables of the result of `profile`, for people.

    The bound is `crossings_per_second`: sphere intersections per second and core that square roots and divisions allow.
    """
    total = costs["cpu_seconds"]
    text = [f"{'task kind':<18}{'tasks':>7}{'CPU s':>10}{'share':>8}{'rays':>10}{'rays/s':>10}{'memory':>10}"]
    text += [_line(row, total, lambda row: f"{row['peak_bytes'] / 1e9:.2f} GB") for row in costs["kinds"]]
    text += [f"{'kernel':<18}{'calls':>7}{'CPU s':>10}{'share':>8}{'rays':>10}{'rays/s':>10}{'of limit':>10}"]
    text += [_line(row, total, lambda row: _of_limit(row, limit_per_s)) for row in costs["kernels"]]
    for name, words in (("loading_seconds", "loading, compiling"), ("other_seconds", "outside kernels")):
        text.append(f"{words:<18}{'':>7}{costs[name]:>10.2f}{_share(costs[name], total):>8}")
    text.append(f"limit: {limit_per_s:.3g} rays times surfaces per second and core, by roots and divisions alone")
    return text


def _line(row: Json, total: float, last_cell: Callable[[Json], str]) -> str:
    """A row of a table of costs, whose last cell is computed from it."""
    seconds = row["seconds"]
    rays = row["rays"]
    costs = f"{row['name']:<18}{round(row['count']):>7,}{seconds:>10.2f}{_share(seconds, total):>8}"
    speed = f"{rays:>10.2g}{rays / seconds:>10.2g}" if rays and seconds > 0 else f"{'':>20}"
    return f"{costs}{speed}{last_cell(row):>10}".rstrip()


def _share(seconds: float, total: float) -> str:
    return f"{seconds / total:.0%}" if total > 0 else "-"


def _of_limit(row: Json, limit_per_s: float) -> str:
    return f"{row['crossings'] / row['seconds'] / limit_per_s:.0%}" if row["crossings"] and row["seconds"] > 0 else ""
