"""Plan of frames/FRAME/CAMERA/correspondences.csv."""

from dataclasses import replace

from pipeline.products.draft import Draft, channel_label, light_of
from pipeline.products.things import target_poses
from pipeline.products.tiles import point_tiles
from pipeline.products.truth.params import Truth, TruthTable
from pipeline.products.views import PlacedView
from pipeline.scene.dataset import CameraEntry, Frame


def plan_truth(draft: Draft) -> None:
    """Add the tables of all cameras in their frames."""
    sizes = {target.name: len(target.target.points().kinds) for target in draft.dataset.targets}
    for entry, frame in draft.frames:
        truth = _truth(draft, entry, frame, sizes)
        draft.files[f"frames/{frame.number:04d}/{entry.folder}/correspondences.csv"] = (truth, "correspondences.csv")


def _truth(draft: Draft, entry: CameraEntry, frame: Frame, sizes: dict[str, int]) -> str:
    """Add the tasks of a table, in tiles if it is large; name of the last one."""
    name = f"{entry.full_name}/{frame.number:04d}"
    table = _table(entry, frame)
    reads = _reads(draft, entry, frame)
    # Only the saddle of a blurred corner depends on colours.
    things = draft.painted if "saddle" in entry.truth.column_sets else draft.bare
    view = PlacedView(
        targets=things.targets(target_poses(draft.dataset, frame, entry.name), frame.motions.get(entry.name)),
        occluders=draft.bare.occluders(frame, entry.name),
    )
    # A search in position images is a single task.
    points = [] if entry.truth.searches else point_tiles(sizes, is_plenoptic=entry.asked.microlenses is not None)
    parts = [Truth(table=table, view=view, square_px=entry.square_px, points=tile) for tile in points]
    tiles = draft.add_tiles(f"truth_tile/{name}", parts, reads)
    params = Truth(table=table, tiles=len(tiles), view=None if tiles else view, square_px=entry.square_px)
    return draft.add(f"truth/{name}", params, {**reads, **tiles})


def _reads(draft: Draft, entry: CameraEntry, frame: Frame) -> dict[str, str]:
    """Role and task of the inputs of a table: the camera and, for a search, its bundles, micro-images and position
    images.
    """
    reads = {"camera": draft.camera(entry)}
    if entry.truth.searches:
        reads["rays"] = rays = f"rays/{entry.full_name}"
        reads |= {role: tile for role, tile in draft.graph[rays].reads.items() if role.startswith("tile")}
        if entry.asked.microlenses:
            reads["micro_images"] = f"micro_images/{entry.full_name}"
    if entry.truth.method == "image":
        reads["positions"] = f"positions/{entry.full_name}/{frame.number:04d}"
    return reads


def _table(entry: CameraEntry, frame: Frame) -> TruthTable:
    """Parameters of a table, for the key of its task and for its header.

    What cannot change a row of it is left out, so that changing it computes nothing anew.
    """
    return TruthTable(
        frame=frame.number,
        camera=entry.name,
        settings=entry.truth.effective,
        light=light_of(entry),
        index_source=entry.index_source,
        seed=entry.sampling.seed,
        samples=entry.sampling.samples if entry.truth.searches else None,
        channel=channel_label(entry),
        shutter=entry.shutter and replace(entry.shutter, instants=1),  # instants are those of images alone
    )
