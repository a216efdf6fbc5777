"""Task `derivatives`: those of the rows of a frame, by differences of cameras with a number a step less and more."""

from pathlib import Path

import numpy as np

from pipeline.files.npy import write_npz
from pipeline.files.tables import read_table
from pipeline.products.cameras import Inputs, focused_camera, rig_of
from pipeline.products.certificate.make import cells_of, planes_of
from pipeline.products.derivatives.params import DERIVATIVES, SIDES, RowDerivatives
from pipeline.truth.derivatives import Neighbour, SolvedRows, Variation
from pipeline.truth.derivatives import derivatives as rates_of

_REMARKS = (
    "row i is row i of correspondences.csv, entry j is that of names[j]; by a unit of units[j]",
    "x_px (n, v, 2): derivatives of x_px and y_px",
    "spread_mm2 (n, v, 2, 2): of the covariance of the bundle on the tangent plane of the point, along the row",
    "jacobian_mm_per_px (n, 2, 2): of J on that plane by x_px and y_px; blur is the covariance mapped by its inverse",
)
_REMARK_OF_BLUR = "blur_px2 (n, v, 2, 2): of the columns of blur"


def derivatives(params: RowDerivatives, inputs: Inputs, out: Path) -> None:
    """Derivatives of all rows of a table: derivatives.npz."""
    table = read_table(inputs["truth"]["correspondences.csv"])
    rig = rig_of(inputs, params.seed, params.square_px)
    target = np.array(table.columns["target"])
    point = table.numbers("point_id").astype(int)
    x_px = np.stack([table.numbers("x_px"), table.numbers("y_px")], axis=1)
    # For each number the tracers of the cameras with less and more of it; a camera that does not change has no role.
    tracers = [
        [
            rig.tracer.next_to(focused_camera(inputs, role)) if role in inputs else rig.tracer
            for role in (f"{side}{position}" for side in SIDES)
        ]
        for position in range(len(params.numbers))
    ]
    rows = len(target)
    numbers = len(params.numbers)
    arrays = {
        "names": np.array([number.name for number in params.numbers]),
        "units": np.array([number.unit for number in params.numbers]),
        "x_px": np.full((rows, numbers, 2), np.nan),
        "spread_mm2": np.full((rows, numbers, 2, 2), np.nan),
        "jacobian_mm_per_px": np.full((rows, 2, 2), np.nan),
    }
    if params.with_blur:
        arrays["blur_px2"] = np.full((rows, numbers, 2, 2), np.nan)
    cells = cells_of(rig, table)
    for index, entry in enumerate(params.nominal.targets):
        planes = planes_of(rig, entry, params.nominal.shutter)
        variations = []
        for number, pair in zip(params.numbers, tracers, strict=True):
            less, more = (
                Neighbour(tracer, planes if view is None else planes_of(rig, view.targets[index], view.shutter))
                for tracer, view in zip(pair, (number.less, number.more), strict=True)
            )
            variations.append(Variation(number.step, less, more))
        of_target = target == entry.name
        solved_rows = SolvedRows(point[of_target], cells[of_target], x_px[of_target], planes)
        rates = rates_of(rig, solved_rows, variations, with_blur=params.with_blur)
        for name in set(arrays) - {"names", "units"}:
            arrays[name][of_target] = getattr(rates, name)
    write_npz(out / DERIVATIVES, (*_REMARKS, *([_REMARK_OF_BLUR] if params.with_blur else [])), arrays)
