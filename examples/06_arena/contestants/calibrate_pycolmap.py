"""COLMAP by pycolmap: bundle adjustment of one shared FULL_OPENCV or OPENCV camera with the points of the board held.

COLMAP puts the corner of the top-left pixel at (0, 0), so half a pixel is added. The board is the world, so every view
is an image with a pose of its own, which starts from COLMAP's own solution for the pose with a pinhole.
"""

import numpy as np
import pycolmap


def calibrate(case, option):
    """Calibrate one of the models."""
    width, height = map(int, case["size_px"])
    focal = float(case["focal_guess_px"])
    start = pycolmap.Camera(
        model="PINHOLE", width=width, height=height, params=[focal, focal, width / 2, height / 2], camera_id=1
    )
    extra = 4 if option == "OPENCV" else 8
    camera = pycolmap.Camera(
        model=option, width=width, height=height, params=[*start.params, *np.zeros(extra)], camera_id=1
    )
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(camera)
    ids = {}
    for point in np.unique(case["point"]):
        at = case["object_mm"][case["point"] == point][0]
        ids[int(point)] = model.add_point3D(at, pycolmap.Track())
    for number, board in enumerate(case["boards"], 1):
        seen = board["image_px"] + 0.5
        pose = pycolmap.estimate_and_refine_absolute_pose(seen, board["object_mm"], start)["cam_from_world"]
        image = pycolmap.Image(name=str(number), keypoints=seen, camera_id=1, image_id=number)
        model.add_image_with_trivial_frame(image, pose)
        for index, point in enumerate(board["point"]):
            model.add_observation(ids[int(point)], pycolmap.TrackElement(number, index))
    config, options = pycolmap.BundleAdjustmentConfig(), pycolmap.BundleAdjustmentOptions()
    numbers = range(1, len(case["boards"]) + 1)
    for number in numbers:
        config.add_image(number)
    for number in ids.values():
        config.add_constant_point(number)
    options.refine_principal_point, options.print_summary = True, False
    options.ceres.solver_options.max_num_iterations = 500
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()
    solved = model.camera(1)
    slopes = np.array([solved.cam_from_img(at)[:2] for at in case["query_px"] + 0.5])
    return {"slopes": slopes, "poses": np.array([model.image(n).cam_from_world().matrix() for n in numbers])}
