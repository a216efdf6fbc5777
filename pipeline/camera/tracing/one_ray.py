"""One ray from the sensor into the scene, for threads of a device; packets: `packets`. Vision frame, mm."""

from pipeline.camera.tracing.acceptance import BY_AREA, is_limited
from pipeline.camera.tracing.microlens_kernels import (
    AIM,
    CURVATURE_OF_NORMALS,
    DISC,
    FOCAL,
    INDEX,
    KIND,
    MODEL,
    PLAIN,
    THIN,
    TWO_PLANE,
    bent_by_normals,
    bent_thinly,
    into_microlens,
    lenslet_of,
    out_of_microlens,
)
from pipeline.camera.tracing.packets import aimed, plain_lens, weighed, within_disc
from pipeline.jit.decorators import inline
from pipeline.optics.crossing import Ray
from pipeline.optics.one_ray import trace_ray


@inline
def send_ray(camera, lens, start_x, start_y, x, y):
    """The ray from a sensor position through a point of the sampling plane, behind the front vertex; its weight.

    `camera` holds what `Tracer.arrays` does: optics, table, outlines, lenses, aperture, mosaic.
    """
    optics, table, _, lenses, _, mosaic = camera
    detail = mosaic[0]
    if lens >= 0 and detail[MODEL] != PLAIN:
        ray, weight = _through(optics, lenses, mosaic, lens, start_x, start_y, x, y)
        h = lenses[lens, AIM]
    else:
        ray, weight = _past(optics, lenses, detail, lens, start_x, start_y, x, y)
        h = optics[1] - optics[0]
    alive = ray.alive
    if is_limited(detail) or detail[BY_AREA] > 0.0:
        weight, alive = weighed(detail, h, weight, alive)
    return trace_ray(table, Ray(ray.x, ray.y, ray.z, ray.dx, ray.dy, ray.dz, alive)), weight


@inline
def _past(optics, lenses, detail, lens, start_x, start_y, x, y):
    """The ray behind a plain microlens, or none."""
    plain = plain_lens(lenses, lens)
    ray, weight = aimed(plain, 1.0 / (optics[1] - optics[0]), optics[1], start_x, start_y, x, y)
    alive = ray.alive
    if lens >= 0 and detail[DISC] > 0.0:
        alive = within_disc(detail[DISC], plain.x, plain.y, ray)
    return Ray(ray.x, ray.y, ray.z, ray.dx, ray.dy, ray.dz, alive), weight


@inline
def _through(optics, lenses, mosaic, lens, start_x, start_y, x, y):
    """The ray behind a microlens that is not plain: vision frame."""
    detail, faces, bends, _ = mosaic
    kind, place = int(lenses[lens, KIND]), lenslet_of(optics, lenses, lens)
    ray, weight = into_microlens(place, detail, start_x, start_y, x, y)
    ray = trace_ray(faces[kind], ray)
    if detail[MODEL] == THIN:
        ray = bent_thinly(lenses[lens, FOCAL], ray)
    elif detail[MODEL] == TWO_PLANE:
        ray = bent_by_normals(bends[kind, CURVATURE_OF_NORMALS], bends[kind, INDEX], ray)
    return out_of_microlens(place, detail, ray), weight
