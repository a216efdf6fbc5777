"""Positions that a camera would see whose numbers are a little off those of its stage, and files with them."""

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation
from stage_text import in_the_library, tiny_text

from pipeline.camera.micro_images.light import micro_light
from pipeline.files.tables import write_table
from pipeline.plugins.fits.calibration import calibrate
from pipeline.plugins.fits.free_numbers import FreeStage
from pipeline.plugins.fits.observations import Observations, Stated
from pipeline.plugins.fits.twin import Twin
from pipeline.render.imaging import irradiance
from pipeline.results.opening import ready
from pipeline.results.ready_camera import ReadyCamera

WIDE = """over "Camera"
{
uniform token plen:camera:model = "pinhole"
uniform double[] plen:camera:distortion = [0, 0, 0, 0, 0]
}
over "Sensor"
{
uniform double plen:pixelPitch = 0.2
}
"""
"""A pinhole that sees 26 degrees to both sides."""
FEW = "uniform int plen:columns = 4\nuniform int plen:rows = 3\n"
"""Corners of boards: fewer than in the library, because a fit takes time for each."""
INNER = ["Rig/Camera.plen:camera:distortion", "Rig/Camera.plen:camera:sensorDistance", "Rig/Sensor.plen:offset"]
OFF = np.array([-0.2, 0.15, 2e-3, -1e-3, -0.05, 1.4, 0.82, -0.47])
"""Errors of the eight numbers of `INNER`."""


def posed(count: int, distance_mm: float, across_mm: float, seed: int = 3) -> str:
    """A board in poses all over the field, tilted by up to 30 degrees."""
    rng, turns, places = np.random.default_rng(seed), [], []
    for frame in range(1, count + 1):
        *imaginary, real = Rotation.from_euler("xyz", rng.uniform(-30, 30, 3) * (1, 1, 0.3), degrees=True).as_quat()
        turns.append(f"{frame}: ({real}, {', '.join(map(str, imaginary))})")
        x, y, z = rng.uniform(-1, 1, 3) * (across_mm, across_mm, 0.12 * distance_mm) - (0, 0, distance_mm)
        places.append(f"{frame}: ({x}, {y}, {z})")
    order = 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]'
    samples = zip(("quatd xformOp:orient", "double3 xformOp:translate"), (turns, places), strict=True)
    return "\n".join([*(f"{name}.timeSamples = {{{', '.join(each)}}}" for name, each in samples), order])


def wide_stage(folder: Path, frames: int) -> Path:
    """A pinhole before a large board."""
    board = f"{FEW}uniform double plen:squareSize = 50\n{posed(frames, 380.0, 60.0)}"
    path = folder / "wide.usda"
    path.write_text(in_the_library("", board=board, rig=WIDE, end=frames), encoding="utf-8")
    return path


def narrow_stage(folder: Path, things: str = "", frames: int = 3) -> Path:
    """The lens of the library before a board in focus."""
    board = f"{FEW}uniform double plen:squareSize = 2.5\n{posed(frames, 432.0, 1.5)}"
    path = folder / "narrow.usda"
    path.write_text(in_the_library(things, board=board, end=frames), encoding="utf-8")
    return path


def seen(stage: FreeStage, by: np.ndarray, sigma_px: float, seed: int | None = None) -> Observations:
    """What the camera sees whose numbers are moved, with noise if there is a seed; all rows to 1e-9 px."""
    dataset, rows = stage.at(by), []
    (target,) = dataset.targets
    points = target.target.points()
    for entry in (each for camera in dataset.cameras for each in camera.in_channels):
        rig = ready(entry.camera).rig
        camera = ReadyCamera(name=entry.full_name, rig=rig, min_hit_fraction=0.1, accuracy_px=1e-9)
        for frame in dataset.frames_of(entry):
            pose = frame.vision_from_target(entry.name, target.name)
            normals = points.plane_axes[:, :, 2] @ pose[:3, :3].T
            projected = camera.project(points.position_mm @ pose[:3, :3].T + pose[:3, 3], normals)
            microlens = np.zeros((len(projected.point), 2), int) if projected.microlens is None else projected.microlens
            rows += [
                (entry.full_name, frame.number, *row)
                for row in zip(projected.point, *microlens.T, projected.x_px, projected.y_px, strict=True)
            ]
    names, frames, ids, k, l, x, y = (np.array(column) for column in zip(*rows, strict=True))
    x_px = np.stack([x, y], axis=1)
    if seed is not None:
        x_px += np.random.default_rng(seed).normal(scale=sigma_px, size=x_px.shape)
    return Observations.of(
        x_px,
        position="exact",
        camera=names,
        frame=frames,
        target=target.name,
        point_id=ids,
        sigma_px=sigma_px,
        microlens=np.stack([k, l], axis=1) if rig.images else None,
    )


def only(found: Observations, kept: np.ndarray) -> Observations:
    """Some of the rows."""
    columns = (each.name for each in fields(found) if getattr(found, each.name) is not None)
    return replace(found, **{name: getattr(found, name)[kept] for name in columns})


def centres(stage: FreeStage, by: np.ndarray, position: str, sigma_px: float) -> Observations:
    """Centres in the white image of the camera whose numbers are moved."""
    (entry,) = stage.at(by).cameras
    rig = ready(entry.camera).rig
    light = micro_light(rig.tracer, rig.images)
    x_px = rig.tracer.pixels_at(light.centroid_mm if position == "centroid" else rig.images.centre_mm[light.rows])
    is_inside = rig.in_image(x_px)
    microlens = rig.axial[light.rows[is_inside]]
    return Observations.of(
        x_px[is_inside], position=position, camera=entry.full_name, sigma_px=sigma_px, microlens=microlens
    )


def plenoptic_stage(folder: Path, *edits: tuple[str, str]) -> Path:
    """The tiny plenoptic camera with the microlenses of its image, of the 11,500 of the array, and with edits."""
    few = 'over "Microlenses"\n{\nuniform double plen:width = 2.6\nuniform double plen:height = 2.6\n}\n'
    text = tiny_text("plenoptic", ('over "Sensor"', f'{few}over "Sensor"'), *edits)
    path = folder / "plenoptic.usda"
    path.write_text(text, encoding="utf-8")
    return path


def stopped_down(folder: Path) -> Path:
    """The tiny plenoptic camera with more pixels, and dark gaps between its micro-images."""
    stop = 'over "Lens"\n{\nover "Stop"\n{\nuniform double plen:semiDiameter = 3.5\n}\n}\n'
    return plenoptic_stage(
        folder,
        ("plen:pixelPitch = 0.03", "plen:pixelPitch = 0.01"),
        ("plen:resolution = (48, 40)", "plen:resolution = (144, 120)"),
        ('over "Sensor"', f'{stop}over "Sensor"'),
    )


def white_image(stage: FreeStage, by: np.ndarray, sigma_px: float) -> Observations:
    """Centroids of whole islands of light in the rendered white image of the camera whose numbers are moved."""
    (entry,) = stage.at(by).cameras
    light = irradiance(ready(entry.camera).rig, 1024, None)
    island, count = ndimage.label(light > 0)
    high, wide = light.shape
    is_whole = [
        y.start > 0 and x.start > 0 and y.stop < high and x.stop < wide for y, x in ndimage.find_objects(island)
    ]
    numbers = np.arange(1, count + 1)[is_whole]
    x_px = np.array(ndimage.center_of_mass(light, island, numbers))[:, ::-1]
    return Observations.of(x_px, position="centroid", camera=entry.full_name, sigma_px=sigma_px)


def table(found: Observations, path: Path, remarks: Sequence[str] = ()) -> Path:
    """Our own file of observations, of points or of centres."""
    of_centres = bool(found.is_centre.all())
    remarks = remarks or ["pixel_origin: 0", f"{'centres' if of_centres else 'position'}: {found.position[0]}"]
    names = ("camera",) if of_centres else ("camera", "frame", "target", "point_id")
    columns = {name: getattr(found, name) for name in names}
    columns |= {"x_px": found.x_px[:, 0], "y_px": found.x_px[:, 1], "sigma_px": found.sigma_px}
    if found.microlens is not None:
        columns |= {"microlens_k": found.microlens[:, 0], "microlens_l": found.microlens[:, 1]}
    write_table(path, remarks, columns)
    return path


def fitted(stage: FreeStage, found: Observations, folder: Path, white: Observations | None = None, **options) -> Twin:
    """The twin of observations, by way of files."""
    files = [table(found, folder / "seen.csv")]
    if white is not None:
        files.append(table(white, folder / "white.csv"))
    return calibrate(stage, files, Stated(), **options)
