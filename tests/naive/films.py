"""Reflection by a stack of films, written for reading: Fresnel's amplitudes at each boundary, summed by Airy.

The recursion starts at the boundary to the last medium and adds one film after the other: the light that goes to and
fro in a film is a geometric series. (Parratt, Physical Review 95, 1954, equations 7 and 8; for one film Airy, 1833.)
There are no matrices and no admittances here; the code under test has nothing else.
"""

import cmath
import math


def reflectance(media: list[float], thicknesses_nm: list[float], wavelength_nm: float, angle: float) -> list[float]:
    """Share of light that is reflected, polarised across the plane of incidence and in it.

    `media` are the indices of the medium that light comes from, all films, and the medium behind; the wavelength is
    that in air, the angle that in the first medium [rad].
    """
    cosines = [cmath.sqrt(1 - (media[0] * math.sin(angle) / n) ** 2) for n in media]
    found = []
    for boundary in (_across, _in_plane):
        amplitude = 0j
        for j in reversed(range(len(media) - 1)):
            here = boundary(media[j], cosines[j], media[j + 1], cosines[j + 1])
            if j + 1 < len(media) - 1:
                path_nm = 2 * media[j + 1] * thicknesses_nm[j] * cosines[j + 1]
                amplitude *= cmath.exp(2j * math.pi * path_nm / wavelength_nm)
            amplitude = (here + amplitude) / (1 + here * amplitude)
        found.append(abs(amplitude) ** 2)
    return found


def _across(n: float, cos: complex, n_behind: float, cos_behind: complex) -> complex:
    return (n * cos - n_behind * cos_behind) / (n * cos + n_behind * cos_behind)


def _in_plane(n: float, cos: complex, n_behind: float, cos_behind: complex) -> complex:
    return (n_behind * cos - n * cos_behind) / (n_behind * cos + n * cos_behind)
