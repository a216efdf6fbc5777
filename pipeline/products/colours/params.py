"""Parameters of images in colour."""

from dataclasses import dataclass

from pipeline.products.light import ChannelLabel
from pipeline.render.sensor.colours import Colorimetry

SPECTRAL = "spectral.exr"


@dataclass(frozen=True, slots=True, kw_only=True)
class ColourImage:
    """Channels of an image, `image` or `white`, in the order of the tasks that it reads."""

    name: str
    channels: tuple[ChannelLabel, ...]
    colorimetry: Colorimetry | None = None

    @property
    def is_spectral(self) -> bool:
        """Whether it is the image of a frame in which each channel is one wavelength, another one for each."""
        lights = [channel.wavelengths_nm for channel in self.channels]
        return self.name == "image" and len(set(lights)) == len(lights) and set(map(len, lights)) == {1}
