"""Task `certificate`: a sample of a camera's correspondences in all frames, solved again with the other rule of
integration; and the number of seen points of each target in each frame.
"""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.camera.rig import Rig
from pipeline.files.jsonfile import Json, write_json
from pipeline.files.tables import Table, read_table
from pipeline.motion import Shutter
from pipeline.products.cameras import Inputs, rig_of
from pipeline.products.certificate.params import Certificate
from pipeline.products.surroundings import placed_target
from pipeline.products.truth.table import PosedPoints
from pipeline.products.views import PlacedTarget
from pipeline.targets.target import target_from_plain
from pipeline.truth.judging import Rows, certify
from pipeline.truth.planes import Planes
from pipeline.truth.settings import ROWS, rows_of_build

_STREAM = 0x5EA1
"""Random stream of the judge, which differs from those of the judged rows."""


def certificate(params: Certificate, inputs: Inputs, out: Path) -> None:
    """Write certificate.json and points.json."""
    tables = [
        (frame.targets, read_table(inputs[f"frame{frame.number}"]["correspondences.csv"])) for frame in params.frames
    ]
    rig = rig_of(inputs, params.seed ^ _STREAM, params.square_px)
    count = sum(len(table.columns["x_px"]) for _, table in tables)
    verdict = judged(rig, tables, params.shutter, params.claim_px, params.seed, rows_of_build(count))
    write_json(out / "certificate.json", verdict)
    frame_numbers = [frame.number for frame in params.frames]
    write_json(out / "points.json", points_seen(frame_numbers, tables))


def points_seen(frame_numbers: list[int], tables: Sequence[tuple[Sequence[PlacedTarget], Table]]) -> Json:
    """Counts for the manifest: points that each target has (`of`), and in each frame (`frames`) the rows of its table
    and the points of each target that are seen.

    A point is seen if it has a row in the table of the frame; one that several microlenses see has several rows, and
    counts once. `tables` holds all targets of each frame, and its correspondences.
    """
    # The targets of the first frame are those of every frame: only their poses differ.
    count_by_target = {
        entry.name: len(target_from_plain(entry.target).points().kinds)
        for targets, _ in tables[:1]
        for entry in targets
    }
    frames = []
    for number, (_, table) in zip(frame_numbers, tables, strict=True):
        points = set(zip(table.columns["target"], table.columns["point_id"], strict=True))
        counts = Counter(target for target, _ in points)
        seen = {name: counts[name] for name in count_by_target}
        frames.append({"frame": number, "rows": len(table.columns["target"]), "seen": seen})
    return {"of": count_by_target, "frames": frames}


def judged(
    rig: Rig,
    tables: Sequence[tuple[Sequence[PlacedTarget], Table]],
    shutter: Shutter | None,
    claim_px: float | None,
    seed: int,
    rows: int = ROWS,
) -> Json:
    """Draw a sample of rows from the tables of all frames, solve it again, and state the differences."""
    all_rows = Rows.joined([part for targets, table in tables for part in rows_of(rig, targets, table, shutter)])
    return certify(rig, all_rows.drawn(seed, rows), len(all_rows.cell), claim_px)


def rows_of(rig: Rig, targets: Sequence[PlacedTarget], table: Table, shutter: Shutter | None) -> list[Rows]:
    """Rows of each target of a table, whose planes are those of the row's own time."""
    names = np.array(table.columns["target"])
    point = table.numbers("point_id").astype(int)
    x_px = np.stack([table.numbers("x_px"), table.numbers("y_px")], axis=1)
    is_direct = set(table.columns["method"]) <= {"direct"}
    cell = cells_of(rig, table)
    parts = []
    for entry in targets:
        of_target = names == entry.name
        exposed = planes_of(rig, entry, shutter).exposed(point[of_target], x_px[of_target])
        parts.append(Rows(exposed, cell[of_target], x_px[of_target], is_direct))
    return parts


def planes_of(rig: Rig, entry: PlacedTarget, shutter: Shutter | None) -> Planes:
    """Tangent planes of the points of a target before a camera."""
    target, pose = placed_target(entry)
    return PosedPoints(entry.name, target.points(), pose).before(rig, shutter, entry.motion)


def cells_of(rig: Rig, table: Table) -> np.ndarray:
    """Row of the microlens of every row of a table; 0 for a conventional camera."""
    lattice = rig.tracer.lattice
    if lattice is None:
        return np.zeros(len(table.columns["x_px"]), np.int64)
    k, l = (table.numbers(name).astype(np.int64) for name in ("microlens_k", "microlens_l"))
    return lattice.rows(k, l)
