"""Micro-images: where the image behind each microlens lies on the sensor, and which pixels belong to it."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pipeline.camera.camera import CameraError
from pipeline.camera.chief import chief_slopes
from pipeline.camera.regions import NO_MICROLENS, SKIP
from pipeline.camera.tracer import Tracer
from pipeline.optics.first_order import exit_pupil

_NEIGHBOURS = 4
"""No point of a plane lies within reach of more than three micro-images of a hexagonal array that hardly overlap."""


@dataclass(frozen=True, slots=True)
class MicroImages:
    """Centres of all micro-images, in the order of `camera.lattice`.

    Attributes
    ----------
    centre_mm : (n, 2) float64
        Sensor hit of the real ray through the stop centre and the microlens vertex, vision frame.
    radius_mm : float
        Exit-pupil radius * B / P, the contour of half illumination.
    reach_mm : (n,) float64
        Beyond this distance from the centre no light of the microlens arrives.
    tree : cKDTree
        Of the centres.
    """

    centre_mm: np.ndarray
    radius_mm: float
    reach_mm: np.ndarray
    tree: cKDTree

    def owner(self, positions_mm: np.ndarray) -> np.ndarray:
        """Row of the microlens whose micro-image centre is nearest to each position of the sensor, (n,)."""
        return self.tree.query(positions_mm)[1]

    def contributors(self, positions_mm: np.ndarray, slack_mm: float) -> np.ndarray:
        """Rows of the microlenses whose light may reach within `slack_mm` of each position, (n, _NEIGHBOURS)."""
        distance, rows = self.tree.query(positions_mm, k=min(_NEIGHBOURS, len(self.centre_mm)))
        distance, rows = distance.reshape(len(positions_mm), -1), rows.reshape(len(positions_mm), -1)
        lit = distance <= self.reach_mm[rows] + slack_mm
        if rows.shape[1] == _NEIGHBOURS and lit[:, -1].any():
            raise CameraError(
                "more than three micro-images overlap",
                hint="stop the main lens down: see matched_stop_diameter_mm in camera.json",
            )
        return np.where(lit, rows, SKIP)


def micro_images(tracer: Tracer) -> MicroImages:
    """Micro-images of a plenoptic camera.

    The chief ray is traced backwards from the microlens vertex, so its slope in front of the array is exact; an ideal
    thin lens passes it undeviated.
    """
    array, grid = tracer.camera.microlenses, tracer.lattice
    if array is None or grid is None:
        raise CameraError("a conventional camera has no micro-images")
    vertex = tracer.vertices_mm
    points = np.column_stack([vertex, np.full(len(vertex), tracer.film_z_mm)])
    slope = chief_slopes(tracer.table, tracer.stop_row, points)
    pupil = exit_pupil(tracer.camera.prescription)
    to_pupil = pupil.z_mm - tracer.film_z_mm
    radius = pupil.diameter_mm / 2 * array.distance_mm / to_pupil
    focal = np.array(array.focal_lengths_mm)[grid.type]
    # A ray through aperture offset a and pupil point e lands at centre + a (1 + B / P - B / f) - e B / P.
    spread = np.abs(1 + array.distance_mm / to_pupil - array.distance_mm / focal)
    corner = array.pitch_mm / np.sqrt(3)
    reach = 1.1 * radius + 1.1 * corner * spread
    centre = vertex - slope * array.distance_mm
    return MicroImages(centre, float(radius), reach, cKDTree(centre))


def owners(images: MicroImages | None, positions_mm: np.ndarray) -> np.ndarray:
    """Microlens of each sensor position: the owner of its cell, or NO_MICROLENS throughout."""
    if images is None:
        return np.full(len(positions_mm), NO_MICROLENS)
    return images.owner(positions_mm)


def strata(tracer: Tracer, images: MicroImages | None, positions_mm: np.ndarray) -> np.ndarray:
    """Microlenses that light of the pixel around each position may pass, (n, s)."""
    if images is None:
        return np.full((len(positions_mm), 1), NO_MICROLENS)
    return images.contributors(positions_mm, tracer.camera.sensor.pitch_mm * np.sqrt(0.5))
