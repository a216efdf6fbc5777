"""Tables of a build as data of the page, with the very numbers of the files."""

from typing import Any

import numpy as np

from pipeline.report.page.records import MicroImageData, TableData
from pipeline.results.spots import drawn

_OUTER = "light_"
"""Beginning of the columns of the outline of all light."""


def table_data(rows: np.recarray) -> TableData:
    """All columns of a table; those in which all rows are equal once."""
    columns = {name: _plain(rows[name]) for name in rows.dtype.names or ()}
    same = {name: cells[0] for name, cells in columns.items() if len(cells) > 1 and len(set(cells)) == 1}
    return TableData(
        rows=len(rows), same=same, columns={name: cells for name, cells in columns.items() if name not in same}
    )


def micro_image_data(images: np.recarray, outlines: np.recarray) -> MicroImageData:
    """Micro-images that light reaches, with the outline of all of their light."""
    names = [name for name in outlines.dtype.names or () if name.startswith(_OUTER)]
    own = {key: row for row, key in enumerate(_keys(images))}
    shown = images[[own[key] for key in _keys(outlines)]].view(np.recarray)
    return MicroImageData(
        k=tuple(shown.microlens_k.tolist()),
        l=tuple(shown.microlens_l.tolist()),
        type=tuple(shown.microlens_type.tolist()),
        centre_x_px=drawn(shown.centre_x_px),
        centre_y_px=drawn(shown.centre_y_px),
        radius_px=drawn(shown.radius_px),
        outline_x_px=drawn(outlines.centroid_x_px),
        outline_y_px=drawn(outlines.centroid_y_px),
        outline_radius_px=tuple(drawn(np.array(one)) for one in zip(*(outlines[name] for name in names), strict=True)),
    )


def _keys(rows: np.recarray) -> list[tuple[int, int]]:
    return list(zip(rows.microlens_k.tolist(), rows.microlens_l.tolist(), strict=True))


def _plain(column: np.ndarray) -> tuple[Any, ...]:
    """Cells of a column; None where one is empty."""
    return tuple(None if cell != cell else cell for cell in column.tolist())
