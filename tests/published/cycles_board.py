"""Render a board that flies past with Cycles: python cycles_board.py HOW.json OUT.npy, with the `bpy` of Blender.

Lengths are millimetres, the camera is at the origin and looks along -z, as in USD.
"""

import json
import sys
from pathlib import Path

import bpy
import numpy as np


def material(radiance: float) -> bpy.types.Material:
    shade = bpy.data.materials.new(str(radiance))
    shade.use_nodes = True
    nodes = shade.node_tree.nodes
    nodes.clear()
    light, out = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
    light.inputs["Strength"].default_value = radiance
    light.inputs["Color"].default_value = (1, 1, 1, 1)
    shade.node_tree.links.new(light.outputs[0], out.inputs[0])
    return shade


def board(rectangles: list) -> bpy.types.Object:
    """Rectangles x0, y0, x1, y1, z with the radiance of each."""
    mesh, corners = bpy.data.meshes.new("board"), []
    for x0, y0, x1, y1, z, _ in rectangles:
        corners += [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]
    faces = np.arange(len(corners)).reshape(-1, 4).tolist()
    mesh.from_pydata(corners, [], faces)
    for polygon, (*_, radiance) in zip(mesh.polygons, rectangles, strict=True):
        mesh.materials.append(material(radiance))
        polygon.material_index = len(mesh.materials) - 1
    return bpy.data.objects.new("board", mesh)


def main(how: dict, out: str) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    camera = bpy.data.cameras.new("camera")
    scene.camera = bpy.data.objects.new("camera", camera)
    thing = board(how["rectangles"])
    for each in (scene.camera, thing):
        scene.collection.objects.link(each)
    camera.sensor_fit, camera.sensor_width, camera.lens, camera.clip_end = "HORIZONTAL", 1.0, how["f_widths"], 1e4
    for frame, place, turn_rad in how["keys"]:
        thing.location, thing.rotation_euler = place, (0, 0, turn_rad)
        thing.keyframe_insert("location", frame=frame)
        thing.keyframe_insert("rotation_euler", frame=frame)
    for curve in thing.animation_data.action.fcurves:
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"
    thing.cycles.motion_steps = 7
    scene.world = bpy.data.worlds.new("world")
    scene.world.color = (how["background"],) * 3
    scene.render.engine, scene.render.resolution_percentage = "CYCLES", 100
    scene.render.resolution_x, scene.render.resolution_y = how["size_px"]
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, how["open_frames"]
    scene.render.motion_blur_position = "START"
    cycles = scene.cycles
    cycles.rolling_shutter_type, cycles.rolling_shutter_duration = "TOP", how["exposed_share"]
    cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = how["samples"], False, False
    cycles.pixel_filter_type = "BOX"
    scene.view_settings.view_transform = "Raw"
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = f"{out}.exr"
    scene.frame_set(how["keys"][0][0])
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(f"{out}.exr")
    width, height = how["size_px"]
    np.save(out, np.array(image.pixels).reshape(height, width, 4)[::-1, :, 0])


if __name__ == "__main__":
    main(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")), sys.argv[2])
