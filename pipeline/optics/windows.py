"""Windows in front of a lens, such as ports, domes and panes, and the medium of the scene.

A window is a group of surfaces in front of those of the lens; the group has the pose of the window. The name of the
group is a slash and the name of the window; names of a lens's own groups have no slash.
"""

from dataclasses import dataclass, replace

from pipeline.optics.prescription import Group, Prescription, PrescriptionError, Surface
from pipeline.records.declared import settle

MARK = "/"
"""First character of the name of a group that is a window."""


def parted(prescription: Prescription) -> tuple[tuple[Group, ...], Prescription]:
    """The windows of a prescription, outermost first, and the lens without them, in the medium behind them."""
    windows = tuple(group for group in prescription.groups if group.name.startswith(MARK))
    if not windows:
        return (), prescription
    count = windows[-1].members.stop
    moved = (replace(group, first=group.first - count) for group in prescription.groups if group not in windows)
    index_in_front = prescription.surfaces[count - 1].index
    lens = replace(
        prescription,
        surfaces=prescription.surfaces[count:],
        groups=tuple(moved),
        index_in_front=index_in_front,
    )
    return windows, lens


@dataclass(frozen=True, slots=True, kw_only=True)
class Indices:
    """Refractive indices of the media before a lens at a wavelength, relative to air."""

    wavelength_nm: float
    index_in_front: float  # of the medium before the outermost window, or before the lens
    behind: tuple[float, ...]  # of the medium behind each surface


@dataclass(frozen=True, slots=True, kw_only=True)
class Windows:
    """Windows from the outermost one to the lens, each as its group; none, for a medium alone.

    The indices of `surfaces` do not count: `light` has those of every wavelength of the camera.
    """

    surfaces: tuple[Surface, ...] = ()
    groups: tuple[Group, ...] = ()
    first_mm: float = 0.0  # vertex of the first surface from the stop along the axis, + towards the sensor
    light: tuple[Indices, ...]

    def __post_init__(self) -> None:
        settle(self, PrescriptionError)

    def at(self, wavelength_nm: float) -> Indices:
        """The media at one of the wavelengths of `light`."""
        return next(indices for indices in self.light if indices.wavelength_nm == wavelength_nm)

    def before(self, lens: Prescription, wavelength_nm: float) -> Prescription:
        """The prescription with these windows in front of it."""
        media = self.at(wavelength_nm)
        panes = tuple(replace(s, index=n) for s, n in zip(self.surfaces, media.behind, strict=True))
        # The last surface of the windows ends at the first vertex of the lens.
        if panes:
            last_mm = self.first_mm + sum(surface.thickness_mm for surface in panes[:-1])
            panes = (*panes[:-1], replace(panes[-1], thickness_mm=lens.vertices_from_stop_mm[0] - last_mm))
        groups_of_lens = (replace(group, first=group.first + len(panes)) for group in lens.groups)
        return replace(
            lens,
            surfaces=(*panes, *lens.surfaces),
            groups=(*self.groups, *groups_of_lens),
            index_in_front=media.index_in_front,
        )
