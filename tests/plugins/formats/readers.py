"""Programs that read exported files, and what each has to find.

Each `check_<format>` asserts that a folder says what a scene of `pretended` is, by that consumer's rules. Nothing here
comes from the table of conventions.
"""

import json
from pathlib import Path

import cv2
import h5py
import numpy as np
import pandas as pd
import pycolmap
import vision_calibration
import yaml
from plugins.formats.pretended import (
    CENTRE_PX,
    COLUMNS,
    CORNER_PX,
    DISTORTION,
    F_PX,
    HIDDEN,
    ROWS,
    SIZE_PX,
    SQUARE_MM,
    Scene,
    board_mm,
    projected,
    same,
)
from scipy.io import loadmat
from vision_calibration import models as calibration

from pipeline.frames import rotation_vector

FLOAT32_PX, PRINTED_PX, SOLVED_PX = 5e-5, 1e-9, 1e-5
"""Rounding of single precision at 640 px; of a double; what OpenCV's iterations leave."""


def grid_points(square: float) -> np.ndarray:
    """The board of most tools: x along columns, y along rows, from the first corner."""
    row, column = np.divmod(np.arange(COLUMNS * ROWS), COLUMNS)
    return np.stack([column, row, 0 * row], axis=1) * square


def check_opencv(folder: Path, scene: Scene) -> None:
    for name in scene.rig:
        data = np.load(folder / f"{name}.npz")
        image, points = data["image_points"], data["object_points"]
        assert image.dtype == points.dtype == np.float32 and image.shape[1:] == (1, 2) and points.shape[1:] == (1, 3)
        assert data["image_size"].tolist() == list(SIZE_PX) and data["frames"].tolist() == [1, 2, 3]
        storage = cv2.FileStorage(str(folder / f"{name}.yml"), cv2.FILE_STORAGE_READ)
        assert storage.getNode("image_width").real() == 640 and storage.getNode("image_height").real() == 480
        matrix, distortion = (storage.getNode(key).mat() for key in ("camera_matrix", "distortion_coefficients"))
        same(matrix, data["camera_matrix"], 0), same(distortion, [data["dist_coeffs"]], 0)
        same(matrix, scene.matrix, 0), same(distortion, [DISTORTION], 0)
        extrinsics = storage.getNode("extrinsic_parameters").mat()
        for view, frame in enumerate((1, 2, 3)):
            rows = slice(*data["starts"][view : view + 2])
            assert data["ids"][rows].tolist() == scene.ids(name, frame)
            same(image[rows, 0], scene.pixels(name, frame)[scene.ids(name, frame)], FLOAT32_PX)
            same(points[rows, 0], grid_points(SQUARE_MM)[scene.ids(name, frame)], 1e-6)
            rvec, tvec = data["rvecs"][view], data["tvecs"][view]
            same(extrinsics[view], [*rvec, *tvec], 0)
            same(cv2.projectPoints(points[rows], rvec, tvec, matrix, distortion)[0], image[rows], FLOAT32_PX)
    same(np.load(folder / "Left.npz")["image_points"][0, 0], CORNER_PX, FLOAT32_PX)
    _check_opencv_rigs(folder, scene)


def _check_opencv_rigs(folder: Path, scene: Scene) -> None:
    data = np.load(folder / "stereo-Left-Right.npz")
    storage = cv2.FileStorage(str(folder / "stereo-Left-Right.yml"), cv2.FILE_STORAGE_READ)
    for key in ("R", "T", "M1", "D1", "M2", "D2"):
        same(storage.getNode(key).mat(), data[key], 0)
    views = [slice(*data["starts"][i : i + 2]) for i in range(3)]
    lists = [[data[name][view] for view in views] for name in ("object_points", "image_points1", "image_points2")]
    error, *_, turn, shift, _, _ = cv2.stereoCalibrate(
        *lists, scene.matrix, DISTORTION, scene.matrix, DISTORTION, SIZE_PX, flags=cv2.CALIB_FIX_INTRINSIC
    )
    assert error < FLOAT32_PX
    for stated in ((turn, shift), (data["R"], data["T"])):
        same(stated[0], scene.rig["Right"][:3, :3], 1e-6)
        same(stated[1].ravel(), scene.rig["Right"][:3, 3], 1e-3)


def check_opencv_multiview(folder: Path, scene: Scene) -> None:
    """`calibrateMultiview` with these arguments finds the rig; a view that misses points is masked."""
    data = np.load(folder / "multiview.npz")
    assert (
        data["detectionMask"].tolist() == [[1, 0, 1], [1, 0, 1], [1, 1, 1]] and data["detectionMask"].dtype == np.uint8
    )
    for camera, name in enumerate(scene.rig):
        for view, frame in enumerate((1, 2, 3)):
            expected = scene.pixels(name, frame).astype(np.float32)
            expected[[point for point in range(COLUMNS * ROWS) if (name, frame, point) in HIDDEN]] = -1
            same(data["imagePoints"][camera, view], expected, FLOAT32_PX)
    same(data["Ks"], [scene.matrix] * 3, 0), same(data["distortions"], [DISTORTION] * 3, 0)
    same(data["objPoints"], [grid_points(SQUARE_MM / 1000)] * 3, 1e-9)
    sizes = [tuple(size) for size in data["imageSize"].tolist()]
    assert sizes == [SIZE_PX] * 3
    views = [[np.ascontiguousarray(view) for view in camera] for camera in data["imagePoints"]]
    known = [matrix.copy() for matrix in data["Ks"]], [one[None].copy() for one in data["distortions"]]
    empty = [np.eye(3) for _ in sizes], [np.zeros((3, 1)) for _ in sizes]
    mask, models = data["detectionMask"], data["models"]
    *_, turns, shifts = cv2.calibrateMultiview(
        list(data["objPoints"]), views, sizes, mask, models, *known, *empty, None, cv2.CALIB_USE_INTRINSIC_GUESS
    )
    for camera, pose in enumerate(scene.rig.values()):
        for turn, shift in ((turns[camera], shifts[camera]), (data["Rs"][camera], data["Ts"][camera])):
            same(np.ravel(turn), rotation_vector(pose), 1e-4)  # OpenCV 5.0 gives vectors
            same(np.ravel(shift), pose[:3, 3] / 1000, 1e-5)


def check_colmap(folder: Path, scene: Scene) -> None:
    """pycolmap projects the points of the model to its own observations."""
    model = pycolmap.Reconstruction(str(folder))
    assert (len(model.cameras), len(model.images), len(model.points3D)) == (3, 9, COLUMNS * ROWS)
    for image in model.images.values():
        _, number, name, _ = image.name.split("/")
        camera, frame = model.cameras[image.camera_id], int(number)
        assert (camera.width, camera.height) == SIZE_PX and camera.model.name == "FULL_OPENCV"
        same(camera.params, [F_PX, F_PX, *(CENTRE_PX + 0.5), *DISTORTION, 0, 0, 0], 0)
        ids = [point.point3D_id - 1 for point in image.points2D]
        assert ids == scene.ids(name, frame)
        stored = np.array([point.xy for point in image.points2D])
        same(stored, scene.pixels(name, frame)[ids] + 0.5, PRINTED_PX)
        seen = np.array([image.cam_from_world() * model.points3D[i + 1].xyz for i in ids])
        assert (seen[:, 2] > 0).all()
        same(camera.img_from_cam(seen), stored, PRINTED_PX)
        if (frame, name) == (1, "Left"):
            same(stored[0], CORNER_PX + 0.5, SOLVED_PX)
    places = np.array([model.points3D[i + 1].xyz for i in range(COLUMNS * ROWS)])
    same(places, grid_points(SQUARE_MM / 1000), 1e-12)
    assert model.points3D[1].track.length() == 8


def check_coco(folder: Path, scene: Scene) -> None:
    """As pycocotools indexes it: images, categories, annotations by id; keypoints from the top left corner."""
    data = json.loads((folder / "coco.json").read_text())
    images, (category,) = {image["id"]: image for image in data["images"]}, data["categories"]
    assert len(images) == len(data["annotations"]) == len(scene.rig) * len(scene.poses)
    assert (category["name"], category["keypoints"]) == ("Board", [str(i) for i in range(COLUMNS * ROWS)])
    for annotation in data["annotations"]:
        image = images[annotation["image_id"]]
        _, number, name, _ = image["file_name"].split("/")
        assert (image["width"], image["height"]) == SIZE_PX and annotation["category_id"] == category["id"]
        x, y, flag = np.array(annotation["keypoints"]).reshape(-1, 3).T
        ids = scene.ids(name, int(number))
        assert np.flatnonzero(flag).tolist() == ids and annotation["num_keypoints"] == len(ids)
        expected = scene.pixels(name, int(number))[ids] + 0.5
        same(np.stack([x, y], axis=1)[ids], expected, PRINTED_PX)
        left, top, width, height = annotation["bbox"]  # of what the pretended scene is; `test_central` has a board
        assert 0 <= left < left + width <= SIZE_PX[0] and 0 <= top < top + height <= SIZE_PX[1]
        assert 0 < annotation["area"] <= width * height and annotation["iscrowd"] == 0
        assert np.flatnonzero(flag == 1).tolist() == ([4] if (name, number) == ("Right", "0003") else [])


def check_ros(folder: Path, scene: Scene) -> None:
    """As camera_calibration_parsers reads it; image_proc rectifies by OpenCV, to the camera of P."""
    for name in scene.rig:
        info = yaml.safe_load((folder / f"{name}.yaml").read_text())
        assert (info["image_width"], info["image_height"]) == SIZE_PX and info["camera_name"] == name
        keys = ("camera_matrix", "distortion_coefficients", "rectification_matrix", "projection_matrix")
        assert all(type(number) is float for key in keys for number in info[key]["data"]), "1e-05 is a text in YAML 1.1"
        k, d, r, p = (np.reshape(info[key]["data"], (info[key]["rows"], info[key]["cols"])) for key in keys)
        assert info["distortion_model"] == "plumb_bob" and d.shape == (1, 5)
        same(r, np.eye(3), 0), same(p, np.column_stack([k, np.zeros(3)]), 0)
        same(projected(scene.camera_from_target(name, 2), None, k, d), scene.pixels(name, 2), PRINTED_PX)


def check_matlab(folder: Path, scene: Scene) -> None:
    """As cameraParameters.m: s [x y 1]' = K [R t] [X Y Z 1]', image coordinates from 1, and its types of all fields."""
    for name in scene.rig:
        data = loadmat(folder / f"{name}.mat")
        fields = data["cameraParams"][0, 0]
        k, rotation, shift = (fields[key] for key in ("K", "RotationVectors", "TranslationVectors"))
        assert fields["ImageSize"].tolist() == [[480, 640]] and fields["WorldUnits"] == ["mm"]
        assert fields["NumRadialDistortionCoefficients"].tolist() == [[3]]
        ((k1, k2, k3),), ((p1, p2),) = fields["RadialDistortion"], fields["TangentialDistortion"]
        same(fields["WorldPoints"], grid_points(SQUARE_MM)[:, :2], 1e-9)
        assert data["frames"].ravel().tolist() == [1, 2, 3] and rotation.shape == shift.shape == (3, 3)
        for view, frame in enumerate((1, 2, 3)):
            world = np.column_stack([fields["WorldPoints"], np.zeros(COLUMNS * ROWS)])
            bent = np.array([k1, k2, p1, p2, k3])
            seen = cv2.projectPoints(world, rotation[view], shift[view], k, bent)[0][:, 0]
            expected = scene.pixels(name, frame) + 1
            expected[[point for point in range(COLUMNS * ROWS) if (name, frame, point) in HIDDEN]] = np.nan
            detected = np.isfinite(expected[:, 0])
            same(data["imagePoints"][:, :, view], expected, PRINTED_PX)
            same(fields["ReprojectionErrors"][:, :, view], expected * 0, PRINTED_PX)
            same(seen[detected], expected[detected], PRINTED_PX)
            assert (fields["DetectedKeypoints"][:, view] == detected).all()


def check_ncore(folder: Path, scene: Scene) -> None:
    """By the formulas of its documentation, in single precision; the first pixel has its centre at (0.5, 0.5)."""
    for name in scene.rig:
        model = json.loads((folder / f"{name}.json").read_text())
        own = model["camera_model_parameters"]
        assert model["camera_model_type"] == "opencv-pinhole" and own["shutter_type"] == "GLOBAL"
        assert own["resolution"] == list(SIZE_PX) and own["external_distortion_parameters"] is None
        (k1, k2, k3, k4, k5, k6), (p1, p2) = own["radial_coeffs"], own["tangential_coeffs"]
        k = [[own["focal_length"][0], 0, own["principal_point"][0]], [0, own["focal_length"][1], 0], [0, 0, 1]]
        k[1][2] = own["principal_point"][1]
        d = np.array([k1, k2, p1, p2, k3, k4, k5, k6, *own["thin_prism_coeffs"]])
        seen = projected(scene.camera_from_target(name, 2), None, np.array(k), d)
        same(seen, scene.pixels(name, 2) + 0.5, PRINTED_PX)


def seen_by_nerfstudio(frame: dict, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of the world before a camera that looks along OpenCV's z, (n, 3), and its matrix; pixel centres at 0.5."""
    world_from_camera = np.array(frame["transform_matrix"])
    ahead = (points_m - world_from_camera[:3, 3]) @ world_from_camera[:3, :3]
    matrix = np.array([[frame["fl_x"], 0, frame["cx"] - 0.5], [0, frame["fl_y"], frame["cy"] - 0.5], [0, 0, 1]])
    return ahead * [1, -1, -1], matrix


def check_nerfstudio(folder: Path, scene: Scene) -> None:
    """As nerfstudio_dataparser and cameras.py: y up and -z ahead, rays through the centres of pixels at 0.5."""
    data = json.loads((folder / "transforms.json").read_text())
    assert data["camera_model"] == "OPENCV" and len(data["frames"]) == 9
    assert not {"fl_x", "fl_y", "cx", "cy", "w", "h", "k1", "p1"} & set(data), "they would hold for all frames"
    for frame in data["frames"]:
        _, number, name, _ = frame["file_path"].split("/")
        assert (frame["w"], frame["h"]) == SIZE_PX and frame["k4"] == 0
        bent = np.array([frame[key] for key in ("k1", "k2", "p1", "p2", "k3")])
        ahead, matrix = seen_by_nerfstudio(frame, board_mm() / 1000)
        assert (ahead[:, 2] > 0).all()
        same(projected(np.eye(4), ahead, matrix, bent), scene.pixels(name, int(number)), PRINTED_PX)


def check_parquet(folder: Path, scene: Scene) -> None:
    remarks = pd.read_parquet(folder / "Left.poses.parquet").attrs["remarks"]
    assert any("image positions in px" in line for line in remarks)
    _check_tables(lambda name: pd.read_parquet(folder / f"{name}.parquet"), scene)


def check_npz(folder: Path, scene: Scene) -> None:
    def frame(name: str) -> pd.DataFrame:
        data = np.load(folder / f"{name}.npz")
        return pd.DataFrame({column: data[column] for column in data.files if column != "remarks"})

    _check_tables(frame, scene)


def check_hdf5(folder: Path, scene: Scene) -> None:
    for name in scene.rig:
        with h5py.File(folder / f"{name}.h5") as file:
            camera = json.loads(file["camera"].asstr()[()])
            assert camera["resolution"] == list(SIZE_PX) and "micro_images" not in file
            assert any("image positions in px" in line for line in file.attrs["remarks"])

    def frame(name: str) -> pd.DataFrame:
        camera, table = name.split(".")
        with h5py.File(folder / f"{camera}.h5") as file:
            columns = file[table].items()
            return pd.DataFrame({key: (c.asstr() if c.dtype.kind == "O" else c)[()] for key, c in columns})

    _check_tables(frame, scene)


def _check_tables(frame_of, scene: Scene) -> None:
    for name in scene.rig:
        rows, poses = frame_of(f"{name}.correspondences"), frame_of(f"{name}.poses").set_index("frame")
        assert set(rows.camera) == {name} and "microlens_k" not in rows
        for frame, view in rows.groupby("frame"):
            assert view.point_id.tolist() == scene.ids(name, frame)
            pixels = view[["x_px", "y_px"]]
            same(pixels, scene.pixels(name, frame)[view.point_id], 0)
            pose = poses.loc[frame]
            rvec = pose[[f"rvec_{axis}_rad" for axis in "xyz"]].to_numpy(float)
            tvec = pose[[f"t_{axis}_mm" for axis in "xyz"]].to_numpy(float)
            seen = cv2.projectPoints(board_mm()[view.point_id], rvec, tvec, scene.matrix, DISTORTION)[0][:, 0]
            same(seen, pixels, PRINTED_PX)


def check_vision_calibration(folder: Path, scene: Scene) -> None:
    """vision-calibration takes the views, and finds the camera that imaged them, in metres."""
    for name in scene.rig:
        data = json.loads((folder / f"{name}.json").read_text())
        views = [vision_calibration.Observation.from_payload(view["obs"]) for view in data["views"]]
        for frame, view in zip((1, 2, 3), views, strict=True):
            same(np.array(view.points_2d), scene.pixels(name, frame)[scene.ids(name, frame)], PRINTED_PX)
            same(np.array(view.points_3d) * 1000, grid_points(SQUARE_MM)[scene.ids(name, frame)], 1e-9)
    dataset = calibration.PlanarDataset([calibration.PlanarView(view) for view in views])
    free = calibration.CameraFixMask(distortion={"k3": False})
    found = vision_calibration.run_planar_intrinsics(dataset, calibration.PlanarCalibrationConfig(fix_camera=free))
    assert found.mean_reproj_error < 1e-3, "its camera explains our positions; three views hardly tell its centre"


CHECKS = {
    "opencv": check_opencv,
    "opencv-multiview": check_opencv_multiview,
    "coco": check_coco,
    "colmap": check_colmap,
    "hdf5": check_hdf5,
    "matlab": check_matlab,
    "ncore": check_ncore,
    "nerfstudio": check_nerfstudio,
    "ros": check_ros,
    "vision-calibration": check_vision_calibration,
    "parquet": check_parquet,
    "npz": check_npz,
}
"""Format of conventional cameras -> its check."""
