"""Lines that `pipeline fit` prints: models with residuals, residuals by distance, the entrance pupil over the field."""

from collections.abc import Iterator

from pipeline.fits.fitting import Fit
from pipeline.fits.result import FittedCamera, by_distance, worst
from pipeline.fits.thin_plenoptic import ThinPlenopticFit

_ROWS = 5
"""Lines about the entrance pupil: from the middle of the field to its edge."""

_NOTHING = 1e-11
"""Size below which a parameter prints as 0 [its unit]: rounding of what symmetry makes 0."""


def page(camera: FittedCamera) -> Iterator[str]:
    """Lines for a terminal."""
    field = camera.field
    width, height = field.size_px
    near, far = field.planes_mm
    yield f"{camera.name}: {len(field.x_px)} rays over {width} x {height} px, on planes {near:.4g} and {far:.4g} mm"
    yield "before the stop; residuals are lengths in px"
    yield ""
    if camera.fits:
        yield "model             rms        largest    where"
    for fit in camera.fits:
        x, y, z_mm = worst(fit, field)
        yield f"{fit.model.name:16}  {fit.rms_px:.3e}  {fit.max_px:.3e}  at ({x:g}, {y:g}) px, {z_mm:.4g} mm"
    for fit in camera.fits:
        yield ""
        yield f"{fit.model.name}: {fit.model.consumer}"
        yield from _parameters(fit.values)
    if camera.fits:
        yield ""
        yield from _distances(camera.best, camera)
    if camera.thin is not None:
        yield ""
        yield from _thin(camera.thin)
    yield ""
    yield "entrance pupil: where rays pass the axis"
    yield "angle      vision z"
    count = len(camera.pupil.angle_deg)
    for row in sorted({round((count - 1) * step / (_ROWS - 1)) for step in range(_ROWS)} if count else ()):
        yield f"{camera.pupil.angle_deg[row]:6.2f}°   {camera.pupil.z_mm[row]:10.4f} mm"


def _parameters(values: dict[str, float]) -> Iterator[str]:
    items = [f"{name} {0 if abs(value) < _NOTHING else value:.8g}" for name, value in values.items()]
    for first in range(0, len(items), 4):
        yield "  " + "  ".join(f"{item:26}" for item in items[first : first + 4]).rstrip()


def _distances(fit: Fit, camera: FittedCamera) -> Iterator[str]:
    yield f"{fit.model.name} at other distances, not fitted again: rays of a lens do not meet in one centre"
    yield "vision z      rms        largest"
    for z_mm, mean, most in by_distance(fit, camera.field):
        yield f"{z_mm:9.1f} mm  {mean:.3e}  {most:.3e}"


def _thin(fit: ThinPlenopticFit) -> Iterator[str]:
    yield f"thin lens before pinholes: {len(fit.residual_px)} positions of {fit.points} points in full light,"
    line = f"rms {fit.rms_px:.3e}, largest {fit.max_px:.3e}"
    if fit.dim_rms_px is not None:
        line += f"; {len(fit.dim_px)} more in the penumbra, rms {fit.dim_rms_px:.3e}"
    yield line
    yield from _parameters(fit.values)
