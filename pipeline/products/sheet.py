"""Product targets/: a file per target, and the picture of its pattern where viewers show one."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np

from pipeline.files.jsonfile import Json, json_bytes
from pipeline.records.plain import to_plain
from pipeline.targets.mesh import MeshTarget
from pipeline.targets.points import TargetPoints
from pipeline.targets.target import Target, plain_from_target, target_from_plain

if TYPE_CHECKING:
    from pipeline.products.cameras import Inputs
    from pipeline.products.draft import Draft
    from pipeline.scene.dataset import TargetEntry

SHEET = "sheet.png"
_EDGE_PX = 1024
"""Edge of the picture of a flat board [px]: its squares stay sharp on a whole screen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """A target whose pattern viewers show."""

    target: Annotated[Json, "targets"]


def plan_targets(draft: "Draft") -> None:
    """Add the files of all targets."""
    for entry in draft.dataset.targets:
        draft.files[f"targets/{entry.name}.json"] = targets_json(entry)
        if isinstance(entry.target, Target):
            params = Sheet(target=plain_from_target(entry.target))
            draft.files[entry.picture_file] = (draft.add(f"sheet/{entry.name}", params), SHEET)


def targets_json(entry: "TargetEntry") -> bytes:
    """The content of targets/<target>.json; only warped boards have points away from their nominal coordinates."""
    target = entry.target
    plain = plain_from_target(target)
    facts = {"order": MeshTarget.ORDER, "parameters": {}, "surface": {"kind": "mesh"}}
    if isinstance(target, Target):
        facts = {"order": target.pattern.ORDER, "parameters": plain["pattern"], "surface": plain["surface"]}
    return json_bytes(
        {
            "kind": target.kind,
            "frame": "target frame: origin at the pattern centre, x right, y up, z towards the viewer, mm",
            **facts,
            "mesh_sag_mm": max(patch.mesh_sag_mm() for patch in target.patches()),
            "points": _points(target.points()),
        }
    )


def _points(points: TargetPoints) -> list[Json]:
    """Id, kind, nominal and actual position and normal of every point, and the radius of its disc if it has one."""
    rows = []
    for index, kind in enumerate(points.kinds):
        vectors = {"nominal_mm": points.nominal_mm, "actual_mm": points.position_mm, "normal": points.axes[:, :, 2]}
        row = {
            "id": index,
            "kind": kind,
            **{name: to_plain(values[index].tolist()) for name, values in vectors.items()},
        }
        radius = float(points.radius_mm[index])
        rows.append(row if math.isnan(radius) else {**row, "radius_mm": radius})
    return rows


def sheet(params: Sheet, inputs: "Inputs", out: Path) -> None:
    """Reflectances of all patches of a target side by side, linear, in 8 bits, for viewers: sheet.png."""
    from pipeline.files.png import write_png  # a plan draws nothing
    from pipeline.targets.preview import preview_picture

    target = target_from_plain(params.target)
    assert isinstance(target, Target)  # a mesh has no sheet
    grey = np.clip(preview_picture(target, _EDGE_PX), 0, 1)
    write_png(out / SHEET, np.rint(255 * grey).astype(np.uint8))
