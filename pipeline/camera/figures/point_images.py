"""Point-spread functions with diffraction at a few field positions of a camera."""

import math
from dataclasses import dataclass, replace

import numpy as np

from pipeline.camera.figures.field_curves import chief_directions
from pipeline.camera.focusing.depth_of_field import foci_on_sensor
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.pupil.from_stop import WIDE_RAD, pupil_fan
from pipeline.camera.pupil.outlines import lit_share
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.wave.spread import (
    intensity,
    saddle_of_light,
    saddle_of_rays,
    strehl_ratio,
    transfer,
    transfer_of_rays,
)
from pipeline.camera.wave.wavefront import View, wavefront
from pipeline.records.plain import Json
from pipeline.records.shapes import Float64

FIELDS = (0.0, 0.7, 1.0)
"""Field positions of a conventional camera: shares of the distance from the axis to the farthest corner."""
_RIM = 0.98
"""Share of the image circle that represents a dark corner: at the rim itself the pupil vanishes."""
_TRIED = 257
"""Positions towards the edge of a wide field at which chief rays are tried: a pixel or a few apart."""
_STEEPEST_RAD = WIDE_RAD - np.radians(2.0)
"""Angle of the outermost chief ray of a wide field: its complete bundle still meets planes across the axis."""
FREQUENCIES = 49
"""Spatial frequencies of a curve, from 0 to its limit: steps too fine to see."""
_CELLS, _RADII = 97, 4.0
"""Points of a picture along an axis, and half its edge over the radius of the Airy disc, which shows three dark
rings."""
_SPOT = 1.2
"""Half the edge of a picture over the extent of the rays, where that is larger."""


@dataclass(frozen=True, slots=True)
class PointImage:
    """Figures and curves of the image of one point, by diffraction and by geometry."""

    place: str  # in words
    x_px: Float64[np.ndarray, "2"]  # image position that the point has by geometry: the mean of its rays
    # Vision z of the point; inf: infinitely far
    object_mm: float
    wavelength_nm: float
    numerical_aperture: float  # sine at the sensor of the circle that has the pupil's area in direction cosines
    airy_radius_um: float  # first dark ring of that circle: 0.61 wavelength / numerical aperture
    # Wavefront error without piston and tilt: root mean square, highest less lowest
    rms_waves: float
    extent_waves: float
    strehl_ratio: float
    # Saddle of an infinite corner, with edges along x and y, by diffraction less that by geometry
    saddle_shift_px: Float64[np.ndarray, "2"]
    per_mm: Float64[np.ndarray, "n"]  # spatial frequencies of the curves
    # Modulation transfer along the radius of the field (lines across it) and across the radius; along the radius also
    # that of the same pupil without errors, and that of the rays. Behind microlenses along x and along y.
    tangential: Float64[np.ndarray, "n"]
    sagittal: Float64[np.ndarray, "n"]
    perfect: Float64[np.ndarray, "n"]
    geometric: Float64[np.ndarray, "n"]
    picture: Float64[np.ndarray, "m m"]  # light per area, 1 at the largest; rows and columns as in the image
    picture_um: float  # edge of the picture

    def at(self, per_mm: float) -> tuple[float, float]:
        """Tangential and sagittal transfer at a frequency, interpolated."""
        tangential, sagittal = (
            np.interp(per_mm, self.per_mm, curve, right=0.0) for curve in (self.tangential, self.sagittal)
        )
        return float(tangential), float(sagittal)

    def to_plain(self) -> Json:
        """All figures and curves as plain values, without the picture; None for unknown."""
        names = [name for name in self.__slots__ if not name.startswith("picture")]
        plain = {name: np.asarray(getattr(self, name)).tolist() for name in names}
        return {**plain, "saddle_shift_px": None if np.isnan(self.saddle_shift_px).any() else plain["saddle_shift_px"]}


def point_images(
    camera: Camera,
    wavelength_nm: float,
    at_px: tuple[float, float] | None = None,
    object_mm: float | None = None,
    focused: Camera | None = None,
) -> list[PointImage]:
    """Images of points in light of one wavelength, whose indices the camera has.

    `at_px`: by default the middle, 0.7 of the way to the farthest corner and the corner, or a microlens of each type.
    `object_mm`: vision z of the points; by default in focus, of the type of the microlens.
    `focused`: the camera whose focus that is, if its light is another.
    Raises CameraError: no light arrives at the position, or blur is far wider than diffraction.
    """
    rig = Rig.of(Tracer(camera if not camera.spectrum else replace(camera, spectrum=())))
    if at_px is None:
        positions_mm = _default_positions_mm(rig)
    elif rig.in_image(np.array([at_px]))[0]:
        positions_mm = {"as asked": rig.tracer.positions_mm(*at_px)}
    else:
        raise CameraError(f"({at_px[0]:g}, {at_px[1]:g}) px lies outside of the image")
    foci = foci_on_sensor(focused or camera)
    lattice = rig.tracer.lattice
    images = []
    for name, position_mm in positions_mm.items():
        microlens = int(rig.microlens_at(position_mm[None])[0])
        in_focus = foci[0 if lattice is None else int(lattice.type[microlens])].focus_distance_mm
        view = View(position_mm, microlens, in_focus if object_mm is None else object_mm)
        images.append(_point_image(rig, name, view, wavelength_nm))
    return images


def _default_positions_mm(rig: Rig) -> dict[str, np.ndarray]:
    """Positions on the sensor of the points that are shown by default, by name."""
    if rig.images is not None:
        return {f"microlens type {kind}": np.array([x, y]) for kind, (x, y, _) in enumerate(rig.middles)}
    tracer = rig.tracer
    corner = tracer.camera.sensor.farthest_corner_mm
    ends = tracer.on_film(np.stack([np.zeros(2), corner]))
    reach = lit_share(tracer.table, tracer.stop_row, *ends)
    edge, share = ("corner", 1.0) if reach == 1 else ("rim of the image circle", _RIM * reach)
    if pupil_fan(tracer.camera.prescription).is_wide:
        edge, share = _last_in_planes(tracer, ends, edge, share)
    names = ("on the axis", "0.7 of the field", edge)
    return {name: field * share * corner for name, field in zip(names, FIELDS, strict=True)}


def _last_in_planes(tracer: Tracer, ends: np.ndarray, edge: str, share: float) -> tuple[str, float]:
    """The edge of the field, or the last position before it whose chief ray meets planes across the axis.

    Returns its name and its share of the distance between two ends.
    """
    shares = np.linspace(0, share, _TRIED)
    direction = chief_directions(tracer, (ends[0] + shares[:, None] * (ends[1] - ends[0]))[:, :2])
    meets = direction[:, 2] > np.cos(_STEEPEST_RAD)
    last = int(np.flatnonzero(meets).max(initial=0))
    if last == _TRIED - 1:
        return edge, share
    return f"{math.degrees(_STEEPEST_RAD):.0f} degrees off the axis", shares[last]


def _point_image(rig: Rig, name: str, view: View, wavelength_nm: float) -> PointImage:
    """The image of the point of a view, which is named `name`."""
    front = wavefront(rig.tracer, view, wavelength_nm)
    pitch_mm = rig.tracer.camera.sensor.pitch_mm
    airy_mm = 0.61 * front.wavelength_mm / front.numerical_aperture
    # Directions of the curves: along the radius of the field and across it; behind microlenses x and y.
    off_axis = float(np.hypot(*view.position_mm))
    radial = view.position_mm / off_axis if off_axis > 0 and rig.images is None else np.array([1.0, 0.0])
    across = np.array([-radial[1], radial[0]])
    # Frequencies up to the pixel's, or to the limit of the pupil, the width of its autocorrelation.
    limit = 2 * front.semi_axes[0, 0] / front.wavelength_mm
    per_mm = np.linspace(0, min(limit, 1 / pitch_mm), FREQUENCIES)
    shift_mm = saddle_of_light(front, pitch_mm) - saddle_of_rays(front, pitch_mm)
    # A picture that shows the rings of the Airy disc and all rays.
    spot_mm = float(np.hypot(*front.crossings_mm[front.share > 0].T).max())
    half_mm = max(_RADII * airy_mm, _SPOT * spot_mm)
    cells = np.linspace(half_mm, -half_mm, _CELLS)  # the image is the vision frame turned by 180 degrees
    light = intensity(front, cells, cells)
    return PointImage(
        place=name,
        x_px=rig.tracer.pixels_at(view.position_mm[None])[0],
        object_mm=view.object_mm,
        wavelength_nm=wavelength_nm,
        numerical_aperture=front.numerical_aperture,
        airy_radius_um=1e3 * airy_mm,
        rms_waves=front.error_waves[0],
        extent_waves=front.error_waves[1],
        strehl_ratio=strehl_ratio(front),
        saddle_shift_px=-shift_mm / pitch_mm + 0.0,
        per_mm=per_mm,
        tangential=np.abs(transfer(front, per_mm, radial)),
        sagittal=np.abs(transfer(front, per_mm, across)),
        perfect=np.abs(transfer(front.perfect(), per_mm, radial)),
        geometric=np.abs(transfer_of_rays(front, per_mm, radial)),
        picture=light / light.max(),
        picture_um=1e3 * (2 * half_mm),
    )
