"""Cylinders: curved along y, straight along x. Functions of one ray, inlined into kernels.

Seen along x a ray is one of the plane of y and z, where it meets the profile; what it has along x goes on straight.
"""

import math

from pipeline.jit.decorators import inline
from pipeline.optics.aspheres import Normal, bent, on_conic
from pipeline.optics.crossing import Ray


@inline
def through_cylinder(shape, mu, ray):
    """The ray moved from the vertex plane to the cylinder of a conic, and refracted there."""
    share = math.sqrt(ray.dy * ray.dy + ray.dz * ray.dz)
    met, normal = on_conic(shape, Ray(0.0, ray.y, ray.z, 0.0, ray.dy / share, ray.dz / share, ray.alive))
    x = ray.x + (met.z - shape.vertex) / ray.dz * ray.dx
    alive = met.alive if x * x + met.y * met.y <= shape.limit else 0.0
    across = Ray(0.0, met.y, met.z, ray.dx, ray.dy, ray.dz, alive)
    behind = bent(mu, across, Normal(share * normal.along, normal.slope, normal.upright))
    return Ray(x, behind.y, behind.z, behind.dx, behind.dy, behind.dz, behind.alive)
