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
    out_of_microlens,
    place_of_microlens,
)
from pipeline.camera.tracing.packets import aimed, plain_microlens, weighed, within_disc
from pipeline.jit.decorators import inline
from pipeline.optics.crossing import Ray
from pipeline.optics.one_ray import trace_ray


@inline
def send_ray(camera, microlens, start_x, start_y, x, y):
    """The ray from a sensor position through a point of the sampling plane, behind the front vertex; its weight.

    `camera` is a `camera.tracing.records.CameraArrays`.
    """
    detail, optics = camera.mosaic.detail, camera.optics
    if microlens >= 0 and detail[MODEL] != PLAIN:
        ray, weight = _through(camera, microlens, start_x, start_y, x, y)
        h = camera.lenses[microlens, AIM]
    else:
        ray, weight = _past(camera, microlens, start_x, start_y, x, y)
        h = optics.sampling_z_mm - optics.sensor_z_mm
    alive = ray.alive
    if is_limited(detail) or detail[BY_AREA] > 0.0:
        weight, alive = weighed(detail, h, weight, alive)
    return trace_ray(camera.table, Ray(ray.x, ray.y, ray.z, ray.dx, ray.dy, ray.dz, alive)), weight


@inline
def _past(camera, microlens, start_x, start_y, x, y):
    """The ray behind a plain microlens, or none."""
    optics, disc, plain = camera.optics, camera.mosaic.detail[DISC], plain_microlens(camera.lenses, microlens)
    per_h = 1.0 / (optics.sampling_z_mm - optics.sensor_z_mm)
    ray, weight = aimed(plain, per_h, optics.sampling_z_mm, start_x, start_y, x, y)
    alive = ray.alive
    if microlens >= 0 and disc > 0.0:
        alive = within_disc(disc, plain.x, plain.y, ray)
    return Ray(ray.x, ray.y, ray.z, ray.dx, ray.dy, ray.dz, alive), weight


@inline
def _through(camera, microlens, start_x, start_y, x, y):
    """The ray behind a microlens that is not plain: vision frame."""
    detail, faces, bends, _ = camera.mosaic
    kind, place = int(camera.lenses[microlens, KIND]), place_of_microlens(camera, microlens)
    ray, weight = into_microlens(place, detail, start_x, start_y, x, y)
    ray = trace_ray(faces[kind], ray)
    if detail[MODEL] == THIN:
        ray = bent_thinly(camera.lenses[microlens, FOCAL], ray)
    elif detail[MODEL] == TWO_PLANE:
        ray = bent_by_normals(bends[kind, CURVATURE_OF_NORMALS], bends[kind, INDEX], ray)
    return out_of_microlens(place, detail, ray), weight
