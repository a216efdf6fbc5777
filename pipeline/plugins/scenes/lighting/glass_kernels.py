"""Paths through smooth faces of glass, reflected or refracted at random. Kernels only; vision frame, mm."""

import math

from pipeline.jit.decorators import borrowed, inline, kernel
from pipeline.plugins.scenes.lighting import draws
from pipeline.plugins.scenes.lighting.path_kernels import gap_at
from pipeline.plugins.scenes.lighting.paths import FACING, RATIO
from pipeline.plugins.scenes.lighting.refraction import bent, dielectric
from pipeline.targets.vectors import along, dot, row, unit

_FLAT = 0.01
"""Least cosine of a ray behind a face of glass for which its start has the whole gap [1]."""


@kernel
def cross(scene, stage, paths, hits):
    """Continue each path at a smooth face of glass: reflected in proportion to its reflectance, else refracted."""
    scene, paths, hits = borrowed((scene, paths, hits))
    _, points, gap_mm = scene
    for i in range(paths.power.size):
        direction, normal, flat = row(paths.direction, i), row(hits.normal, i), row(hits.flat, i)
        ratio = hits.paint[i, RATIO]
        dice = draws.draw(points, paths.key[i], paths.rank[i], stage)[0]
        onward, is_behind = _crossed(direction, normal, ratio, hits.paint[i, FACING], dice)
        if (dot(onward, flat) < 0.0) != is_behind:  # the normal for shading is too far off that of the triangle
            onward, is_behind = _crossed(direction, flat, ratio, hits.paint[i, FACING], dice)
        if is_behind:
            # A bundle of light is narrower in glass, and brighter.
            paths.power[i] /= ratio * ratio
            paths.absorption[i] = hits.beyond[i]
        if 0.0 < paths.density[i] < math.inf:
            paths.density[i] = -1.0
        # Along the ray, so that it meets what is behind the glass where it should.
        point = row(hits.point, i)
        start = along(point, gap_at(point, gap_mm) / max(abs(dot(onward, flat)), _FLAT), onward)
        for axis in range(3):
            paths.origin[i, axis], paths.direction[i, axis] = start[axis], onward[axis]


@inline
def _crossed(direction, normal, ratio, mirrored, dice):
    """Direction after a smooth face of glass, and whether it lies behind the face."""
    cosine = -dot(direction, normal)
    reflectance, beyond = dielectric(cosine, ratio)
    if dice < max(reflectance, mirrored):
        return unit(along(direction, 2.0 * cosine, normal)), False
    return unit(bent(direction, normal, cosine, beyond, ratio)), True
