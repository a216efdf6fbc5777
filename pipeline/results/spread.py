"""Spread of an ensemble: moments of camera figures and of ground-truth rows over its builds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.files.jsonfile import Json
from pipeline.records.shapes import Float64
from pipeline.results.output import Output

_KEY = ("frame", "target", "point_id", "microlens_k", "microlens_l")
"""Columns that identify a point and the microlens that sees it."""
_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")
"""Distortion coefficients of OpenCV; those that a fit leaves out are 0, as is the tilt of an upright sensor."""
_SAME = 1e-9
"""Standard deviation, relative to max(1, |mean|), below which figures count as equal: they come from fits."""


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures of a camera over n members, named with their units.

    A correlation is NaN where a figure is equal in all members.
    """

    names: tuple[str, ...]
    nominal: Float64[np.ndarray, "q"]
    mean: Float64[np.ndarray, "q"]
    deviation: Float64[np.ndarray, "q"]  # standard deviation of a member
    correlation: Float64[np.ndarray, "q q"]

    def to_dict(self) -> Json:
        """The figures as plain data, with null where a correlation is unknown."""
        columns = zip(self.names, self.nominal, self.mean, self.deviation, self.correlation, strict=True)
        return {
            name: {
                "nominal": nominal,
                "mean": mean,
                "standard_deviation": deviation,
                "correlations": {
                    other: None if np.isnan(value) else value for other, value in zip(self.names, row, strict=True)
                },
            }
            for name, nominal, mean, deviation, row in columns
        }


def figures(camera: str, nominal: Output, members: Sequence[Output]) -> Figures:
    """Focal length, sensor, pupils, equivalent pinhole and distortion, as far as every member has them and not all are
    0.
    """
    records = [_figures_of(output.cameras[camera].record) for output in (nominal, *members)]
    common = [name for name in records[0] if all(record.get(name) is not None for record in records)]
    names = tuple(name for name in common if any(record[name] for record in records))
    values = np.array([[record[name] for name in names] for record in records], np.float64)
    mean = values[1:].mean(axis=0)
    deviation = values[1:].std(axis=0, ddof=1)
    differs = deviation > _SAME * np.maximum(1, abs(mean))
    scaled = np.where(differs, (values[1:] - mean) / np.where(differs, deviation, 1.0), np.nan)
    return Figures(names, values[0], mean, deviation, scaled.T @ scaled / (len(members) - 1))


def _figures_of(record: Json) -> dict[str, float | None]:
    """Figures in camera.json by name; None where the camera has none, or it is infinite (a string in JSON)."""
    lens = record["lens"]
    fit = (record["pinhole"] or {}).get("with_distortion") or {}
    x_px, y_px = fit.get("principal_point_px") or (None, None)
    values = {
        "efl_mm": lens.get("efl_mm"),
        "sensor_distance_mm": record.get("sensor_distance_mm"),
        "entrance_pupil_z_mm": (lens.get("entrance_pupil") or {}).get("z_mm"),
        "exit_pupil_z_mm": (lens.get("exit_pupil") or {}).get("z_mm"),
        "principal_distance_px": fit.get("principal_distance_px"),
        "principal_point_x_px": x_px,
        "principal_point_y_px": y_px,
    }
    if coefficients := fit.get("distortion"):
        values |= dict.fromkeys(_COEFFICIENTS, 0.0)
        values |= dict(zip(_COEFFICIENTS, coefficients, strict=False))
    return {name: value if isinstance(value, float) else None for name, value in values.items()}


def rows(camera: str, nominal: Output, members: Sequence[Output]) -> dict[str, np.ndarray]:
    """Columns of a table with a row for each point that the nominal camera or a member sees, sorted by point.

    `members` counts the members that see it. Moments are NaN unless all do: over only those members that see a point at
    the edge they would be biased.
    """
    tables = [output.cameras[camera].correspondences for output in (nominal, *members)]
    key = [name for name in _KEY if name in (tables[0].dtype.names or ())]
    keys = np.concatenate([table[key] for table in tables])
    points, row = np.unique(keys, return_inverse=True)
    position = np.concatenate([np.stack([table.x_px, table.y_px], axis=1) for table in tables])
    is_member = np.arange(len(row)) >= len(tables[0])
    nominal_px = np.full((len(points), 2), np.nan)
    nominal_px[row[~is_member]] = position[~is_member]
    count = np.bincount(row[is_member], minlength=len(points))
    origin = np.zeros((len(points), 2))
    origin[row] = position  # any position of a point: in moments about it no digits cancel
    x, y = (position - origin[row])[is_member].T

    def mean(values: np.ndarray) -> np.ndarray:
        """Mean of each point over the members; NaN unless all see it."""
        total = np.bincount(row[is_member], values, minlength=len(points))
        return np.where(count == len(members), total / len(members), np.nan)

    x_mean = mean(x)
    y_mean = mean(y)
    freedom = len(members) / (len(members) - 1)
    xx, xy, yy = (
        freedom * (mean(a * b) - a_mean * b_mean)
        for a, b, a_mean, b_mean in ((x, x, x_mean, x_mean), (x, y, x_mean, y_mean), (y, y, y_mean, y_mean))
    )
    x_deviation = np.sqrt(np.maximum(xx, 0))
    y_deviation = np.sqrt(np.maximum(yy, 0))
    product = x_deviation * y_deviation
    return {
        **{name: points[name] for name in key},
        "members": count,
        "x_px": nominal_px[:, 0],
        "y_px": nominal_px[:, 1],
        "mean_x_px": origin[:, 0] + x_mean,
        "mean_y_px": origin[:, 1] + y_mean,
        "deviation_x_px": x_deviation,
        "deviation_y_px": y_deviation,
        "correlation_xy": np.divide(xy, product, out=np.full(len(points), np.nan), where=product > 0),
    }
