"""Sizes of tasks for forecasts: numbers proportional to their work."""

from typing import Any


def size(_: str, params: dict[str, Any]) -> float:
    """Rays of a task per pixel of the sensor, or of a band of its rows; 0 if its params have no samples.

    The resolution of the sensor is not considered: after it was edited, a forecast states the cost of the old one.
    """
    rows = params["end_row"] - params["first_row"] if "end_row" in params else 1
    rays = params.get("sampling") or params.get("exposure") or {}
    # Passes double the samples; how many rows a strip has is forgotten as a tile's is.
    rows *= 1 << max(0, params.get("number", 0) - 1)
    return float(rows * rays.get("supersampling", 1) ** 2 * rays.get("samples", 0))
