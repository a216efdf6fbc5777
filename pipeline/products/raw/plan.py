"""Plan of raw images, of the fixed pattern of sensors, and of losses in lenses."""

from pipeline.products.draft import Draft
from pipeline.products.raw.params import (
    DNG,
    MAPS,
    PREVIEW,
    TIFF,
    TRANSMISSION,
    Expose,
    LossesOfLight,
    PatternMaps,
    Transmission,
)
from pipeline.render.sensor.response import Irradiation
from pipeline.scene.dataset import CameraEntry


def plan_raw_images(draft: Draft) -> None:
    """Add the raw images of the cameras of which the stage says how much light falls on their sensors."""
    for entry in draft.dataset.cameras:
        _plan(draft, entry)


def _plan(draft: Draft, entry: CameraEntry) -> None:
    """Add the raw images of a camera in all frames, and their fixed pattern."""
    files = draft.files
    name = entry.name
    response = entry.response
    irradiation = entry.irradiation
    sensor = entry.asked.sensor
    if response is None or irradiation is None:
        return
    of_cameras = {"camera": draft.camera(entry)}
    entries = {camera.channel.name: camera for camera in entry.in_channels if camera.channel}
    channels = [radiance.channel for radiance in irradiation.channels]
    of_cameras |= {f"camera_{channel}": draft.camera(entries[channel]) for channel in channels if channel}
    # Behind microlenses the share is that of the axis everywhere.
    lossy = None if entry.asked.microlenses else _lossy(irradiation)
    if lossy is not None:
        transmission = draft.add(f"transmission/{name}", lossy, of_cameras)
        files[f"cameras/{name}/{TRANSMISSION}"] = (transmission, TRANSMISSION)
    for frame in draft.dataset.frames_of(entry):
        params = Expose(
            camera=name,
            frame=frame.number,
            seed=entry.sampling.seed,
            response=response,
            irradiation=irradiation,
            colorimetry=entry.colorimetry,
        )
        of_channels = [channel for channel in response.channels if channel in entries]
        images = {
            f"image_{channel}": f"image/{entries[channel].full_name}/{frame.number:04d}" for channel in of_channels
        }
        images = images or {"image": f"image/{name}/{frame.number:04d}"}
        reads = images | of_cameras | ({"transmission": f"transmission/{name}"} if lossy else {})
        raw = draft.add(f"expose/{name}/{frame.number:04d}", params, reads)
        files |= {f"frames/{frame.number:04d}/{name}/{file}": (raw, file) for file in (TIFF, DNG, PREVIEW)}
    pattern = PatternMaps(camera=name, shape=(sensor.height_px, sensor.width_px), spread=response.spread)
    files[f"cameras/{name}/{MAPS}"] = (draft.add(f"fixed_pattern/{name}", pattern), MAPS)


def _lossy(irradiation: Irradiation) -> Transmission | None:
    """Losses of an exposure by radiance in the lens; None: there are none."""
    radiances = [radiance for radiance in (irradiation.radiance, *irradiation.channels) if radiance]
    lights = [LossesOfLight(channel=radiance.channel, of_each=radiance.losses) for radiance in radiances]
    return Transmission(lights=tuple(lights)) if any(any(light.of_each) for light in lights) else None
