"""Photons in a pixel by the radiance of what it sees: etendue and transmission of the traced bundle.

The radiance L of what fills the aperture gives a pixel of area A the power L A W T: W is the integral of cos(theta)
d omega over the bundle, the projected solid angle of the traced pupil (with the acceptance of pixels), and T the share
of its light that surfaces and glass let pass. Each photon has the energy h c / wavelength. In a channel the wavelengths
that stand for it add W T by their shares.
"""

from pipeline.camera.parts.camera import Camera
from pipeline.camera.tracer import Tracer
from pipeline.render.field_transmission import axial_transmission
from pipeline.render.sensor.irradiation import ChannelRadiance, Radiance
from pipeline.render.sensor.response import SensorError


def photon_rate(camera: Camera, radiance: Radiance | ChannelRadiance) -> float:
    """Photons that hit a pixel in a second where the linear image is 1: on the axis, before a white scene [1/s].

    Those of a channel count by its relative response; the camera is then the one of the channel.

    Raises SensorError: rays of the camera weigh area, so that no image is one of irradiance.
    """
    if camera.weight != "irradiance":
        raise SensorError("radiance gives photons only where rays weigh irradiance, not area")
    area_m2, rate = (camera.sensor.pitch_mm * 1e-3) ** 2, 0.0
    for light, losses in zip(Tracer(camera).lights, radiance.losses_of_each, strict=True):
        weight_sr, share = light.tracer.reference_weight_sr, axial_transmission(light.tracer, losses)
        rate += light.share * radiance.photons(radiance.w_per_m2_sr * area_m2 * weight_sr * share)
    return rate
