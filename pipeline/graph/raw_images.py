"""The tasks of raw images: of all channels of a camera together, because one sensor has them."""

from pipeline.channel_names import name_with
from pipeline.engine.output.deliver import Source
from pipeline.engine.planning.graph import TaskGraph
from pipeline.graph.adding import add
from pipeline.render.sensor.irradiation import Irradiation
from pipeline.scene.dataset import CameraEntry, Dataset
from pipeline.tasks.params import exposing
from pipeline.tasks.params.exposing import DNG, MAPS, PREVIEW, TIFF, TRANSMISSION, Expose, FixedPattern


def add_raw(graph: TaskGraph, files: dict[str, Source], entry: CameraEntry, dataset: Dataset) -> None:
    """Add the raw images of a camera in all frames, and their fixed pattern, if the stage says how much light falls."""
    name, response, irradiation, sensor = entry.name, entry.response, entry.irradiation, entry.asked.sensor
    if response is None or irradiation is None:
        return
    kind = "colour_image" if entry.channels else "image"
    cameras = {"camera": f"focus/{name}"} if irradiation.radiance else {}
    cameras |= {f"camera_{one.channel}": f"channel/{name_with(name, one.channel)}" for one in irradiation.channels}
    # Behind microlenses the share is that of the axis everywhere.
    lossy = None if entry.asked.microlenses else _lossy(irradiation)
    if lossy is not None:
        transmission = add(graph, f"transmission/{name}", lossy, cameras)
        files[f"cameras/{name}/{TRANSMISSION}"] = (transmission, TRANSMISSION)
    for frame in dataset.frames:
        params = Expose(
            camera=name,
            frame=frame.number,
            seed=entry.sampling.seed,
            response=response,
            irradiation=irradiation,
            colorimetry=entry.colorimetry,
        )
        image = f"{kind}/{name}/{frame.number:04d}"
        reads = {"image": image} | cameras | ({"transmission": f"transmission/{name}"} if lossy else {})
        raw = add(graph, f"expose/{name}/{frame.number:04d}", params, reads)
        files |= {f"frames/{frame.number:04d}/{name}/{file}": (raw, file) for file in (TIFF, DNG, PREVIEW)}
    pattern = FixedPattern(camera=name, shape=(sensor.height_px, sensor.width_px), spread=response.spread)
    files[f"cameras/{name}/{MAPS}"] = (add(graph, f"fixed_pattern/{name}", pattern), MAPS)


def _lossy(irradiation: Irradiation) -> exposing.Transmission | None:
    """Losses of an exposure by radiance in the lens; None: there are none."""
    lights = [exposing.LossesOfLight(channel=one.channel, of_each=one.losses) for one in irradiation.channels]
    if irradiation.radiance:
        lights = [exposing.LossesOfLight(channel=None, of_each=irradiation.radiance.losses_of_each)]
    return exposing.Transmission(lights=tuple(lights)) if any(any(one.of_each) for one in lights) else None
