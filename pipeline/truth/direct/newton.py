"""Method `direct`: J(x) = p is solved for every target point and microlens, with J integrated at x itself.

There is no position image, no interpolation and no K. J is a function of a continuous x, and Newton's method solves for
a vanishing residual, with B the inverse Jacobian, s the last step and y the change of the residual in it:

    x <- x - B (J(x) - p),  B <- B + (s - B y) s^T B / (s^T B y)

B starts from chief rays and is refined by finite differences; each step changes it by Broyden's update ("good" Broyden,
Math. Comp. 19, 1965, 577). A few steps suffice.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pipeline.camera.frozen_pupils import FrozenPupils, by_x
from pipeline.camera.integrals import LEVELS, Bundles, Integral, integrals, pooled
from pipeline.camera.integrating.quadrature import STEADY
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.moments import COLUMNS
from pipeline.optics.table import INNER_SQUARED
from pipeline.records.shapes import Float64, Int64
from pipeline.truth import blur
from pipeline.truth.direct.candidates import chief_jacobian, inverse
from pipeline.truth.direct.residuals import errors_px, mean_hit, over_exposure
from pipeline.truth.direct.starts import AROUND_PX, BEYOND_PX, MayExist, least_miss
from pipeline.truth.planes import Exposed

_STEPS = 14
"""Most rough steps: if steps are not short by then, there is no solution nearby."""
_RETREATS = 8
"""Most halvings of a step into the dark: down to 1/256 of it."""
_DIFFERENCES_PX = 0.25, 1 / 32, 1 / 256
"""Half the steps of finite differences [px]: large beside the errors of a rough integral, small beside a micro-image.
The shorter ones are for rows where J bends between the ends, as where another rim begins to cut; the last one is too
short for random rays."""
_BENT = 0.05
"""Distance of J from the mean of its values at both ends, over half of their distance, beyond which J is bent [1]; the
error of the Jacobian is about that."""
BLUR_LEVEL = 1
"""Level of quadrature for light and blur, which need fewer digits than positions."""
_ROUGH_PX = 0.05
"""Step length below which finer integrals are used [px]: so near to a solution the Jacobian holds."""
_SHARP_LEVEL = 2
"""Level of the last Jacobian if rays are random: at level 0 it errs by 1 %, and the blur mapped by it by 2 %."""
_LOST = 0.25
"""Contraction above which the Jacobian is computed anew [1]: for a smooth J it is a tenth at most."""
_LONGEST_STEP_PX = 8.0
"""Longest step [px]: a wrong Jacobian far from the solution must not throw a row out of its micro-image."""
_FINE_STEPS = 3
"""Most steps of one level: with `_TRUST` a thousandth of the first step remains after three."""
_TRUST = 0.1
"""Assumed relative error of the Jacobian near a solution; bounds the error after a Newton step. It is usually far
smaller; where J bends the contraction of the last step is larger, and counts instead. With random rays the Jacobian is
noisy, and only the measured contraction counts."""
GRACE_PX, NEARLY_PX = 1.0, 0.25
"""Distances outside a cell or the image [px] within which a search continues, because its next step may lead back:
during the rough steps, where the end of the next step counts, too, and once steps are shorter than `_ROUGH_PX`, when
five more would have to add up."""
ExposedAt = Callable[[np.ndarray, np.ndarray], Exposed]
"""Function of row indices (m,) and image positions (m, 2) that returns their planes."""


class Search:
    """Newton's method for many candidates at once; finished rows drop out.

    `planes` are tangent planes whose origins are the target points; J is the mean over their pairs, and J(x) = 0 is
    solved. `x_px` are first guesses, `home_px` positions that surely receive light, towards which a dark guess
    retreats. `square_px` is the edge of the square around a position from which its rays start; 0: they start at the
    position.

    Attributes, a row for each candidate:

    `x_px`: solutions after `approach` and `refine`; NaN if there is none.
    `residual`: J at the current positions on the planes [mm], which the search brings to 0.
    `jacobian`: derivative of J by image position [mm per px]; columns are x and y. Before `sharpen` that of the search.
    `inverse`: its inverse as Broyden's method updates it [px per mm].
    `bend`: distance of J from the mean of its values at both ends of that finite difference, over half of their
    distance.
    `sigma_px`: error of the integral and remaining error of Newton's method, mapped to the image.
    `moments`: of the bundle at the solution, on the tangent plane.
    `lit_moments`: moments of the last bundle with light during the search; NaN if none had any.
    `is_random`, `reached`: whether random rays replaced the quadrature; whether the accuracy was reached.
    `anchor_px`: positions whose random numbers serve neighbouring positions, too: a change would make J jump.
    `contraction`: remaining error over the length of a step, as last measured; infinite before.
    `random_mm`: standard error of J from the last random rays; NaN without random rays.
    `rays`: number of rays traced, for all candidates.
    """

    def __init__(
        self,
        tracer: Tracer,
        microlens: Int64[np.ndarray, "n"],
        planes: ExposedAt,
        x_px: Float64[np.ndarray, "n 2"],
        home_px: Float64[np.ndarray, "n 2"],
        square_px: float = 0.0,
    ) -> None:
        self.tracer = tracer
        self.microlens = microlens
        self.planes = planes
        self.home_px = home_px
        self.square_px = square_px
        self.x_px = x_px.copy()
        self.anchor_px = x_px.copy()
        self.rays = 0
        n = len(x_px)
        self.is_random = np.zeros(n, bool)
        self.reached = np.zeros(n, bool)
        self.residual = np.full((n, 2), np.nan)
        self.sigma_px = np.full((n, 2), np.nan)
        self.jacobian = np.full((n, 2, 2), np.nan)
        self.inverse = np.full((n, 2, 2), np.nan)
        self.bend = np.full(n, np.inf)
        self.moments = np.full((n, COLUMNS), np.nan)
        self.lit_moments = self.moments.copy()
        self.contraction = np.full(n, np.inf)
        self.random_mm = np.full((n, 2), np.nan)

    def approach(self, may_exist: MayExist) -> None:
        """Newton's method with rough integrals until steps are short; rows stop where they can no longer exist.

        The first Jacobian is that of chief rays, which move almost as bundles do and cost far less.
        """
        # Start where there is light.
        rows = self._retreat_to_light(may_exist)
        # Take the Jacobian of chief rays, or one of J where these do not represent the bundle.
        planes = self.planes(rows, self.x_px[rows]).first.near
        self.jacobian[rows] = chief_jacobian(self.tracer, self.microlens[rows], self.x_px[rows], planes)
        self.inverse[rows] = inverse(self.jacobian[rows])
        # Behind obstructions, which cut bundles in their middle, means do not move as chief rays do.
        is_hollow = self.tracer.table[:, INNER_SQUARED].any()
        self._derive(rows[is_hollow | np.isnan(self.inverse[rows]).any(axis=(1, 2))])
        # Iterate until steps are short, and again beyond solutions outside of the image.
        self._damped_steps(rows, may_exist)
        self._search_beyond(rows, may_exist)
        # Take the Jacobian of J near the solutions.
        rows = np.flatnonzero(np.isfinite(self.residual[:, 0]) & np.isfinite(self.x_px).all(axis=1))
        rows = rows[may_exist(self.x_px[rows], rows, NEARLY_PX)]
        self._derive(rows)

    def linearise(self) -> None:
        """Compute the Jacobian of J at the first guesses without moving them."""
        rows = np.arange(len(self.x_px))
        self.residual[rows] = self._j(rows, self.x_px)
        self._derive(rows[~np.isnan(self.residual[:, 0])])

    def refine(self, rows: Int64[np.ndarray, "k"], accuracy_px: float) -> None:
        """Use finer integrals, level by level, until their error and the next step are below the accuracy."""
        requested = rows
        for level in range(1, LEVELS):
            # Converge at this level, and drop the rows that have reached the accuracy.
            self._converge_at_level(rows, level, accuracy_px)
            self.reached[rows] = np.hypot(*self.sigma_px[rows].T) < accuracy_px
            rows = rows[~self.reached[rows] & np.isfinite(self.x_px[rows, 0])]
            if not len(rows):
                break
            # Renew the Jacobian of rows that do not converge: between slivers of a bundle rough integrals jump.
            lost = rows[(self.contraction[rows] > _LOST) & np.isfinite(self.contraction[rows]) & ~self.is_random[rows]]
            self.residual[lost] = self._j(lost, self.x_px[lost], level)
            self._derive(lost, level)
        # Renew the Jacobian of random rows with more rays.
        random = requested[self.is_random[requested] & np.isfinite(self.x_px[requested, 0])]
        self._derive(random, _SHARP_LEVEL)

    def sharpen(self, rows: Int64[np.ndarray, "k"], accuracy_px: float) -> None:
        """Renew Jacobians at the solutions for rows whose blur's radius may err by more than the accuracy.

        J may bend between the ends of its difference, or have bent since; random rows already have accurate Jacobians.
        """
        # Select rows by the bend of J.
        radius_px = blur.radius_px(blur.in_image(blur.spread(self.moments[rows]), self.jacobian[rows]))
        rows = rows[~self.is_random[rows] & ~(radius_px * self.bend[rows] <= accuracy_px)]
        x_px, microlens = self.x_px[rows], self.microlens[rows]
        # Differentiate J with the pupils of their bundles frozen.
        bundles = Bundles(x_px, microlens, self.planes(rows, x_px).first.both, self.square_px)
        pupils = FrozenPupils(self.tracer, bundles, BLUR_LEVEL, STEADY)

        def moments(x_px: np.ndarray) -> np.ndarray:
            """Moments of the bundles at other image positions, over their exposure."""

            def integrate(planes: np.ndarray) -> Integral:
                return pupils.next_to(self.tracer, replace(bundles, x_px=x_px, planes=planes))

            return over_exposure(self.planes(rows, x_px), integrate).moments

        jacobian = mean_hit(by_x(moments, x_px))
        is_finite = np.isfinite(jacobian).all(axis=(1, 2))
        self.jacobian[rows[is_finite]] = jacobian[is_finite]
        self.rays += pupils.rays

    def _converge_at_level(self, rows: np.ndarray, level: int, accuracy_px: float) -> None:
        """Newton steps with integrals of one level; rows with a sufficiently small remaining error stop."""
        step = np.zeros_like(self.x_px)
        coarser = self.random_mm.copy()
        self.anchor_px[rows] = self.x_px[rows]
        for iteration in range(_FINE_STEPS):
            # Integrate J, and update the inverse Jacobian by the last step.
            integral = pooled(self._integral(rows, self.x_px[rows], level), coarser[rows])
            self.moments[rows] = integral.moments
            if iteration:
                self._measure_contraction(rows, step[rows], mean_hit(integral.moments))
                self._update(rows, step[rows], mean_hit(integral.moments))
            # Take the Newton step, and bound the error that remains.
            self.residual[rows] = mean_hit(integral.moments)
            step[rows] = -_times(self.inverse[rows], self.residual[rows])
            self.x_px[rows] += step[rows]
            remaining = self._remaining_px(rows, step[rows])
            self.sigma_px[rows] = np.hypot(errors_px(self.inverse[rows], integral), remaining)
            # Each row ends independently, so that its result does not depend on the rows solved with it.
            rows = rows[~(remaining.max(axis=1, initial=0.0) < accuracy_px / 4)]
            if not len(rows):
                break

    def _measure_contraction(self, rows: np.ndarray, step: np.ndarray, j: np.ndarray) -> None:
        """Measure the contraction of a step, the relative error of the Jacobian, from J at its end.

        It is the length of the next step over that of this one, and at least `_TRUST`.
        """
        with np.errstate(divide="ignore", invalid="ignore"):  # rows that do not move
            contraction = np.hypot(*_times(self.inverse[rows], j).T) / np.hypot(*step.T)
        self.contraction[rows] = np.fmax(contraction, _TRUST)

    def _remaining_px(self, rows: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Upper bound of the error of Newton's method after a step, (n, 2) [px]."""
        contraction = self.contraction[rows, None]
        by_quadrature = np.where(np.isfinite(contraction), contraction, _TRUST) * np.abs(step)
        # Noise turns steps, so that the error of random rows may lie along either axis.
        by_random_rays = contraction * np.hypot(*step.T)[:, None]
        return np.where(self.is_random[rows, None], by_random_rays, by_quadrature)

    def _retreat_to_light(self, may_exist: MayExist) -> np.ndarray:
        """Compute J at the first guesses, retreating from dark ones towards `home_px`; returns the rows with light.

        Where an obstruction hides everything in between, the best of many starts around the guess is taken.
        """
        dark = np.arange(len(self.x_px))
        guess = self.x_px.copy()
        for _ in range(_RETREATS):
            self.residual[dark] = self._j(dark, self.x_px[dark])
            dark = dark[np.isnan(self.residual[dark, 0])]
            if not len(dark):
                break
            self.x_px[dark] = (self.x_px[dark] + self.home_px[dark]) / 2
        self._restart(dark, guess[dark] + AROUND_PX[:, None], may_exist)
        return np.flatnonzero(~np.isnan(self.residual[:, 0]))

    def _search_beyond(self, rows: np.ndarray, may_exist: MayExist) -> None:
        """Search again beyond solutions outside the image.

        Where rims cut bundles J turns back, and meets the point a second time farther from the middle of the light.
        """
        rows = rows[np.isfinite(self.x_px[rows]).all(axis=1)]
        rows = rows[~may_exist(self.x_px[rows], rows, NEARLY_PX)]
        outward = self.x_px[rows] - self.home_px[rows]
        outward /= np.maximum(np.hypot(*outward.T), _ROUGH_PX)[:, None]
        # Keep the first solutions, and search from the best start on the line that leads outward.
        before = [values.copy() for values in (self.x_px, self.residual, self.inverse)]
        restarted = rows[self._restart(rows, self.x_px[rows] + BEYOND_PX[:, None, None] * outward, may_exist)]
        self._derive(restarted)
        self._damped_steps(restarted, may_exist)
        # Restore those of rows that have found none in the image.
        failed = restarted[~may_exist(self.x_px[restarted], restarted, NEARLY_PX)]
        for values, old in zip((self.x_px, self.residual, self.inverse), before, strict=True):
            values[failed] = old[failed]

    def _restart(self, rows: np.ndarray, starts_px: np.ndarray, may_exist: MayExist) -> np.ndarray:
        """Move rows to the one of their starts, (m, k, 2), with the smallest residual; returns which have a lit one."""
        x_px, j = least_miss(self._j, rows, starts_px, may_exist)
        lit = np.isfinite(j[:, 0])
        self.x_px[rows[lit]], self.residual[rows[lit]] = x_px[lit], j[lit]
        return lit

    def _derive(self, rows: np.ndarray, level: int = 0) -> None:
        """Jacobian of J by central differences, shorter where J bends, one-sided at the edge of the light."""
        self.anchor_px[rows] = self.x_px[rows]
        for half_px in _DIFFERENCES_PX:
            if not len(rows):
                return
            rows = rows[self._difference(rows, half_px, level)]

    def _difference(self, rows: np.ndarray, half_px: float, level: int) -> np.ndarray:
        """Set the Jacobian by finite differences; returns where J bends, so that shorter ones help, (k,) bool."""
        middle = self.residual[rows]
        is_random = self.is_random[rows]
        bend = np.zeros(len(rows))
        # Integrate J at both ends of a step along x and of one along y.
        ends = half_px * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
        x_px = (self.x_px[rows] + ends[:, None]).reshape(-1, 2)
        integral = self._integral(np.tile(rows, len(ends)), x_px, level)
        self.is_random[rows] = is_random
        is_noisy = is_random | integral.is_random.reshape(len(ends), -1).any(axis=0)
        values = mean_hit(integral.moments).reshape(2, 2, -1, 2)
        for i, (plus, minus) in enumerate(values):
            # Take the central difference, or a one-sided one where an end is dark, and the bend between the ends.
            change = (plus - minus) / 2
            with np.errstate(divide="ignore", invalid="ignore"):  # J that does not move
                bend = np.maximum(bend, np.hypot(*((plus + minus) / 2 - middle).T) / np.hypot(*change.T))
            change = np.where(np.isnan(plus), middle - minus, change)
            change = np.where(np.isnan(minus), plus - middle, change)
            self.jacobian[rows, :, i] = change / half_px
        self.inverse[rows] = inverse(self.jacobian[rows])
        self.bend[rows] = bend
        return ~(bend < _BENT) & ~(is_noisy & (half_px < _DIFFERENCES_PX[0]))

    def _damped_steps(self, rows: np.ndarray, may_exist: MayExist) -> None:
        """Newton steps with Broyden's update, each halved while it leads into the dark (damped Newton)."""
        # Rows do not wait for each other: while one retreats the rest take their next steps, so that J is computed for
        # many positions at once.
        step = np.empty_like(self.x_px)
        retreats = np.zeros(len(self.x_px), int)
        steps = np.zeros(len(self.x_px), int)
        step[rows] = self._next_step(rows)
        while len(rows):
            # Compute J at the ends of the steps, and halve those that end in the dark.
            j = self._j(rows, self.x_px[rows] + step[rows])
            is_dark = np.isnan(j[:, 0]) & ~np.isnan(step[rows, 0]) & (retreats[rows] < _RETREATS)
            dark, stepped = rows[is_dark], rows[~is_dark]
            step[dark] /= 2
            retreats[dark] += 1
            # Take the other steps, and update their inverse Jacobians.
            self.x_px[stepped] += step[stepped]
            self._update(stepped, step[stepped], j[~is_dark])
            steps[stepped] += 1
            # Drop rows that have converged or taken too many steps, and find the next step of the rest.
            stepped = stepped[(np.hypot(*step[stepped].T) > _ROUGH_PX) & (steps[stepped] < _STEPS)]
            step[stepped] = self._next_step(stepped)
            retreats[stepped] = 0
            # Where rims cut bundles the Jacobian of chief rays misleads: renew it before a row nearby is given up.
            may = self._may_continue(stepped, step, may_exist)
            misled = stepped[~may & (steps[stepped] == 1) & may_exist(self.x_px[stepped], stepped, _LONGEST_STEP_PX)]
            self._derive(misled)
            step[misled] = self._next_step(misled)
            stepped = stepped[self._may_continue(stepped, step, may_exist)]
            rows = np.sort(np.concatenate([dark, stepped]))

    def _may_continue(self, rows: np.ndarray, step: np.ndarray, may_exist: MayExist) -> np.ndarray:
        """Whether a solution may exist at the rows' positions, or at the ends of their next steps, (k,) bool."""
        may = may_exist(self.x_px[rows], rows, GRACE_PX)
        return may | may_exist(self.x_px[rows] + step[rows], rows, GRACE_PX)

    def _next_step(self, rows: np.ndarray) -> np.ndarray:
        """Newton steps from the current positions, (n, 2), limited to the longest step; NaN without light."""
        step = -_times(self.inverse[rows], self.residual[rows])
        step *= np.minimum(1.0, _LONGEST_STEP_PX / np.maximum(np.hypot(*step.T), 1e-300))[:, None]
        return step

    def _update(self, rows: np.ndarray, step: np.ndarray, j: np.ndarray) -> None:
        """Broyden's update of the inverse Jacobian, by the smallest change of the Jacobian that fits the step.

        `j` is the residual at the end of the step, and becomes that of the rows.
        """
        inverse = self.inverse[rows]
        predicted = _times(inverse, j - self.residual[rows])
        scale = np.einsum("ni,ni->n", step, predicted)
        row = np.einsum("ni,nij->nj", step, inverse)
        with np.errstate(divide="ignore", invalid="ignore"):  # rows that do not move
            update = np.einsum("ni,nj->nij", step - predicted, row) / scale[:, None, None]
        self.inverse[rows] = np.where(np.isfinite(update), inverse + update, inverse)
        self.residual[rows] = j

    def _j(self, rows: np.ndarray, x_px: np.ndarray, level: int = 0) -> np.ndarray:
        """J of rows at image positions, (k, 2) [mm]."""
        return mean_hit(self._integral(rows, x_px, level).moments)

    def _integral(self, rows: np.ndarray, x_px: np.ndarray, level: int) -> Integral:
        """Integrals of the bundles of rows at image positions, over their exposure; keeps light and random errors."""

        def integrate(planes: np.ndarray) -> Integral:
            bundles = Bundles(x_px, self.microlens[rows], planes, self.square_px, self.anchor_px[rows])
            return integrals(self.tracer, bundles, level)

        integral = over_exposure(self.planes(rows, x_px), integrate)
        self.rays += integral.rays
        has_light = ~np.isnan(integral.moments[:, 0])
        self.lit_moments[rows[has_light]] = integral.moments[has_light]
        self.is_random[rows] = integral.is_random
        self.random_mm[rows] = np.where(integral.is_random[:, None], integral.error_mm, np.nan)
        return integral


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Product of each matrix (n, 2, 2) and its vector (n, 2)."""
    return np.einsum("nij,nj->ni", matrices, vectors)
