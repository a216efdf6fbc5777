"""A camera ready for questions in a notebook: image positions of points, and rays of image positions.

Its solver is that of the ground truth, method `direct`: a row of correspondences.csv and a projection of the same point
are the same number.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.pupil.from_stop import pupil_fan
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.motion import Motion, Shutter
from pipeline.optics.first_order import first_order
from pipeline.records.declared import number
from pipeline.results.answers import Fate, PixelRays, Projected
from pipeline.results.notebook import html_table
from pipeline.scene.dataset import VariedNumber
from pipeline.truth.derivatives import Neighbour, SolvedRows, Variation
from pipeline.truth.derivatives import derivatives as row_derivatives
from pipeline.truth.direct.direct_rows import Guess, guesses, mean_rays, planes_of_rays, solve
from pipeline.truth.moving import planes_at_own_times
from pipeline.truth.planes import Planes, axes_across, faces_camera
from pipeline.truth.rows import Solutions

if TYPE_CHECKING:
    from pipeline.results.spots import SpotDiagram

_FACING = np.diag([1.0, -1.0, -1.0])
"""Axes of a plane that faces the camera, by rows: x right, y up, and its front towards the camera."""
_FRONT = (0.0, 0.0, 1.0)
"""Front of a flat target in its own frame."""
_LEAST_PX = 1e-9
"""Finest accuracy that can be requested [px]: below it, double precision rounds."""
POINT = "point"
"""Name of the point's own coordinates among the parameters of derivatives."""
_SHARE_OF_DISTANCE = 1e-5
"""Step of points for finite differences, as a share of their distance [1]."""
_PLANES_FOCAL_LENGTHS = (10.0, 20.0)
"""Distances of the two planes of rays in focal lengths [1], for a camera that is not focused: any two will do."""


@dataclass(frozen=True, kw_only=True)
class ReadyCamera:
    """A camera that projects points and back-projects pixels.

    `name`: name as in tables; empty for a camera that comes from no stage.
    `min_hit_fraction`: positions with less light count as dark.
    `accuracy_px`: default accuracy of answers.
    `shutter`: exposure times of its lines; None where a frame is an instant.
    `vary`: function that returns the camera with each number of a stage property slightly decreased and increased; None
    without a stage.
    """

    name: str
    rig: Rig = field(repr=False)
    min_hit_fraction: float
    accuracy_px: float
    shutter: Shutter | None = None
    vary: Callable[[str], list[VariedNumber[Camera]]] | None = field(default=None, repr=False)

    def __str__(self) -> str:
        sensor = self.camera.sensor
        lens = first_order(self.camera.prescription)
        figures = f"{sensor.width_px} x {sensor.height_px} px, f = {lens.efl_mm:.5g} mm, F/{lens.f_number:.3g}"
        return f"{self.name or 'camera'}: {figures}"

    @property
    def camera(self) -> Camera:
        return self.rig.tracer.camera

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of its image."""
        return self.camera.sensor.size_px

    @property
    def is_plenoptic(self) -> bool:
        """Whether a microlens array stands before the sensor."""
        return self.rig.images is not None

    def project(
        self,
        points_mm: ArrayLike,
        normals: ArrayLike | None = None,
        *,
        moving: Motion | Callable[[float], np.ndarray] | None = None,
        accuracy_px: float | None = None,
        derivatives: Sequence[str] = (),
        blur_derivatives: bool = False,
    ) -> Projected:
        """Image positions of points: where the mean of a position's bundle is the point, J(x) = p.

        Parameters
        ----------
        points_mm : (p, 3)
            Vision frame: origin at the centre of the aperture stop, x right, y down, z forward.
        normals : (p, 3) or (3,), optional
            Fronts of the surfaces on which the points lie. J is the mean on the tangent plane, so out of focus a
            tilted surface has other positions. By default planes perpendicular to the axis.
        moving : Motion or function of a time [s], optional
            The pose (4, 4) from a frame in which the points rest, and normals with +z as default, to the vision frame
            at a time after the time code of the frame, while a shutter is open. A point then lies where its own line
            sees it, as rows of the ground truth do.
        accuracy_px : float, optional
            Error that positions may have; by default that of the camera.
        derivatives : sequence of str, optional
            Numbers by which positions have derivatives: "point", the point itself, and paths of properties of the
            stage, from its default prim on: "Rig/Lens/Front.plen:radius". What follows from a number counts: a
            lens is focused again.
        blur_derivatives : bool
            Whether the blur has them, too. They cost eight times what those of positions do.

        CameraError if an argument holds no such numbers, or if something moves before a camera without a shutter.
        """
        points = _numbers("points_mm", points_mm, 3)
        if isinstance(derivatives, str) or not all(isinstance(name, str) for name in derivatives):
            raise CameraError(f"derivatives={derivatives!r} is no list of names", hint=f'as ["{POINT}"]')
        if derivatives and moving is not None:
            hint = "leave out derivatives, or what changes while the shutter is open"
            raise CameraError("positions that move with their lines have no derivatives", hint=hint)
        planes = np.empty((len(points), 4, 3))
        planes[:, 0] = points
        planes[:, 1:] = _axes(_FRONT if moving is not None and normals is None else normals, len(points))
        of_points = Planes(planes) if moving is None else self._moving(planes, moving)
        planes, _ = planes_at_own_times(self.rig, of_points, slice(None))
        # A point is without light until a guess finds it, outside until a solution is in the image, and dark until
        # enough light reaches it there.
        fates = np.array([Fate.NO_LIGHT if faces else Fate.AWAY for faces in faces_camera(planes)], dtype=object)
        fates[~pupil_fan(self.camera.prescription).may_see(planes[:, 0])] = Fate.BEHIND
        to_guess = np.flatnonzero(fates == Fate.NO_LIGHT)
        guess, _ = guesses(self.rig, planes[to_guess])
        guess = Guess(to_guess[guess.point], guess.cell, guess.x_px)
        truth = solve(self.rig, guess, of_points, self._accuracy(accuracy_px), 0.0)
        is_lit = truth.hit_fraction >= self.min_hit_fraction
        fates[guess.point] = Fate.OUTSIDE
        fates[truth.solutions.point] = Fate.DARK
        fates[truth.solutions.point[is_lit]] = Fate.SEEN
        rows = truth.only(is_lit)
        lattice = self.rig.tracer.lattice
        solutions = rows.solutions
        rates, blur_rates = self._derivatives(solutions, planes, derivatives, with_blur=blur_derivatives)
        return Projected(
            point=solutions.point,
            x_px=solutions.x_px,
            y_px=solutions.y_px,
            error_px=rows.sigma_px,
            hit_fraction=rows.hit_fraction,
            rho_px=rows.rho_px,
            microlens=None if lattice is None else self.rig.axial[solutions.cell],
            microlens_type=None if lattice is None else lattice.type[solutions.cell],
            fates=tuple(fates),
            t_s=None if self.shutter is None else self.shutter.middle_s(solutions.xy_px, self.size_px),
            blur_px2=rows.blur_px2,
            derivatives=rates,
            blur_derivatives=blur_rates,
        )

    def _derivatives(
        self, rows: Solutions, planes: np.ndarray, names: Sequence[str], *, with_blur: bool
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Derivatives of positions and, if requested, of blur, by name of the parameter.

        `planes`, (p, 4, 3): tangent planes of all points, each a point and three axes by rows, vision frame [mm].
        Returns (n, 2) [px] and (n, 2, 2) [px^2] per unit of a parameter. One of several numbers, as a point, adds an
        axis: (n, 2, k) and (n, 2, 2, k).
        """
        still_planes = Planes(planes)
        variations = list[Variation]()
        end_of_name = dict[str, int]()  # end of its variations among all
        for name in dict.fromkeys(names):
            if name == POINT:
                variations += [_shifted(self.rig.tracer, planes, axis) for axis in range(3)]
            elif self.vary is None:
                raise CameraError(
                    f"a camera without a stage has no {name!r}", hint=f'derivatives=["{POINT}"] needs no stage'
                )
            else:
                for varied in self.vary(name):
                    less, more = (
                        Neighbour(self.rig.tracer.next_to(camera), still_planes)
                        for camera in (varied.less, varied.more)
                    )
                    variations.append(Variation(varied.step, less, more))
            end_of_name[name] = len(variations)
        if not variations:
            return {}, {}
        solved = SolvedRows(rows.point, rows.cell, rows.xy_px, still_planes)
        rates = row_derivatives(self.rig, solved, variations, with_blur=with_blur)

        def by_name(by_variation: np.ndarray) -> dict[str, np.ndarray]:
            """Rates by variation, (n, v, …), as one array for each name, (n, …) or (n, …, k)."""
            result = {}
            first = 0
            for name, end in end_of_name.items():
                its_rates = np.moveaxis(by_variation[:, first:end], 1, -1)
                result[name] = its_rates if end - first > 1 else its_rates[..., 0]
                first = end
            return result

        return by_name(rates.x_px), {} if rates.blur_px2 is None else by_name(rates.blur_px2)

    def _moving(self, planes: np.ndarray, moving: Motion | Callable[[float], np.ndarray]) -> Planes:
        """Planes of points that move while the shutter is open; CameraError without one."""
        if self.shutter is None:
            hint = "give points where they are at the time code, or plen:shutter:* to the camera"
            raise CameraError(f"{self.name or 'the camera'} has no shutter, so a frame is an instant", hint=hint)
        motion = moving if isinstance(moving, Motion) else Motion.of(moving, self.shutter.motion_s(self.size_px))
        return Planes(planes, motion, self.shutter, self.size_px)

    def rays(self, x_px: ArrayLike, y_px: ArrayLike, *, accuracy_px: float | None = None) -> PixelRays:
        """Rays of image positions: the line of J(x) through all planes perpendicular to the axis; for a camera that
        sees 80 degrees or more off its axis, perpendicular to the chief ray of the position.

        `x_px`, `y_px`: (n,); (0, 0) is the centre of the top-left pixel; positions between pixels are allowed.
        Raises CameraError: an argument holds no such numbers.
        """
        x = _numbers("x_px", x_px)
        y = _numbers("y_px", y_px)
        if len(x) != len(y) and 1 not in (len(x), len(y)):
            raise CameraError(f"{len(x)} x_px have {len(y)} y_px", hint="as many of both, or one for all")
        x, y = np.broadcast_arrays(x, y)
        near_mm, far_mm = self.planes_mm
        xy_px = np.stack([x, y], axis=1)
        planes = planes_of_rays(self.rig, xy_px, (near_mm, far_mm))
        mean = mean_rays(self.rig, xy_px, planes, self._accuracy(accuracy_px))
        near, far = mean.crossings_mm[:, 0], mean.crossings_mm[:, 1]
        if np.array_equal(planes[:, 0, 3, 2], np.ones(len(x))):  # all planes are perpendicular to the axis
            slope = (far - near) / (far_mm - near_mm)
            direction = np.column_stack([slope, np.ones(len(x))])
            origin = np.column_stack([near - near_mm * slope, np.zeros(len(x))])
        else:
            ends = planes[:, :, 0] + np.einsum("nek,nekj->nej", mean.crossings_mm, planes[:, :, 1:3])
            direction = ends[:, 1] - ends[:, 0]
            origin = ends[:, 0] - (near_mm - self._front_mm) / (far_mm - near_mm) * direction
        return PixelRays(
            x_px=x.copy(),
            y_px=y.copy(),
            origin_mm=np.where(np.isnan(near[:, :1]), np.nan, origin),
            direction=direction / np.linalg.norm(direction, axis=1, keepdims=True),
            error_px=mean.error_px,
            hit_fraction=mean.hit_fraction,
            microlens=self.rig.axial[mean.microlens] if self.is_plenoptic else None,
        )

    def spots(self) -> "SpotDiagram":
        """Spot diagrams from the centre to the corner of the image, in focus and at the ends of the depth of field.

        A notebook shows them as a picture.
        """
        from pipeline.results.spots import spot_diagram

        return spot_diagram(self.camera, self.name)

    def _repr_html_(self) -> str:
        """Key figures and the drawing with real rays, for a notebook."""
        # Imported here: a notebook that only projects points does not load drawing.
        from pipeline.results.drawing import focus_in_words, svg

        lens = first_order(self.camera.prescription)
        sensor = self.camera.sensor
        array = self.camera.microlenses
        rows = [
            ("focal length", f"{lens.efl_mm:.4g} mm"),
            ("entrance pupil", f"{lens.entrance_pupil.diameter_mm:.4g} mm wide"),
            ("in focus", focus_in_words(self.camera, ".5g")),
            ("sensor", f"{sensor.width_px} x {sensor.height_px} px of {1000 * sensor.pitch_mm:g} µm"),
        ]
        if array is not None:
            focal_lengths = ", ".join(f"{length:.4g}" for length in array.focal_lengths_mm)
            rows.append(("microlenses", f"{array.pitch_mm:.4g} mm apart, f = {focal_lengths} mm"))
        name = self.name or "camera"
        return html_table(("camera", name), rows) + svg(self.camera, name)

    @property
    def _front_mm(self) -> float:
        """Vision z of the first vertex of the lens."""
        return -float(self.camera.prescription.vertices_from_stop_mm[0])

    @property
    def planes_mm(self) -> tuple[float, float]:
        """Vision z of the two planes on which rays are found: those of J_near and J_far, if the camera has them."""
        near_mm, far_mm = self.camera.near_mm, self.camera.far_mm
        if near_mm is not None and far_mm is not None and np.isfinite([near_mm, far_mm]).all():
            return near_mm, far_mm
        efl_mm = abs(first_order(self.camera.prescription).efl_mm)
        first, second = (self._front_mm + times * efl_mm for times in _PLANES_FOCAL_LENGTHS)
        return first, second

    def _accuracy(self, accuracy_px: float | None) -> float:
        """The requested accuracy [px], by default that of the camera."""
        if accuracy_px is None:
            return self.accuracy_px
        return number("accuracy_px", accuracy_px, CameraError, _LEAST_PX, 1.0)


def _shifted(tracer: Tracer, planes: np.ndarray, axis: int) -> Variation:
    """Points displaced a little backwards and forwards along an axis, with their tangent planes."""
    step = _SHARE_OF_DISTANCE * float(np.abs(planes[:, 0, 2]).max(initial=1.0))
    shift = np.zeros((4, 3))
    shift[0, axis] = step
    return Variation(step, *(Neighbour(tracer, Planes(planes + side * shift)) for side in (-1, 1)))


def _numbers(name: str, argument: Any, columns: int | None = None) -> np.ndarray:
    """Finite float64 (n,), or (n, columns); one number or one point becomes an array of length one."""
    try:
        values = np.atleast_1d(np.asarray(argument, dtype=np.float64))
    except (TypeError, ValueError):
        raise CameraError(f"{name} holds values that are not numbers") from None
    if columns is not None:
        values = np.atleast_2d(values)
    if values.ndim != (1 if columns is None else 2) or (columns is not None and values.shape[1] != columns):
        shape = "(n,)" if columns is None else f"(n, {columns})"
        raise CameraError(f"{name} has the shape {values.shape}", hint=f"it has to be {shape}")
    if not np.isfinite(values).all():
        raise CameraError(f"{name} holds numbers that are not finite", hint="leave them out, or mend them")
    return values


def _axes(normals: ArrayLike | None, count: int) -> np.ndarray:
    """Axes of tangent planes by rows, (count, 3, 3) or (3, 3): first, second, normal."""
    if normals is None:
        return _FACING
    vectors = _numbers("normals", normals, 3)
    if not vectors.any(axis=1).all():
        raise CameraError("a normal has no direction", hint="normals are vectors of any length but 0")
    if len(vectors) not in (1, count):
        raise CameraError(f"{count} points have {len(vectors)} normals", hint="one for all, or one for each")
    return axes_across(np.broadcast_to(vectors, (count, 3)))
