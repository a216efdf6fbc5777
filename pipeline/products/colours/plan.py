"""Plan of images in colour."""

from pipeline.products.colours.params import SPECTRAL, ColourImage
from pipeline.products.draft import Draft, channel_label
from pipeline.scene.dataset import CameraEntry


def plan_colours(draft: Draft) -> None:
    """Add the images that join those of the channels of a camera; none for a camera of one wavelength."""
    for entry in draft.dataset.cameras:
        _plan(draft, entry)


def _plan(draft: Draft, entry: CameraEntry) -> None:
    """Add the joined white image of a camera, and its joined image in each frame."""
    cameras = entry.in_channels if entry.channels else ()
    labels = tuple(label for camera in cameras if (label := channel_label(camera)))
    numbers = [frame.number for frame in draft.dataset.frames_of(entry)]
    images = [("white", "", f"cameras/{entry.name}")]
    images += [("image", f"/{frame:04d}", f"frames/{frame:04d}/{entry.name}") for frame in numbers]
    for kind, frame, folder in images if cameras else ():
        reads = {f"channel{i}": f"{kind}/{camera.full_name}{frame}" for i, camera in enumerate(cameras)}
        params = ColourImage(name=kind, channels=labels, colorimetry=next(iter(entry.colorimetry), None))
        joined = draft.add(f"colour_image/{entry.name}{frame}", params, reads)
        files = [f"{kind}.exr", f"{kind}.png"] + [SPECTRAL] * params.is_spectral
        draft.files.update({f"{folder}/{file}": (joined, file) for file in files})
