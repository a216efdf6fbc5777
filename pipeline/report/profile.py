"""Profile of a build: where its time went, by kind of task and by kernel, in lines for a terminal."""

from collections.abc import Callable, Iterable

from pipeline.files.jsonfile import Json

_SUMS = ("count", "seconds", "rays", "crossings")
"""Fields that are summed; of `peak_bytes` the largest counts."""


def profile(tasks: Iterable[tuple[str, Json]]) -> Json:
    """Sum what tasks took, by their kinds and records: `kinds` and `kernels`, rows with the dearest first.

    Seconds of the processor: all `cpu_seconds`, `loading_seconds` for compiled code, `other_seconds` outside kernels.
    """
    kinds, kernels = dict[str, Json](), dict[str, Json]()
    total = loading = 0.0
    for kind, run in tasks:
        total, loading = total + run["cpu_seconds"], loading + run["loading_seconds"]
        rays, crossings = (
            sum(calls.get(name, 0) for calls in run["kernels"].values()) for name in ("rays", "crossings")
        )
        _add(kinds, kind, {**run, "count": 1, "seconds": run["cpu_seconds"], "rays": rays, "crossings": crossings})
        for name, calls in run["kernels"].items():
            _add(kernels, name, {**calls, "count": calls.get("calls", 0)})
    within = sum(row["seconds"] for row in kernels.values())
    facts = {"cpu_seconds": total, "loading_seconds": loading, "other_seconds": max(0.0, total - loading - within)}
    return {**facts, "kinds": _dearest_first(kinds), "kernels": _dearest_first(kernels)}


def _add(rows: dict[str, Json], name: str, costs: Json) -> None:
    """Add the costs of one task or kernel; fields that it does not have are 0."""
    row = rows.setdefault(name, {"name": name, "count": 0, "seconds": 0.0, "rays": 0, "crossings": 0, "peak_bytes": 0})
    for key in _SUMS:
        row[key] += costs.get(key, 0)
    row["peak_bytes"] = max(row["peak_bytes"], costs.get("peak_bytes", 0))


def _dearest_first(rows: dict[str, Json]) -> list[Json]:
    return sorted(rows.values(), key=lambda row: (-row["seconds"], row["name"]))


def lines(costs: Json, limit_per_s: float) -> list[str]:
    """Two tables of the result of `profile`, for people.

    The limit is `crossings_per_second`: crossings of spheres per second and core that roots and divisions allow.
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


def _line(row: Json, total: float, last: Callable[[Json], str]) -> str:
    seconds, rays = row["seconds"], row["rays"]
    figures = f"{row['name']:<18}{round(row['count']):>7,}{seconds:>10.2f}{_share(seconds, total):>8}"
    shown = f"{rays:>10.2g}{rays / seconds:>10.2g}" if rays and seconds > 0 else f"{'':>20}"
    return f"{figures}{shown}{last(row):>10}".rstrip()


def _share(seconds: float, total: float) -> str:
    return f"{seconds / total:.0%}" if total > 0 else "-"


def _of_limit(row: Json, limit_per_s: float) -> str:
    return f"{row['crossings'] / row['seconds'] / limit_per_s:.0%}" if row["crossings"] and row["seconds"] > 0 else ""
