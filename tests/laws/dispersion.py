"""Cameras whose glasses disperse, in closed form: a term of Cauchy's formula by the Abbe number of each glass."""

from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.spectrum import Channel, SpectralNode

D_NM, F_NM, C_NM = 587.56, 486.13, 656.27
"""Wavelengths at which glasses are stated [nm]: the lines of helium and hydrogen."""
ABBE = {1.67: 47.2, 1.699: 30.1, 1.603: 38.0, 1.658: 57.3, 1.717: 47.9}
"""Abbe numbers of the glasses of the Tronnier double Gauss, by index."""


def index_at(index: float, wavelength_nm: float) -> float:
    """n = n_d + b (1 / lambda^2 - 1 / lambda_d^2), with b from the Abbe number."""
    if index == 1.0:
        return 1.0
    b = (index - 1) / ABBE[index] / (F_NM**-2 - C_NM**-2)
    return index + b * (wavelength_nm**-2 - D_NM**-2)


def node(camera: Camera, wavelength_nm: float, weight: float = 1.0) -> SpectralNode:
    """A wavelength with the indices of the camera's glasses there."""
    indices = tuple(index_at(surface.index, wavelength_nm) for surface in camera.prescription.surfaces)
    return SpectralNode(wavelength_nm=wavelength_nm, weight=weight, indices=indices)


def in_light(camera: Camera, light: dict[float, float]) -> Camera:
    """The camera in a light of some wavelengths [nm] with their shares."""
    nodes = tuple(node(camera, nm, share) for nm, share in light.items())
    mean = sum(nm * share for nm, share in light.items())
    return camera.in_light(Channel(name="", middle=node(camera, mean), nodes=nodes))


def at(camera: Camera, wavelength_nm: float) -> Camera:
    """The camera in light of one wavelength."""
    return camera.at(node(camera, wavelength_nm))
