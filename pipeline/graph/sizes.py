"""Sizes of tasks, for forecasts: numbers that their work grows with."""

from typing import Any


def size(_: str, params: dict[str, Any]) -> float:
    """Rays of a task per pixel of the sensor, or of a band of its rows; 0 where its params have no samples.

    The sensor is no param of it: a forecast after an edit of the resolution tells what the old one cost.
    """
    rows = params["end_row"] - params["first_row"] if "end_row" in params else 1
    rays = params.get("sampling") or params.get("exposure") or {}
    return float(rows * rays.get("supersampling", 1) ** 2 * rays.get("samples", 0))
