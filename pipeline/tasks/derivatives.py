"""Tasks `varied`, cameras with a number a little less and more, and `derivatives`, of the rows of a frame."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.camera.focusing.focus_request import solved
from pipeline.camera.parts.camera import Camera
from pipeline.exports.filestorage import write_npz
from pipeline.files.jsonfile import read_json, write_json
from pipeline.files.tables import read_table
from pipeline.records.plain import from_plain, to_plain
from pipeline.tasks.artefacts.cameras import Inputs, rig_of
from pipeline.tasks.artefacts.surroundings import placed_target
from pipeline.tasks.artefacts.truth_table import PosedPoints
from pipeline.tasks.certificate import cells_of
from pipeline.tasks.params.cameras import SettledCamera, VariedCameras
from pipeline.tasks.params.frames import PlacedTarget, RowDerivatives
from pipeline.tasks.params.outputs import DERIVATIVES
from pipeline.truth.derivatives import Neighbour, Variation
from pipeline.truth.derivatives import derivatives as rates_of

_VARIED = "varied.json"
_REMARKS = (
    "row i is row i of correspondences.csv, entry j is that of names[j]; by a unit of units[j]",
    "x_px (n, v, 2): derivatives of x_px and y_px",
    "spread_mm2 (n, v, 2, 2): of the covariance of the bundle on the tangent plane of the point, along the row",
    "jacobian_mm_per_px (n, 2, 2): of J on that plane by x_px and y_px; blur is the covariance mapped by its inverse",
)


def varied(params: VariedCameras, inputs: Inputs, out: Path) -> None:
    """The cameras, by the place of their number: varied.json."""
    ends = {str(each.number): [to_plain(_settled(end)) for end in (each.less, each.more)] for each in params.cameras}
    write_json(out / _VARIED, ends)


def _settled(parts: SettledCamera) -> Camera:
    """The camera that tasks `focus`, `channel` and `windows` make."""
    camera = solved(parts.asked.asked)
    if parts.channel is not None:
        camera = camera.in_light(parts.channel)
    return camera.behind(parts.windows.windows, parts.windows.wavelength_nm) if parts.windows else camera


def derivatives(params: RowDerivatives, inputs: Inputs, out: Path) -> None:
    """Derivatives of all rows of a table: derivatives.npz."""
    table = read_table(inputs["truth"]["correspondences.csv"])
    rig = rig_of(inputs, params.seed, params.square_px)
    names, point = np.array(table.columns["target"]), table.numbers("point_id").astype(int)
    x_px = np.stack([table.numbers("x_px"), table.numbers("y_px")], axis=1)
    cameras = read_json(inputs["varied"][_VARIED]) if "varied" in inputs else {}
    here, there = _planes(params.targets, names, point), rig.tracer

    def neighbour(number: int, side: int, targets: Sequence[PlacedTarget] | None) -> Neighbour:
        tracer = there
        if plain := cameras.get(str(number)):
            tracer = there.next_to(from_plain(Camera, plain[side]))
        return Neighbour(tracer, here if targets is None else _planes(targets, names, point))

    variations = [
        Variation(number.step, neighbour(place, 0, number.less), neighbour(place, 1, number.more))
        for place, number in enumerate(params.numbers)
    ]
    rates = rates_of(rig, x_px, cells_of(rig, table), here, variations)
    arrays = {
        "names": np.array([number.name for number in params.numbers]),
        "units": np.array([number.unit for number in params.numbers]),
        "x_px": rates.x_px,
        "spread_mm2": rates.spread_mm2,
        "jacobian_mm_per_px": rates.jacobian_mm_per_px,
    }
    write_npz(out / DERIVATIVES, _REMARKS, arrays)


def _planes(targets: Sequence[PlacedTarget], names: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Tangent planes of the points of rows, (n, 4, 3)."""
    planes = np.zeros((len(names), 4, 3))
    for entry in targets:
        target, pose = placed_target(entry)
        rows = names == entry.name
        planes[rows] = PosedPoints(entry.name, target.points(), pose).planes[point[rows]]
    return planes
