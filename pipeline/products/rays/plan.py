"""Plan of cameras/CAMERA/rays.exr."""

from pipeline.products.draft import Draft, light_of
from pipeline.products.rays.params import JoinedRays, RaysTile
from pipeline.products.tiles import bundle_bands


def plan_rays(draft: Draft) -> None:
    """Add the bundles of the cameras that deliver or search them."""
    for entry in draft.entries:
        if not (entry.delivers_rays or entry.truth.searches):
            continue
        reads = {"camera": draft.camera(entry, is_alone=True, has_planes=True)}
        parts = [
            RaysTile(first_row=first, end_row=end, sampling=entry.sampling, square_px=entry.square_px)
            for first, end in bundle_bands(entry.asked.sensor, entry.sampling)
        ]
        tiles = draft.add_tiles(f"rays_tile/{entry.full_name}", parts, reads, least=1)
        params = JoinedRays(tiles=len(tiles), sampling=entry.sampling, light=light_of(entry))
        task = draft.add(f"rays/{entry.full_name}", params, {**reads, **tiles})
        draft.files[f"cameras/{entry.folder}/rays.exr"] = (task, "rays.exr")
