"""Our figures beside those that CODE V, Zemax OpticStudio and optiland print: docs/public_numbers.md. `--write` puts
them there.

python docs/public_numbers.py [--write]

The listings are kept in tests/published with their sources; nothing of the other programs is run. Each table has the
columns that optiland asks for: the quantity, the other program, ours, and the difference.
"""

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
from inserted import print_or_write
from pxr import Usd

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.camera.wave.spread import transfer
from pipeline.camera.wave.wavefront import View, wavefront
from pipeline.optics.first_order import FirstOrder, first_order
from pipeline.optics.glass.catalogue import find
from pipeline.optics.kernels import trace_rays
from pipeline.optics.prescription import Prescription, Surface
from pipeline.optics.table import towards_sensor
from pipeline.scene.lens import read_prescription

ROOT = Path(__file__).resolve().parents[1]
PUBLISHED = ROOT / "tests/published"
PAGE = ROOT / "docs/public_numbers.md"
ROUNDINGS = 1e-12
"""Difference below which only the roundings of both programs are left [mm or 1]."""
WIDE_MM, OF_RADIUS = 40.0, 0.99
"""Clear apertures of the public lenses [mm, and of a radius at most], which state none: no ray is blocked."""
_SCALES = np.arange(1, 6) / 25
"""Scales at which rays are traced whose limit is of third order: errors of the limit are of order 11."""
EDGE_MM = 0.01
"""Clear aperture beyond the outermost listed ray [mm]: listings without semi-diameters block no ray."""


@dataclass(frozen=True)
class Row:
    """A quantity as another program printed it, and as ours computes it."""

    quantity: str
    printed: str
    ours: float

    @property
    def half_unit(self) -> float:
        """Half a unit of the last printed digit."""
        return 0.5 * 10.0 ** int(Decimal(self.printed).as_tuple().exponent)

    @property
    def difference(self) -> float:
        """Ours less theirs."""
        return self.ours - float(self.printed)

    def __str__(self) -> str:
        agrees = abs(self.difference) <= max(1.0002 * self.half_unit, ROUNDINGS)
        digits = -int(Decimal(self.printed).as_tuple().exponent)
        return f"| {self.quantity} | {self.printed} | {self.ours:.{min(digits, 12)}f} | {self._told(agrees)} |"

    def _told(self, agrees: bool) -> str:
        if not agrees:
            return f"{self.difference:+.1e}"
        return "0 within the printed digits" if self.half_unit > ROUNDINGS else "below 1e-12"


def listed(name: str) -> dict[str, Any]:
    """A file of listings."""
    content: dict[str, Any] = json.loads((PUBLISHED / f"{name}.json").read_text(encoding="utf-8"))
    return content


def public_lens(system: dict[str, Any]) -> Prescription:
    """One of optiland's public lenses, with a stop that gives the stated entrance pupil or F-number."""
    at_nm = system["wavelength_nm"]

    def with_stop(semi_mm: float) -> Prescription:
        return Prescription(
            surfaces=tuple(
                Surface(
                    radius_mm=math.inf if radius is None else radius,
                    thickness_mm=thickness,
                    index=find(medium).index(at_nm) if ":" in medium else 1.0,
                    semi_diameter_mm=semi_mm if medium == "stop" else wide_mm(radius or math.inf),
                    is_stop=medium == "stop",
                )
                for radius, thickness, medium in system["surfaces"]
            )
        )

    unit = first_order(with_stop(1.0))
    pupil_mm = unit.efl_mm / system["f_number"] if "f_number" in system else system["entrance_pupil_mm"]
    return with_stop(pupil_mm / unit.entrance_pupil.diameter_mm)


def wide_mm(radius_mm: float) -> float:
    """A clear aperture that blocks no ray of a listing."""
    return min(WIDE_MM, OF_RADIUS * abs(radius_mm))


def public_first_order(system: dict[str, Any]) -> list[Row]:
    """Tier 1: first-order quantities."""
    lens = public_lens(system)
    found, vertices, back_mm = first_order(lens), lens.vertices_from_stop_mm, system["surfaces"][-1][1]
    image_z_mm = -(vertices[-1] + back_mm)
    field = math.tan(math.radians(system["field_deg"]))
    ours = {
        "EFL": found.efl_mm,
        "EPD": found.entrance_pupil.diameter_mm,
        "Entrance pupil location (from surf 1)": -vertices[0] - found.entrance_pupil.z_mm,
        "Exit pupil diameter": found.exit_pupil.diameter_mm,
        "Exit pupil location (from image surface)": image_z_mm - found.exit_pupil.z_mm,
        "Image-space F/# (on axis)": found.f_number,
        "Back focal point (from image surface)": found.bfd_mm - back_mm,
        "Rear principal plane (from image surface)": found.bfd_mm - found.efl_mm - back_mm,
        "Lagrange invariant": found.entrance_pupil.diameter_mm / 2 * field,
    }
    return [Row(quantity, printed, ours[quantity]) for quantity, printed in system["first_order"].items()]


def public_rays(system: dict[str, Any]) -> np.ndarray:
    """Tier 2: the same rays through our surfaces, aimed at the same points of the paraxial entrance pupil.

    Returns
    -------
    (n, 4) float64
        x, y in the image surface [mm], and the direction cosines along x and y there.
    """
    lens = public_lens(system)
    found, vertices, back_mm = first_order(lens), lens.vertices_from_stop_mm, system["surfaces"][-1][1]
    # Aimed to first order, rays miss the rim of the stop by their aberrations; in the listing it blocks none.
    wide = (replace(one, semi_diameter_mm=wide_mm(one.radius_mm)) for one in lens.surfaces)
    rays = np.array(system["rays"])
    slope = np.tan(np.radians(rays[:, 0] * system["field_deg"]))
    direction = np.column_stack([np.zeros(len(rays)), slope, np.ones(len(rays))])
    in_pupil = rays[:, 1:3] * found.entrance_pupil.diameter_mm / 2
    pupil = np.column_stack([in_pupil, np.full(len(rays), -found.entrance_pupil.z_mm)])
    position = pupil - direction * (pupil[:, 2:] - vertices[0] + 2 * found.efl_mm)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    alive = np.ones(len(rays))
    trace_rays(towards_sensor(Prescription(surfaces=tuple(wide))), position, direction, alive)
    if not alive.all():
        raise RuntimeError(f"rays {np.flatnonzero(alive == 0)} of {system['name']} are lost")
    on_image = position + direction * ((vertices[-1] + back_mm - position[:, 2]) / direction[:, 2])[:, None]
    return np.column_stack([on_image[:, :2], direction[:, :2]])


def codev_lens(listing: dict[str, Any]) -> Prescription:
    """The double Gauss of CODE V's listing; edges, which are not listed, lie a little outside of all listed rays."""
    heights = np.max([np.hypot(*np.array(ray["rows"])[:, 1:3].T) for ray in listing["rays"]], axis=0)
    return Prescription(
        surfaces=tuple(
            Surface(
                radius_mm=math.inf if row["radius_mm"] is None else 1 / row["curvature_per_mm"],
                thickness_mm=row["thickness_mm"],
                index=row["n_587_6nm"],
                semi_diameter_mm=row.get("semi_diameter_mm", height + EDGE_MM),
                is_stop=row.get("stop", False),
            )
            for row, height in zip(listing["surfaces"], heights, strict=True)
        )
    )


def codev_first_order(listing: dict[str, Any]) -> list[Row]:
    """First-order quantities of CODE V's listing, with its names and signs."""
    lens = codev_lens(listing)
    found: FirstOrder = first_order(lens)
    first_mm, last_mm = -lens.vertices_from_stop_mm[0], -lens.vertices_from_stop_mm[-1]
    ours = {
        "EFL": found.efl_mm,
        "BFL": found.bfd_mm,
        "FFL": first_mm - found.front_focus_mm,
        "F_number": found.f_number,
        "image_distance": found.bfd_mm + listing["image_shift_mm"],
        "overall_length": first_mm - last_mm,
        "paraxial_image_height_14deg": found.efl_mm * math.tan(math.radians(14.0000000032)),
        "entrance_pupil_diameter": found.entrance_pupil.diameter_mm,
        "entrance_pupil_from_first": first_mm - found.entrance_pupil.z_mm,
        "exit_pupil_diameter": found.exit_pupil.diameter_mm,
        "exit_pupil_from_last": last_mm - found.exit_pupil.z_mm,
    }
    named = listing["first_order"].items()
    return [Row(quantity.replace("_", " "), f"{printed:.4f}", ours[quantity]) for quantity, printed in named]


def codev_rays(listing: dict[str, Any]) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Each listed ray: its name, and x, y, slopes behind the last surface, as printed and as ours, (4,) each."""
    lens, degrees = codev_lens(listing), {0: 0.0, 10: 10.0000000023, 14: 14.0000000032}
    for ray in listing["rays"]:
        slope, rows = math.tan(math.radians(degrees[ray["field_deg"]])), np.array(ray["rows"])
        position = rows[:1, 1:4] + [0.0, 0.0, lens.vertices_from_stop_mm[0]]
        direction, alive = np.array([[0.0, slope, 1.0]]) / math.hypot(slope, 1.0), np.ones(1)
        trace_rays(towards_sensor(lens), position, direction, alive)
        ours = np.array([*position[0, :2], *(direction[0, :2] / direction[0, 2])])
        yield ray["what"], rows[-1][[1, 2, 4, 5]], np.where(alive, ours, math.nan)


def codev_third_order(listing: dict[str, Any]) -> list[Row]:
    """Sums of CODE V's table of third-order transverse aberrations, and ours: limits of exact rays.

    A ray through the point (x, y) of the paraxial entrance pupil (in its radii), from the field h (in the tangent of
    14 degrees), misses its paraxial image in the paraxial image plane. To third order, with s the scale of x, y and h,
    that is s³ times a sum of SA ρ³, TCO ρ² h, TAS ρ h² (along y) or SAS ρ h² (along x), and DST h³; PTB is what TAS and
    SAS leave of the field's curvature, (3 SAS - TAS) / 2.
    """
    s, none = _SCALES, np.zeros_like(_SCALES)
    spherical = _third(_missed(listing, s, none, none)[:, 0])
    distortion = _third(_missed(listing, none, none, s)[:, 1])
    sagittal = _third(_missed(listing, s, none, s)[:, 0]) - spherical
    above, below = _missed(listing, none, s, s)[:, 1], _missed(listing, none, -s, s)[:, 1]
    tangential = _third((above - below) / 2) - spherical
    ours = {
        "SA": spherical,
        "TCO": _third((above + below) / 2) - distortion,
        "TAS": tangential,
        "SAS": sagittal,
        "PTB": (3 * sagittal - tangential) / 2,
        "DST": distortion,
    }
    return [Row(name, f"{printed:.6f}", ours[name]) for name, printed in listing["third_order_sum"].items()]


def _third(missed_mm: np.ndarray) -> float:
    """Coefficient of s³ of an odd function given at all scales."""
    powers = np.vander(_SCALES**2, increasing=True)
    return float(np.linalg.solve(powers, missed_mm / _SCALES**3)[0])


def _missed(listing: dict[str, Any], x: np.ndarray, y: np.ndarray, field: np.ndarray) -> np.ndarray:
    """By how much rays miss their paraxial images, (n, 2) [mm]."""
    lens = codev_lens(listing)
    found, vertices = first_order(lens), lens.vertices_from_stop_mm
    radius_mm = listing["first_order"]["entrance_pupil_diameter"] / 2
    slope = field * math.tan(math.radians(14.0))
    direction = np.column_stack([np.zeros_like(slope), slope, np.ones_like(slope)])
    pupil = np.column_stack([radius_mm * x, radius_mm * y, np.full_like(x, -found.entrance_pupil.z_mm)])
    position = pupil + direction * ((vertices[0] - found.efl_mm) - pupil[:, 2:])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    alive = np.ones(len(x))
    trace_rays(towards_sensor(lens), position, direction, alive)
    if not alive.all():
        raise RuntimeError("a ray near the axis is lost")
    image = position + direction * ((vertices[-1] + found.bfd_mm - position[:, 2]) / direction[:, 2])[:, None]
    return image[:, :2] - np.column_stack([np.zeros_like(slope), found.efl_mm * slope])


def optiland_contrast(listing: dict[str, Any]) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Each kept contrast of optiland: its place, theirs and ours at all frequencies, (n,) each."""
    per_mm = np.array(listing["per_mm"])
    for row in listing["lenses"]:
        surfaces = library_lens("double_gauss_100mm_tronnier").surfaces
        stop = row["stop_semi_mm"]
        lens = Prescription(
            surfaces=tuple(replace(one, semi_diameter_mm=stop) if one.is_stop else one for one in surfaces)
        )
        found = first_order(lens)
        sensor = Sensor(width_px=64, height_px=64, pitch_mm=0.3)
        camera = Camera(prescription=lens, sensor=sensor, sensor_distance_mm=-found.rear_focus_mm)
        place = np.array([0.0, found.efl_mm * math.tan(math.radians(row["field_deg"]))])
        front = wavefront(Tracer(camera), View(place, NO_MICROLENS, math.inf), listing["wavelength_nm"])
        for along, name in (((0.0, 1.0), "tangential"), ((1.0, 0.0), "sagittal")):
            what = f"F/{found.f_number:.2f}, {row['field_deg']:g}°, {name}"
            yield what, np.array(row[name]), np.abs(transfer(front, per_mm, np.array(along)))


def tables() -> str:
    """All tables, with their headings."""
    listing = listed("codev_double_gauss")
    parts = [
        "## Double Gauss f/2: CODE V",
        about("CODE V 10.8", listing["name"], "tabulated indices of Schott glasses at 587.6 nm"),
        quantities("CODE V", codev_first_order(listing)),
        rays("Ray, behind surface 11", "CODE V: x, y, tan x, tan y", codev_ray_cells(listing)),
        quantities("CODE V", codev_third_order(listing), "Tier 3: sum of third order"),
    ]
    for system in listed("optiland_systems")["systems"]:
        parts += [
            f"## {system['name'][0].upper()}{system['name'][1:]}: OpticStudio and optiland",
            about(f"{system['tool']}; optiland 0.6.3", system["name"], system["glasses"]),
            quantities("OpticStudio", public_first_order(system)),
            rays("Ray: field, pupil x, pupil y", "optiland: x, y in the image", public_ray_cells(system)),
        ]
    return "\n\n".join([*parts, contrast(), "## Lenses of the library", library()]) + "\n"


def about(tool: str, system: str, glasses: str, changed: str = "none") -> str:
    """The head that optiland asks for above each listing."""
    return f"**Tool:** {tool} · **System:** {system} · **Glasses:** {glasses} · **Anything non-default:** {changed}"


def quantities(tool: str, rows: list[Row], head: str = "Tier 1: quantity") -> str:
    """A table of quantities."""
    return "\n".join([f"| {head} | {tool} | ours | Δ |", "|---|---|---|---|", *map(str, rows)])


def contrast() -> str:
    """Tier 4: contrast of the waves' images of points."""
    listing = listed("optiland_contrast")
    nm, at = listing["wavelength_nm"], " / ".join(f"{one:g}" for one in listing["per_mm"])
    glasses, changed = f"indices as printed in its patent, at {nm:g} nm", "`num_rays=256, grid_size=1024`"
    lines = [
        "## Contrast: optiland",
        about("optiland 0.6.3", "double Gauss 100 mm of Tronnier, two stops, object at infinity", glasses, changed),
        "",
        f"| Tier 4: contrast at {at} lines per mm | optiland | ours | largest Δ |",
        "|---|---|---|---|",
    ]
    for what, theirs, ours in optiland_contrast(listing):
        lines.append(f"| {what} | {numbers(theirs, 3)} | {numbers(ours, 3)} | {gap(ours, theirs)} |")
    return "\n".join([lines[0], "", *lines[1:]])


def rays(head: str, theirs: str, cells: Iterable[tuple[str, ...]]) -> str:
    """Tier 2: a table of rays."""
    lines = [f"| Tier 2: {head[0].lower()}{head[1:]} | {theirs} | ours | largest Δ |", "|---|---|---|---|"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in cells)])


def codev_ray_cells(listing: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    """A row for each ray of CODE V's listing."""
    for what, printed, ours in codev_rays(listing):
        yield what, numbers(printed, 6), numbers(ours, 6), gap(ours, printed)


def public_ray_cells(system: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    """A row for each ray of optiland; the difference counts direction cosines, too."""
    for ray, ours in zip(system["rays"], public_rays(system), strict=True):
        at = f"{ray[0]:g}; {ray[1]:g}, {ray[2]:g}"
        yield at, numbers(ray[3:5], 9), numbers(ours[:2], 9), gap(ours, ray[3:])


def library_lens(name: str) -> Prescription:
    """A lens of stages/lenses."""
    stage = Usd.Stage.Open(str(ROOT / f"stages/lenses/{name}.usda"))
    return read_prescription(stage.GetDefaultPrim())


def library() -> str:
    """Focal length and back focal distance of every lens of the library."""
    lines = [
        "| Tier 1: lens | EFL: another program | ours | BFD: another program | ours | largest Δ |",
        f"|{'---|' * 6}",
    ]
    for name, entry in listed("library_lenses")["lenses"].items():
        found, theirs = first_order(library_lens(name)), entry["independent"]
        cells = (theirs["efl_mm"], found.efl_mm, theirs["bfd_mm"], found.bfd_mm)
        shown = " | ".join(f"{cell:.4f}" for cell in cells)
        lines.append(f"| {name} | {shown} | {gap(cells[::2], cells[1::2])} |")
    return "\n".join(lines)


def gap(ours: Any, theirs: Any) -> str:
    """Largest difference of two rows of numbers."""
    return f"{np.abs(np.subtract(ours, theirs)).max():.0e}".replace("0e+00", "0")


def numbers(values: Any, digits: int) -> str:
    """Numbers with so many decimals; no negative zero."""
    return ", ".join(f"{round(float(value), digits) + 0.0:.{digits}f}" for value in values)


if __name__ == "__main__":
    print_or_write(__doc__ or "", tables, PAGE, "docs/public_numbers.py")
