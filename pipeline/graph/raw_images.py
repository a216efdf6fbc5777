"""The tasks of raw images: of all channels of a camera together, because one sensor has them."""

from pipeline.channel_names import name_with
from pipeline.engine.output.deliver import Source
from pipeline.engine.planning.graph import TaskGraph
from pipeline.graph.adding import add
from pipeline.scene.dataset import CameraEntry, Dataset
from pipeline.tasks.params.exposing import DNG, MAPS, PREVIEW, TIFF, Expose, FixedPattern


def add_raw(graph: TaskGraph, files: dict[str, Source], entry: CameraEntry, dataset: Dataset) -> None:
    """Add the raw images of a camera in all frames, and their fixed pattern, if the stage says how much light falls."""
    name, response, irradiation, sensor = entry.name, entry.response, entry.irradiation, entry.asked.sensor
    if response is None or irradiation is None:
        return
    kind = "colour_image" if entry.channels else "image"
    for frame in dataset.frames:
        params = Expose(
            camera=name,
            frame=frame.number,
            seed=entry.sampling.seed,
            response=response,
            irradiation=irradiation,
        )
        image = f"{kind}/{name}/{frame.number:04d}"
        reads = {"image": image} | ({"camera": f"focus/{name}"} if irradiation.radiance else {})
        reads |= {f"camera_{one.channel}": f"channel/{name_with(name, one.channel)}" for one in irradiation.channels}
        raw = add(graph, f"expose/{name}/{frame.number:04d}", params, reads)
        files |= {f"frames/{frame.number:04d}/{name}/{file}": (raw, file) for file in (TIFF, DNG, PREVIEW)}
    pattern = FixedPattern(camera=name, shape=(sensor.height_px, sensor.width_px), spread=response.spread)
    files[f"cameras/{name}/{MAPS}"] = (add(graph, f"fixed_pattern/{name}", pattern), MAPS)
