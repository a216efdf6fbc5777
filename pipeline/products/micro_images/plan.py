"""Plan of the tables of micro-images."""

from pipeline.products.draft import Draft
from pipeline.products.micro_images.params import MicroImagesTile, MicroImageTables
from pipeline.products.tiles import microlens_tiles

_TABLES = "micro_images.csv", "micro_image_outlines.csv"


def plan_micro_images(draft: Draft) -> None:
    """Add the tables of plenoptic cameras, at each stop of their white images."""
    for entry in draft.entries:
        if entry.asked.microlenses is None:
            continue
        count = microlens_tiles(entry.asked.sensor, entry.asked.microlenses)
        parts = [MicroImagesTile(tile=number, tiles=count) for number in range(count)]
        for stop in draft.stops(entry):
            reads = {"camera": stop.camera}
            tiles = draft.add_tiles(f"micro_images_tile/{stop.name}", parts, reads)
            params = MicroImageTables(tiles=len(tiles))
            task = draft.add(f"micro_images/{stop.name}", params, {**reads, **tiles})
            draft.files.update({f"{stop.tables}{table}": (task, table) for table in _TABLES})
