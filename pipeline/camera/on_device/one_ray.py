"""One ray from the sensor into the scene, for threads of a device; packets: `packets`. Vision frame, mm."""

from pipeline.camera.tracing.acceptance import is_limited
from pipeline.camera.tracing.microlens_kernels import (
    AIM,
    CURVATURE_OF_NORMALS,
    FOCAL,
    INDEX,
    KIND,
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
    acceptance, optics = camera.acceptance, camera.optics
    if microlens >= 0 and camera.elements.model != PLAIN:
        ray, weight = _through(camera, microlens, start_x, start_y, x, y)
        h = camera.microlenses[microlens, AIM]
    else:
        ray, weight = _past(camera, microlens, start_x, start_y, x, y)
        h = optics.sampling_z_mm - optics.sensor_z_mm
    alive = ray.alive
    if is_limited(acceptance) or acceptance.by_area:
        weight, alive = weighed(acceptance, h, weight, alive)
    return trace_ray(camera.table, Ray(ray.x, ray.y, ray.z, ray.dx, ray.dy, ray.dz, alive)), weight


@inline
def _past(camera, microlens, start_x, start_y, x, y):
    """The ray behind a plain microlens, or none."""
    optics, disc, plain = camera.optics, camera.elements.disc_mm, plain_microlens(camera.microlenses, microlens)
    per_h = 1.0 / (optics.sampling_z_mm - optics.sensor_z_mm)
    ray, weight = aimed(plain, per_h, optics.sampling_z_mm, start_x, start_y, x, y)
    alive = ray.alive
    if microlens >= 0 and disc > 0.0:
        alive = within_disc(disc, plain.x, plain.y, ray)
    return Ray(ray.x, ray.y, ray.z, ray.dx, ray.dy, ray.dz, alive), weight


@inline
def _through(camera, microlens, start_x, start_y, x, y):
    """The ray behind a microlens that is not plain: vision frame."""
    elements, bends = camera.elements, camera.elements.bends
    kind, place = int(camera.microlenses[microlens, KIND]), place_of_microlens(camera, microlens)
    ray, weight = into_microlens(place, elements.turn, start_x, start_y, x, y)
    ray = trace_ray(elements.faces[kind], ray)
    if elements.model == THIN:
        ray = bent_thinly(camera.microlenses[microlens, FOCAL], ray)
    elif elements.model == TWO_PLANE:
        ray = bent_by_normals(bends[kind, CURVATURE_OF_NORMALS], bends[kind, INDEX], ray)
    return out_of_microlens(place, elements.turn, ray), weight
