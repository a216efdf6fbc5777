"""The contract of docs/outputs.md about a table of correspondences: its comments, columns and labels."""

from collections.abc import Iterator

import numpy as np

from pipeline.app.verifying.judged_camera import JudgedCamera, Scene
from pipeline.camera.rig import Rig
from pipeline.files.tables import Table
from pipeline.targets.target import target_from_plain
from pipeline.tasks.artefacts.truth_table import CHANNEL, column_order, header_of

_TEXT = ("camera", CHANNEL, "target", "method")


def broken_contract(camera: JudgedCamera, rig: Rig, scene: Scene, table: Table) -> Iterator[str]:
    """Descriptions of what a table lacks or has too much; if there are none, its rows can be judged."""
    head = header_of(scene.truth, camera.supersampling, camera.camera)
    if [line.strip() for line in head] != list(table.comments[: len(head)]):
        yield "its comments are not those of the stage"
    columns = column_order(scene.truth)
    if list(table.columns) != columns:
        yield f"its columns are not {', '.join(columns)}"
        return
    try:
        values = {name: table.numbers(name) for name in columns if name not in _TEXT}
    except ValueError as error:
        yield str(error)
        return
    if not np.isfinite([values["x_px"], values["y_px"]]).all():
        yield "rows without a position"
    for names, labels in _labels(rig, scene):
        rows = zip(*(table.columns[name] for name in names), strict=True)
        unknown = [number for number, row in enumerate(rows, 1) if row not in labels]
        if unknown:
            yield f"{len(unknown)} rows, first row {unknown[0]}, have {', '.join(names)} that the stage has not"


def _labels(rig: Rig, scene: Scene) -> Iterator[tuple[tuple[str, ...], set[tuple[str, ...]]]]:
    """Columns that say what a row belongs to, and all cells that the stage has for them."""
    yield ("frame", "camera"), {(str(scene.truth.frame), scene.truth.camera)}
    if channel := scene.truth.labels.channel:
        yield (CHANNEL,), {(channel.name,)}
    counts = {entry.name: len(target_from_plain(entry.target).points().kinds) for entry in scene.view.targets}
    yield ("target", "point_id"), {(name, str(point)) for name, count in counts.items() for point in range(count)}
    lattice = rig.tracer.lattice
    cells = [[""]] * 3 if lattice is None else [lattice.k.tolist(), lattice.l.tolist(), lattice.type.tolist()]
    yield ("microlens_k", "microlens_l", "microlens_type"), set(zip(*(map(str, cell) for cell in cells), strict=True))
