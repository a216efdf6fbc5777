"""Compile every kernel by running a tiny camera through it; afterwards workers find the code in the kernel cache."""

import dataclasses

import numpy as np

from pipeline.camera import probes
from pipeline.camera.camera import Camera, MicrolensArray, Sensor
from pipeline.camera.micro_images import micro_images
from pipeline.camera.micro_light import micro_light
from pipeline.camera.quadrature import edges
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.optics.prescription import Prescription, Surface
from pipeline.render.imaging import irradiance
from pipeline.render.light import TargetLight
from pipeline.target.checkerboard import Checkerboard
from pipeline.target.mesh import MeshTarget
from pipeline.target.surfaces import Cylinder, Warped
from pipeline.target.target import AnyTarget, Target
from pipeline.truth import search


def compile_kernels() -> None:
    """Run every kernel once, with the argument types of real work."""
    stop = Surface(semi_diameter_mm=1.0, is_stop=True)
    sensor = Sensor(width_px=2, height_px=2, pitch_mm=0.01)
    camera = Camera(prescription=Prescription(surfaces=(stop,)), sensor=sensor, sensor_distance_mm=10.0)
    array = MicrolensArray(pitch_mm=0.1, focal_lengths_mm=(1.0,), columns=1, rows=1, distance_mm=1.0, tilt_x_deg=1.0)
    plenoptic = Tracer(dataclasses.replace(camera, microlenses=array))
    micro_light(plenoptic, micro_images(plenoptic))
    tracer = Tracer(camera)
    pixels = np.zeros((1, 2), np.int64)
    tracer.moments(np.zeros((1, 2)), np.array([-1]), parallel_planes(1.0, 2.0), 4, pixels)
    found = edges(tracer.arrays, np.zeros((1, 2)), np.array([-1]))
    found.moments(parallel_planes(1.0, 2.0)[None], (2, 4))
    probes.spread(found.polygons, found.counts, np.zeros((1, 1, 2)))
    irradiance(tracer, None, 1, None)
    board = Checkerboard(columns=2, rows=1, square_mm=1.0)
    board.radiance(np.zeros(1), np.zeros(1))
    rays = np.array([[0.0, 0.0, 1.0]])
    corners, one = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), ((0.0, 0.0, 1.0),)
    bent = Warped(deflection_mm=(0.0, 0.0)), Cylinder(radius_mm=9.0)
    mesh = MeshTarget(vertices_mm=corners, triangles=((0, 1, 2),), albedo=one, points_mm=one, normals=one)
    targets: list[AnyTarget] = [Target(board), *(Target(board, shape) for shape in bent), mesh]
    for target in targets:
        target.points()
        TargetLight([(target, np.eye(4))], 0.0).radiance(rays, rays)
    image, cell, quads = np.zeros((2, 2, 2)), np.zeros((2, 2), np.int64), np.zeros((1, 3), np.int64)
    search.quads_that_hold(image, cell, np.zeros((1, 2)), quads)
    search.solve_quads(image, cell, np.zeros((1, 2)), quads, True, 0.1, 0.1, np.zeros(1, np.int64), np.zeros((1, 9)))
    search.nearest_positions(image, cell, np.zeros((1, 2)), np.zeros((1, 1)), np.zeros((1, 1, 2), np.int64))
