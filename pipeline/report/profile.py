"""Profile of a build: where its time went, by kind of task and by kernel, in lines for a terminal."""

from collections.abc import Callable, Iterable
from typing import Any

Row = dict[str, Any]
"""Fields of a row: name, count, seconds, rays, crossings, peak_bytes."""
_SUMS = ("count", "seconds", "rays", "crossings")
"""Fields that are summed; of `peak_bytes` the largest counts."""


def profile(tasks: Iterable[tuple[str, dict[str, Any]]]) -> dict[str, Any]:
    """Sum what tasks took.

    Parameters
    ----------
    tasks : iterable of (str, dict)
        Kind of a task, and what its record says of the run: seconds, cpu_seconds, loading_seconds, kernels, peak_bytes.

    Returns
    -------
    dict
        `kinds` and `kernels`, rows with the dearest first; seconds of the processor in all: `cpu_seconds`,
        `loading_seconds` for compiled code, `other_seconds` outside kernels.
    """
    kinds, kernels = dict[str, Row](), dict[str, Row]()
    total = loading = 0.0
    for kind, made in tasks:
        total, loading = total + made["cpu_seconds"], loading + made["loading_seconds"]
        rays, crossings = (sum(one.get(name, 0) for one in made["kernels"].values()) for name in ("rays", "crossings"))
        _add(kinds, kind, {**made, "count": 1, "seconds": made["cpu_seconds"], "rays": rays, "crossings": crossings})
        for name, one in made["kernels"].items():
            _add(kernels, name, {**one, "count": one.get("calls", 0)})
    within = sum(row["seconds"] for row in kernels.values())
    facts = {"cpu_seconds": total, "loading_seconds": loading, "other_seconds": max(0.0, total - loading - within)}
    return {**facts, "kinds": _dearest_first(kinds), "kernels": _dearest_first(kernels)}


def _add(rows: dict[str, Row], name: str, costs: dict[str, Any]) -> None:
    """Add the costs of one task or kernel; fields that it does not have are 0."""
    row = rows.setdefault(name, {"name": name, "count": 0, "seconds": 0.0, "rays": 0, "crossings": 0, "peak_bytes": 0})
    for key in _SUMS:
        row[key] += costs.get(key, 0)
    row["peak_bytes"] = max(row["peak_bytes"], costs.get("peak_bytes", 0))


def _dearest_first(rows: dict[str, Row]) -> list[Row]:
    return sorted(rows.values(), key=lambda row: (-row["seconds"], row["name"]))


def lines(found: dict[str, Any], limit_per_s: float) -> list[str]:
    """Two tables, for people.

    Parameters
    ----------
    found : dict
        Result of `profile`.
    limit_per_s : float
        Crossings of spheres per second and core that roots and divisions allow, see `optics.limit`.
    """
    total = found["cpu_seconds"]
    text = [f"{'task kind':<18}{'tasks':>7}{'CPU s':>10}{'share':>8}{'rays':>10}{'rays/s':>10}{'memory':>10}"]
    text += [_line(row, total, lambda row: f"{row['peak_bytes'] / 1e9:.2f} GB") for row in found["kinds"]]
    text += [f"{'kernel':<18}{'calls':>7}{'CPU s':>10}{'share':>8}{'rays':>10}{'rays/s':>10}{'of limit':>10}"]
    text += [_line(row, total, lambda row: _of_limit(row, limit_per_s)) for row in found["kernels"]]
    for name, words in (("loading_seconds", "loading, compiling"), ("other_seconds", "outside kernels")):
        text.append(f"{words:<18}{'':>7}{found[name]:>10.2f}{_share(found[name], total):>8}")
    text.append(f"limit: {limit_per_s:.3g} rays times surfaces per second and core, by roots and divisions alone")
    return text


def _line(row: Row, total: float, last: Callable[[Row], str]) -> str:
    seconds, rays = row["seconds"], row["rays"]
    figures = f"{row['name']:<18}{round(row['count']):>7,}{seconds:>10.2f}{_share(seconds, total):>8}"
    shown = f"{rays:>10.2g}{rays / seconds:>10.2g}" if rays and seconds > 0 else f"{'':>20}"
    return f"{figures}{shown}{last(row):>10}".rstrip()


def _share(seconds: float, total: float) -> str:
    return f"{seconds / total:.0%}" if total > 0 else "-"


def _of_limit(row: Row, limit_per_s: float) -> str:
    return f"{row['crossings'] / row['seconds'] / limit_per_s:.0%}" if row["crossings"] and row["seconds"] > 0 else ""
